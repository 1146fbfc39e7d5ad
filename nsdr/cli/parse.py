"""`nsdr parse`: videos and mask proposals become scenes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from nsdr.cli.common import (
    VIDEO,
    Command,
    check_outputs,
    failures_line,
    make_pipeline,
    print_notes,
    refuse_idle,
    settings_of,
    shared_options,
)
from nsdr.errors import DataError
from nsdr.io.files import check_output_folder, find_files
from nsdr.io.storage import save

DECIMALS = 3
"""Decimals of positions (world units) and speeds (world units/s) in a saved scene."""
PROPOSALS = (".npz", ".json", ".json.gz")
"""Endings of files with mask proposals."""


def parse_options(parser: Any) -> None:
    add = parser.add_argument
    add("source", help=f"{VIDEO}; a folder of videos; or mask proposals: a folder, a file, or a compact NPZ")
    output = (
        "scene file of one video, .json; else a folder for scene_N.json, with proposal_N.json where videos are parsed"
    )
    add(
        "-o",
        "--output",
        default=None,
        metavar="FILE|FOLDER",
        help=f"{output}; of one video, without it the scene is printed only",
    )
    proposals = "of one video: also write its mask proposals in CLEVRER's format, .json"
    add("--proposals-out", default=None, metavar="FILE", help=proposals)
    forms = "of mask proposals: write scenes, or predictions in the research code's files"
    add("--form", default="scenes", choices=["scenes", "predictions"], help=forms)
    shared_options(parser, "checkpoint", "pipeline", "video", "work", "failures")


def parse(options: Any) -> int:
    """`nsdr parse`: one video as a scene, or a folder of videos or of mask proposals as scenes."""
    kind = _kind(Path(options.source))
    if kind != "proposals" and options.form != "scenes":
        raise DataError(f"--form {options.form} is of mask proposals, and {options.source} is a {kind}; leave it out")
    if kind == "video":
        refuse_idle(options, ("workers", "engine", "keep_going"), f": {options.source} is one video")
        return _parse_video(options)
    refuse_idle(options, ("proposals_out",), f": {options.source} is no single video")
    if options.output is None:
        raise DataError(f"{options.source} is no single video; give -o FOLDER for what is made of it")
    o, settings = options, settings_of(options)
    check_output_folder(o.output)
    about = (o.checkpoint, settings, o.engine, o.workers, o.device)
    if kind == "folder of videos":
        from nsdr.evaluation import parse_videos

        return _report(o, parse_videos(o.source, o.output, *about), "videos")
    refuse_idle(o, ("force", "background", "fps"), " for mask proposals")
    from nsdr.evaluation import predict_dynamics

    return _report(o, predict_dynamics(o.source, o.output, o.form, *about), "files")


def _kind(source: Path) -> str:
    """Whether a source is a "video", a "folder of videos" or "proposals"."""
    from nsdr.io.decoding import find_frame_folders, find_videos, has_images

    if not source.exists():
        raise DataError(f"{source}: no such file or folder")
    if not source.is_dir():
        return "proposals" if source.name.endswith(PROPOSALS) else "video"
    if find_videos(source):
        return "folder of videos"
    if has_images(source):
        return "video"
    is_proposals = not find_frame_folders(source) and any(
        find_files(source, f"{stem}_*.json*") for stem in ("proposal", "sim")
    )
    return "proposals" if is_proposals else "folder of videos"


def _parse_video(options: Any) -> int:
    check_outputs([options.source], (options.output, (".json",)), (options.proposals_out, (".json",)))
    pipeline = make_pipeline(options, asks=False)  # before the other imports, so that errors in the video come soon
    from nsdr.clevrer.files.proposals import proposals_document
    from nsdr.io.files import write_json

    perception = pipeline.perceive(options.source)
    scene = perception.scene
    if options.output is not None:
        save(options.output, replace(scene, dynamics=_rounded(perception.explanation.prediction)))
    if options.proposals_out:
        write_json(options.proposals_out, proposals_document(perception.proposals, Path(options.source).name))
    print(f"{options.output or options.source}: {scene}")
    print_notes(scene.notes)
    return 0


def _rounded(dynamics: Any) -> Any:
    """A prediction that takes little space in a file.

    Positions, speeds and headings are rounded to a thousandth. Of the counterfactual rollouts, the speeds are left out, and the
    rest is kept, which pictures show.
    """

    def short(rollout: Any, *dropped: str) -> Any:
        names = ("location_world", "speed_world_per_s", "yaw")
        arrays = {name: value for name in names if (value := getattr(rollout, name)) is not None}
        rounded = {name: None if name in dropped else value.round(DECIMALS) for name, value in arrays.items()}
        return replace(rollout, **rounded)

    counterfactual = {
        removed: short(rollout, "speed_world_per_s") for removed, rollout in dynamics.counterfactual.items()
    }
    return replace(dynamics, observed=short(dynamics.observed), counterfactual=counterfactual)


def _report(options: Any, summary: Any, what: str) -> int:
    done, skipped, failed = len(summary.done), len(summary.skipped), len(summary.failed)
    print(f"{options.output}: {done} done, {skipped} kept from before, {failed} failed")
    messages = [f"{name}: {error}" for name, error in sorted(summary.failed.items())]
    for message in messages:
        print(f"  {message}")
    return failures_line(failed, done + skipped + failed, what, "".join(messages[:1]), options.keep_going)


FUNCTIONS = {
    "parse": Command(parse, parse_options),
}
"""What runs the command of this file."""

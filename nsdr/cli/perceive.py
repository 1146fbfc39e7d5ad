"""`nsdr judge` and `visualize`: what is seen in videos."""

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from jsonargparse.typing import NonNegativeInt

from nsdr.cli.common import (
    VIDEO,
    Command,
    check_outputs,
    failures_line,
    frames_of,
    is_scene,
    make_pipeline,
    print_notes,
    refuse_for_scene,
    refuse_idle,
    settings_of,
    shared_options,
)
from nsdr.errors import DataError
from nsdr.io.files import check_installed, check_output, write_file
from nsdr.io.notes import distinct
from nsdr.io.storage import load
from nsdr.types import Scene

IMAGES = ("strobe", "last", "plan")
"""Images of a video. Only the plan can be drawn of a saved scene, if its file has trajectories."""


def judge_options(parser: Any) -> None:
    add = parser.add_argument
    add("videos", nargs="+", help="video files, animated images (GIF, WebP) or folders of frames (PNG, JPEG)")
    add("-o", "--output", default=None, metavar="FILE", help="report, .json; a folder beside it keeps what is done")
    add("--report", default=None, metavar="FILE", help="page with frames of the violations, .html")
    shared_options(parser, "checkpoint", "pipeline", "video", "work", "failures")


def judge(options: Any) -> int:
    """`nsdr judge`: which laws videos break; a video that cannot be judged has the reason in place of a judgement."""
    from nsdr.evaluation.batch import judge_videos, judged
    from nsdr.visualize.violations import judged_video, write_judgements

    o = options
    check_outputs(o.videos, (o.output, (".json",)), (o.report, (".html",)))
    pipeline: Any = make_pipeline(o, asks=False) if o.report or not o.output else None
    kept: Iterable[dict[str, Any]]
    rows, pictured = [], []
    if o.output:
        kept = judge_videos(o.videos, o.output, o.checkpoint, settings_of(o), o.engine, o.workers, o.device)
    else:
        refuse_idle(o, ("workers", "engine"), " without -o")
        kept = map(partial(judged, pipeline), o.videos)
    for row in kept:
        _print_judgement(row)
        rows.append(row)
        if o.report:
            pictured.append(judged_video(pipeline, row))
    if o.report:
        write_judgements(o.report, pictured)
    errors = [row["error"] for row in rows if "error" in row]
    return failures_line(len(errors), len(rows), "videos", "".join(errors[:1]), o.keep_going)


def _print_judgement(row: dict[str, Any]) -> None:
    from nsdr.visualize.violations import judgement_of_row

    if "error" in row:
        print(f"not judged: {row['error']}", flush=True)
        return
    found = judgement_of_row(row)
    print(f"{row['video']}: {found}", flush=True)
    print_notes(found.notes, row["video"])


def visualize_options(parser: Any) -> None:
    add = parser.add_argument
    add("video", help=f"{VIDEO}, or a scene saved by parse")
    add("-q", "--question", default=None, help="for an HTML report: a question")
    add("-c", "--choice", action="append", default=[], help="its options; repeat it for each")
    image = "for a PNG: which image (default: strobe; of a saved scene, plan); all adds each one's name to the file's"
    add("--image", default=None, choices=[*IMAGES, "all"], help=image)
    add("--removed", type=NonNegativeInt, default=None, help="plan: draw the scene without this object")
    output = "file ending in .mp4, .png or .html; repeatable"
    add("-o", "--output", action="append", required=True, help=output)
    shared_options(parser, "failures", "checkpoint", "pipeline", "video")


def visualize(options: Any) -> int:
    """`nsdr visualize`: annotated videos, images and HTML reports of one video or saved scene, which is looked at once."""
    saved = is_scene(options.video)
    pictures = _pictures(options, saved)
    images = {image for _, image in pictures}
    if "mp4" in images:
        check_installed("av", "writing videos needs PyAV", "visualize")
    if images & {"plan", "html"}:
        check_installed("matplotlib", "figures need matplotlib", "visualize")
    scene = load(options.video, Scene) if saved else None
    if scene is not None:
        if scene.dynamics is None and "plan" in images:
            message = "holds no trajectories for --image plan; make it again with nsdr parse"
            raise DataError(f"{options.video}: {message}")
        refuse_for_scene(options)
    pipeline: Any = make_pipeline(options, bool(options.question)) if scene is None or options.question else None
    p = pipeline.perceive(options.video) if scene is None else _saved_perception(scene)
    removed = p.explanation.counterfactual if p.explanation is not None else ()
    if options.removed is not None and options.removed not in removed:
        raise DataError(f"--removed {options.removed}: the objects are 0 to {len(p.scene.objects) - 1}")
    answers = [pipeline.answer(p.scene, options.question, options.choice or None)] if options.question else []
    frames = None
    if not saved and images != {"plan"}:
        frames = frames_of(pipeline, options.video)
    for path, image in pictures:
        _write_picture(path, image, frames, p, answers, options.removed)
        print(path)
    print_notes(distinct(p.scene.notes, *(answer.notes for answer in answers)))
    errors = [f"{choice.choice!r}: {choice.error}" for answer in answers for choice in answer.choices if choice.error]
    return failures_line(len(errors), len(options.choice), "choices", "".join(errors[:1]), options.keep_going)


def _saved_perception(scene: Scene) -> Any:
    """What is known of the video of a saved scene."""
    from nsdr.dynamics import StoredExplanation
    from nsdr.pipeline import Perception

    return Perception(None, None, StoredExplanation(scene.dynamics) if scene.dynamics else None, scene)


def _pictures(options: Any, saved: bool) -> list[tuple[str, str]]:
    """(file, image) of every picture to make: an image of `IMAGES`, "mp4" or "html"."""
    taken = [options.video]
    kinds = {}
    for path in options.output:
        kinds[path] = check_output(path, (".png", ".mp4", ".html"), taken).removeprefix(".")
        taken.append(path)
    if (options.question or options.choice) and "html" not in kinds.values():
        raise DataError("--question and --choice do nothing here; they need an output ending in .html")
    if options.choice and not options.question:
        raise DataError("--choice does nothing without --question")
    if options.image is not None and "png" not in kinds.values():
        raise DataError("--image does nothing here; it needs an output ending in .png")
    if options.removed is not None and options.image not in ("plan", "all"):
        raise DataError("--removed does nothing here; it needs --image plan")
    wanted = options.image or ("plan" if saved else "strobe")
    pictures = []
    for path, kind in kinds.items():
        if kind == "png" and wanted == "all":
            for image in ("plan",) if saved else IMAGES:
                file = str(Path(path).with_stem(f"{Path(path).stem}_{image}"))
                check_output(file, (".png",), taken)
                pictures.append((file, image))
        else:
            pictures.append((path, wanted if kind == "png" else kind))
    impossible = [image for _, image in pictures if saved and image not in ("plan", "html")]
    if impossible:
        raise DataError(f"{options.video}: is a saved scene, which has no frames for {impossible[0]}; give the video")
    return pictures


def _write_picture(path: str, image: str, frames: Any, p: Any, answers: list[Any], removed: int | None) -> None:
    from nsdr.visualize import annotated_image, stroboscopic_image, write_annotated_video, write_report
    from nsdr.visualize.annotate import write_image
    from nsdr.visualize.figures import figure_png, plan_figure

    if image == "html":
        write_report(path, frames, p, answers)
    elif image == "mp4":
        write_annotated_video(path, frames, p.proposals, p.tracks, p.scene)
    elif image == "last":
        write_image(path, annotated_image(frames[-1], len(frames) - 1, p.proposals, p.tracks, p.scene))
    elif image == "strobe":
        write_image(path, stroboscopic_image(frames, p.proposals, p.tracks))
    else:
        write_file(path, figure_png(plan_figure(p.explanation.prediction, removed)))


FUNCTIONS = {
    "judge": Command(judge, judge_options),
    "visualize": Command(visualize, visualize_options),
}
"""What runs the commands of this file."""

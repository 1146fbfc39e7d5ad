"""`nsdr parse-video`, `parse-videos`, `predict-dynamics` and `visualize`: what is seen in videos."""

import warnings
from pathlib import Path
from typing import Any

from nsdr.cli.common import make_pipeline, settings_of
from nsdr.cli.status import failures_line
from nsdr.errors import DataError
from nsdr.io.outputs import check_installed, check_output, check_output_folder

__all__ = ["parse_video", "parse_videos", "predict_dynamics", "visualize"]


def parse_video(options: Any) -> int:
    """`nsdr parse-video`: one video as a scene."""
    outputs = [
        (options.output, (".json", ".npz")),
        (options.proposals_out, (".json",)),
        (options.image, (".png", ".jpg")),
    ]
    taken = [options.video]
    for path, suffixes in outputs:
        if path is not None:
            check_output(path, suffixes, taken)
            taken.append(path)
    pipeline = make_pipeline(options)  # before the other imports, so that errors in the video come soon
    from nsdr.clevrer.proposals import proposals_document
    from nsdr.io import storage
    from nsdr.io.files import write_json
    from nsdr.symbolic.world import world_of
    from nsdr.visualize import write_annotated_image

    perception = pipeline.perceive(options.video)
    scene = perception.scene
    storage.save(scene, options.output)
    if options.proposals_out:
        name = Path(options.video).name
        number = "".join(c for c in Path(name).stem if c.isdigit())
        write_json(options.proposals_out, proposals_document(perception.proposals, int(number or 0), name))
    if options.image:
        write_annotated_image(options.image, options.video, perception, pipeline.video)
    print(f"{options.output}: {scene.n_frames} frames, {len(scene.objects)} objects")
    for o in scene.objects:
        print(f"  object {o.id}: {o.name}")
    world = world_of(scene)
    for text in world.event_text(world.observed).split("; ") if scene.events else ():
        print(f"  {text}")
    return 0


def parse_videos(options: Any) -> int:
    """`nsdr parse-videos`: a folder of videos as scenes and proposals."""
    from nsdr.evaluation import parse_videos as run

    o = options
    settings = settings_of(o)
    check_output_folder(o.output)
    return _report(o, run(o.videos, o.output, o.checkpoint, settings, o.engine, o.workers, o.device), "videos")


def predict_dynamics(options: Any) -> int:
    """`nsdr predict-dynamics`: a folder of proposals as predictions or scenes."""
    from nsdr.evaluation import predict_dynamics as run
    from nsdr.pipeline import pipeline_settings

    o = options
    settings = pipeline_settings(o.config, o.dynamics, o.set)
    check_output_folder(o.output)
    summary = run(o.proposals, o.output, o.form, o.checkpoint, settings, o.engine, o.workers, o.device)
    return _report(o, summary, "files")


def _report(options: Any, summary: Any, what: str) -> int:
    done, skipped, failed = len(summary.done), len(summary.skipped), len(summary.failed)
    print(f"{options.output}: {done} done, {skipped} kept from before, {failed} failed")
    messages = [f"{name}: {error}" for name, error in sorted(summary.failed.items())]
    for message in messages:
        print(f"  {message}")
    return failures_line(failed, done + skipped + failed, what, "".join(messages[:1]), options.keep_going)


def visualize(options: Any) -> int:
    """`nsdr visualize`: an annotated video, an image or an HTML report."""
    import numpy as np

    kind = check_output(options.output, (".png", ".mp4", ".html"), [options.video])
    if (options.question or options.choice) and kind != ".html":
        raise DataError("--question and --choice do nothing here; they need an output ending in .html")
    if options.choice and not options.question:
        raise DataError("--choice does nothing without --question")
    if options.image != "strobe" and kind != ".png":
        raise DataError("--image does nothing here; it needs an output ending in .png")
    if options.removed is not None and options.image != "plan":
        raise DataError("--removed does nothing here; it needs --image plan")
    if kind == ".mp4":
        check_installed("av", "writing videos needs PyAV", "visualize")
    elif kind == ".html" or options.image in ("plan", "causal"):
        check_installed("matplotlib", "figures need matplotlib", "visualize")
    pipeline = make_pipeline(options)  # before the other imports, so that errors in the video come soon
    from nsdr.io.files import atomic_path
    from nsdr.visualize import stroboscopic_image, write_annotated_image, write_annotated_video, write_report
    from nsdr.visualize.annotate import write_image
    from nsdr.visualize.figures import causal_figure, figure_png, plan_figure

    p = pipeline.perceive(options.video)
    if options.removed is not None and options.removed not in p.dynamics.counterfactual:
        raise DataError(f"--removed {options.removed}: the objects are 0 to {len(p.scene.objects) - 1}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # reported once already
        frames = np.stack(list(pipeline.frames(options.video)))
    if kind == ".html":
        questions = [options.question] if options.question else []
        answers = [pipeline.answer(options.video, q, options.choice or None) for q in questions]
        write_report(options.output, frames, p, answers)
    elif kind == ".mp4":
        write_annotated_video(options.output, frames, p.proposals, p.tracks, p.scene)
    elif options.image == "last":
        write_annotated_image(options.output, options.video, p, pipeline.video)
    elif options.image == "strobe":
        write_image(options.output, stroboscopic_image(frames, p.proposals, p.tracks))
    else:
        figure = plan_figure(p.dynamics, options.removed) if options.image == "plan" else causal_figure(p.scene)
        with atomic_path(options.output) as temporary:
            temporary.write_bytes(figure_png(figure))
    print(options.output)
    return 0

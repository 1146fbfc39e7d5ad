"""What the commands of `nsdr` do; `nsdr.cli.main` reads their arguments."""

import json
import logging
import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from nsdr.errors import DataError
from nsdr.types import Answer, Scene

__all__ = ["COMMANDS", "generate", "train", "write_annotated_image"]


def _answer(options: Any) -> int:
    pipeline = _pipeline(options)
    source: Any = options.video
    if Path(options.video).suffix == ".json":
        source = _load_scene(options.video)
    answer = pipeline.answer(source, options.question, options.choice or None)
    if options.json:
        print(json.dumps(asdict(answer)))
    else:
        _print_answer(answer, options.trace)
    return 0


def _print_answer(answer: Answer, trace: bool) -> None:
    from nsdr.symbolic import format_trace

    if answer.answer is not None:
        if trace:
            print(format_trace(answer.trace))
        print(answer.answer)
    for choice in answer.choices:
        print(f"{choice.answer:<8} {choice.choice}")
        if trace:
            print(format_trace(choice.trace))


def _parse_video(options: Any) -> int:
    from nsdr.clevrer.proposals import proposals_document
    from nsdr.io import storage
    from nsdr.io.files import write_json

    if Path(options.output).suffix not in (".json", ".npz"):
        raise DataError(f"{options.output}: expected a name ending in .json or .npz")
    pipeline = _pipeline(options)
    perception = pipeline.perceive(options.video)
    scene = perception.scene
    storage.save(scene, options.output)
    if options.proposals_out:
        assert perception.proposals is not None
        name = Path(options.video).name
        number = "".join(c for c in Path(name).stem if c.isdigit())
        write_json(options.proposals_out, proposals_document(perception.proposals, int(number or 0), name))
    if options.image:
        write_annotated_image(options.image, options.video, perception)
    print(f"{options.output}: {scene.n_frames} frames, {len(scene.objects)} objects")
    for o in scene.objects:
        print(f"  object {o.id}: {o.name}")
    from nsdr.symbolic.world import world_of

    world = world_of(scene)
    for text in world.event_text(world.observed).split("; ") if scene.events else ():
        print(f"  {text}")
    return 0


def write_annotated_image(path: str, video: str, perception: Any) -> None:
    """Write the annotated last frame of a video as a image file."""
    import cv2

    from nsdr.io.video import read_frames
    from nsdr.visualize import annotated_image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # said once already
        for index, frame in enumerate(read_frames(video)):
            last = (index, frame)
    image = annotated_image(last[1], last[0], perception.proposals, perception.tracks, perception.scene)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(path, image[..., ::-1]):
        raise DataError(f"{path}: cannot write a image; expected a name ending in .png or .jpg")


def _visualize(options: Any) -> int:
    import numpy as np

    from nsdr.io.video import read_frames
    from nsdr.visualize import stroboscopic_image, write_annotated_video, write_report
    from nsdr.visualize.figures import causal_figure, figure_png, plan_figure

    kind = Path(options.output).suffix
    if kind not in (".mp4", ".png", ".html"):
        raise DataError(f"{options.output}: expected a name ending in .mp4, .png or .html")
    pipeline = _pipeline(options)
    p = pipeline.perceive(options.video)
    if options.removed is not None and options.removed not in p.dynamics.counterfactual:
        raise DataError(f"--removed {options.removed}: the objects are 0 to {len(p.scene.objects) - 1}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # said once already
        frames = np.stack(list(read_frames(options.video)))
    Path(options.output).parent.mkdir(parents=True, exist_ok=True)
    if kind == ".html":
        questions = [options.question] if options.question else []
        answers = [pipeline.answer(options.video, q, options.choice or None) for q in questions]
        write_report(options.output, frames, p, answers)
    elif kind == ".mp4":
        write_annotated_video(options.output, frames, p.proposals, p.tracks, p.scene)
    elif options.image == "last":
        write_annotated_image(options.output, options.video, p)
    elif options.image == "strobe":
        import cv2

        cv2.imwrite(options.output, stroboscopic_image(frames, p.proposals, p.tracks)[..., ::-1])
    else:
        figure = plan_figure(p.dynamics, options.removed) if options.image == "plan" else causal_figure(p.scene)
        Path(options.output).write_bytes(figure_png(figure))
    print(options.output)
    return 0


def _parse_videos(options: Any) -> int:
    from nsdr.evaluation.batch import parse_videos

    summary = parse_videos(
        options.videos,
        options.output,
        options.checkpoint,
        options.stride,
        options.engine,
        options.workers,
        options.dynamics,
    )
    return _summarize(options.output, summary)


def _predict_dynamics(options: Any) -> int:
    from nsdr.evaluation.batch import predict_dynamics

    summary = predict_dynamics(
        options.proposals,
        options.output,
        options.form,
        options.checkpoint,
        options.engine,
        options.workers,
        options.dynamics,
    )
    return _summarize(options.output, summary)


def _summarize(output: str, summary: Any) -> int:
    done, skipped, failed = len(summary.done), len(summary.skipped), len(summary.failed)
    print(f"{output}: {done} done, {skipped} done before, {failed} failed")
    for name, error in summary.failed.items():
        print(f"  {name}: {error}")
    return 1 if failed else 0


def _parse_question(options: Any) -> int:
    from nsdr.errors import QuestionError
    from nsdr.io.checkpoint import find_checkpoint
    from nsdr.question_parser.parser import QuestionParser

    parser = QuestionParser.from_checkpoint(find_checkpoint(options.checkpoint))
    kinds = ["descriptive", "multiple_choice", "choice"] if options.kind == "auto" else [options.kind]
    for kind in kinds:
        try:
            program = parser.parse(options.text, kind)
            break
        except QuestionError:
            if kind == kinds[-1]:
                raise
    print(program.tree() if options.tree else program)
    return 0


def _execute(options: Any) -> int:
    from nsdr.symbolic import Executor

    _print_answer(Executor(_load_scene(options.scene)).answer(options.program), options.trace)
    return 0


def _evaluate(options: Any) -> int:
    from nsdr.clevrer.questions import QUESTION_TYPES
    from nsdr.clevrer.submissions import write_submission
    from nsdr.evaluation.score import evaluate_file, format_table
    from nsdr.evaluation.splits import SplitEvaluation, evaluate_split
    from nsdr.io.files import write_json

    types = tuple(options.types or QUESTION_TYPES)
    if options.root is not None:
        config = SplitEvaluation(
            options.root,
            options.split,
            options.source,
            options.cache,
            options.limit,
            options.programs,
            types,
            options.checkpoint,
            options.dynamics,
            options.stride,
            options.engine,
            options.workers,
        )
        report = evaluate_split(config)
    elif options.questions is None or options.data is None:
        raise DataError("nsdr evaluate: give --questions and --data, or --root for a whole split")
    else:
        report = evaluate_file(
            options.questions,
            options.source,
            options.data,
            options.programs,
            options.checkpoint,
            types,
            options.semantics,
            options.collisions,
            set(options.exclude),
            options.dynamics,
        )
    print(format_table(report))
    if options.output:
        write_json(options.output, report, indent=1)
    if options.submission:
        write_submission(options.submission, report["results"])
    return 0


def _experiment(options: Any) -> int:
    from nsdr.evaluation.experiments import run_experiment

    print(run_experiment(options.file, options.output).read_text())
    return 0


def _data(options: Any) -> int:
    from nsdr.clevrer.dataset import CLEVRER
    from nsdr.clevrer.download import download

    if options.action == "download":
        if options.split is None:
            raise DataError("nsdr data download: --split is missing; expected train, validation or test")
        for path in download(options.root, options.split, options.what):
            print(path)
        return 0
    if options.action == "frames":
        from nsdr.frame_parser.training_frames import write_frames

        if options.proposals is None or options.output is None:
            raise DataError("nsdr data frames: --proposals or --output is missing")
        print(
            f"{options.output}: {write_frames(options.root, options.proposals, options.output, options.every)} frames"
        )
        return 0
    print(f"{'split':<12}{'kind':<14}{'found':>7}{'expected':>10}  first missing")
    complete = True
    for row in CLEVRER(options.root).inventory():
        complete &= row.found == row.expected
        first = ", ".join(str(i) for i in row.missing[:5]) + (", ..." if len(row.missing) > 5 else "")
        print(f"{row.split:<12}{row.kind:<14}{row.found:>7}{row.expected:>10}  {first}")
    print("complete" if complete else "incomplete: `nsdr data download` fetches videos, annotations and questions")
    return 0


def _demo(options: Any) -> int:
    from nsdr.cli.demo import run_demo

    return run_demo(options.checkpoint, options.output)


def train(arguments: list[str]) -> int:
    """`nsdr train ...`."""
    from importlib import import_module

    parts = {
        name: f"nsdr.training.{name.replace('-', '_')}" for name in ("frame-parser", "dynamics", "question-parser")
    }
    if not arguments or arguments[0] not in parts:
        raise DataError(
            f"nsdr train: expected one of {', '.join(parts)}, got {arguments[0] if arguments else 'nothing'!r}"
        )
    logging.getLogger("nsdr").setLevel(logging.INFO)
    print(import_module(parts[arguments[0]]).main(arguments[1:]))
    return 0


def generate(arguments: list[str]) -> int:
    """`nsdr generate ...`."""
    from nsdr.cli.generate import main

    print(main(arguments))
    return 0


def _pipeline(options: Any) -> Any:
    from nsdr.pipeline import Pipeline

    pipeline = Pipeline.from_pretrained(options.checkpoint, dynamics=options.dynamics)
    pipeline.progress = sys.stderr.isatty()
    return pipeline


def _load_scene(path: str) -> Scene:
    from nsdr.io import storage

    return storage.load(Scene, path)


COMMANDS: dict[str, Callable[[Any], int]] = {
    "answer": _answer,
    "parse-video": _parse_video,
    "visualize": _visualize,
    "parse-videos": _parse_videos,
    "predict-dynamics": _predict_dynamics,
    "parse-question": _parse_question,
    "execute": _execute,
    "evaluate": _evaluate,
    "experiment": _experiment,
    "data": _data,
    "demo": _demo,
}

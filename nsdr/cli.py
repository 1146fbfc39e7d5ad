"""The command `nsdr`."""

import json
import logging
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jsonargparse

from nsdr.errors import DataError, NsdrError
from nsdr.types import Answer, Scene

__all__ = ["main", "write_picture"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0, or 2 after an error told in one line on stderr)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    arguments = [a for a in arguments if a != "--debug"]
    logging.basicConfig(level=logging.DEBUG if debug else logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            of_its_own = {"train": _train, "generate": _generate}.get(arguments[0] if arguments else "")
            if of_its_own and arguments[1:2] not in (["--help"], ["-h"]):
                return of_its_own(arguments[1:])
            parser = _parser()
            options = parser.parse_args(arguments)
            if options.command is None:
                parser.print_help()
                return 2
            return _COMMANDS[options.command](options[options.command])
        except (NsdrError, jsonargparse.ArgumentError, FloatingPointError) as e:
            if debug:
                traceback.print_exc()
            print(f"error: {' '.join(str(e).split())}", file=sys.stderr)
            return 2


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _parser() -> jsonargparse.ArgumentParser:
    parser = jsonargparse.ArgumentParser(
        prog="nsdr",
        exit_on_error=False,
        description="Answer questions about videos of colliding objects. Every command takes --debug for tracebacks.",
    )
    commands = parser.add_subcommands(required=False, dest="command")

    def add(name: str, summary: str, checkpoint: bool = True) -> jsonargparse.ArgumentParser:
        sub = jsonargparse.ArgumentParser(description=summary, exit_on_error=False)
        if checkpoint:
            sub.add_argument("--checkpoint", default="default", help="folder, name or hub id of the weights")
        commands.add_subcommand(name, sub, help=summary)
        return sub

    answer = add("answer", "answer a question about a video")
    answer.add_argument("video", help="video file, or a scene saved as .json by parse-video")
    answer.add_argument("-q", "--question", required=True, help="in CLEVRER's English")
    answer.add_argument("-c", "--choice", action="append", default=[], help="an option; repeat it for each")
    answer.add_argument("--trace", action="store_true", help="print every executed step")
    answer.add_argument("--json", action="store_true", help="print the answer as JSON")

    parse_video = add("parse-video", "turn a video into a symbolic scene")
    parse_video.add_argument("video", help="video file")
    parse_video.add_argument("-o", "--output", required=True, help="scene file, .json or .npz")
    parse_video.add_argument("--proposals-out", default=None, help="also write the mask proposals in CLEVRER's format")
    parse_video.add_argument("--picture", default=None, help="also write an annotated picture of the last frame")

    parse_videos = add("parse-videos", "turn a folder of videos into scenes and proposals; goes on where it stopped")
    parse_videos.add_argument("videos", help="folder with *.mp4")
    parse_videos.add_argument("-o", "--output", required=True, help="folder for scene_N.json and proposal_N.json")
    parse_videos.add_argument("--stride", type=int, default=1, help="look at every so-manieth frame")
    parse_videos.add_argument("--workers", type=int, default=0, help="processes; 0 for one a CPU core")
    parse_videos.add_argument("--engine", default="processes", choices=["processes", "ray"], help="where to work")

    predict = add("predict-dynamics", "turn mask proposals into motion and collisions; goes on where it stopped")
    predict.add_argument("proposals", help="folder of proposal files, or one compact NPZ")
    predict.add_argument("-o", "--output", required=True, help="folder for the files")
    predict.add_argument(
        "--form", default="predictions", choices=["predictions", "scenes"], help="the research code's files, or ours"
    )
    predict.add_argument("--workers", type=int, default=0, help="processes; 0 for one a CPU core")
    predict.add_argument("--engine", default="processes", choices=["processes", "ray"], help="where to work")

    parse_question = add("parse-question", "turn a question or choice into a program")
    parse_question.add_argument("text", help="in CLEVRER's English")
    parse_question.add_argument(
        "--kind", default="auto", choices=["auto", "descriptive", "multiple_choice", "choice"], help="kind of text"
    )
    parse_question.add_argument("--tree", action="store_true", help="print it as the paper writes it")

    execute = add("execute", "run a program on a saved scene", checkpoint=False)
    execute.add_argument("--scene", required=True, help="scene file written by parse-video")
    execute.add_argument("--program", required=True, help="postfix tokens, or a tree as in the paper")
    execute.add_argument("--trace", action="store_true", help="print every executed step")

    evaluate = add("evaluate", "score answers to a question file")
    evaluate.add_argument("--questions", required=True, help="question file in CLEVRER's format")
    evaluate.add_argument(
        "--source",
        required=True,
        choices=["videos", "proposals", "predictions", "annotations", "ground-truth", "truth"],
        help="what scenes are made from",
    )
    evaluate.add_argument("--data", required=True, help="folder of these files (or one compact file)")
    evaluate.add_argument("--programs", default="parsed", choices=["parsed", "gold"], help="whose programs run")
    evaluate.add_argument("--types", nargs="+", default=None, help="question types to answer; all when left out")
    evaluate.add_argument("--semantics", default="paper", choices=["paper", "official"], help="of the executor")
    evaluate.add_argument(
        "--collisions",
        default="predicted",
        choices=["predicted", "velocity"],
        help="official semantics: velocity is NE",
    )
    evaluate.add_argument("--exclude", type=list[int], default=[], help="scene indices to leave out")
    evaluate.add_argument("-o", "--output", default=None, help="write the table and every result as JSON")
    evaluate.add_argument("--submission", default=None, help="write the answers as an EvalAI submission")

    data = add(
        "data", "check or download CLEVRER's official files, or make training frames of videos", checkpoint=False
    )
    data.add_argument("action", choices=["verify", "download", "frames"], help="what to do")
    data.add_argument("root", help="the data set's folder; for frames: the videos' folder")
    data.add_argument("--proposals", default=None, help="frames: folder of the videos' mask proposals")
    data.add_argument("-o", "--output", default=None, help="frames: folder to write")
    data.add_argument("--every", type=int, default=8, help="frames: take every so-manieth frame")
    data.add_argument("--split", default=None, choices=["train", "validation", "test"], help="which to download")
    data.add_argument(
        "--what", nargs="+", default=["videos", "annotations", "questions"], help="videos, annotations, questions"
    )

    demo = add("demo", "answer questions about the clip that comes with the package")
    demo.add_argument("-o", "--output", default="nsdr_demo.png", help="annotated picture to write")

    parser.add_argument("--version", action="version", version=_version())
    commands.add_subcommand(
        "train",
        jsonargparse.ArgumentParser(description="see nsdr train frame-parser|dynamics|question-parser --help"),
        help="train frame-parser|dynamics|question-parser --config configs/….yaml [--field value]",
    )
    commands.add_subcommand(
        "generate",
        jsonargparse.ArgumentParser(description="see nsdr generate dataset|scene --help"),
        help="generate dataset|scene [--config configs/generate/….yaml] -o OUTPUT [--field value]",
    )
    return parser


def _version() -> str:
    import nsdr

    return nsdr.__version__


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
    from nsdr import storage
    from nsdr.clevrer.proposals import proposals_document
    from nsdr.files import write_json

    if Path(options.output).suffix not in (".json", ".npz"):
        raise DataError(f"{options.output}: expected a name ending in .json or .npz")
    pipeline = _pipeline(options)
    perception = pipeline.perception(options.video)
    scene = perception.scene
    storage.save(scene, options.output)
    if options.proposals_out:
        assert perception.proposals is not None
        name = Path(options.video).name
        number = "".join(c for c in Path(name).stem if c.isdigit())
        write_json(options.proposals_out, proposals_document(perception.proposals, int(number or 0), name))
    if options.picture:
        write_picture(options.picture, options.video, perception)
    print(f"{options.output}: {scene.n_frames} frames, {len(scene.objects)} objects")
    for o in scene.objects:
        print(f"  object {o.id}: {o.name}")
    from nsdr.symbolic.world import world_of

    world = world_of(scene)
    for text in world.event_text(world.observed).split("; ") if scene.events else ():
        print(f"  {text}")
    return 0


def write_picture(path: str, video: str, perception: Any) -> None:
    """Write the annotated last frame of a video as a picture file."""
    import cv2

    from nsdr.frame_parser.video import read_frames
    from nsdr.visualize import annotated_picture

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # said once already
        for index, frame in enumerate(read_frames(video)):
            last = (index, frame)
    picture = annotated_picture(last[1], last[0], perception.proposals, perception.tracks, perception.scene)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(path, picture[..., ::-1]):
        raise DataError(f"{path}: cannot write a picture; expected a name ending in .png or .jpg")


def _parse_videos(options: Any) -> int:
    from nsdr.perceive import parse_videos

    summary = parse_videos(
        options.videos, options.output, options.checkpoint, options.stride, options.engine, options.workers
    )
    return _summarize(options.output, summary)


def _predict_dynamics(options: Any) -> int:
    from nsdr.perceive import predict_dynamics

    summary = predict_dynamics(
        options.proposals, options.output, options.form, options.checkpoint, options.engine, options.workers
    )
    return _summarize(options.output, summary)


def _summarize(output: str, summary: Any) -> int:
    done, skipped, failed = len(summary.done), len(summary.skipped), len(summary.failed)
    print(f"{output}: {done} done, {skipped} done before, {failed} failed")
    for name, error in summary.failed.items():
        print(f"  {name}: {error}")
    return 1 if failed else 0


def _parse_question(options: Any) -> int:
    from nsdr.checkpoint import find_checkpoint
    from nsdr.errors import QuestionError
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
    from nsdr.evaluate import evaluate_file, format_table
    from nsdr.files import write_json

    report = evaluate_file(
        options.questions,
        options.source,
        options.data,
        options.programs,
        options.checkpoint,
        options.types or QUESTION_TYPES,
        options.semantics,
        options.collisions,
        set(options.exclude),
    )
    print(format_table(report))
    if options.output:
        write_json(options.output, report, indent=1)
    if options.submission:
        write_submission(options.submission, report["results"])
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
        from nsdr.frame_parser.frames import write_frames

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
    from nsdr.demo import run_demo

    return run_demo(options.checkpoint, options.output)


def _train(arguments: list[str]) -> int:
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


def _generate(arguments: list[str]) -> int:
    from nsdr.generate.commands import main as generate

    print(generate(arguments))
    return 0


def _pipeline(options: Any) -> Any:
    from nsdr.pipeline import Pipeline

    pipeline = Pipeline.from_pretrained(options.checkpoint)
    pipeline.progress = sys.stderr.isatty()
    return pipeline


def _load_scene(path: str) -> Scene:
    from nsdr import storage

    return storage.load(Scene, path)


_COMMANDS: dict[str, Callable[[Any], int]] = {
    "answer": _answer,
    "parse-video": _parse_video,
    "parse-videos": _parse_videos,
    "predict-dynamics": _predict_dynamics,
    "parse-question": _parse_question,
    "execute": _execute,
    "evaluate": _evaluate,
    "data": _data,
    "demo": _demo,
}

if __name__ == "__main__":
    sys.exit(main())

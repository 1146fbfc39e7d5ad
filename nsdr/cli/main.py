"""The command `nsdr`."""

import logging
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Any

import jsonargparse

from nsdr.cli.commands import COMMANDS, generate, train
from nsdr.errors import NsdrError

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0, or 2 after an error told in one line on stderr)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    arguments = [a for a in arguments if a != "--debug"]
    logging.basicConfig(level=logging.DEBUG if debug else logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            of_its_own = {"train": train, "generate": generate}.get(arguments[0] if arguments else "")
            if of_its_own and arguments[1:2] not in (["--help"], ["-h"]):
                return of_its_own(arguments[1:])
            parser = _parser()
            options = parser.parse_args(arguments)
            if options.command is None:
                parser.print_help()
                return 2
            return COMMANDS[options.command](options[options.command])
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

    def add(name: str, summary: str, checkpoint: bool = True, dynamics: bool = False) -> jsonargparse.ArgumentParser:
        sub = jsonargparse.ArgumentParser(description=summary, exit_on_error=False)
        if checkpoint:
            sub.add_argument("--checkpoint", default="default", help="folder, name or hub id of the weights")
        if dynamics:
            sub.add_argument("--dynamics", default="physics", help="physics, state, paper, or a YAML file")
        commands.add_subcommand(name, sub, help=summary)
        return sub

    answer = add("answer", "answer a question about a video", dynamics=True)
    answer.add_argument("video", help="video file, or a scene saved as .json by parse-video")
    answer.add_argument("-q", "--question", required=True, help="in CLEVRER's English")
    answer.add_argument("-c", "--choice", action="append", default=[], help="an option; repeat it for each")
    answer.add_argument("--trace", action="store_true", help="print every executed step")
    answer.add_argument("--json", action="store_true", help="print the answer as JSON")

    parse_video = add("parse-video", "turn a video into a symbolic scene", dynamics=True)
    parse_video.add_argument("video", help="video file")
    parse_video.add_argument("-o", "--output", required=True, help="scene file, .json or .npz")
    parse_video.add_argument("--proposals-out", default=None, help="also write the mask proposals in CLEVRER's format")
    parse_video.add_argument("--image", default=None, help="also write an annotated image of the last frame")

    parse_videos = add(
        "parse-videos", "turn a folder of videos into scenes and proposals; goes on where it stopped", dynamics=True
    )
    parse_videos.add_argument("videos", help="folder with *.mp4")
    parse_videos.add_argument("-o", "--output", required=True, help="folder for scene_N.json and proposal_N.json")
    parse_videos.add_argument("--stride", type=int, default=1, help="look at every so-manieth frame")
    parse_videos.add_argument("--workers", type=int, default=0, help="processes; 0 for one a CPU core")
    parse_videos.add_argument("--engine", default="processes", choices=["processes", "ray"], help="where to work")

    predict = add(
        "predict-dynamics", "turn mask proposals into motion and collisions; goes on where it stopped", dynamics=True
    )
    predict.add_argument("proposals", help="folder of proposal files, or one compact NPZ")
    predict.add_argument("-o", "--output", required=True, help="folder for the files")
    predict.add_argument(
        "--form", default="predictions", choices=["predictions", "scenes"], help="the research code's files, or ours"
    )
    predict.add_argument("--workers", type=int, default=0, help="processes; 0 for one a CPU core")
    predict.add_argument("--engine", default="processes", choices=["processes", "ray"], help="where to work")

    visualize = add("visualize", "show what was seen and why it was answered so", dynamics=True)
    visualize.add_argument("video", help="video file")
    visualize.add_argument("-q", "--question", default=None, help="for an HTML report: a question")
    visualize.add_argument("-c", "--choice", action="append", default=[], help="its options; repeat it for each")
    visualize.add_argument(
        "--image", default="strobe", choices=["strobe", "last", "plan", "causal"], help="for a PNG: which"
    )
    visualize.add_argument("--removed", type=int, default=None, help="plan: draw the world without this object")
    visualize.add_argument("-o", "--output", required=True, help="file ending in .mp4, .png or .html")

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

    evaluate = add("evaluate", "score answers to a question file", dynamics=True)
    evaluate.add_argument("--questions", default=None, help="question file in CLEVRER's format")
    evaluate.add_argument(
        "--source",
        required=True,
        choices=["videos", "proposals", "tracks", "predictions", "annotations", "ground-truth", "truth", "scenes"],
        help="what scenes are made from",
    )
    evaluate.add_argument("--data", default=None, help="folder of these files (or one compact file)")
    evaluate.add_argument(
        "--root", default=None, help="whole splits: folder in the official layout, for --questions and --data"
    )
    evaluate.add_argument(
        "--split", default="validation", choices=["train", "validation", "test"], help="whole splits: which"
    )
    evaluate.add_argument("--limit", type=int, default=0, help="whole splits: first so many scenes; 0 for all")
    evaluate.add_argument(
        "--cache", default="runs/scenes", help="whole splits: folder that keeps scenes for the next run"
    )
    evaluate.add_argument("--stride", type=int, default=1, help="whole splits: look at every so-manieth frame")
    evaluate.add_argument("--workers", type=int, default=0, help="whole splits: processes; 0 for one a CPU core")
    evaluate.add_argument(
        "--engine", default="processes", choices=["processes", "ray"], help="whole splits: where to work"
    )
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

    experiment = add("experiment", "measure all rows of a table; goes on where it stopped", checkpoint=False)
    experiment.add_argument("file", help="configs/experiments/….yaml")
    experiment.add_argument("-o", "--output", default="results", help="folder for NAME.json and NAME.md")

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
    demo.add_argument("-o", "--output", default="nsdr_demo.png", help="annotated image to write")

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


if __name__ == "__main__":
    sys.exit(main())

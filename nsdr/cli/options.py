"""The options of the commands that have no file of their own for them, and those that several share."""

from typing import Any

import jsonargparse
from jsonargparse.typing import NonNegativeInt, PositiveInt

from nsdr.cli import data, perceive, simulate

__all__ = ["ENGINES", "SPLITS", "Commands", "ask_options", "data_options", "evaluate_options", "perceive_options"]

SPLITS = ["train", "validation", "test"]
ENGINES = ["processes", "ray"]
EXTENSIONS = "also read questions beyond CLEVRER: speeds, directions, masses, changed objects (docs/questions.md)"
KEEP_GOING = "exit with status 0 although a part of the work failed"


class Commands:
    """Adds commands with the options that several share.

    Args:
        parser: of the command `nsdr`.
    """

    def __init__(self, parser: jsonargparse.ArgumentParser) -> None:
        self.commands = parser.add_subcommands(required=False, dest="command")

    def add(
        self,
        name: str,
        summary: str,
        checkpoint: bool = True,
        pipeline: bool = False,
        work: bool = False,
        texts: bool = False,
        videos: bool = False,
    ) -> Any:
        """A command.

        Args:
            name: of the command.
            summary: one line of help.
            checkpoint: takes `--checkpoint` and `--device`.
            pipeline: takes the settings of a pipeline.
            work: works on many files.
            texts: takes `--parser`.
            videos: looks at videos.
        """
        sub = jsonargparse.ArgumentParser(description=summary, exit_on_error=False)
        if checkpoint:
            where = "folder, name or hub address (hf://USER/NAME@COMMIT) of the weights"
            sub.add_argument("--checkpoint", default="default", help=where)
            sub.add_argument("--device", default="auto", help="where networks run: auto, cpu, cuda or cuda:N")
        if pipeline:
            sub.add_argument(
                "--dynamics",
                default="",
                help="backend (physics, state, paper, paper_images, or an installed one) or YAML file",
            )
            sub.add_argument(
                "--config", default="", help="YAML file with the settings of all stages (configs/pipeline)"
            )
            sub.add_argument(
                "--set", action="append", default=[], help="one setting, such as tracker.score=0.8; repeatable"
            )
        if texts:
            server = "OpenAI-compatible server for texts that the rules cannot read, such as http://localhost:8000/v1"
            sub.add_argument("--parser", default="", help=server)
            sub.add_argument("--parser-model", default="", help="its model's name; may be left out if it has only one")
        if videos:
            sub.add_argument("--force", action="store_true", help="go on with videos that are not of CLEVRER's scene")
            help_text = "image of the scene without objects, for another camera or other lamps"
            sub.add_argument("--background", default="", help=help_text)
        if work:
            help_text = "number of processes; 0 for one per CPU core"
            sub.add_argument("--workers", type=NonNegativeInt, default=0, help=help_text)
            sub.add_argument("--engine", default="processes", choices=ENGINES, help="where to work")
            sub.add_argument("--keep-going", action="store_true", help=KEEP_GOING)
        self.commands.add_subcommand(name, sub, help=summary)
        return sub


def ask_options(commands: Commands) -> None:
    """Add the commands that ask questions and run programs."""
    answer = commands.add("answer", "answer a question about a video", pipeline=True, videos=True, texts=True)
    answer.add_argument("video", help="video file, or a scene saved by parse-video")
    answer.add_argument("-q", "--question", required=True, help="in CLEVRER's English")
    answer.add_argument("-c", "--choice", action="append", default=[], help="an option; repeat it for each")
    answer.add_argument(
        "--responsible",
        default="chain",
        choices=["chain", "but_for"],
        help="what it means: a chain of events led to it (CLEVRER's), or it would not have happened without",
    )
    answer.add_argument("--extensions", action="store_true", help=EXTENSIONS)
    answer.add_argument("--trace", action="store_true", help="print every executed step")
    answer.add_argument("--json", action="store_true", help="print the answer as JSON")
    answer.add_argument("--keep-going", action="store_true", help=KEEP_GOING)

    parse_question = commands.add("parse-question", "turn a question or choice into a program", texts=True)
    parse_question.add_argument("text", help="in CLEVRER's English")
    parse_question.add_argument(
        "--kind", default="auto", choices=["auto", "descriptive", "multiple_choice", "choice"], help="kind of text"
    )
    parse_question.add_argument("--extensions", action="store_true", help=EXTENSIONS)
    parse_question.add_argument("--tree", action="store_true", help="print it as the paper writes it")

    execute = commands.add("execute", "run a program on a saved scene", checkpoint=False)
    execute.add_argument("--scene", required=True, help="scene saved by parse-video; official: prediction file")
    execute.add_argument("--program", required=True, help="postfix tokens, or a tree as in the paper")
    _semantics_options(execute)
    execute.add_argument("--trace", action="store_true", help="print every executed step")

    demo = commands.add("demo", "answer questions about the clip that ships with the package")
    demo.add_argument("-o", "--output", default="nsdr_demo.png", help="annotated image to write")


def _semantics_options(parser: Any) -> None:
    parser.add_argument("--semantics", default="paper", choices=["paper", "official"], help="of the executor")
    parser.add_argument(
        "--collisions",
        default="predicted",
        choices=["predicted", "velocity"],
        help="official semantics: velocity is NE",
    )


def perceive_options(commands: Commands) -> None:
    """Add the commands that look at videos."""
    parse_video = commands.add("parse-video", "turn a video into a symbolic scene", pipeline=True, videos=True)
    parse_video.add_argument("video", help="video file")
    parse_video.add_argument("-o", "--output", required=True, help="scene file, .json or .npz")
    parse_video.add_argument("--proposals-out", default=None, help="also write the mask proposals in CLEVRER's format")
    parse_video.add_argument("--image", default=None, help="also write the annotated last frame as an image")

    parse_videos = commands.add(
        "parse-videos",
        "turn a folder of videos into scenes and proposals; resumable",
        pipeline=True,
        work=True,
        videos=True,
    )
    parse_videos.add_argument("videos", help="folder with *.mp4")
    parse_videos.add_argument("-o", "--output", required=True, help="folder for scene_N.json and proposal_N.json")
    parse_videos.add_argument("--stride", type=PositiveInt, default=1, help="process every n-th frame")

    predict = commands.add(
        "predict-dynamics", "turn mask proposals into motion and collisions; resumable", pipeline=True, work=True
    )
    predict.add_argument("proposals", help="folder of proposal files, or one compact NPZ")
    predict.add_argument("-o", "--output", required=True, help="folder for the files")
    predict.add_argument(
        "--form", default="predictions", choices=["predictions", "scenes"], help="the research code's files, or ours"
    )

    summary = "show what was seen, and why a question got its answer"
    visualize = commands.add("visualize", summary, pipeline=True, videos=True)
    visualize.add_argument("video", help="video file, or a scene saved by parse-video")
    visualize.add_argument("-q", "--question", default=None, help="for an HTML report: a question")
    visualize.add_argument("-c", "--choice", action="append", default=[], help="its options; repeat it for each")
    visualize.add_argument(
        "--image",
        default=None,
        choices=[*perceive.IMAGES, "all"],
        help="for a PNG: which image (default: strobe; of a saved scene, causal); all adds each one's name to the file's",
    )
    visualize.add_argument(
        "--removed", type=NonNegativeInt, default=None, help="plan: draw the scene without this object"
    )
    visualize.add_argument(
        "-o", "--output", action="append", required=True, help="file ending in .mp4, .png or .html; repeatable"
    )
    visualize.add_argument("--keep-going", action="store_true", help=KEEP_GOING)

    summary = "what would happen in a video with objects removed, changed or added"
    simulate.add_options(commands.add("simulate", summary, pipeline=True, videos=True))

    summary = (
        "the paper's figures (distributions of a question set, program-count curve, sample results), training curves"
    )
    add = commands.add("figures", summary, pipeline=True, videos=True).add_argument
    add("--questions", default="", help="question file whose distribution is drawn beside the release's")
    add("--ablation", default="", help="CSV file of `nsdr train question-parser --ablation`, for the curve")
    add("--samples", default="", help="question file for samples: pictures with questions, programs and answers")
    add("--videos", default="", help="samples: folder of their videos")
    add("--show", nargs="+", default=[], help="samples: which questions, as SCENE:QUESTION")
    add("--runs", nargs="+", default=[], help="run folders of trainings, whose losses are drawn")
    add("-o", "--output", required=True, help="folder for the pictures")


def evaluate_options(commands: Commands) -> None:
    """Add the commands that score."""
    evaluate = commands.add(
        "evaluate", "score answers to a question file; resumable", pipeline=True, work=True, texts=True
    )
    _semantics_options(evaluate)
    add = evaluate.add_argument
    add("--questions", default="", help="question file in CLEVRER's format")
    add(
        "--source", required=True, help="what scenes are made from: videos, proposals, tracks, … or an installed source"
    )
    add("--data", default="", help="folder of these files (or one compact file)")
    add("--videos", default="", help="folder of the videos of --data's proposals, for --dynamics that reads images")
    add("--root", default="", help="folder in the official layout, in place of --questions and --data")
    add("--split", default="validation", choices=SPLITS, help="of --root")
    add(
        "--programs",
        default="parsed",
        help="parsed, network, gold, or the released parser's JSON files, separated by commas",
    )
    add(
        "--types",
        nargs="+",
        default=["descriptive", "explanatory", "predictive", "counterfactual"],
        help="question types",
    )
    add("--exclude", type=list[int], default=[], help="scene indices to leave out")
    add("--every", type=PositiveInt, default=1, help="answer every n-th scene")
    add("--limit", type=NonNegativeInt, default=0, help="answer the first n scenes; 0 for all")
    add("--stride", type=PositiveInt, default=1, help="videos: process every n-th frame")
    add(
        "--counterfactuals",
        default="simulated",
        choices=["simulated", "recording"],
        help="recording: delete the removed object from the recording and simulate nothing, as a control",
    )
    add("--truth_source", default="", help="source of scenes whose observed collisions replace the detected ones")
    add("--truth", default="", help="folder or file of --truth_source")
    add("--cache", default="runs/scenes", help="folder that keeps scenes for the next run")
    add("-o", "--output", default=None, help="write the table and every result as JSON")
    add("--submission", default=None, help="write the answers as an EvalAI submission")

    experiment = commands.add("experiment", "measure all rows of a table; resumable", checkpoint=False)
    experiment.add_argument("file", help="configs/experiments/….yaml")
    experiment.add_argument("--device", default="auto", help="where networks run: auto, cpu, cuda or cuda:N")
    experiment.add_argument("-o", "--output", default="results", help="folder for NAME.json and NAME.md")
    experiment.add_argument("--keep-going", action="store_true", help=KEEP_GOING)

    summary = "mark the questions that the recording alone, or the text alone, answers"
    add = commands.add("tag", summary, checkpoint=False).add_argument
    add("questions", help="question file in CLEVRER's format, with programs and answers")
    truth = "tags counterfactual options: folders or files of annotations, truth files or compact ground truth"
    add("--truth", nargs="+", default=[], help=truth)
    add("--train", default="", help="questions of other scenes, which the texts' answers are learned from")
    add("--no-blind", action="store_true", help="leave out what the texts alone predict (needs the extra `blind`)")
    add("--seed", type=NonNegativeInt, default=0, help="of the folds of scenes, without --train")
    add("-o", "--output", required=True, help="question file to write")


def data_options(commands: Commands) -> None:
    """Add `nsdr data`."""
    summary = "check or download CLEVRER's official files, or make training data of them or of generated ones"
    add = commands.add("data", summary, checkpoint=False).add_argument
    add("action", choices=list(data.TAKES), help="what to do")
    add("root", help="the data set's folder; for frames: the videos' folder")
    add("--proposals", default=None, help="frames: folder of the videos' mask proposals")
    add("-o", "--output", default=None, help="frames, motion: folder to write")
    add("--every", type=PositiveInt, default=None, help="frames: take every n-th frame (default: 8)")
    add("--split", default=None, choices=SPLITS, help="download, motion (default: train): which videos")
    add("--what", nargs="+", default=None, help="download: videos, annotations, questions (default: all)")
    trust = "download: accept files over plain HTTP that have no checksum in the folder's checksums.json yet"
    add("--trust-first-use", action="store_true", default=None, help=trust)
    add(
        "--workers",
        type=NonNegativeInt,
        default=None,
        help="motion: number of processes; 0 (default) for one per CPU core",
    )
    add("--engine", default=None, choices=ENGINES, help="motion: where to work (default: processes)")
    add("--keep-going", action="store_true", default=None, help="frames, motion: leave out what failed")

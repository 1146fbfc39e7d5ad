"""What several commands share: options, the pipeline they ask for, saved scenes, and the line about failures."""

import sys
import warnings
from pathlib import Path
from typing import Any

from jsonargparse.typing import NonNegativeInt

from nsdr.errors import DataError
from nsdr.io.files import check_output
from nsdr.io.jobs import ENGINES, FAILURES
from nsdr.io.reading import read_json
from nsdr.types import Scene

__all__ = [
    "SPLITS",
    "check_outputs",
    "failures_line",
    "frames_of",
    "is_scene",
    "left_out",
    "load_scene",
    "make_pipeline",
    "question_parser",
    "refuse_for_scene",
    "settings_of",
    "shared_options",
]

SPLITS = ["train", "validation", "test"]
PARSER = "OpenAI-compatible server for texts that the rules cannot read, such as http://localhost:8000/v1"
PARTLY = 1
"""Exit status: a part of the work failed."""


OPTIONS: dict[str, dict[str, dict[str, Any]]] = {
    "checkpoint": {
        "--checkpoint": {
            "default": "default",
            "help": "folder, name or hub address (hf://USER/NAME@COMMIT) of the weights",
        },
        "--device": {"default": "auto", "help": "where networks run: auto, cpu, cuda or cuda:N"},
    },
    "pipeline": {
        "--dynamics": {
            "default": "",
            "help": "backend (physics, state, paper, paper_images, an installed one) or YAML file",
        },
        "--config": {"default": "", "help": "YAML file with the settings of all stages (configs/pipeline)"},
        "--set": {"action": "append", "default": [], "help": "one setting, such as tracker.score=0.8; repeatable"},
    },
    "video": {
        "--force": {"action": "store_true", "help": "go on with videos that are not of CLEVRER's scene"},
        "--background": {
            "default": "",
            "help": "image of the scene without objects, for another camera or other lamps",
        },
    },
    "parser": {
        "--parser": {"default": "", "help": PARSER},
        "--parser-model": {"default": "", "help": "its model's name; may be left out if it has only one"},
    },
    "work": {
        "--workers": {"type": NonNegativeInt, "default": 0, "help": "number of processes; 0 for one per CPU core"},
        "--engine": {"default": "processes", "choices": ENGINES, "help": "where to work"},
    },
    "failures": {"--keep-going": {"action": "store_true", "help": "accept failures of a part of the work: status 0"}},
}
"""Options that several commands share, in groups."""


def shared_options(parser: Any, *groups: str) -> None:
    """Add groups of `OPTIONS`."""
    for group in groups:
        for name, settings in OPTIONS[group].items():
            parser.add_argument(name, **settings)


def settings_of(options: Any) -> Any:
    """The `PipelineConfig` of the command's options."""
    from nsdr.pipeline import pipeline_settings

    overrides = list(options.set)
    if getattr(options, "force", False):
        overrides.append("video.check=warn")
    if getattr(options, "background", ""):
        overrides.append(f"video.background={options.background}")
    return pipeline_settings(options.config, options.dynamics, overrides, getattr(options, "stride", 1))


def make_pipeline(options: Any) -> Any:
    """The pipeline of the command's options; it shows progress on a terminal.

    Raises:
        VideoError: the command's video is not one to be processed; mostly before the networks' libraries are loaded, which
            settings that say what is expected of a video need.
    """
    if not is_scene(options.video) and not options.config and not any(v.startswith("video") for v in options.set):
        from nsdr.frame_parser.check.video import VideoConfig, check_video

        check_video(options.video, VideoConfig("warn" if options.force else "refuse", options.background))
    from nsdr.pipeline import Pipeline

    settings = settings_of(options)
    pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings, device=options.device)
    pipeline.progress = sys.stderr.isatty()
    return pipeline


def frames_of(pipeline: Any, video: str | Path) -> Any:
    """(F, 320, 480, 3) uint8, the frames that perception saw, without the warnings that it has given."""
    import numpy as np

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.stack(list(pipeline.frames(video)))


def check_outputs(video: str, *outputs: tuple[str | None, tuple[str, ...]]) -> None:
    """Check files that are to be written, each with its possible endings: none of them is the video or another one."""
    taken = [video]
    for path, suffixes in outputs:
        if path is not None:
            check_output(path, suffixes, taken)
            taken.append(path)


def is_scene(path: str) -> bool:
    """Whether a file is a saved scene by its name, and not a video."""
    return Path(path).suffix in (".json", ".npz")


def load_scene(path: str) -> Scene:
    """A scene saved by `nsdr parse-video`."""
    from nsdr.io import storage

    return storage.load(Scene, path)


def refuse_for_scene(options: Any) -> None:
    """Refuse what is set about videos and dynamics where a saved scene is given."""
    given = [f"--{name}" for name in ("dynamics", "config", "force", "background") if getattr(options, name)]
    given += [f"--set {value}" for value in options.set]
    if given:
        raise DataError(f"{options.video} is a saved scene: {', '.join(given)} would do nothing; leave it out")


def question_parser(options: Any) -> Any:
    """The question parser of `--checkpoint`, or with the model of `--parser` in place of the networks.

    Raises:
        DataError: `--parser-model` without `--parser`.
    """
    from nsdr.question_parser.auto import AutoParser

    if options.parser:
        from nsdr.question_parser.language_model import LanguageModelParser

        return AutoParser(LanguageModelParser(options.parser, options.parser_model), options.extensions)
    if options.parser_model:
        raise DataError("--parser-model is of --parser and would do nothing without it; leave it out")
    return AutoParser.from_pretrained(options.checkpoint, options.device, options.extensions)


def failures_line(failed: int, total: int, what: str, example: str, keep_going: bool) -> int:
    """Print how much failed, if anything, as the last line; returns the exit status.

    Args:
        failed, total: numbers of things.
        what: what they are, in the plural.
        example: one of them, with what went wrong.
        keep_going: failures are no reason for a status other than 0.
    """
    if not failed:
        return 0
    line = f"{failed} of {total} {what} failed, such as {' '.join(example.split())}"
    if keep_going:
        print(line)
        return 0
    sys.stdout.flush()
    print(f"error: {line}; --keep-going accepts that", file=sys.stderr)
    return PARTLY


def left_out(folder: str | Path) -> int:
    """Print how many jobs failed, if any, in a folder where `run_jobs` worked; returns 0, the exit status of `--keep-going`."""
    path = Path(folder) / FAILURES
    if path.is_file():
        print(f"{len(read_json(path))} failed and are left out; see {path}")
    return 0

"""What several commands share: options, the pipeline they ask for, saved scenes, and the line about failures."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from jsonargparse.typing import NonNegativeFloat, NonNegativeInt

from nsdr.errors import DataError
from nsdr.io.configuration import parse_config
from nsdr.io.files import check_output
from nsdr.io.jobs import FAILURES, failed_text
from nsdr.io.notes import unsaid
from nsdr.io.reading import read_json
from nsdr.io.stages import stage
from nsdr.io.tasks import ENGINES

Config = TypeVar("Config")
VIDEO = "video file, animated image (GIF, WebP) or folder of frames (PNG, JPEG)"
"""What commands take as a video, for their help."""
PARTLY = 1
"""Exit status: a part of the work failed."""
HELP = ("--help", "-h")
KEEP_GOING = "--keep-going"
KEEP_GOING_HELP = f"{KEEP_GOING} accepts failures of a part of the work: status 0."
NOT_GIVEN: tuple[Any, ...] = (None, "", False, [], "default", "auto", "processes")
"""Values of options that were not given."""


class Command(NamedTuple):
    """What runs a command.

    Attributes:
        run: does the work and returns the exit status. It takes the parsed options, or the arguments where `add_options` is
            None.
        add_options: adds the command's options to a parser; None for a command that reads its arguments itself.
    """

    run: Callable[[Any], int]
    add_options: Callable[[Any], None] | None = None


GROUPS = {
    "weights and settings": ("checkpoint", "device", "dynamics", "config", "set"),
    "the video": ("force", "background", "fps"),
    "reading questions": ("question_parser", "extensions"),
    "work": ("workers", "engine", "keep_going"),
}
"""Options that several commands have, by their headings in the help."""


def shared_options(parser: Any, *groups: str) -> None:
    """Add groups of options that several commands share, such as "checkpoint", "pipeline" and "video"."""
    add = parser.add_argument
    parser.headings.update(GROUPS)
    if "checkpoint" in groups:
        add("--checkpoint", default="default", help="folder or name of the weights")
        add("--device", default="auto", metavar="auto|cpu|cuda|cuda:N", help="where networks run")
    if "pipeline" in groups:
        backend = "backend: physics, propnet, propnet_patches, propnet_images, an installed one, or a YAML file"
        add("--dynamics", default="", metavar="NAME|FILE", help=backend)
        add("--config", default="", metavar="FILE|paper", help="settings of all parts: a YAML file, or one that ships")
        setting = "one setting, such as tracker.score=0.8; repeatable"
        add("--set", action="append", default=[], metavar="NAME=VALUE", help=setting)
    if "video" in groups:
        add("--force", action="store_true", help="go on with videos of another scene")
        background = "image of the scene without objects, for another camera or other lamps"
        add("--background", default="", metavar="FILE", help=background)
        add("--fps", type=NonNegativeFloat, default=0.0, help="frames per second, in place of what the video says")
    if "parser" in groups:
        parsers = "grammar (default), the paper's network, or the address of a language model, http://localhost:8000/v1[#MODEL]"
        add("--question-parser", default="", metavar="grammar|network|URL", help=parsers)
    if "extensions" in groups:
        beyond = "also read questions beyond CLEVRER: speeds, directions, masses, changed objects"
        add("--extensions", action="store_true", help=beyond)
    if "work" in groups:
        processes = (
            "number of processes; 0 for one per CPU core, and on a GPU for no more than its memory is enough for"
        )
        add("--workers", type=NonNegativeInt, default=0, help=processes)
        add("--engine", default="processes", choices=ENGINES, help="where to work")
    if "failures" in groups:
        add(KEEP_GOING, action="store_true", help="accept failures of a part of the work: status 0")


def configured(kind: type[Config], arguments: Sequence[str], command: str, group: str, more: str = "") -> Config:
    """The configuration of a command whose options are its fields; `-o` is short for `--output`.

    Args:
        kind: the dataclass.
        arguments: of the command.
        command: its name.
        group: the folder of `configs` whose files `--config` takes by their names.
        more: what its help says of other options.
    """
    return parse_config(kind, arguments, f"nsdr {command}", more, {"-o": "--output"}, group)


def print_parts(usage: str, parts: Mapping[str, tuple[Any, str]], more: str) -> None:
    """Print the help of a command with parts.

    Args:
        usage: its first line.
        parts: of each part what runs it and what it is, by its name.
        more: its last line.
    """
    width = max(map(len, parts)) + 2
    print(f"{usage}\n")
    print("\n".join(f"  {name:<{width}}{summary}" for name, (_, summary) in parts.items()))
    print(f"\n{more}")


def refuse_idle(options: Any, names: Sequence[str], reason: str, about: str = "") -> None:
    """Refuse the options that are given although they would do nothing: "ABOUT--NAME would do nothing REASON"."""
    given = [
        f"--{name.replace('_', '-')}" for name in names if name != "set" and getattr(options, name) not in NOT_GIVEN
    ]
    given += [f"--set {value}" for value in options.set] if "set" in names else []
    if given:
        raise DataError(f"{about}{', '.join(given)} would do nothing{reason}; leave it out")


def settings_of(options: Any) -> Any:
    """The `PipelineConfig` of the command's options."""
    from nsdr.pipeline_config import OF_QUESTIONS, pipeline_settings

    given = vars(options)
    overrides = [*options.set, *(f"{name}={given[name]}" for name in OF_QUESTIONS if given.get(name))]
    settings = pipeline_settings(options.config, options.dynamics, overrides, options.checkpoint)
    expected = {name: given[name] for name in ("background", "fps") if given.get(name)}
    expected |= {"check": "warn"} if given.get("force") else {}
    return replace(settings, video=replace(settings.video, **expected))


def make_pipeline(options: Any, asks: bool = True) -> Any:
    """The pipeline of the command's options; it shows progress on a terminal.

    Args:
        options: of the command.
        asks: whether it is asked questions. If not, the networks or the server that parse them are not needed.

    Raises:
        VideoError: the command's video is not one to be processed; mostly before the networks' libraries are loaded, which
            settings that say what is expected of a video need.
    """
    with stage("loading the networks", sys.stderr.isatty()):
        video = vars(options).get("video") or vars(options).get("source", "")
        plain = not options.config and not any(v.startswith(("video", "world")) for v in options.set)
        if video and not is_scene(video) and plain and options.checkpoint == "default":
            from nsdr.frame_parser.check.video import VideoConfig, check_video

            expected = VideoConfig("warn" if options.force else "refuse", options.background, fps=options.fps)
            check_video(video, expected)
        from nsdr.pipeline import Pipeline
        from nsdr.question_parser.loading import GRAMMAR

        settings = settings_of(options)
        if not asks:
            settings = replace(settings, question_parser=GRAMMAR, extensions=False)
        pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings, device=options.device)
    pipeline.progress = sys.stderr.isatty()
    return pipeline


def frames_of(pipeline: Any, video: str | Path) -> Any:
    """(F, height, width, 3) uint8, the frames that perception saw, whose notes the scene has."""
    import numpy as np

    return np.stack(list(pipeline.frames(video, note=unsaid)))


def print_notes(notes: Iterable[str], about: str = "") -> None:
    """Print what a user should know about a result, each on a line `note: …` of stderr, so that the result stays as it is.

    Args:
        notes: of the result.
        about: the video, where a command works on several; it stands before each note.
    """
    sys.stdout.flush()
    for note in notes:
        print(f"note: {about and f'{about}: '}{note}", file=sys.stderr)


def check_outputs(inputs: Sequence[str], *outputs: tuple[str | None, tuple[str, ...]]) -> None:
    """Check files that are to be written, each with its possible endings: none of them is an input or another one."""
    taken = [*inputs]
    for path, suffixes in outputs:
        if path is not None:
            check_output(path, suffixes, taken)
            taken.append(path)


def is_scene(path: str) -> bool:
    """Whether a file is a saved scene by its name, and not a video."""
    return Path(path).suffix == ".json"


def refuse_for_scene(options: Any) -> None:
    """Refuse what is set about videos and dynamics where a saved scene is given."""
    from nsdr.pipeline_config import idle_without_video

    about = f"{options.video} is a saved scene: "
    refuse_idle(options, ("dynamics", "force", "background", "fps"), "", about)
    idle = idle_without_video(options.config, options.set)
    if idle:
        raise DataError(f"{about}{', '.join(idle)} would do nothing; leave it out")


def failures_line(failed: int, total: int, what: str, example: str, keep_going: bool) -> int:
    """Print how much failed, if anything, as the last line; return the exit status.

    Args:
        failed, total: numbers of things.
        what: what they are, in the plural.
        example: one of them, with what went wrong.
        keep_going: whether the status is 0 in spite of failures.
    """
    if not failed:
        return 0
    line = failed_text(failed, total, what, " ".join(example.split()))
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

"""What several commands share."""

import sys
from pathlib import Path
from typing import Any

from nsdr.errors import DataError
from nsdr.types import Scene

__all__ = ["check_port", "is_scene", "load_scene", "make_pipeline", "question_parser", "settings_of"]

MAX_PORT = 65535


def check_port(port: int) -> None:
    """Refuse a TCP port that there is not."""
    if not 1 <= port <= MAX_PORT:
        raise DataError(f"--port {port}: expected 1 to {MAX_PORT}")


def settings_of(options: Any) -> Any:
    """The `PipelineConfig` of the command's options."""
    from nsdr.pipeline import pipeline_settings

    overrides = list(options.set)
    if options.force:
        overrides.append("video.check=warn")
    if options.background:
        overrides.append(f"video.background={options.background}")
    return pipeline_settings(options.config, options.dynamics, overrides, getattr(options, "stride", 1))


def make_pipeline(options: Any) -> Any:
    """The pipeline of the command's options; it shows progress on a terminal.

    Raises:
        VideoError: the command's video is not one to be processed; mostly before the networks' libraries are loaded.
    """
    if not is_scene(options.video):
        _check_early(options)
    from nsdr.pipeline import Pipeline

    settings = settings_of(options)
    pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings, device=options.device)
    pipeline.progress = sys.stderr.isatty()
    return pipeline


def _check_early(options: Any) -> None:
    """Check the video within a second or two, unless what is expected of it stands in the settings of the pipeline.

    The settings take the networks' libraries, which take seconds; `Pipeline.perceive` checks in any case.
    """
    from nsdr.frame_parser.check.video import VideoConfig, check_video

    if not options.config and not any(value.startswith("video") for value in options.set):
        check_video(options.video, VideoConfig("warn" if options.force else "refuse", options.background))


def is_scene(path: str) -> bool:
    """Whether a file is a saved scene by its name, and not a video."""
    return Path(path).suffix in (".json", ".npz")


def question_parser(options: Any) -> Any:
    """The question parser of `--checkpoint`, or with the model of `--parser` in place of the networks.

    Raises:
        DataError: `--parser-model` without `--parser`, or `--checkpoint` of a command that needs nothing else with it.
    """
    from nsdr.question_parser.auto import AutoParser

    if options.parser:
        from nsdr.question_parser.language_model import LanguageModelParser

        return AutoParser(LanguageModelParser(options.parser, options.parser_model), options.extensions)
    if options.parser_model:
        raise DataError("--parser-model is of --parser and would do nothing without it; leave it out")
    return AutoParser.from_pretrained(options.checkpoint, options.device, options.extensions)


def load_scene(path: str) -> Scene:
    """A scene saved by `nsdr parse-video`."""
    from nsdr.io import storage

    return storage.load(Scene, path)

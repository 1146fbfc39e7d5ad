"""What several commands share."""

import sys
from pathlib import Path
from typing import Any

from nsdr.errors import DataError, VideoError
from nsdr.types import Scene

__all__ = ["check_input", "endpoint_parser", "load_scene", "make_pipeline"]


def make_pipeline(options: Any) -> Any:
    """The pipeline of the command's options; it shows progress on a terminal."""
    from nsdr.pipeline import Pipeline, pipeline_settings

    settings = pipeline_settings(options.config, options.dynamics, options.set)
    pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings, device=options.device)
    pipeline.progress = sys.stderr.isatty()
    return pipeline


def endpoint_parser(options: Any) -> Any:
    """The question parser on the server of `--parser`, which is there; None without that option.

    Raises:
        DataError: `--parser-model` without `--parser`.
    """
    if not options.parser:
        if options.parser_model:
            raise DataError("--parser-model is of --parser and would do nothing without it; leave it out")
        return None
    from nsdr.question_parser.endpoint import EndpointParser

    return EndpointParser.connect(options.parser, options.parser_model)


def check_input(path: str) -> None:
    """Refuse a missing file or a folder before anything is loaded."""
    if not Path(path).is_file():
        what = "is a folder or a device; expected a file" if Path(path).exists() else "no such file"
        raise VideoError(f"{path}: {what}")


def load_scene(path: str) -> Scene:
    """A scene saved by `nsdr parse-video`."""
    from nsdr.io import storage

    return storage.load(Scene, path)

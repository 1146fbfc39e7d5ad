"""What several commands share."""

import sys
from typing import Any

from nsdr.types import Scene

__all__ = ["load_scene", "make_pipeline"]


def make_pipeline(options: Any) -> Any:
    """The pipeline of the command's options; it shows progress on a terminal."""
    from nsdr.pipeline import Pipeline, pipeline_settings

    settings = pipeline_settings(options.config, options.dynamics, options.set)
    pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings, device=options.device)
    pipeline.progress = sys.stderr.isatty()
    return pipeline


def load_scene(path: str) -> Scene:
    """A scene saved by `nsdr parse-video`."""
    from nsdr.io import storage

    return storage.load(Scene, path)

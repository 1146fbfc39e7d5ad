"""`nsdr serve`: the page to ask on."""

import math
from pathlib import Path
from typing import Any

from jsonargparse.typing import PositiveFloat, PositiveInt

from nsdr.cli.common import check_port, settings_of
from nsdr.errors import DataError
from nsdr.io.files import check_installed, find_files

__all__ = ["add_options", "serve"]

VIDEO_SUFFIXES = (".mp4",)
"""Endings of the clips to pick from."""


def add_options(parser: Any) -> None:
    """Add the options of `nsdr serve` to its parser."""
    add = parser.add_argument
    add("folder", nargs="?", default="", help="folder of clips (.mp4) to pick from; without it, the one of the package")
    add("--host", default="127.0.0.1", help="address to listen on; the default is seen by this machine only")
    add("--port", type=PositiveInt, default=7860, help="TCP port (default: 7860)")
    add("--max-seconds", type=PositiveFloat, default=20.0, help="longest clip that is taken (default: 20 s)")
    add("--max-megabytes", type=PositiveInt, default=50, help="largest upload (default: 50 MB)")


def serve(options: Any) -> int:
    """`nsdr serve`: listen until Ctrl-C."""
    check_port(options.port)
    if not math.isfinite(options.max_seconds):
        raise DataError(f"--max-seconds {options.max_seconds}: expected a finite number of seconds")
    files = _clips(options.folder)
    from nsdr.pipeline import Pipeline

    pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings_of(options), device=options.device)
    check_installed("gradio", "the page needs Gradio", "web")
    check_installed("av", "writing videos needs PyAV", "web")
    from nsdr.apps.clips import Clips
    from nsdr.apps.web import ServerConfig, serve as serve_page

    config = ServerConfig(options.host, options.port, options.max_megabytes)
    serve_page(Clips(pipeline, options.max_seconds), files, config, _say)
    return 0


def _say(address: str) -> None:
    print(f"{address} (Ctrl-C ends it)", flush=True)


def _clips(folder: str) -> dict[str, Path]:
    """The clips to pick from, by name."""
    if not folder:
        from nsdr.clevrer.example import VIDEO

        return {VIDEO.name: VIDEO}
    root = Path(folder)
    if not root.is_dir():
        raise DataError(f"{folder}: expected a folder of clips, found {'a file' if root.exists() else 'nothing'}")
    found = [path for path in find_files(root, "*") if path.suffix.lower() in VIDEO_SUFFIXES]
    if not found:
        raise DataError(f"{folder}: no .mp4 files in it; leave it out for the clip of the package")
    return {str(path.relative_to(root)): path for path in found}

"""`nsdr serve`, the page to ask on, and `nsdr mcp`, tools for agents."""

import math
from pathlib import Path
from typing import Any

from jsonargparse.typing import PositiveInt, restricted_number_type

from nsdr.cli.common import Command, make_pipeline, shared_options
from nsdr.errors import DataError
from nsdr.io.files import check_installed

Port = restricted_number_type("Port", int, [(">=", 1), ("<=", 65535)], docstring="int restricted to be from 1 to 65535")
Seconds = restricted_number_type("Seconds", float, [(">", 0), ("<", math.inf)], docstring="float restricted to be >0")


def serve_options(parser: Any) -> None:
    add = parser.add_argument
    add(
        "folder",
        nargs="?",
        default="",
        help="folder of clips (.mp4, .gif, .webp) to pick from; without it, the one of the package",
    )
    add("--host", default="127.0.0.1", help="address to listen on; the default is seen by this machine only")
    add("--port", type=Port, default=7860, help="TCP port (default: 7860)")
    add("--max-seconds", type=Seconds, default=20.0, help="longest clip that is taken (default: 20 s)")
    add("--max-megabytes", type=PositiveInt, default=50, help="largest upload (default: 50 MB)")
    shared_options(parser, "checkpoint", "pipeline", "video")


def serve(options: Any) -> int:
    """`nsdr serve`: listen until Ctrl-C."""
    files = _clips(options.folder)
    pipeline = make_pipeline(options)
    check_installed("gradio", "the page needs Gradio", "web")
    check_installed("av", "writing videos needs PyAV", "web")
    from nsdr.apps.clips import Clips
    from nsdr.apps.web import serve as serve_page

    def started(address: str) -> None:
        print(f"{address} (Ctrl-C ends it)", flush=True)

    clips = Clips(pipeline, options.max_seconds)
    serve_page(clips, files, started, options.host, options.port, options.max_megabytes)
    return 0


def _clips(folder: str) -> dict[str, Path]:
    """The clips to pick from, by name."""
    if not folder:
        from nsdr.clevrer.example import VIDEO

        return {VIDEO.name: VIDEO}
    from nsdr.io.decoding import SUFFIXES, find_videos

    root = _checked_folder(folder)
    found = find_videos(root)
    if not found:
        raise DataError(f"{folder}: no {', '.join(SUFFIXES)} files in it; leave it out for the clip of the package")
    return {str(path.relative_to(root)): path for path in found}


def _checked_folder(folder: str) -> Path:
    root = Path(folder)
    if not root.is_dir():
        raise DataError(f"{folder}: expected a folder of clips, found {'a file' if root.exists() else 'nothing'}")
    return root


def mcp_options(parser: Any) -> None:
    add = parser.add_argument
    add("folder", nargs="?", default=".", help="videos in it and below it can be named, and no other files")
    shared_options(parser, "checkpoint", "pipeline", "video")


def mcp(options: Any) -> int:
    """`nsdr mcp`: serve the Model Context Protocol (stdio) on the videos of a folder until it is ended."""
    from nsdr.apps.mcp import make_server

    folder = _checked_folder(options.folder)
    make_server(make_pipeline(options), folder).run()
    return 0


FUNCTIONS = {
    "mcp": Command(mcp, mcp_options),
    "serve": Command(serve, serve_options),
}
"""What runs the commands of this file."""

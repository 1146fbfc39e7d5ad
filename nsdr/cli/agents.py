"""`nsdr mcp`: tools for agents."""

from typing import Any

from jsonargparse.typing import PositiveInt

from nsdr.cli.common import check_port, settings_of
from nsdr.errors import DataError

__all__ = ["add_options", "mcp"]


def add_options(commands: Any) -> None:
    """Add the command; `commands.add(name, summary, …)` adds one."""
    summary = "tools for agents (Model Context Protocol) on a folder's videos"
    add = commands.add("mcp", summary, pipeline=True, videos=True).add_argument
    add("folder", nargs="?", default=".", help="videos in it and below it can be named, and no other files")
    add("--transport", default="stdio", choices=["stdio", "http"], help="http: streamable HTTP at /mcp")
    add("--host", default="", help="address of HTTP (default: 127.0.0.1, which can be reached from this machine only)")
    add("--port", type=PositiveInt, default=None, help="port of HTTP (default: 8000)")


def mcp(options: Any) -> int:
    """`nsdr mcp`: serve the Model Context Protocol on the videos of a folder until it is ended."""
    from nsdr.apps.mcp import check_folder, serve
    from nsdr.pipeline import Pipeline

    given = [f"--{name}" for name in ("host", "port") if getattr(options, name)]
    if options.transport != "http" and given:
        raise DataError(f"{' and '.join(given)} would do nothing without --transport http; add that, or leave it out")
    if options.port is not None:
        check_port(options.port)
    check_folder(options.folder)
    pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings_of(options), device=options.device)
    serve(pipeline, options.folder, options.transport, options.host or "127.0.0.1", options.port or 8000)
    return 0

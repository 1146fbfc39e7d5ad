"""An agent server: the pipeline as tools of the Model Context Protocol (https://modelcontextprotocol.io)."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import cv2

import nsdr
from nsdr.apps.agent_tools import AgentTools, AnswerView, Change, SceneView, SimulationView
from nsdr.errors import DataError, NsdrError
from nsdr.pipeline import Pipeline

__all__ = ["make_server", "serve"]

TRANSPORTS = {"stdio": "stdio", "http": "streamable-http"}
"""Names of the transports on the command line, and in the SDK."""
INSTRUCTIONS = """Tools that look at short videos of colliding objects (CLEVRER), answer questions about them, predict what
comes next, and simulate what would happen if something were different. Videos are named by their path in one folder.
Frames count from 0, 25 a second. Perceiving a video takes a few seconds the first time."""
P = ParamSpec("P")
R = TypeVar("R")


def make_server(pipeline: Pipeline, folder: str | Path) -> Any:
    """The server with the tools `perceive`, `ask`, `run_program`, `simulate` and `render_frame`, an `MCPServer` of the SDK.

    Args:
        pipeline: what looks and answers.
        folder: videos in it can be named, and no other files.

    Raises:
        DataError: the extra `mcp` is not installed, or there is no such folder.
    """
    try:
        from mcp.server.mcpserver import Image, MCPServer
        from mcp.server.mcpserver.exceptions import ToolError
    except ImportError as e:
        raise DataError("agents need the official SDK: pip install 'nsdr[mcp]'") from e
    tools = AgentTools(pipeline, folder)
    videos = ", ".join(tools.videos()[:20]) or "none"
    server = MCPServer(
        "nsdr", instructions=f"{INSTRUCTIONS}\nVideos: {videos}", version=nsdr.__version__, log_level="WARNING"
    )

    def tool(function: Callable[P, R]) -> Callable[P, R]:
        """Register a tool whose errors are messages for the agent."""

        @wraps(function)
        def run(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return function(*args, **kwargs)
            except NsdrError as e:
                raise ToolError(str(e)) from e

        server.tool()(run)
        return run

    @tool
    def perceive(video: str) -> SceneView:
        """Look at a video: its objects, events (entrances, exits, collisions), and collisions predicted after its end."""
        return tools.perceive(video)

    @tool
    def ask(video: str, question: str, choices: list[str] | None = None) -> AnswerView:
        """Ask in CLEVRER's English, such as "What color is the object that enters the scene?"; with choices, such as "What will
        happen if the red cube is removed?" with "The sphere and the cylinder collide". What is not understood is refused."""
        return tools.ask(video, question, choices or ())

    @tool
    def run_program(video: str, program: str, choice_programs: list[str] | None = None) -> AnswerView:
        """Run a CLEVRER program in postfix, such as "events objects filter_collision count"; the programs of a multiple-choice
        question end in belong_to and take choice programs."""
        return tools.run_program(video, program, choice_programs or ())

    @tool
    def simulate(video: str, changes: list[Change], from_frame: int = 0) -> SimulationView:
        """Simulate the video with changes at a frame, such as {"kind": "remove", "object": "red cube"} or {"kind": "set_mass",
        "object": "blue sphere", "factor": 2}, and say what happens differently, with probabilities."""
        return tools.simulate(video, changes, from_frame)

    @tool
    def render_frame(video: str, frame: int, changes: list[Change] | None = None, from_frame: int = 0) -> Image:
        """A picture of a frame of the video, with names; after its end, or with changes as of simulate, a rendered one."""
        image = tools.render_frame(video, frame, changes or (), from_frame)
        return Image(data=cv2.imencode(".png", image[..., ::-1])[1].tobytes(), format="png")

    return server


def serve(
    pipeline: Pipeline, folder: str | Path, transport: str = "stdio", host: str = "127.0.0.1", port: int = 8000
) -> None:
    """Run the server until it is ended.

    Args:
        pipeline, folder: as of `make_server`.
        transport: "stdio", for a program that starts this one, or "http" (streamable HTTP at `/mcp`).
        host, port: of HTTP.

    Raises:
        DataError: an unknown transport, or as of `make_server`.
    """
    if transport not in TRANSPORTS:
        raise DataError(f"transport is {transport!r}; expected one of {', '.join(TRANSPORTS)}")
    server = make_server(pipeline, folder)
    if transport == "stdio":
        server.run()
    else:
        server.run(TRANSPORTS[transport], host=host, port=port)

"""An agent server: the pipeline as tools of the Model Context Protocol (https://modelcontextprotocol.io)."""

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, asdict, dataclass, fields, replace
from functools import wraps
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

import nsdr
from nsdr.claims.narration import reasons
from nsdr.errors import DataError, NsdrError
from nsdr.io.files import find_files
from nsdr.pipeline import Pipeline
from nsdr.symbolic import format_tree
from nsdr.types import Add, Event, Freeze, Move, Remove, SceneObject, SetMass, SetVelocity
from nsdr.types.interventions import Intervention, intervention_text

__all__ = [
    "AgentTools",
    "AnswerView",
    "Change",
    "ChoiceView",
    "DifferenceView",
    "EventView",
    "SceneView",
    "SimulationView",
    "check_folder",
    "make_server",
    "serve",
]

TRANSPORTS = {"stdio": "stdio", "http": "streamable-http"}
"""Names of the transports on the command line, and in the SDK."""
INSTRUCTIONS = """Tools that look at short videos of colliding objects (CLEVRER), answer questions about them, predict what
comes next, and simulate what would happen if something were different. Videos are named by their path in one folder.
Frames count from 0, 25 a second. Perceiving a video takes a few seconds the first time."""
KINDS = {"remove": Remove, "set_mass": SetMass, "set_velocity": SetVelocity, "move": Move, "freeze": Freeze, "add": Add}
VIDEOS_NAMED = 20
"""Videos that a message names."""


@dataclass(frozen=True)
class Change:
    """One change of the scene. `kind` says which of the other fields it takes.

    - remove, freeze: `object`, by words that only one object has, such as "red cube"
    - set_mass: `object`, `factor`
    - set_velocity: `object`, and `vx` and `vy`, or `speed` and/or `direction` (degrees), or `factor`
    - move: `object`, and `x` and `y`, or `dx` and `dy`
    - add: `color`, `material`, `shape`, `x`, `y`; optional `vx`, `vy`, `yaw` (radians), `mass`

    x points towards the camera, y to the right of the image. Lengths are world units (an object is 0.4 wide), speeds world
    units per second of simulated time, of which a frame is 0.028 s (objects start with up to 3).
    """

    kind: Literal["remove", "set_mass", "set_velocity", "move", "freeze", "add"]
    object: str | None = None
    factor: float | None = None
    vx: float | None = None
    vy: float | None = None
    speed: float | None = None
    direction: float | None = None
    x: float | None = None
    y: float | None = None
    dx: float | None = None
    dy: float | None = None
    color: str | None = None
    material: str | None = None
    shape: str | None = None
    yaw: float | None = None
    mass: float | None = None

    def intervention(self) -> Intervention:
        """The change as the pipeline takes it.

        Raises:
            DataError: a field that the kind lacks or does not take, or a value that is impossible.
        """
        made = KINDS[self.kind]
        given = {name: value for name, value in asdict(self).items() if name != "kind" and value is not None}
        known = [f.name for f in fields(made)]
        if surplus := sorted(set(given) - set(known)):
            raise DataError(f"{self.kind} takes {', '.join(known)}, not {', '.join(surplus)}")
        if missing := [f.name for f in fields(made) if f.default is MISSING and f.name not in given]:
            raise DataError(f"{self.kind} needs {', '.join(missing)}")
        return made(**given)


@dataclass(frozen=True)
class EventView:
    """An event: "in", "out" or "collision", its frame (25 a second), the objects' names, and how probable a collision is; None
    where that is not known."""

    kind: str
    frame: int
    objects: list[str]
    probability: float | None = None


@dataclass(frozen=True)
class SceneView:
    """What was seen in a video: objects, events of the video, and collisions predicted after its last frame."""

    video: str
    n_frames: int
    objects: list[str]
    events: list[EventView]
    after_video: list[EventView]
    possible: list[EventView]


@dataclass(frozen=True)
class ChoiceView:
    """The judgement of a choice: "correct" or "wrong", how probable it is to be correct, why; or why there is none."""

    choice: str
    answer: str | None
    probability: float | None
    explanation: str
    error: str = ""


@dataclass(frozen=True)
class AnswerView:
    """An answer, how probable it is right, why, and the executed program. Multiple choice has `choices` and no `answer`."""

    answer: str | None
    probability: float | None
    explanation: str
    program: str
    choices: list[ChoiceView]


@dataclass(frozen=True)
class DifferenceView:
    """How an event differs: "no longer", "new" or "other frame" (then `before` is its frame in the video)."""

    difference: str
    event: EventView
    before: int | None


@dataclass(frozen=True)
class SimulationView:
    """What changes in a video, and after it, with the interventions."""

    interventions: list[str]
    from_frame: int
    differences: list[DifferenceView]
    events: list[EventView]


class AgentTools:
    """The tools on the videos of a folder; their docstrings are what agents read.

    Calls are done one after the other. What was perceived is kept as by the pipeline.

    Args:
        pipeline: answers.
        folder: videos in it and below it can be named, and no others.

    Raises:
        DataError: there is no such folder.
    """

    def __init__(self, pipeline: Pipeline, folder: str | Path) -> None:
        self._pipeline, self._folder, self._lock = pipeline, Path(folder).resolve(), Lock()
        check_folder(folder)

    def videos(self) -> list[str]:
        """Names of the folder's videos, as the tools take them."""
        return sorted(str(p.relative_to(self._folder)) for p in find_files(self._folder, "*.mp4"))

    def perceive(self, video: str) -> SceneView:
        """Look at a video: its objects, events (entrances, exits, collisions), and collisions predicted after its end."""
        with self._working():
            scene = self._pipeline.perceive(self._path(video)).scene
        uncertain = [d for d in scene.uncertain or () if d.removed is None]
        known = None if scene.uncertain is None else {d.event: d.probability for d in uncertain}
        unseen = scene.unseen or ()
        possible = [d.event for d in uncertain if d.event not in {*scene.events, *unseen}]
        events = [[_event(e, scene.objects, known) for e in listed] for listed in (scene.events, unseen, possible)]
        return SceneView(video, scene.n_frames, [o.name for o in scene.objects], *events)

    def ask(self, video: str, question: str, choices: list[str] | None = None) -> AnswerView:
        """Ask in CLEVRER's English, such as "What color is the object that enters the scene?"; with choices, such as "What will
        happen if the red cube is removed?" with "The sphere and the cylinder collide". What is not understood is refused."""
        return self._answered(video, question=question, choices=choices or None)

    def run_program(self, video: str, program: str, choice_programs: list[str] | None = None) -> AnswerView:
        """Run a CLEVRER program in postfix, such as "events objects filter_collision count"; the programs of a multiple-choice
        question end in belong_to and take choice programs."""
        return self._answered(video, program=program, choice_programs=choice_programs or None)

    def simulate(self, video: str, changes: list[Change], from_frame: int = 0) -> SimulationView:
        """Simulate the video with changes at a frame, such as {"kind": "remove", "object": "red cube"} or {"kind": "set_mass",
        "object": "blue sphere", "factor": 2}, and say what happens differently, with probabilities."""
        with self._working():
            s = self._pipeline.simulate(self._path(video), [c.intervention() for c in changes], from_frame)
        known = s.probabilities
        differences = [
            DifferenceView(d.kind, replace(_event(d.event, s.objects, None), probability=d.probability), d.before)
            for d in s.differences()
        ]
        done = [intervention_text(change) for change in s.interventions]
        return SimulationView(done, s.from_frame, differences, [_event(e, s.objects, known) for e in s.events])

    def frame(
        self, video: str, frame: int, changes: Sequence[Change] | None = None, from_frame: int = 0
    ) -> NDArray[np.uint8]:
        """A frame: annotated; after the video, or with changes, as the simulator renders it. (H, W, 3) uint8 RGB."""
        from nsdr.generate.render.preview import render_motion
        from nsdr.generate.render.view import View
        from nsdr.visualize import annotated_image

        path = self._path(video)
        with self._working():
            perception = self._pipeline.perceive(path)
            n_frames = perception.scene.n_frames
            if 0 <= frame < n_frames and not changes:
                assert perception.tracks is not None
                image = next(islice(self._pipeline.frames(path), frame, None))
                return annotated_image(image, frame, perception.proposals, perception.tracks, perception.scene)
            # of the video as it is, the simulator knows what follows
            made = [c.intervention() for c in changes] if changes else [SetMass(0, 1.0)]
            s = self._pipeline.simulate(path, made, from_frame if changes else 0)
            last = s.changed.location_world.shape[1] - 1
            if not 0 <= frame <= last:
                raise DataError(f"frame {frame}: expected 0 to {last}; the video ends at {n_frames - 1}")
            shown = slice(frame, frame + 1)
            motion = s.changed.location_world[:, shown], s.changed_yaw[:, shown]
            return next(render_motion(s.objects, *motion, View(perception.camera)))

    @contextmanager
    def _working(self) -> Iterator[None]:
        with self._lock, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield

    def _answered(self, video: str, **asked: Any) -> AnswerView:
        path = self._path(video)
        with self._working():
            scene = self._pipeline.perceive(path).scene
            found = self._pipeline.answer(path, **asked)
        choices = [
            ChoiceView(c.choice, c.answer, c.probability, " ".join(reasons(c, scene)), c.error) for c in found.choices
        ]
        why = "" if choices else " ".join(reasons(found, scene))
        trace = format_tree(found.trace) if found.trace else " ".join(found.program)
        return AnswerView(found.answer, found.probability, why, trace, choices)

    def _path(self, video: str) -> Path:
        """The file of a video of the folder, by its name there; links that lie in the folder are followed."""
        names, name = self.videos(), os.path.normpath(video)
        if name in names:
            return self._folder / name
        more = f" and {len(names) - VIDEOS_NAMED} more" if len(names) > VIDEOS_NAMED else ""
        listed = ", ".join(names[:VIDEOS_NAMED]) or "none"
        raise DataError(f"{video!r} is no video of the folder; it has {listed}{more}")


def check_folder(folder: str | Path) -> None:
    """Raise a `DataError` unless the folder is there."""
    if not Path(folder).is_dir():
        raise DataError(f"{folder}: no such folder")


def _event(event: Event, objects: Sequence[SceneObject], known: Mapping[Event, float] | None) -> EventView:
    """An event with its probability: 1 for collisions that are certain, None where no probability is known."""
    probability = known.get(event, 1.0) if event.kind == "collision" and known is not None else None
    return EventView(event.kind, event.frame, [objects[i].name for i in event.objects], probability)


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
    named = f"{INSTRUCTIONS}\nVideos: {', '.join(tools.videos()[:VIDEOS_NAMED]) or 'none'}"
    server = MCPServer("nsdr", instructions=named, version=nsdr.__version__, log_level="WARNING")

    def render_frame(video: str, frame: int, changes: list[Change] | None = None, from_frame: int = 0) -> Image:
        """A picture of a frame of the video, with names; after its end, or with changes as of simulate, a rendered one."""
        image = tools.frame(video, frame, changes, from_frame)
        return Image(data=cv2.imencode(".png", image[..., ::-1])[1].tobytes(), format="png")

    def with_messages(tool: Callable[..., Any]) -> Callable[..., Any]:
        """The tool, whose errors are messages for the agent."""

        @wraps(tool)
        def run(*args: Any, **kwargs: Any) -> Any:
            try:
                return tool(*args, **kwargs)
            except NsdrError as e:
                raise ToolError(str(e)) from e

        return run

    for tool in (tools.perceive, tools.ask, tools.run_program, tools.simulate, render_frame):
        server.tool()(with_messages(tool))
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

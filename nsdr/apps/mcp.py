"""An agent server: the pipeline as tools of the Model Context Protocol (https://modelcontextprotocol.io)."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from functools import partial, wraps
from pathlib import Path
from typing import Any, Literal

import nsdr
from nsdr.apps.strangers import check_asked, check_programs, without_folders
from nsdr.claims.narration import reasons
from nsdr.errors import DataError, MachineError, NsdrError
from nsdr.io.decoding import find_videos
from nsdr.pipeline import Pipeline
from nsdr.symbolic import format_tree
from nsdr.types import Add, Event, Freeze, Move, Remove, SceneObject, SetMass, SetVelocity
from nsdr.types.interventions import Intervention, intervention_text
from nsdr.world.world import World

INSTRUCTIONS = """Tools that look at short videos of colliding objects ({name}), answer questions about them, predict what
comes next, and simulate what would happen if something were different. Videos are named by their path in one folder.
Frames count from 0, {fps} a second. Perceiving a video takes a few seconds the first time. Events are "in", "out" and
"collision"; the probability of a collision is null where it is not known. "notes" say what makes a result doubtful, and how a
question was read. Objects are {width} world units wide, such as the {example}, and start with up to {speed:g} world units per
second of simulated time, of which a frame is {seconds:g} s."""
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

    x points towards the camera, y to the right of the image. Lengths are world units, speeds world units per second of
    simulated time; the server's instructions say how wide and fast objects are.
    """

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 (the SDK's name for it)

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


class AgentTools:
    """The tools on the videos of a folder; their docstrings are what agents read.

    Only one may be called at a time. What was perceived is kept by the pipeline.

    Args:
        pipeline: answers.
        folder: videos in it and below it can be named, and no others.
    """

    def __init__(self, pipeline: Pipeline, folder: str | Path) -> None:
        self._pipeline, self._folder = pipeline, Path(folder).resolve()

    def videos(self) -> list[str]:
        """Names of the folder's videos, as the tools take them."""
        return sorted(str(p.relative_to(self._folder)) for p in find_videos(self._folder))

    def perceive(self, video: str) -> dict[str, Any]:
        """Look at a video: its objects, its events (entrances, exits, collisions), the collisions predicted after its end, and
        those that are only possible."""
        scene = self._pipeline.perceive(self._path(video)).scene
        uncertain = [d for d in scene.uncertain or () if d.removed is None]
        known = None if scene.uncertain is None else {d.event: d.probability for d in uncertain}
        predicted = scene.predicted or ()
        possible = [d.event for d in uncertain if d.event not in {*scene.events, *predicted}]
        listed = {"events": scene.events, "after_video": predicted, "possible": possible}
        return {
            "video": video,
            "n_frames": scene.n_frames,
            "objects": [o.name for o in scene.objects],
            **{name: [_event(e, scene.objects, known) for e in events] for name, events in listed.items()},
            "notes": list(scene.notes),
        }

    def ask(self, video: str, question: str, choices: list[str] | None = None) -> dict[str, Any]:
        """Ask in CLEVRER's English, such as "What color is the object that enters the scene?"; with choices, such as "What will
        happen if the red cube is removed?" with "The sphere and the cylinder collide". What is not understood is refused."""
        check_asked(question, choices or ())
        return self._answered(video, question=question, choices=choices or None)

    def run_program(self, video: str, program: str, choice_programs: list[str] | None = None) -> dict[str, Any]:
        """Run a CLEVRER program in postfix, such as "events objects filter_collision count"; the programs of a multiple-choice
        question end in belong_to and take choice programs."""
        check_programs(program, choice_programs or ())
        return self._answered(video, program=program, choice_programs=choice_programs or None)

    def simulate(self, video: str, changes: list[Change], from_frame: int = 0) -> dict[str, Any]:
        """Simulate the video with changes at a frame, such as {"kind": "remove", "object": "red cube"} or {"kind": "set_mass",
        "object": "blue sphere", "factor": 2}, and say what happens differently ("no longer", "new", or "other frame" than the
        one `before`), with probabilities."""
        s = self._pipeline.simulate(self._path(video), [c.intervention() for c in changes], from_frame)
        differences = [
            {
                "difference": d.kind,
                "event": {**_event(d.event, s.objects, None), "probability": d.probability},
                "before": d.before,
            }
            for d in s.differences()
        ]
        return {
            "interventions": [intervention_text(change) for change in s.interventions],
            "from_frame": s.from_frame,
            "differences": differences,
            "events": [_event(e, s.objects, s.probabilities) for e in s.events],
            "notes": list(s.notes),
        }

    def _answered(self, video: str, **asked: Any) -> dict[str, Any]:
        """The answer or the judged choices, how probable and why, and the executed program."""
        path = self._path(video)
        scene = self._pipeline.perceive(path).scene
        found = self._pipeline.answer(path, **asked)
        choices = [
            {
                "choice": c.choice,
                "answer": c.answer,
                "probability": c.probability,
                "explanation": " ".join(reasons(c, scene)) if c.trace or c.error else "",
                "error": c.error,
            }
            for c in found.choices
        ]
        return {
            "answer": found.answer,
            "probability": found.probability,
            "explanation": " ".join(reasons(found, scene)) if found.trace else "",
            "program": format_tree(found.trace) if found.trace else " ".join(found.program),
            "choices": choices,
            "notes": list(found.notes),
        }

    def _path(self, video: str) -> Path:
        """The file of a video of the folder, by its name there; links that lie in the folder are followed."""
        names, name = self.videos(), os.path.normpath(video)
        if name in names:
            return self._folder / name
        more = f" and {len(names) - VIDEOS_NAMED} more" if len(names) > VIDEOS_NAMED else ""
        listed = ", ".join(names[:VIDEOS_NAMED]) or "none"
        raise DataError(f"{video!r} is no video of the folder; it has {listed}{more}")


def _event(event: Event, objects: Sequence[SceneObject], known: Mapping[Event, float] | None) -> dict[str, Any]:
    """An event with its probability: 1 for collisions that are certain, None where no probability is known."""
    probability = known.get(event, 1.0) if event.kind == "collision" and known is not None else None
    names = [objects[i].name for i in event.objects]
    return {"kind": event.kind, "frame": event.frame, "objects": names, "probability": probability}


def instructions_for(world: World) -> str:
    """`INSTRUCTIONS` with the numbers of a world."""
    widths = sorted({f"{2 * shape.half_width_world:g}" for shape in world.vocabulary.shapes}, key=float)
    return INSTRUCTIONS.format(
        name=world.name,
        fps=world.timeline.fps,
        width=" to ".join(widths[:: max(len(widths) - 1, 1)]),
        example=world.vocabulary.example,
        speed=world.physics.start_speed_world_per_s[1],
        seconds=world.physics.frame_seconds,
    )


def make_server(pipeline: Pipeline, folder: str | Path) -> Any:
    """The server with the tools `perceive`, `ask`, `run_program` and `simulate`, an `MCPServer` of the SDK.

    Args:
        pipeline: what looks and answers.
        folder: videos in it can be named, and no other files.

    Raises:
        DataError: the extra `mcp` is not installed.
    """
    try:
        import anyio
        from mcp.server.mcpserver import MCPServer
        from mcp.server.mcpserver.exceptions import ToolError
        from mcp.server.mcpserver.tools import Tool
    except ImportError as e:
        raise DataError("agents need the official SDK: pip install 'nsdr[mcp]'") from e
    tools, one = AgentTools(pipeline, folder), anyio.CapacityLimiter(1)
    named = f"{instructions_for(pipeline.world)}\nVideos: {', '.join(tools.videos()[:VIDEOS_NAMED]) or 'none'}"

    def tool(function: Callable[..., Any]) -> Tool:
        """The tool of a function. Its errors are messages for the agent, and it refuses arguments that it does not know.

        Calls run one after the other. One that is cancelled while it waits never runs.
        """

        @wraps(function)
        async def run(**arguments: Any) -> Any:
            try:
                return await anyio.to_thread.run_sync(partial(function, **arguments), limiter=one)
            except (NsdrError, MachineError) as e:
                raise ToolError(without_folders(str(e))) from e

        made = Tool.from_function(run)
        made.fn_metadata.arg_model.model_config["extra"] = "forbid"
        made.fn_metadata.arg_model.model_rebuild(force=True)
        made.parameters = made.fn_metadata.arg_model.model_json_schema(by_alias=True)
        return made

    listed = [tool(function) for function in (tools.perceive, tools.ask, tools.run_program, tools.simulate)]
    return MCPServer("nsdr", instructions=named, version=nsdr.__version__, log_level="WARNING", tools=listed)

"""`nsdr simulate`: what would happen in a video with an object removed, heavier, faster, elsewhere, fixed or added."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jsonargparse.typing import NonNegativeInt, PositiveInt

from nsdr.cli.common import (
    VIDEO,
    Command,
    check_outputs,
    frames_of,
    is_scene,
    make_pipeline,
    print_notes,
    settings_of,
    shared_options,
)
from nsdr.dynamics.interventions import check_changes
from nsdr.errors import DataError, NsdrError
from nsdr.io.files import check_installed, write_json
from nsdr.types import Add, Event, Freeze, Move, Remove, SetMass, SetVelocity, Simulation
from nsdr.types.interventions import Intervention
from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import World

PLACE, PLACE_AND_VELOCITY = 2, 4
"""Numbers after an object of `--add`."""
ID_DIGITS = 9
"""Longest text that is read as an id (characters)."""
DECIMALS = 3
"""Decimals of positions (world units) in JSON."""
WORDS = 3
"""Words of an added object: color, material and shape."""


def simulate_options(parser: Any) -> None:
    add = parser.add_argument
    add("video", help=VIDEO)
    words = "words of the video's world, such as CLEVRER's 'red cube', or an id; repeatable"
    add("--remove", action="append", default=[], metavar="OBJECT", help=words)
    add("--mass", action="append", default=[], metavar="OBJECT=FACTOR", help="'blue sphere=2': twice as heavy")
    velocity = (
        "'red cube=1.5,0': velocity towards the camera and to the right (world units/s); 'red cube=x2': twice as fast"
    )
    add("--velocity", action="append", default=[], metavar="OBJECT=VX,VY", help=velocity)
    place = "'red cube=0.5,-1': position towards the camera and to the right of the middle (world units)"
    add("--move", action="append", default=[], metavar="OBJECT=X,Y", help=place)
    add("--shift", action="append", default=[], metavar="OBJECT=DX,DY", help="'red cube=0,0.4': from where it is")
    add("--freeze", action="append", default=[], metavar="OBJECT", help="stop an object and fix it to the ground")
    new = "'red metal cube=1,0' or 'red metal cube=1,0,-2,0': a new object with its position, and its velocity"
    add("--add", action="append", default=[], metavar="OBJECT=X,Y[,VX,VY]", help=new)
    add(
        "--from-frame", type=NonNegativeInt, default=0, help="frame of the video at which all this happens (default: 0)"
    )
    frames = "number of frames to simulate from the video's start on (default: to the world's horizon; 180 for CLEVRER)"
    add("--frames", type=PositiveInt, default=None, help=frames)
    output = (
        "file to write, repeatable: .mp4 with the original and the changed world side by side, or .json as of --json"
    )
    add("-o", "--output", action="append", default=[], metavar="FILE", help=output)
    add("--json", action="store_true", help="print events, probabilities and positions as JSON")
    shared_options(parser, "checkpoint", "pipeline", "video")


def simulate(options: Any) -> int:
    """`nsdr simulate`: what differs in a video with interventions, printed, as a video and as JSON."""
    check_outputs([options.video], *((path, (".mp4", ".json")) for path in options.output))
    videos, documents = ([p for p in options.output if Path(p).suffix == ending] for ending in (".mp4", ".json"))
    if videos:
        check_installed("av", "writing videos needs PyAV", "visualize")
    if is_scene(options.video):
        raise DataError(f"{options.video}: is a saved scene, to which no simulator was fitted; give the video")
    world = settings_of(options).world
    interventions = _interventions(options, world)
    if not interventions:
        raise DataError("no intervention: expected --remove, --mass, --velocity, --move, --shift, --freeze or --add")
    if options.from_frame:
        _check_frame(options.video, options.from_frame, options.fps, world.timeline.fps)
    pipeline = make_pipeline(options, asks=False)
    simulation = pipeline.simulate(options.video, interventions, options.from_frame, options.frames)
    if options.json:
        print(json.dumps(_document(simulation)))
    else:
        print(simulation)
        print_notes(simulation.notes)
    for path in documents:
        write_json(path, _document(simulation))
    if videos:
        from nsdr.apps.comparison import write_comparison

        frames = list(frames_of(pipeline, options.video))
        for path in videos:
            write_comparison(path, frames, simulation)
    for path in () if options.json else options.output:
        print(path)
    return 0


def _interventions(options: Any, world: World) -> list[Intervention]:
    def named(text: str) -> str | int:
        return _object(text, world.vocabulary)

    def each(name: str, make: Callable[[str], Intervention]) -> Iterator[Intervention]:
        for text in options[name]:
            try:
                change = make(text)
                check_changes([change], world)
                yield change
            except NsdrError as e:
                raise DataError(f"--{name} {text}: {e}") from e

    return [
        *each("remove", lambda text: Remove(named(text))),
        *each("mass", lambda text: SetMass(named(_name(text)), *_numbers(text, 1))),
        *each("velocity", lambda text: _velocity(text, named)),
        *each("move", lambda text: Move(named(_name(text)), *_numbers(text, PLACE))),
        *each("shift", lambda text: Move(named(_name(text)), None, None, *_numbers(text, PLACE))),
        *each("freeze", lambda text: Freeze(named(text))),
        *each("add", lambda text: _added(text, world.vocabulary)),
    ]


def _check_frame(video: str, frame: int, fps: float, rate: int) -> None:
    """Refuse a frame after the video's end by its header, before it is looked at; the simulation checks exactly."""
    from nsdr.io.video import video_seconds

    frames = round(video_seconds(video, fps) * rate)
    if frames and frame > frames:
        raise DataError(f"--from-frame {frame}: expected a frame of {video}, which has {frames} at {rate} a second")


def _object(text: str, vocabulary: Vocabulary) -> str | int:
    """Words or an id; words that no object has are refused before the video is looked at."""
    if text.strip().isdecimal() and len(text) <= ID_DIGITS:
        return int(text)
    words = set(text.lower().removeprefix("the ").split())
    of_each = [words & set(known) for known in vocabulary.words.values()]
    if not words or sum(map(len, of_each)) < len(words) or max(map(len, of_each)) > 1:
        raise DataError(f"expected the words of one object, such as {vocabulary.example!r}, or its id")
    return text


def _name(text: str) -> str:
    """What stands before the equals sign."""
    return text.partition("=")[0]


def _numbers(text: str, *counts: int) -> list[float]:
    """The numbers behind the equals sign."""
    values = text.partition("=")[2].split(",")
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        expected = " or ".join(str(count) for count in counts)
        raise DataError(f"expected OBJECT={'NUMBER' if counts == (1,) else f'{expected} numbers with commas'}")
    return numbers


def _velocity(text: str, named: Callable[[str], str | int]) -> SetVelocity:
    name, _, value = text.partition("=")
    if value.startswith("x"):
        return SetVelocity(named(name), factor=_numbers(f"={value[1:]}", 1)[0])
    return SetVelocity(named(name), *_numbers(text, PLACE))


def _added(text: str, vocabulary: Vocabulary) -> Add:
    words = _name(text).split()
    if len(words) != WORDS:
        raise DataError(f"expected color, material and shape, such as '{vocabulary.example}=1,0'")
    color, material, shape = words
    return Add(color, material, shape, *_numbers(text, PLACE, PLACE_AND_VELOCITY))


def _document(s: Simulation) -> dict[str, Any]:
    """Events, probabilities and positions of a simulation."""
    known = s.probabilities

    def row(event: Event) -> dict[str, Any]:
        content: dict[str, Any] = {"kind": event.kind, "frame": event.frame, "objects": list(event.objects)}
        if known is not None and event in known:
            content["probability"] = known[event]
        return content

    def positions(location: Any) -> list[Any]:
        return [
            [None if x != x else [round(x, DECIMALS), round(y, DECIMALS)] for x, y in path]
            for path in location.tolist()
        ]

    possible = [] if known is None else [row(e) for e in known if e not in s.events]
    return {
        "from_frame": s.from_frame,
        "n_frames": s.n_frames,
        "interventions": [{"type": type(c).__name__, **asdict(c)} for c in s.interventions],
        "objects": [asdict(o) for o in s.objects],
        "original_events": [{k: v for k, v in row(e).items() if k != "probability"} for e in s.original_events],
        "events": [row(e) for e in s.events],
        "possible_events": possible,
        "original_location_world": positions(s.original.location_world),
        "location_world": positions(s.changed.location_world),
        "notes": list(s.notes),
    }


FUNCTIONS = {
    "simulate": Command(simulate, simulate_options),
}
"""What runs the commands of this file."""

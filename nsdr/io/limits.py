"""Limits on what is read, so that a damaged or hostile file ends in an error and not in exhausted memory.

The limits are far above everything in CLEVRER. The environment variable `NSDR_LIMITS`, such as `frames=20000,json_bytes=4e9`,
changes them, also for worker processes.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache

from nsdr.errors import DataError

VARIABLE = "NSDR_LIMITS"
"""Environment variable with changed limits."""


@dataclass(frozen=True)
class Limits:
    """The largest values that are accepted.

    Attributes:
        json_bytes: size of a JSON file, decompressed (the largest official file, the training questions, has 0.2 GB).
        array_bytes: size of all arrays of an NPZ file, decompressed (the proposals of 8,664 videos have 0.1 GB).
        yaml_bytes: size of a configuration file.
        weights_bytes: size of a part's weights.
        frames: frames of a video (CLEVRER: 128), and the last frame of a prediction.
        image_pixels: pixels of a frame (CLEVRER: 153,600).
        video_pixels: pixels of all frames that a video's file holds (CLEVRER: 19,660,800; 20 s of 1920x1080 at 60 frames a
            second: 2,488,320,000).
        frame_objects: detections in a frame (CLEVRER: at most 10).
        scene_objects: objects of a scene (CLEVRER: at most 8).
        events: events of a scene.
        videos: videos that a manifest lists (CLEVRER: 20,000).
        program_tokens: tokens of a program (CLEVRER: at most 20).
        text_characters: characters of a question or choice.
    """

    json_bytes: int = 500_000_000
    array_bytes: int = 2_000_000_000
    yaml_bytes: int = 1_000_000
    weights_bytes: int = 4_000_000_000
    frames: int = 10_000
    image_pixels: int = 10_000_000
    video_pixels: int = 3_000_000_000
    frame_objects: int = 100
    scene_objects: int = 32
    events: int = 10_000
    videos: int = 1_000_000
    program_tokens: int = 1_000
    text_characters: int = 2_000


def limits() -> Limits:
    """The limits in force.

    Raises:
        DataError: `NSDR_LIMITS` names an unknown limit, or a value that is not a positive number.
    """
    return _parsed(os.environ.get(VARIABLE, ""))


@lru_cache(maxsize=8)
def _parsed(text: str) -> Limits:
    known = {f.name for f in fields(Limits)}
    changes = {}
    for part in filter(None, text.split(",")):
        name, _, value = part.strip().partition("=")
        try:
            changes[name] = int(float(value))
        except (ValueError, OverflowError):
            changes[name] = 0
        if name not in known or changes[name] < 1:
            raise DataError(f"limit {part!r}: expected NAME=NUMBER, with a name of {', '.join(sorted(known))}")
    return replace(Limits(), **changes)


def check_limit(value: float, name: str, what: object, error: Callable[[str], Exception] = DataError) -> None:
    """Refuse a value above the limit `name`.

    Args:
        value: the value that was found.
        name: a field of `Limits`.
        what: file and place, for the message.
        error: makes the exception from a message.

    Raises:
        DataError: the value is too large; names the limit and how to raise it.
    """
    highest = getattr(limits(), name)
    if value > highest:
        raise error(f"{what}: {value:,.0f} {name}, more than {highest:,}; if this is right, set {VARIABLE}={name}=…")

"""`semantics="official"`: what the released executor answers on its own prediction files, its quirks included.

All of its differences from the paper's semantics live here; the modules are the same.

Scene: objects are their exact attribute triples, others get no identity. MotionTable is known at samples (every 5 frames) only:
velocity is the mean of the available differences to the neighbouring samples, moving is faster than 0.1 grid units a frame.
The video ends at frame 125, where the difference ahead reaches into the prediction; for `null`, visibility looks at frames
below 128 but movement at the whole rollout. Objects enter at the first sample they are in and leave at the first they are not
in, without smoothing. Collisions are not deduplicated. What enters or leaves after the video never matches a filter. An object
is not responsible for an event by taking part in it. A counterfactual counts collisions at any frame.

Programs: `<START>` is skipped, `<END>` and `<NULL>` stop; unknown tokens are values that fit no module; the answer is the
top of the stack, what is left below is ignored; any failure gives the answer "error".
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from nsdr.clevrer.velocity_rule import GridPath, GridPosition, velocity_collisions
from nsdr.errors import DataError, ExecutionError
from nsdr.symbolic.world import MotionTable, World
from nsdr.types import Event, SceneObject
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["END_FRAME", "official_tokens", "official_world"]

START_TOKEN, STOP_TOKENS = "<START>", ("<END>", "<NULL>")
END_FRAME = 125
MOVING_GRID_PER_FRAME = 0.1
DIRECTIONS_DEGREES = {"left": 180.0, "right": 0.0, "up": 90.0, "down": -90.0}
"""Angle of (vx, vy) in the file's own x and y; tested in this order."""
DIRECTION_HALF_RANGE_DEGREES = 40.0


def official_tokens(source: Sequence[str]) -> list[str]:
    """The tokens that the released executor gets to see."""
    tokens: list[str] = []
    for token in source:
        if token in STOP_TOKENS:
            break
        if token != START_TOKEN:
            tokens.append(token)
    return tokens


def official_world(document: Mapping[str, Any], collisions: str = "predicted") -> World:
    """The world of a prediction file, by the released executor's rules.

    Args:
        document: content of `sim_N.json` (see `nsdr.clevrer.predictions`).
        collisions: "predicted", or "velocity" for the variant NE ("no events"), which finds them in the motion.

    Raises:
        DataError: a missing key, or another value of `collisions`.
    """
    if collisions not in ("predicted", "velocity"):
        raise DataError(f"collisions is {collisions!r}; expected predicted or velocity")
    try:
        objects = [SceneObject(i, o["color"], o["material"], o["shape"]) for i, o in enumerate(document["objects"])]
        ids = {(o.color, o.material, o.shape): o.id for o in objects}
        predictions = document["predictions"]
        paths, times = _paths(predictions[0], ids, len(objects))

        def found(prediction: Mapping[str, Any]) -> list[Event]:
            if collisions == "velocity":
                return velocity_collisions(_paths(prediction, ids, len(objects))[0])
            return _collisions(prediction, ids)

        happened = found(predictions[0])
        counterfactual = {p["what_if"]: found(p) for p in predictions[1:]}
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not a prediction file: {e!r}") from e
    shown = [t for t in times if t < VIDEO_FRAMES]
    observed = _entering_and_leaving(paths, shown) + [e for e in happened if e.frame < VIDEO_FRAMES]
    unseen = [e for e in happened if e.frame >= VIDEO_FRAMES]
    return World(
        objects,
        sorted(observed, key=lambda e: e.frame),
        sorted(unseen, key=lambda e: e.frame),
        counterfactual,
        end_frame=END_FRAME,
        motion=lambda: _motion(paths, shown, times),
        participants_are_responsible=False,
    )


def _paths(prediction: Mapping[str, Any], ids: Mapping[Any, int], n: int) -> tuple[list[GridPath], list[int]]:
    paths: list[GridPath] = [{} for _ in range(n)]
    times = []
    for sample in prediction["trajectory"]:
        time = sample["frame_index"]
        times.append(time)
        for o in sample["objects"]:
            i = ids.get((o["color"], o["material"], o["shape"]))
            if i is not None:
                paths[i][time] = (o["x"], o["y"])
    return paths, times


def _collisions(prediction: Mapping[str, Any], ids: Mapping[Any, int]) -> list[Event]:
    events = []
    for row in prediction["collisions"]:
        first, second = (ids.get((o["color"], o["material"], o["shape"]), -1) for o in row["objects"])
        if first >= 0 and second >= 0 and first != second:
            events.append(Event("collision", row["frame"], (min(first, second), max(first, second))))
    return events


def _entering_and_leaving(paths: Sequence[GridPath], times: Sequence[int]) -> list[Event]:
    events = []
    for i, path in enumerate(paths):
        for before, now in pairwise(times):
            if (now in path) != (before in path):
                events.append(Event("in" if now in path else "out", now, (i,)))
    return events


def _motion(paths: Sequence[GridPath], shown: Sequence[int], times: Sequence[int]) -> MotionTable:
    visible = dict.fromkeys(shown, 0)
    moving = dict.fromkeys(shown, 0)
    ever_visible = ever_moving = 0
    for i, path in enumerate(paths):
        bit = 1 << i
        for time in times:
            if time not in path:
                continue
            moves = _moves(path, time, times)
            if moves:
                ever_moving |= bit
            if time < VIDEO_FRAMES:
                ever_visible |= bit
                visible[time] |= bit
                moving[time] |= bit if moves else 0

    def direction(i: int, time: int) -> str:
        velocity = _velocity(paths[i], time, times) if time in paths[i] and time in visible else None
        if velocity is None or velocity == (0.0, 0.0):
            raise ExecutionError(f"no direction at frame {time}")
        angle = math.degrees(math.atan2(velocity[1], velocity[0]))
        for name, middle in DIRECTIONS_DEGREES.items():
            if abs((angle - middle + 180) % 360 - 180) <= DIRECTION_HALF_RANGE_DEGREES:
                return name
        raise ExecutionError(f"the direction at frame {time} is between two")

    return MotionTable(visible, moving, ever_visible, ever_moving & ever_visible, direction)


def _moves(path: GridPath, time: int, times: Sequence[int]) -> bool:
    velocity = _velocity(path, time, times)
    return velocity is not None and velocity[0] ** 2 + velocity[1] ** 2 > MOVING_GRID_PER_FRAME**2


def _velocity(path: GridPath, time: int, times: Sequence[int]) -> GridPosition | None:
    """Mean of the available differences to the samples before and after, in grid units a frame."""
    x, y = path[time]
    step = times[1] - times[0] if len(times) > 1 else 5
    before, after = path.get(time - step), path.get(time + step)
    if before is not None and after is not None:
        return (after[0] - before[0]) / (2 * step), (after[1] - before[1]) / (2 * step)
    if before is not None:
        return (x - before[0]) / step, (y - before[1]) / step
    if after is not None:
        return (after[0] - x) / step, (after[1] - y) / step
    return None

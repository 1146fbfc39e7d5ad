"""`semantics="official"`: the answers of the released executor on its own prediction files, including its quirks.

Both semantics share the program modules. Where the official one differs from the paper's:

- Objects are identified by exact attribute triples; rows with other triples are ignored.
- Motion is known only at the samples, every 5th frame. The velocity is the mean of the available differences to the
  neighbouring samples; an object moves when it is faster than 0.1 grid units per frame.
- The video ends at frame 125, whose forward difference uses a predicted sample. With `null`, visibility is tested on frames
  below 128, but motion on the whole rollout.
- Objects enter at the first sample that contains them and leave at the first that does not, without smoothing.
- Collisions are not deduplicated.
- Entrances and exits after the video never match a filter.
- Taking part in an event does not make an object responsible for it.
- A counterfactual counts collisions at any frame.
- In programs, `<START>` is skipped, and `<END>` and `<NULL>` end the program. Unknown tokens are values that fit no module.
  The answer is the top of the stack; values left below it are ignored. Any failure gives the answer "error".
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from nsdr.clevrer.predictions import SAMPLE_FRAMES
from nsdr.clevrer.velocity_rule import GridPath, GridPosition, velocity_collisions
from nsdr.errors import DataError, ExecutionError
from nsdr.symbolic.world import MotionTable, World
from nsdr.types import Event, SceneObject
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["END_FRAME", "official_tokens", "official_world"]

START_TOKEN = "<START>"
"""Token that the released executor skips."""
STOP_TOKENS = ("<END>", "<NULL>")
"""Tokens that end a program."""
END_FRAME = 125
"""Frame of the event `end`: the last sample of the video."""
MOVING_GRID_PER_FRAME = 0.1
"""Speed above which an object counts as moving (grid units per frame). Source: the released executor."""
DIRECTIONS_DEGREES = {"left": 180.0, "right": 0.0, "up": 90.0, "down": -90.0}
"""Angle of the velocity (vx, vy) in the file's x and y (degrees), tested in this order. Source: the released executor."""
DIRECTION_HALF_RANGE_DEGREES = 40.0
"""Largest angle between a velocity and its direction (degrees). Source: the released executor."""


def official_tokens(source: Sequence[str]) -> list[str]:
    """The tokens that the released executor runs: without the start token, up to the first stop token."""
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
        collisions: "predicted", or "velocity" for the variant NE ("no events"), which detects them from the motion.

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

        def collisions_of(prediction: Mapping[str, Any]) -> list[Event]:
            if collisions == "velocity":
                return velocity_collisions(_paths(prediction, ids, len(objects))[0])
            return _collisions(prediction, ids)

        factual = collisions_of(predictions[0])
        counterfactual = {p["what_if"]: collisions_of(p) for p in predictions[1:]}
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not a prediction file: {e!r}") from e
    shown = [t for t in times if t < VIDEO_FRAMES]
    observed = _enter_exit_events(paths, shown) + [e for e in factual if e.frame < VIDEO_FRAMES]
    unseen = [e for e in factual if e.frame >= VIDEO_FRAMES]
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


def _enter_exit_events(paths: Sequence[GridPath], times: Sequence[int]) -> list[Event]:
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
        for name, centre in DIRECTIONS_DEGREES.items():
            if abs((angle - centre + 180) % 360 - 180) <= DIRECTION_HALF_RANGE_DEGREES:
                return name
        raise ExecutionError(f"the direction at frame {time} is none of {', '.join(DIRECTIONS_DEGREES)}")

    return MotionTable(visible, moving, ever_visible, ever_moving & ever_visible, direction)


def _moves(path: GridPath, time: int, times: Sequence[int]) -> bool:
    velocity = _velocity(path, time, times)
    return velocity is not None and velocity[0] ** 2 + velocity[1] ** 2 > MOVING_GRID_PER_FRAME**2


def _velocity(path: GridPath, time: int, times: Sequence[int]) -> GridPosition | None:
    """Mean of the available differences to the samples before and after (grid units per frame)."""
    x, y = path[time]
    step = times[1] - times[0] if len(times) > 1 else SAMPLE_FRAMES
    before, after = path.get(time - step), path.get(time + step)
    if before is not None and after is not None:
        return (after[0] - before[0]) / (2 * step), (after[1] - before[1]) / (2 * step)
    if before is not None:
        return (x - before[0]) / step, (y - before[1]) / step
    if after is not None:
        return (after[0] - x) / step, (after[1] - y) / step
    return None

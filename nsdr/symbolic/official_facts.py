"""What the released executor knows of a prediction file: its events, motion and counterfactual collisions.

- Objects are identified by exact attribute triples. Rows with other triples are one unknown object, -1, whose events count.
- Motion is known only at the samples, every 5th frame. The velocity is the mean of the available differences to the
  neighbouring samples; an object moves when it is faster than 0.1 grid units per frame.
- The video ends at frame 125, whose forward difference uses a predicted sample. Without a frame, visibility is tested on
  frames below 128, but motion on the whole rollout.
- Objects enter at the first sample that contains them and leave at the first that does not, without smoothing. Objects that
  do so at the same sample keep the order in which the file lists them.
- Collisions are not deduplicated.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from nsdr.clevrer.files.predictions import SAMPLE_FRAMES, Described, Prediction, PredictionFile
from nsdr.clevrer.velocity_rule import GridPath, GridPosition, sampled_velocity, velocity_collisions
from nsdr.errors import DataError, ExecutionError
from nsdr.symbolic.causal import ancestor_sets
from nsdr.types import Event, SceneObject
from nsdr.world.world import CLEVRER_WORLD

VIDEO_FRAMES = CLEVRER_WORLD.timeline.frames
UNKNOWN_OBJECT = -1
"""Id of every object whose attribute triple is not listed."""
END_FRAME = 125
"""Frame of the event `end`: the last sample of the video."""
MOVING_GRID_PER_FRAME = 0.1
"""Speed above which an object counts as moving (grid units per frame). Source: the released executor."""
DIRECTIONS_DEGREES = {"left": -90.0, "right": 90.0, "up": 180.0, "down": 0.0}
"""Angle of the velocity (row, column) in degrees, tested in this order. Source: the released executor."""
DIRECTION_HALF_RANGE_DEGREES = 40.0
"""Largest angle between a velocity and its direction (degrees). Source: the released executor."""

Samples = list[tuple[int, dict[int, GridPosition]]]
"""Frame and grid positions by object id, in the order of the file, of each sample of a trajectory."""


@dataclass(frozen=True)
class OfficialEvent(Event):
    """An event as the released executor lists it.

    Attributes:
        kind: "start", "end", "in", "out" or "collision".
        frame: frame index; -1 for a possible event.
        objects: ids of the objects, ascending; -1 for unknown ones.
    """

    def __post_init__(self) -> None:
        """Nothing is checked, as this is not an event of a scene."""


class OfficialFacts:
    """Events and motion of one prediction file.

    Args:
        content: of `sim_N.json`.
        collisions: "predicted", or "velocity" for the variant NE ("no events"), which detects them from the motion.

    Attributes:
        objects: identities.
        all_objects: their ids.
        events: of the video, in order of time, with its start and end.
        unseen_events: after the video, in order of time.
        possible: the collision of each pair, without a frame.
        start, end: the first and last frame of the video, as events.

    Raises:
        DataError: another value of `collisions`.
    """

    def __init__(self, content: PredictionFile, collisions: str = "predicted") -> None:
        if collisions not in ("predicted", "velocity"):
            raise DataError(f"collisions: expected one of predicted, velocity, got {collisions!r}")
        self.objects = [SceneObject(i, *o.triple) for i, o in enumerate(content.objects)]
        self._ids = {o.triple: o.id for o in content.objects}
        observed, *others = content.predictions
        samples = self._samples(observed)
        self._paths = _paths(samples, len(self.objects))
        find = self._listed if collisions == "predicted" else self._detected
        factual = find(observed)
        self._counterfactual = {p.what_if: tuple(find(p)) for p in others}
        self._frames = {frame for frame, _ in samples}
        self.all_objects = tuple(range(len(self.objects)))
        self.possible = tuple(OfficialEvent("collision", -1, pair) for pair in combinations(self.all_objects, 2))
        self.start, self.end = OfficialEvent("start", 0, ()), OfficialEvent("end", END_FRAME, ())
        events = sorted([self.start, self.end, *_entrances_and_exits(samples), *factual], key=lambda e: e.frame)
        self.events = tuple(e for e in events if e.frame < VIDEO_FRAMES)
        self.unseen_events = tuple(e for e in events if e.frame >= VIDEO_FRAMES)

    def _identify(self, row: Described) -> int:
        return self._ids.get(row.triple, UNKNOWN_OBJECT)

    def _samples(self, prediction: Prediction) -> Samples:
        return [(s.frame_index, {self._identify(o): (o.x, o.y) for o in s.objects}) for s in prediction.trajectory]

    def _listed(self, prediction: Prediction) -> list[OfficialEvent]:
        rows = prediction.collisions
        return [OfficialEvent("collision", c.frame, tuple(sorted(map(self._identify, c.objects)))) for c in rows]

    def _detected(self, prediction: Prediction) -> list[OfficialEvent]:
        paths = _paths(self._samples(prediction), len(self.objects))
        return [OfficialEvent(e.kind, e.frame, e.objects) for e in velocity_collisions(paths, SAMPLE_FRAMES)]

    def object(self, one: int) -> SceneObject:
        """The object with an id."""
        if not 0 <= one < len(self.objects):
            raise ExecutionError(f"there is no object {one}")
        return self.objects[one]

    def frame_of(self, event: OfficialEvent) -> int:
        """Frame of an event of the video."""
        if event.frame < 0:
            raise ExecutionError(f"a possible {event.kind} has no frame")
        return event.frame

    def _speed(self, one: int, frame: int) -> float:
        return math.hypot(*sampled_velocity(self._paths[one], frame, SAMPLE_FRAMES))

    def in_motion(self, objects: Sequence[int], frame: int | None, wanted: bool) -> tuple[int, ...]:
        """Objects that are visible, and move or (`wanted` is False) rest, at a frame; with None, ever or never move."""
        if frame is not None and frame not in self._frames:
            raise ExecutionError(f"motion at frame {frame} is not known")
        found = []
        for i in objects:
            path = self._paths[self.object(i).id]
            visible = any(t < VIDEO_FRAMES for t in path) if frame is None else frame in path
            frames = path if frame is None else (frame,)
            if visible and any(self._speed(i, t) > MOVING_GRID_PER_FRAME for t in frames) == wanted:
                found.append(i)
        return tuple(found)

    def direction(self, one: int, frame: int | None) -> str:
        """Direction in which an object moves at a frame: left, right, up or down."""
        path = self._paths[self.object(one).id]
        if frame is None or frame not in path:
            raise ExecutionError(f"the {self.objects[one].name} has no position at frame {frame}")
        rows, columns = sampled_velocity(path, frame, SAMPLE_FRAMES)
        angle = math.degrees(math.atan2(columns, rows))
        for name, centre in DIRECTIONS_DEGREES.items():
            if (rows or columns) and abs((angle - centre + 180) % 360 - 180) <= DIRECTION_HALF_RANGE_DEGREES:
                return name
        raise ExecutionError(f"the direction at frame {frame} is none of {', '.join(DIRECTIONS_DEGREES)}")

    def causes(self, event: OfficialEvent) -> set[OfficialEvent]:
        """Direct and indirect causes of an observed event."""
        if event not in self.events:
            raise ExecutionError(f"the {event.kind} was not observed, so its causes are not known")
        return {self.events[i] for i in ancestor_sets(self.events)[self.events.index(event)]}

    def collisions_without(self, removed: int) -> tuple[OfficialEvent, ...]:
        """Collisions at any frame that happen without an object."""
        if removed not in self._counterfactual:
            raise ExecutionError(f"events without object {removed} are not known")
        return self._counterfactual[removed]

    def object_text(self, objects: Sequence[int]) -> str:
        """A set of objects in words."""
        known = range(len(self.objects))
        return "; ".join(self.objects[i].name if i in known else "unknown object" for i in objects) or "none"

    def event_text(self, events: Sequence[OfficialEvent]) -> str:
        """A set of events in words."""
        texts = []
        for e in events:
            names = " and ".join(self.object_text([i]) for i in e.objects)
            when = "" if e.frame < 0 else f"(frame {e.frame})"
            texts.append(" ".join(part for part in (names, e.kind, when) if part))
        return "; ".join(texts) or "none"


def _paths(samples: Samples, n: int) -> list[GridPath]:
    return [{frame: shown[i] for frame, shown in samples if i in shown} for i in range(n)]


def _entrances_and_exits(samples: Samples) -> list[OfficialEvent]:
    events = []
    for (_, before), (frame, now) in pairwise(samples):
        events += [OfficialEvent("in", frame, (i,)) for i in now if i not in before]
        events += [OfficialEvent("out", frame, (i,)) for i in before if i not in now]
    return events

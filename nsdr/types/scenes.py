"""What happens in a video: events, motion, and the scene that programs run on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from nsdr.errors import DataError
from nsdr.types.checks import ArrayHolder, BoolArray, FloatArray, check, check_values, check_whole, store_array
from nsdr.types.object_physics import ObjectPhysics
from nsdr.types.tracks import SceneObject, check_objects

__all__ = ["DynamicsPrediction", "Event", "Rollout", "Scene", "UncertainCollision"]

PARTICIPANTS = {"in": 1, "out": 1, "collision": 2}
"""Number of objects of each kind of event."""
NO_FRAME = -1
"""`Event.frame` of an event that is only possible. Rollouts and scenes hold events at frames only."""


@dataclass(frozen=True)
class Event:
    """Something that happens at one frame.

    Attributes:
        kind: "in" (enters the image), "out" (leaves it) or "collision".
        frame: frame index; at or beyond the video's length for unseen events, -1 for events that are only possible.
        objects: object ids: one for "in" and "out", two in ascending order for "collision".
    """

    kind: str
    frame: int
    objects: tuple[int, ...]

    def __post_init__(self) -> None:
        expected = PARTICIPANTS.get(self.kind)
        check(expected is not None, f"event kind {self.kind!r}: expected in, out or collision")
        check_whole("event", "frame", self.frame, NO_FRAME)
        for number in self.objects:
            check_whole("event", "objects", number, 0)
        if len(self.objects) != expected or (expected == 2 and self.objects[0] >= self.objects[1]):
            raise DataError(f"event {self.kind}: expected {expected} ascending object ids, got {self.objects}")


@dataclass(frozen=True)
class UncertainCollision:
    """A collision that is neither certain nor ruled out.

    Attributes:
        event: the collision, which is in the lists of its scene or rollout only if it is more probable than not.
        probability: that it happens, in 0-1.
        removed: id of the object without which it would happen; None for the video and what follows it.
    """

    event: Event
    probability: float
    removed: int | None = None

    def __post_init__(self) -> None:
        fits = self.event.kind == "collision" and self.event.frame >= 0
        check(fits, f"UncertainCollision.event: expected a collision at a frame, got {self.event}")
        check(0 <= self.probability <= 1, f"UncertainCollision.probability: expected 0 to 1, got {self.probability}")
        if self.removed is not None:
            check_whole("UncertainCollision", "removed", self.removed, 0)


@dataclass(frozen=True, eq=False, repr=False)
class Rollout(ArrayHolder):
    """Trajectories and collisions of all objects, either as observed and predicted or with one object removed.

    Attributes:
        location_world: (n_objects, F, 2) float, ground-plane positions (x, y) (world units); NaN where absent or unknown.
        visible: (n_objects, F) bool, whether the object is in the image.
        collisions: collision events in order of time.
        unseen_scores: (n_objects, n_objects) float in 0-1, symmetric: probability of a collision after the video, or None.
        speed_world_per_s: (n_objects, F) float, speed on the ground (world units/s), NaN or None where it is not known.
        uncertain: collisions of this rollout that are uncertain; None where nothing is known about that.
    """

    location_world: FloatArray
    visible: BoolArray
    collisions: tuple[Event, ...]
    unseen_scores: FloatArray | None = None
    speed_world_per_s: FloatArray | None = None
    uncertain: tuple[UncertainCollision, ...] | None = None

    def __post_init__(self) -> None:
        store_array(self, "location_world", (None, None, 2), "f")
        store_array(self, "visible", self.location_world.shape[:2], "b")
        if self.speed_world_per_s is not None:
            store_array(self, "speed_world_per_s", self.location_world.shape[:2], "f")
            check_values("Rollout", "speed_world_per_s", self.speed_world_per_s, 0, np.inf, nan=True)
        check_values("Rollout", "location_world", self.location_world, -np.inf, np.inf, nan=True)
        n = len(self.visible)
        if self.unseen_scores is not None:
            store_array(self, "unseen_scores", (n, n), "f")
            check_values("Rollout", "unseen_scores", self.unseen_scores, 0, 1)
        for event in (*self.collisions, *(d.event for d in self.uncertain or ())):
            fits = event.kind == "collision" and event.objects[1] < n and event.frame >= 0
            check(fits, f"Rollout: {event} is not a collision of two of the {n} objects at a frame")


@dataclass(frozen=True, eq=False, repr=False)
class DynamicsPrediction(ArrayHolder):
    """The dynamics predictor's output for one video.

    Attributes:
        objects: identities.
        n_frames: number of frames of the video; rollouts continue beyond it.
        observed: the rollout with all objects: the video and its continuation.
        counterfactual: rollouts with one object removed, by that object's id.
        physics: velocities during the video and masses; None where the backend does not know them.
    """

    objects: tuple[SceneObject, ...]
    n_frames: int
    observed: Rollout
    counterfactual: Mapping[int, Rollout] = field(default_factory=dict)
    physics: ObjectPhysics | None = None

    def __post_init__(self) -> None:
        check_objects("DynamicsPrediction", self.objects)
        check_whole("DynamicsPrediction", "n_frames", self.n_frames, 1)
        _check_removed("DynamicsPrediction", self.counterfactual, len(self.objects))
        for rollout in (self.observed, *self.counterfactual.values()):
            expected, got = len(self.objects), len(rollout.visible)
            check(got == expected, f"DynamicsPrediction: expected rollouts of {expected} objects, got {got}")
        _check_physics("DynamicsPrediction", self.physics, len(self.objects), self.n_frames)
        object.__setattr__(self, "counterfactual", MappingProxyType(dict(self.counterfactual)))


@dataclass(frozen=True, eq=False, repr=False)
class Scene(ArrayHolder):
    """The symbolic scene that programs run on.

    Attributes:
        objects: identities; attribute triples are unique.
        n_frames: number of frames of the video.
        visible: (n_objects, n_frames) bool, whether the object is in the image.
        moving: (n_objects, n_frames) bool, whether the object moves; None where motion is not known.
        events: observed events (enter, exit, collision) in order of time.
        unseen: collisions after the video; None where they are not known.
        counterfactual: collisions with one object removed, by that object's id; None where they are not known.
        unseen_scores: (n_objects, n_objects) float, as in `Rollout`; None for ground-truth scenes.
        dynamics: the trajectories that the scene was made from, which pictures show; None where they were not kept.
        uncertain: collisions that are uncertain: observed, unseen (those after the video) and counterfactual ones; None where
            nothing is known about that.
        physics: velocities and masses, for questions beyond CLEVRER; None where they are not known.
    """

    objects: tuple[SceneObject, ...]
    n_frames: int
    visible: BoolArray
    moving: BoolArray | None
    events: tuple[Event, ...]
    unseen: tuple[Event, ...] | None = None
    counterfactual: Mapping[int, tuple[Event, ...]] | None = None
    unseen_scores: FloatArray | None = None
    dynamics: DynamicsPrediction | None = None
    uncertain: tuple[UncertainCollision, ...] | None = None
    physics: ObjectPhysics | None = None

    def __post_init__(self) -> None:
        check_objects("Scene", self.objects)
        triples = [o.name for o in self.objects]
        repeated = sorted({name for name in triples if triples.count(name) > 1})
        check(not repeated, f"Scene: more than one {', '.join(repeated)}; attribute triples must be unique")
        n = len(self.objects)
        check_whole("Scene", "n_frames", self.n_frames, 1)
        if self.dynamics is not None:
            _check_dynamics(self, self.dynamics)
        store_array(self, "visible", (n, self.n_frames), "b")
        if self.moving is not None:
            store_array(self, "moving", (n, self.n_frames), "b")
        if self.unseen_scores is not None:
            store_array(self, "unseen_scores", (n, n), "f")
            check_values("Scene", "unseen_scores", self.unseen_scores, 0, 1)
        _check_removed("Scene", self.counterfactual or {}, n)
        _check_physics("Scene", self.physics, n, self.n_frames)
        for event in self.events:
            if event.frame >= self.n_frames:
                raise DataError(f"Scene.events: {event} is after the video's {self.n_frames} frames")
        counterfactual, uncertain = self.counterfactual or {}, self.uncertain or ()
        later = [*(self.unseen or ()), *(e for events in counterfactual.values() for e in events)]
        for event in [*self.events, *later, *(d.event for d in uncertain)]:
            if event.objects[-1] >= n or event.frame < 0:
                raise DataError(f"Scene: {event} names an object outside 0-{n - 1} or no frame")
        for one in uncertain:
            fits = one.removed is None or one.removed < n
            check(fits, f"Scene.uncertain: expected removed objects from 0 to {n - 1}, got {one.removed}")
        object.__setattr__(self, "events", _in_order(self.events))
        if self.unseen is not None:
            object.__setattr__(self, "unseen", _in_order(self.unseen))
        if self.counterfactual is not None:
            object.__setattr__(self, "counterfactual", MappingProxyType(dict(self.counterfactual)))


def _check_removed(owner: str, counterfactual: Mapping[int, object], n: int) -> None:
    for removed in counterfactual:
        check_whole(f"{owner}.counterfactual", "keys", removed, 0)
        check(removed < n, f"{owner}.counterfactual: expected object ids from 0 to {n - 1} as keys, got {removed}")


def _check_physics(owner: str, physics: ObjectPhysics | None, n: int, n_frames: int) -> None:
    if physics is not None:
        got = physics.velocity_world_per_s.shape[:2]
        check(got == (n, n_frames), f"{owner}.physics: expected {n} objects and {n_frames} frames, got {got}")


def _check_dynamics(scene: Scene, dynamics: DynamicsPrediction) -> None:
    same = dynamics.objects == scene.objects and dynamics.n_frames == scene.n_frames
    check(same, "Scene.dynamics: expected the same objects and number of frames as the scene's")
    for rollout in (dynamics.observed, *dynamics.counterfactual.values()):
        last = max([scene.n_frames - 1, *(e.frame for e in rollout.collisions)])
        n = rollout.location_world.shape[1]
        check(last < n, f"Scene.dynamics: expected positions until frame {last}, got {n} frames")


def _in_order(events: Sequence[Event]) -> tuple[Event, ...]:
    """Events sorted by frame; at the same frame, entrances and exits come before collisions."""
    return tuple(sorted(events, key=lambda e: (e.frame, e.kind == "collision")))

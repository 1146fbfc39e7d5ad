"""What happens in a video: events, motion, and the scene that programs run on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from nsdr.types.arrays import ArrayHolder
from nsdr.types.events import Event, event_sentence, in_order, visible_by
from nsdr.types.tracks import SceneObject, check_objects, check_words, find_object, object_of
from nsdr.validation import (
    Array,
    BoolArray,
    Checked,
    Count,
    FloatArray,
    NotNegative,
    PositiveCount,
    Share,
    expect,
)
from nsdr.world.camera import CLEVRER_CAMERA, Camera, on_ground
from nsdr.world.world import CLEVRER_WORLD, World

EventSource = Event | tuple[Any, ...]
"""An event, or its kind, frame and objects; see `Scene.of`."""


@dataclass(frozen=True)
class UncertainEvent(Checked):
    """An event that is neither certain nor ruled out: a collision, or an entrance or exit that is simulated.

    Attributes:
        event: the event, which is in the lists of its scene only if it is more probable than not.
        probability: that it happens, in 0-1.
        removed: id of the object without which it would happen; None for the video and what follows it.
    """

    event: Event
    probability: Share
    removed: Count | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        expect(self.event.frame >= 0, "UncertainEvent.event", "an event at a frame", self.event)


@dataclass(frozen=True, eq=False, repr=False)
class Rollout(ArrayHolder):
    """Trajectories and collisions of all objects, either as observed and predicted or with one object removed.

    Printed, it is its size and its collisions, with ids: a rollout knows no names.

    Attributes:
        location_world: (n_objects, F, 2) float, ground-plane positions (x, y) (world units); NaN where absent or unknown.
        visible: (n_objects, F) bool, whether the object is in the image.
        collisions: collision events in order of time.
        predicted_scores: (n_objects, n_objects) float in 0-1, symmetric: probability of a collision after the video, or None.
        speed_world_per_s: (n_objects, F) float, speed on the ground (world units/s), NaN or None where it is not known.
        uncertain: events of this rollout that are uncertain; None where nothing is known about that.
        yaw: (n_objects, F) float, rotation about the vertical axis (radians); None where it is not known.
    """

    location_world: Annotated[FloatArray, Array("n", "F", 2, nan=True)]
    visible: Annotated[BoolArray, Array("n", "F")]
    collisions: tuple[Event, ...]
    predicted_scores: Annotated[FloatArray, Array("n", "n", low=0, high=1)] | None = None
    speed_world_per_s: Annotated[FloatArray, Array("n", "F", low=0, nan=True)] | None = None
    uncertain: tuple[UncertainEvent, ...] | None = None
    yaw: Annotated[FloatArray, Array("n", "F")] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        n = len(self.visible)
        for event in self.collisions:
            fits = event.kind == "collision" and event.objects[1] < n and event.frame >= 0
            expect(fits, "Rollout.collisions", f"collisions of two of the {n} objects at a frame", event)
        for event in (d.event for d in self.uncertain or ()):
            expect(event.objects[-1] < n, "Rollout.uncertain", f"events of the {n} objects", event)

    def pixels(
        self, camera: Camera = CLEVRER_CAMERA, height_world: ArrayLike = CLEVRER_WORLD.vocabulary.shapes[0].height_world
    ) -> FloatArray:
        """Where the objects' centres are in the image: (n_objects, F, 2) float, (column, row) (pixels).

        They may lie outside of the image; NaN where the position is not known, or behind the camera.

        Args:
            camera: the camera that took the video.
            height_world: how high the centres are, for all objects or for each (n_objects,) (world units).
        """
        heights = np.broadcast_to(height_world, len(self.visible))
        return camera.pixels(on_ground(self.location_world, heights[:, None]))

    def __str__(self) -> str:
        n, frames = self.visible.shape
        names = [f"object {i}" for i in range(n)]
        return "\n".join([f"{frames} frames, {n} objects", *(f"  {event_sentence(e, names)}" for e in self.collisions)])


def yaws(rollout: Rollout) -> FloatArray:
    """(n, F) rotations about the vertical axis (radians), which are 0 where the rollout does not know them."""
    return np.zeros(rollout.visible.shape) if rollout.yaw is None else rollout.yaw


@dataclass(frozen=True, eq=False, repr=False)
class ObjectPhysics(ArrayHolder):
    """Velocities and relative masses of n objects, with their errors. Seconds are of simulated time: a frame of CLEVRER is
    0.028 s (`Physics.frame_seconds`).

    Attributes:
        velocity_world_per_s: (n, n_frames, 2) float, on the ground: towards the camera, and to the right of the image (world
            units/s); NaN where it is not known.
        velocity_error_world_per_s: standard deviation of each component (world units/s); 0 for true velocities.
        log_mass: (n,) float, natural logarithms of the masses, of which only ratios matter; None where they are not known.
        log_mass_covariance: (n, n) float, of the errors of `log_mass`; zeros for true masses; None without `log_mass`.
    """

    velocity_world_per_s: Annotated[FloatArray, Array("n", "F", 2, nan=True)]
    velocity_error_world_per_s: NotNegative
    log_mass: Annotated[FloatArray, Array("n")] | None = None
    log_mass_covariance: Annotated[FloatArray, Array("n", "n")] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        both = (self.log_mass is None) == (self.log_mass_covariance is None)
        expect(both, "ObjectPhysics", "log_mass and log_mass_covariance, or neither", "one of them")
        if self.log_mass_covariance is not None:
            lowest = float(np.diagonal(self.log_mass_covariance).min(initial=0.0))
            expect(lowest >= 0, "ObjectPhysics.log_mass_covariance", "variances from 0 on", lowest)


@dataclass(frozen=True, eq=False, repr=False)
class DynamicsPrediction(ArrayHolder):
    """The dynamics predictor's output for one video.

    Attributes:
        objects: identities.
        n_frames: number of frames of the video; rollouts continue beyond it.
        observed: the rollout with all objects: the video and its continuation.
        counterfactual: rollouts with one object removed, by that object's id.
        physics: velocities during the video and masses; None where the backend does not know them.
        world: the world that the video is of.
    """

    objects: tuple[SceneObject, ...]
    n_frames: PositiveCount
    observed: Rollout
    counterfactual: Mapping[Count, Rollout] = field(default_factory=dict)
    physics: ObjectPhysics | None = None
    world: World = CLEVRER_WORLD

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_common("DynamicsPrediction", self)
        for rollout in (self.observed, *self.counterfactual.values()):
            n, found = len(self.objects), len(rollout.visible)
            expect(found == n, "DynamicsPrediction", f"rollouts of {n} objects", found)
        object.__setattr__(self, "counterfactual", MappingProxyType(dict(self.counterfactual)))


@dataclass(frozen=True, eq=False, repr=False)
class Scene(ArrayHolder):
    """The symbolic scene that programs run on. Printed, it is its objects and its events, a line for each.

    Attributes:
        objects: identities; attribute triples are unique.
        n_frames: number of frames of the video.
        visible: (n_objects, n_frames) bool, whether the object is in the image.
        moving: (n_objects, n_frames) bool, whether the object moves; None where motion is not known.
        events: observed events (enter, exit, collision) in order of time.
        predicted: events after the video; None where they are not known.
        counterfactual: events with one object removed, by that object's id; None where they are not known.
        predicted_scores: (n_objects, n_objects) float, as in `Rollout`; None for ground-truth scenes.
        dynamics: the trajectories that the scene was made from, which pictures show; None where they were not kept.
        uncertain: events that are uncertain: observed collisions, events after the video, and counterfactual ones; None where
            nothing is known about that.
        physics: velocities and masses, for questions beyond CLEVRER; None where they are not known.
        existence: (n_objects,) float, how probable it is that each object is there, in a scene that was perceived: one whose
            events may be a frame off. None for true scenes.
        motion_px: (n_objects, 2) float, how far each object's centre moves in the image from its first visible frame to its
            last, to the right and down (pixels); NaN for an object that is never visible; None where it is not known.
        notes: what a user should know about the video and how it was perceived, one sentence each. Answers about the scene
            carry them, too.
        collisions_only: whether `unseen` and `counterfactual` hold collisions only, as CLEVRER's questions need, so that
            entrances and exits after the video or with an object removed are not known.
        world: the world that the video is of.
    """

    objects: tuple[SceneObject, ...]
    n_frames: PositiveCount
    visible: Annotated[BoolArray, Array("objects", "n_frames")]
    moving: Annotated[BoolArray, Array("objects", "n_frames")] | None
    events: tuple[Event, ...]
    predicted: tuple[Event, ...] | None = None
    counterfactual: Mapping[Count, tuple[Event, ...]] | None = None
    predicted_scores: Annotated[FloatArray, Array("objects", "objects", low=0, high=1)] | None = None
    dynamics: DynamicsPrediction | None = None
    uncertain: tuple[UncertainEvent, ...] | None = None
    physics: ObjectPhysics | None = None
    existence: Annotated[FloatArray, Array("objects", low=0, high=1)] | None = None
    motion_px: Annotated[FloatArray, Array("objects", 2, nan=True)] | None = None
    notes: tuple[str, ...] = ()
    collisions_only: bool = True
    world: World = CLEVRER_WORLD

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_common("Scene", self)
        n, names = len(self.objects), [o.name for o in self.objects]
        expect(len(set(names)) == n, "Scene.objects", "unique attribute triples", ", ".join(sorted(names)))
        counterfactual, uncertain = self.counterfactual or {}, self.uncertain or ()
        later = [*(self.predicted or ()), *(e for events in counterfactual.values() for e in events)]
        for event in self.events:
            expect(event.frame < self.n_frames, "Scene.events", f"frames from 0 to {self.n_frames - 1}", event)
        for event in [*self.events, *later, *(d.event for d in uncertain)]:
            fits = event.objects[-1] < n and event.frame >= 0
            expect(fits, "Scene: event", f"objects from 0 to {n - 1} at a frame", event)
        for one in uncertain:
            fits = one.removed is None or one.removed < n
            expect(fits, "Scene.uncertain", f"removed objects from 0 to {n - 1}", one.removed)
        if self.dynamics is not None:
            _check_dynamics(self, self.dynamics)
        object.__setattr__(self, "events", in_order(self.events))
        if self.predicted is not None:
            object.__setattr__(self, "predicted", in_order(self.predicted))
        if self.counterfactual is not None:
            in_time = {removed: in_order(events) for removed, events in counterfactual.items()}
            object.__setattr__(self, "counterfactual", MappingProxyType(in_time))

    @classmethod
    def of(
        cls,
        objects: Sequence[str],
        events: Sequence[EventSource] = (),
        n_frames: int | None = None,
        predicted: Sequence[EventSource] | None = None,
        counterfactual: Mapping[str | int, Sequence[EventSource]] | None = None,
        visible: BoolArray | None = None,
        moving: BoolArray | None = None,
        world: World = CLEVRER_WORLD,
    ) -> "Scene":
        """A scene written by hand. What is left out is not known, and questions that need it are refused.

            >>> scene = nsdr.Scene.of(
            ...     ["red metal cube", "blue rubber sphere"],
            ...     [("in", 10, "sphere"), ("collision", 30, "red cube", "blue sphere")],
            ... )
            >>> nsdr.Executor(scene).answer("count(filter_collision(events, objects))").answer
            1

        Args:
            objects: color, material and shape of each object.
            events: what happens: an `Event`, or its kind ("in", "out" or "collision"), its frame, and its objects by words that
                only one object has, or by ids.
            n_frames: number of frames of the video; None for that of the world's videos.
            predicted: collisions after the video, like `events`.
            counterfactual: collisions without an object, by that object.
            visible, moving: see `Scene`. With `visible` None, an object is in the image except before it enters and after it
                exits.
            world: the world that the scene is of.

        Raises:
            DataError: words that no object can have, or that fit no or several objects of the scene; or see `Scene`.
        """
        found = tuple(object_of(i, words, world.vocabulary) for i, words in enumerate(objects))
        n_frames = world.timeline.frames if n_frames is None else n_frames

        def listed(given: Sequence[EventSource]) -> tuple[Event, ...]:
            return tuple(e if isinstance(e, Event) else _event_of(found, e) for e in given)

        observed = listed(events)
        return cls(
            found,
            n_frames,
            visible_by(observed, len(found), n_frames) if visible is None else visible,
            moving,
            observed,
            None if predicted is None else listed(predicted),
            None
            if counterfactual is None
            else {find_object(found, one): listed(given) for one, given in counterfactual.items()},
            world=world,
        )

    def describe(self, event: Event) -> str:
        """An event with the names of its objects, such as "red metal cube enters (frame 12)"."""
        return event_sentence(event, [o.name for o in self.objects])

    def __str__(self) -> str:
        head = f"{self.n_frames} frames, {len(self.objects)} objects"
        objects = (f"  object {o.id}: {o.name}" for o in self.objects)
        return "\n".join([head, *objects, *(f"  {self.describe(event)}" for event in self.events)])


def _event_of(objects: Sequence[SceneObject], source: Sequence[Any]) -> Event:
    """An event from its kind, its frame, and its objects by words or ids, in any order."""
    fits = isinstance(source, tuple | list) and len(source) > 2
    expect(fits, "event", "its kind, frame and objects, such as ('in', 12, 'red cube')", source)
    kind, frame, *who = source
    return Event(kind, frame, tuple(sorted(find_object(objects, one) for one in who)))


def _check_common(owner: str, value: DynamicsPrediction | Scene) -> None:
    """What both have in common: ids and words of objects, removed ones, and the size of the physics."""
    check_objects(owner, value.objects)
    check_words(owner, value.objects, value.world.vocabulary)
    n = len(value.objects)
    for removed in value.counterfactual or {}:
        expect(removed < n, f"{owner}.counterfactual", f"object ids from 0 to {n - 1} as keys", removed)
    if value.physics is not None:
        found, expected = value.physics.velocity_world_per_s.shape[:2], (n, value.n_frames)
        expect(found == expected, f"{owner}.physics", f"{n} objects and {value.n_frames} frames", found)


def _check_dynamics(scene: Scene, dynamics: DynamicsPrediction) -> None:
    same = dynamics.objects == scene.objects and dynamics.n_frames == scene.n_frames
    expect(same, "Scene.dynamics", "the same objects and number of frames as the scene's", dynamics.n_frames)
    for rollout in (dynamics.observed, *dynamics.counterfactual.values()):
        last = max([scene.n_frames - 1, *(e.frame for e in rollout.collisions)])
        n = rollout.location_world.shape[1]
        expect(last < n, "Scene.dynamics", f"positions until frame {last}", f"{n} frames")

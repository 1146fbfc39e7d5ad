"""The interface of dynamics backends: a backend explains tracks, and its explanation makes rollouts with or without changes."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Protocol

from nsdr.dynamics.interventions import resolve
from nsdr.dynamics.motion_states import MotionStates
from nsdr.errors import DataError
from nsdr.io.limits import check_limit
from nsdr.io.registry import checked_result
from nsdr.types import DynamicsPrediction, Event, ObjectPhysics, Remove, Rollout, SceneObject
from nsdr.types.interventions import Intervention
from nsdr.validation import expect
from nsdr.world.camera import Camera
from nsdr.world.world import CLEVRER_WORLD, World

__all__ = ["Dynamics", "Explanation", "StoredExplanation", "only_removal"]


class Dynamics(Protocol):
    """A dynamics backend, which explains how the objects of a video move and collide."""

    def explain(self, states: MotionStates, collisions: Sequence[Event] | None = None) -> "Explanation":
        """Explain the motion of a video.

        Args:
            states: the motion of the video's objects.
            collisions: the collisions in the video, taken as true; None to detect them.

        Returns:
            The explanation of the video.
        """


class Explanation(ABC):
    """An explained video. It can be continued as it is or with changes.

    Subclasses implement `run`.

    Args:
        objects: identities of the objects.
        n_frames: number of frames of the video.
        world: the world that the video is of.
        physics: masses, and velocities during the video; None if the backend does not estimate them.
    """

    def __init__(
        self,
        objects: Sequence[SceneObject],
        n_frames: int,
        world: World = CLEVRER_WORLD,
        physics: ObjectPhysics | None = None,
    ) -> None:
        self.objects = tuple(objects)
        self.n_frames = n_frames
        self.world = world
        self.physics = physics

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.n_frames} frames, {len(self.objects)} objects)"

    @property
    def camera(self) -> Camera:
        """The camera that took the video."""
        return self.world.camera

    @abstractmethod
    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """Compute a rollout with changes that `rollout` has already checked.

        Args:
            changes: interventions whose `object` is an id. Added objects get the ids that follow those of the video, in order.
            from_frame: frame at which the changes happen, 0 to `n_frames - 1`.
            frames: number of frames of the rollout, at least `n_frames`.

        Returns:
            The rollout of the objects of the video and the added objects.

        Raises:
            DataError: the backend cannot make these changes.
        """

    def rollout(self, changes: Sequence[Intervention] = (), from_frame: int = 0, frames: int | None = None) -> Rollout:
        """Roll out the video and its continuation.

        Args:
            changes: interventions; none for the video as it is.
            from_frame: frame of the video at which the interventions happen.
            frames: number of frames of the rollout, which has at least those of the video; None for the horizon of predictive
                questions (`nsdr.world.physics.Timeline.horizon_frame`): in CLEVRER, 180 for a video of 128 frames.

        Raises:
            DataError: a change concerns an object that is not there or is impossible, two changes contradict each other, or
                `frames` is no number or too large.
        """
        if frames is not None:
            expect(isinstance(frames, int), "frames", "a number of frames", repr(frames))
            check_limit(frames, "frames", "the rollout")
        if not changes and not from_frame and frames is None:
            return self.observed
        if changes != () or from_frame:
            visible = self.observed.visible[:, : self.n_frames]
            changes = resolve(changes, self.objects, visible, from_frame, self.world)
        return self._ran(changes, from_frame, self._length(frames))

    @cached_property
    def observed(self) -> Rollout:
        """The rollout of the video as it is, up to the horizon."""
        return self._ran((), 0, self._length())

    @cached_property
    def counterfactual(self) -> Mapping[int, Rollout]:
        """Rollouts up to the horizon by the id of the object that is removed. Each is computed when it is first read."""
        return _Removals(self)

    @cached_property
    def prediction(self) -> DynamicsPrediction:
        """The rollout of the video and the rollouts without each object, as a record that can be stored."""
        removals = dict(self.counterfactual)
        return DynamicsPrediction(self.objects, self.n_frames, self.observed, removals, self.physics, self.world)

    def _ran(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """The result of `run`, which may be another package's."""
        return checked_result(self.run(changes, from_frame, frames), Rollout, self, "run")

    def _length(self, frames: int | None = None) -> int:
        """Number of frames of a rollout: at least that of the video; None for a rollout to the horizon."""
        return max(self.world.timeline.horizon_frame(self.n_frames) + 1 if frames is None else frames, self.n_frames)


class _Removals(Mapping[int, Rollout]):
    """Rollouts by the id of the removed object, each computed when it is first read."""

    def __init__(self, explanation: Explanation) -> None:
        self._explanation = explanation
        self._known: dict[int, Rollout] = {}

    def __getitem__(self, removed: int) -> Rollout:
        if removed not in range(len(self)):
            raise KeyError(removed)
        if removed not in self._known:
            e = self._explanation
            self._known[removed] = e._ran((Remove(removed),), 0, e._length())
        return self._known[removed]

    def __contains__(self, removed: object) -> bool:
        return removed in range(len(self))

    def __iter__(self) -> Iterator[int]:
        return iter(range(len(self)))

    def __len__(self) -> int:
        return len(self._explanation.objects)


class StoredExplanation(Explanation):
    """An explanation read from a stored prediction. It has only the rollouts that were stored."""

    def __init__(self, prediction: DynamicsPrediction) -> None:
        super().__init__(prediction.objects, prediction.n_frames, prediction.world, prediction.physics)
        self.observed, self.counterfactual = prediction.observed, prediction.counterfactual
        self.prediction = prediction

    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """Return the stored rollout.

        Raises:
            DataError: no such rollout was stored.
        """
        removed = only_removal(changes, from_frame, "stored predictions")
        if removed is not None and removed not in self.counterfactual:
            raise DataError(f"the stored prediction has no rollout without the {self.objects[removed].name}")
        rollout = self.observed if removed is None else self.counterfactual[removed]
        stored = rollout.visible.shape[1]
        if frames > stored:
            raise DataError(f"frames: the stored rollouts have {stored}, got {frames}")
        return rollout if frames == stored else _first_frames(rollout, frames)

    def _length(self, frames: int | None = None) -> int:
        """Number of frames of a rollout; None for the length of the stored ones."""
        return self.observed.visible.shape[1] if frames is None else frames


def _first_frames(rollout: Rollout, frames: int) -> Rollout:
    """The first frames of a rollout, and what happens in them."""
    speed, yaw, uncertain = rollout.speed_world_per_s, rollout.yaw, rollout.uncertain
    return replace(
        rollout,
        location_world=rollout.location_world[:, :frames],
        visible=rollout.visible[:, :frames],
        collisions=tuple(e for e in rollout.collisions if e.frame < frames),
        speed_world_per_s=None if speed is None else speed[:, :frames],
        uncertain=None if uncertain is None else tuple(u for u in uncertain if u.event.frame < frames),
        yaw=None if yaw is None else yaw[:, :frames],
    )


def only_removal(changes: Sequence[Intervention], from_frame: int, what: str) -> int | None:
    """The id of the one object that is removed from frame 0, for backends that support no other change; None without changes.

    Args:
        changes: interventions whose `object` is an id.
        from_frame: frame at which the changes happen.
        what: name of the backend in the error message.

    Raises:
        DataError: a change other than the removal of one object from frame 0.
    """
    if not changes:
        return None
    first = changes[0]
    if from_frame == 0 and len(changes) == 1 and isinstance(first, Remove):
        return int(first.object)
    asked = ", ".join(type(change).__name__ for change in changes)
    raise DataError(
        f"{asked} from frame {from_frame}: {what} can only remove one object from frame 0; use the backend physics"
    )

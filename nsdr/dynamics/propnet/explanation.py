"""The explanation of a network backend: rollouts of the video, with all objects and without each object."""

from collections.abc import Callable, Sequence

from nsdr.dynamics.base import Explanation, only_removal
from nsdr.dynamics.motion_states import MotionStates
from nsdr.io.device import limit_threads
from nsdr.types import Rollout
from nsdr.types.interventions import Intervention


class NetworkExplanation(Explanation):
    """The rollouts that a network predicts. The only change it supports is the removal of one object from frame 0.

    Args:
        states: motion states of the objects of the video.
        continued: a function (number of frames) -> rollout with all objects.
        without_each: a function (number of frames) -> rollouts without each object, in order of ids, made in one batch.
    """

    def __init__(
        self,
        states: MotionStates,
        continued: Callable[[int], Rollout],
        without_each: Callable[[int], Sequence[Rollout]],
    ) -> None:
        super().__init__(states.objects, states.n_frames, states.world)
        self._continued, self._without_each = continued, without_each
        self._removals: dict[int, Sequence[Rollout]] = {}

    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """Roll out the video as it is, or without one object.

        Raises:
            DataError: a change other than the removal of one object from frame 0.
        """
        removed = only_removal(changes, from_frame, "PropNet")
        if removed is None:
            with limit_threads(1):
                return self._continued(frames)
        if frames not in self._removals:
            with limit_threads(1):  # not for kept rollouts, as setting the number of threads takes milliseconds
                self._removals[frames] = self._without_each(frames)
        return self._removals[frames][removed]

"""What a dynamics backend is: tracks in, rollouts out."""

from collections.abc import Sequence
from typing import Protocol

from nsdr.types import DynamicsPrediction, Event, VideoTracks
from nsdr.world import timeline

__all__ = ["DynamicsBackend", "rollout_frames"]


class DynamicsBackend(Protocol):
    """Predicts motion and collisions: observed, after the video, and with each object removed."""

    def predict(self, tracks: VideoTracks, observed: Sequence[Event] | None = None) -> DynamicsPrediction:
        """Observed motion and collisions, their future, and one rollout per removed object.

        Args:
            tracks: the video's objects.
            observed: the video's collisions, taken as true; None finds them.

        Returns:
            Rollouts to the horizon (`nsdr.world.timeline.horizon_frame`); empty ones for a video without objects.
        """


def rollout_frames(n_frames: int, horizon_frame: int | None = None) -> int:
    """Length of the rollouts of a video of `n_frames`, whose last frame is `horizon_frame` (None: 7/5 of the video)."""
    last = timeline.horizon_frame(n_frames) if horizon_frame is None else horizon_frame
    return max(last + 1, n_frames)

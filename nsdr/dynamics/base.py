"""What a dynamics backend is: tracks in, rollouts out."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nsdr.types import DynamicsPrediction, Event, VideoProposals, VideoTracks
from nsdr.world import physics_constants

__all__ = ["DynamicsBackend", "VideoPixels", "rollout_frames"]


class DynamicsBackend(Protocol):
    """Predicts motion and collisions: observed, after the video, and with each object removed.

    A backend with an attribute `reads_images` that is true gets the video's `VideoPixels` as third argument. One with a method
    `simulate(tracks, interventions, from_frame)` takes interventions (see `nsdr.dynamics.physics.PhysicsPredictor`).
    """

    def predict(self, tracks: VideoTracks, observed: Sequence[Event] | None = None) -> DynamicsPrediction:
        """Observed motion and collisions, their future, and one rollout per removed object.

        Args:
            tracks: the video's objects.
            observed: the video's collisions, taken as true; None finds them.

        Returns:
            Rollouts to the horizon (`nsdr.world.physics_constants.horizon_frame`); empty ones for a video without objects.
        """


@dataclass(frozen=True, eq=False)
class VideoPixels:
    """What a backend on images reads beside the tracks.

    Attributes:
        frames: the video's frames (320, 480, 3) uint8 RGB, in order; read once.
        proposals: the detections that the tracks were made from, with their masks.
    """

    frames: Iterable[NDArray[np.uint8]]
    proposals: VideoProposals


def rollout_frames(n_frames: int, horizon_frame: int | None = None) -> int:
    """Length of the rollouts of a video of `n_frames`, whose last frame is `horizon_frame` (None: 7/5 of the video)."""
    last = physics_constants.horizon_frame(n_frames) if horizon_frame is None else horizon_frame
    return max(last + 1, n_frames)

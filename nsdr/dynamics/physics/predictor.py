"""The physics backend: a planar simulator fitted to each video, which predicts the future and the effect of changes.

This goes beyond the paper. A fit explains the video by one run of the simulator (see `trajectory_fit`). What a removal cannot
influence keeps its observed motion. All else is simulated many times with perturbed states, which gives probabilities.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from nsdr.dynamics.base import Explanation, StoredExplanation
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.collision_search import search_collisions
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.fitted_scene import FittedScene
from nsdr.dynamics.track_smoothing import smooth_tracks
from nsdr.io.checkpoint import HasWeights, find_checkpoint
from nsdr.io.description import described
from nsdr.io.device import limit_threads
from nsdr.types import DynamicsPrediction, Event, Rollout


class CollisionDetector(Protocol):
    """A detector of collisions in observed motion, such as `TrackCollisionDetector`."""

    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        """For every pair, its most probable collision and the probability of the collision, in order of frames."""


class PhysicsPredictor:
    """A dynamics backend that fits a simulator to the tracks of a video.

    Differs from the paper: a simulator replaces the learned dynamics; a network only detects observed collisions.

    Args:
        detector: detector of collisions in observed motion.
        config: settings of the fit and the simulation; None for the defaults.
    """

    name = "physics"
    __repr__ = described

    def __init__(self, detector: CollisionDetector, config: PhysicsConfig | None = None) -> None:
        self.detector = detector
        self.config = config or PhysicsConfig()

    @classmethod
    def from_checkpoint(cls, folder: str | Path, config: PhysicsConfig | None = None) -> "PhysicsPredictor":
        """The backend with the collision detector of a checkpoint's folder, on the CPU.

        Raises:
            CheckpointError: a file is missing or corrupt.
        """
        from nsdr.dynamics.collisions.network import TrackCollisionDetector

        return cls(TrackCollisionDetector.from_checkpoint(folder), config)

    @classmethod
    def from_pretrained(
        cls, path_or_id: str | Path = "default", device: str = "auto", config: PhysicsConfig | None = None
    ) -> "PhysicsPredictor":
        """The backend with the collision detector of a checkpoint.

        Args:
            path_or_id: see `nsdr.io.checkpoint.find_checkpoint`.
            device: where the detector runs: "auto" for CUDA where there is one, else "cpu"; or a device such as "cuda:1".
            config: settings of the fit and the simulation; None for the defaults.

        Raises:
            CheckpointError: not found, incomplete or corrupt.
            DataError: the device is unknown or not available.
        """
        return cls.from_checkpoint(find_checkpoint(path_or_id), config).to(device)

    @limit_threads(1)
    def explain(self, states: MotionStates, collisions: Sequence[Event] | None = None) -> Explanation:
        """Fit the simulator to a video; see `nsdr.dynamics.Dynamics`."""
        if not states.objects:
            total = states.world.timeline.horizon_frame(states.n_frames) + 1
            nothing = Rollout(np.zeros((0, total, 2)), np.zeros((0, total), bool), (), np.zeros((0, 0)))
            return StoredExplanation(DynamicsPrediction((), states.n_frames, nothing, world=states.world))
        given = None if collisions is None else [(event, 1.0) for event in collisions]
        candidates = self.detector.collision_candidates(states) if given is None else given
        found = search_collisions(states, candidates, self.config)
        return FittedScene(states, smooth_tracks(states, found.collisions), found, self.config)

    def to(self, device: str) -> "PhysicsPredictor":
        """Move the network of the detector to a device. The simulation runs on the CPU."""
        if isinstance(self.detector, HasWeights):
            self.detector.to(device)
        return self

    def save_pretrained(self, folder: str | Path) -> None:
        """Write the weights of the detector. The simulator has none."""
        if isinstance(self.detector, HasWeights):
            self.detector.save_pretrained(folder)

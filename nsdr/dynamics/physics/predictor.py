"""The physics backend: a planar simulator fitted to each video predicts what comes next, and what happens without an object.

Beyond the paper. A fit explains the video by one run (see `trajectory_fit`). Whatever a removal cannot influence keeps its
observed motion; the rest is simulated, many times with states perturbed by their uncertainty, which gives probabilities.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from nsdr.dynamics.base import rollout_frames
from nsdr.dynamics.interventions import make_simulation, resolve
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.dynamics.physics.collision_search import search_collisions
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.fitted_scene import FittedScene
from nsdr.dynamics.track_smoothing import smooth_tracks, with_smoothed_tracks
from nsdr.errors import DataError
from nsdr.io.device import limit_threads
from nsdr.types import DynamicsPrediction, Event, ObjectPhysics, Rollout, Simulation, VideoTracks
from nsdr.types.interventions import Intervention

VELOCITY_ERROR_WORLD_PER_S = 0.02
"""Standard deviation of each component of the observed velocities (world units/s): 95 % of errors of speeds are within 1.645
of them, rounded (`python benchmarks/extensions.py DATA PROPOSALS --scenes 70 --errors`)."""


class CollisionDetector(Protocol):
    """Finds collisions in observed motion, such as `nsdr.dynamics.propnet.StatePredictor`."""

    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        """For every pair its most probable collision, and its probability, by frame."""


class PhysicsPredictor:
    """Simulation of a scene that was fitted to the tracks.

    Differs from the paper: a simulator replaces the learned dynamics; a network only detects observed collisions.

    Args:
        detector: finds collisions in observed motion.
        config: of the simulation.
        shortcut: objects that a removal cannot influence keep their observed motion; otherwise all are simulated from frame 0.
        horizon_frame: last frame to predict; None is 7/5 of the video's length.
    """

    def __init__(
        self,
        detector: CollisionDetector,
        config: PhysicsConfig | None = None,
        shortcut: bool = True,
        horizon_frame: int | None = None,
    ) -> None:
        self.detector = detector
        self.config = config or PhysicsConfig()
        self.shortcut = shortcut
        self.horizon_frame = horizon_frame

    @limit_threads(1)
    def predict(self, tracks: VideoTracks, observed: Sequence[Event] | None = None) -> DynamicsPrediction:
        """Observed motion and collisions, their future, and one rollout per removed object; see `DynamicsBackend`."""
        if not tracks.tracks:
            return DynamicsPrediction((), tracks.n_frames, self._empty(tracks.n_frames), {})
        scene = self._fitted(states_from_tracks(tracks), observed)
        rollout = with_smoothed_tracks(scene.rollout(), scene.smoothed)
        objects = scene.states.objects
        counterfactual = {o.id: scene.rollout(o.id) for o in objects}
        velocity, fit = scene.smoothed.velocity_world_per_s.astype(np.float32), scene.fitted
        physics = ObjectPhysics(velocity, VELOCITY_ERROR_WORLD_PER_S, np.log(fit.bodies.mass), fit.log_mass_covariance)
        return DynamicsPrediction(objects, tracks.n_frames, rollout, counterfactual, physics)

    @limit_threads(1)
    def simulate(self, tracks: VideoTracks, interventions: Sequence[Intervention], from_frame: int = 0) -> Simulation:
        """The video's motion with interventions, beside that without.

        Args:
            tracks: the video's objects.
            interventions: changes of the scene, all at `from_frame`.
            from_frame: a frame of the video.

        Raises:
            DataError: an object that is not there, or a change that is impossible; says why with the numbers.
        """
        if not tracks.tracks:
            raise DataError("interventions: the video has no objects")
        scene = self._fitted(states_from_tracks(tracks), None)
        changes = resolve(interventions, scene.states.objects, scene.smoothed.visible, from_frame)
        changed, changed_yaw = scene.what_if(changes, from_frame)
        before, yaw = scene.original(len(changes.added), from_frame)
        return make_simulation(changes, tracks.n_frames, from_frame, before, changed, (yaw, changed_yaw), tracks.camera)

    def to(self, device: str) -> "PhysicsPredictor":
        """Move the detector's network to a device; the simulation runs on the CPU."""
        if hasattr(self.detector, "to"):
            self.detector.to(device)
        return self

    def save_pretrained(self, folder: str | Path) -> None:
        """Write the detector's weights; the simulator has none."""
        if hasattr(self.detector, "save_pretrained"):
            self.detector.save_pretrained(folder)

    @limit_threads(1)
    def continue_motion(self, states: MotionStates) -> Rollout:
        """The rollout after the last frame of `states`, nothing removed."""
        if not states.objects:
            return self._empty(states.present.shape[1])
        return self._fitted(states, None).rollout()

    def _fitted(self, states: MotionStates, observed: Sequence[Event] | None) -> FittedScene:
        given = None if observed is None else [(event, 1.0) for event in observed]
        candidates = self.detector.collision_candidates(states) if given is None else given
        found = search_collisions(states, candidates, self.config)
        smoothed = smooth_tracks(states, found.collisions)
        frames = rollout_frames(states.present.shape[1], self.horizon_frame)
        return FittedScene(states, smoothed, found, self.config, self.shortcut, frames)

    def _empty(self, n_frames: int) -> Rollout:
        frames = rollout_frames(n_frames, self.horizon_frame)
        return Rollout(np.zeros((0, frames, 2)), np.zeros((0, frames), bool), (), np.zeros((0, 0)))

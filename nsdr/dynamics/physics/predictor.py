"""The physics backend: a planar simulator fitted to each video predicts what comes next, and what happens without an object.

Beyond the paper. A fit explains the video by one run (see `trajectory_fit`). Whatever a removal cannot influence keeps its
observed motion; the rest is simulated, many times with states perturbed by their uncertainty, which gives probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.base import rollout_frames
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.dynamics.physics.collision_search import CollisionSearchConfig, FoundCollisions, search_collisions
from nsdr.dynamics.physics.simulator import (
    NO_CONTACT,
    Perturbations,
    PrescribedMotion,
    SimulatedMotion,
    simulate_perturbed,
)
from nsdr.dynamics.track_smoothing import (
    SmoothedTracks,
    SmoothingConfig,
    rollout_in_image,
    smooth_tracks,
    with_smoothed_tracks,
)
from nsdr.io.threads import limit_threads
from nsdr.io.validation import COUNT, NOT_NEGATIVE, POSITIVE, SHARE, check_ranges
from nsdr.types import Doubt, DynamicsPrediction, Event, Rollout, VideoTracks
from nsdr.world.physics_constants import LOG_MASS_STD, OBJECT_RADIUS_WORLD

__all__ = ["CollisionDetector", "PhysicsConfig", "PhysicsPredictor"]

FloatArray = NDArray[np.floating[Any]]
MAX_RUNS = 10_000
"""Largest `PhysicsConfig.runs`."""
DOUBT = 0.005
"""Collisions that are less probable count as ruled out, and those that are more probable than 1 minus this as certain."""


@dataclass(frozen=True)
class PhysicsConfig:
    """How the fitted scene is simulated on.

    Noise levels were set on left-out scenes of `train`; `python benchmarks/continued.py` compares them. Perturbations drawn
    from the posterior of the fit were tried in place of fixed ones: on cut videos they are better calibrated, but they decide
    fewer counterfactuals of simulated scenes rightly.

    Attributes:
        runs: simulations of each rollout; the first is not perturbed.
        position_noise_world: standard deviation of perturbed positions (world units).
        velocity_noise_world_per_s: standard deviation of perturbed velocities (world units/s).
        yaw_noise: standard deviation of perturbed yaws (radians).
        mass_noise: standard deviation of perturbed log masses of objects that were seen to collide.
        unmet_mass_noise: the same for objects that were not; CLEVRER's masses are uniform in 0.7-1.3.
        collision_threshold: share of runs above which a collision counts.
        seed: of the perturbations.
        closeness_world: scale on which the closest approach tells pairs apart that collide in equally many runs (world units).
        search: how the observed collisions and the fit are found.
    """

    runs: int = 30
    position_noise_world: float = 0.004
    velocity_noise_world_per_s: float = 0.015
    yaw_noise: float = 0.1
    mass_noise: float = 0.08
    unmet_mass_noise: float = LOG_MASS_STD
    collision_threshold: float = 0.5
    seed: int = 0
    closeness_world: float = 0.4
    search: CollisionSearchConfig = field(default_factory=CollisionSearchConfig)

    def __post_init__(self) -> None:
        check_ranges(self, runs=(1, MAX_RUNS), collision_threshold=SHARE, seed=COUNT, closeness_world=POSITIVE)
        noise = ("position_noise_world", "velocity_noise_world_per_s", "yaw_noise", "mass_noise", "unmet_mass_noise")
        check_ranges(self, **dict.fromkeys(noise, NOT_NEGATIVE))


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
        smoothing: how observed tracks are smoothed.
    """

    def __init__(
        self,
        detector: CollisionDetector,
        config: PhysicsConfig | None = None,
        shortcut: bool = True,
        horizon_frame: int | None = None,
        smoothing: SmoothingConfig | None = None,
    ) -> None:
        self.detector = detector
        self.config = config or PhysicsConfig()
        self.shortcut = shortcut
        self.horizon_frame = horizon_frame
        self.smoothing = smoothing or SmoothingConfig()

    @limit_threads(1)
    def predict(self, tracks: VideoTracks, observed: Sequence[Event] | None = None) -> DynamicsPrediction:
        """Observed motion and collisions, their future, and one rollout per removed object; see `DynamicsBackend`."""
        states = states_from_tracks(tracks, self.smoothing.measurement.visibility)
        if not states.objects:
            return DynamicsPrediction(states.objects, tracks.n_frames, self._empty(tracks.n_frames), {})
        scene = self._fitted(states, observed)
        rollout = with_smoothed_tracks(scene.rollout(None), scene.smoothed)
        counterfactual = {k: scene.rollout(k) for k in range(len(states.objects))}
        return DynamicsPrediction(states.objects, tracks.n_frames, rollout, counterfactual)

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
        return self._fitted(states, None).rollout(None)

    def _fitted(self, states: MotionStates, observed: Sequence[Event] | None) -> "_FittedScene":
        given = None if observed is None else [(event, 1.0) for event in observed]
        candidates = self.detector.collision_candidates(states) if given is None else given
        found = search_collisions(states, candidates, self.config.search, self.smoothing.measurement)
        smoothed = smooth_tracks(states, found.collisions, self.smoothing)
        frames = rollout_frames(states.present.shape[1], self.horizon_frame)
        return _FittedScene(states, smoothed, found, self.config, self.shortcut, frames)

    def _empty(self, n_frames: int) -> Rollout:
        frames = rollout_frames(n_frames, self.horizon_frame)
        return Rollout(np.zeros((0, frames, 2)), np.zeros((0, frames), bool), (), np.zeros((0, 0)))


class _FittedScene:
    """A fitted video that can be simulated on, with and without each object."""

    def __init__(
        self,
        states: MotionStates,
        smoothed: SmoothedTracks,
        found: FoundCollisions,
        config: PhysicsConfig,
        shortcut: bool,
        total_frames: int,
    ) -> None:
        self.states, self.smoothed = states, smoothed
        fitted, observed = self.fitted, self.observed = found.fit, found.collisions
        self.config, self.shortcut, self.total = config, shortcut, total_frames
        n, self.frames = states.present.shape
        # Smoothed stretches follow the tracks most closely; where there is none, the fitted run steps in.
        known = np.isfinite(smoothed.location_world)
        self.position = np.where(known, smoothed.location_world, fitted.motion.position)
        self.velocity = np.where(known, smoothed.velocity_world_per_s, fitted.motion.velocity)
        met = {i for e in observed for i in e.objects}
        self.mass_noise = np.array([config.mass_noise if i in met else config.unmet_mass_noise for i in range(n)])
        self.perturbations = self._perturbations(np.random.default_rng(config.seed))
        self.doubts = [Doubt(event, p) for event, p in found.candidates if DOUBT <= p <= 1 - DOUBT]
        self.collisions = np.array([(*e.objects, e.frame) for e in observed], np.int64).reshape(-1, 3)

    def rollout(self, removed: int | None) -> Rollout:
        """The scene as it is (None), or without an object."""
        exists = np.ones(len(self.states.objects), bool)
        if removed is not None:
            exists[removed] = False
        first, frames = self._runs(exists)
        hit = frames != NO_CONTACT
        pairs = {e.objects for e in self.observed}
        scores = hit.mean(0)
        collisions = list(self.observed) if removed is None else []
        doubts = list(self.doubts) if removed is None else []
        probability = scores if removed is None else self._with_observed_doubts(scores, exists)
        for i, j in np.argwhere(np.triu(probability >= DOUBT, 1)).tolist():
            if removed is None and (i, j) in pairs:
                continue
            at = frames[hit[:, i, j], i, j]
            frame = (
                int(np.median(at)) if len(at) else next(d.event.frame for d in self.doubts if d.event.objects == (i, j))
            )
            event = Event("collision", max(frame, self.frames) if removed is None else frame, (i, j))
            if probability[i, j] > self.config.collision_threshold:
                collisions.append(event)
            if probability[i, j] <= 1 - DOUBT:
                doubts.append(Doubt(event, float(probability[i, j]), removed))
        scores = (len(frames) * scores + self._closeness(first)) / (len(frames) + 1)
        for pair in pairs:  # a pair collides once
            scores[pair] = scores[pair[::-1]] = 0.0
        return Rollout(
            np.where(exists[:, None, None], first.position, np.nan),
            self._visible(first, exists),
            tuple(sorted(collisions, key=lambda e: e.frame)),
            scores if removed is None else None,
            doubts=tuple(doubts),
        )

    def _with_observed_doubts(self, share: FloatArray, exists: NDArray[np.bool_]) -> FloatArray:
        """(n, n) probabilities of collisions without an object, given the shares of runs with them.

        The runs take the collisions of the video as they were found. One that is in doubt is as doubtful without the object;
        one that was probably none happens in the runs, or else as probably as in the video.
        """
        result, chosen = share.copy(), {e.objects for e in self.observed}
        for doubt in self.doubts:
            (i, j), p = doubt.event.objects, doubt.probability
            if exists[[i, j]].all():
                result[i, j] = share[i, j] * p if (i, j) in chosen else 1 - (1 - share[i, j]) * (1 - p)
        return result

    def _runs(self, exists: NDArray[np.bool_]) -> tuple[SimulatedMotion, NDArray[np.integer[Any]]]:
        """The first run, and the frames (runs, n, n) of first contacts of all."""
        bodies, motion, rebound = self.fitted.bodies, self.fitted.motion, None
        prescribed: PrescribedMotion | None = PrescribedMotion(
            self.position,
            self.velocity,
            motion.yaw,
            motion.spin,
            np.full(len(exists), self.frames - 1),
            self.collisions,
        )
        if self.shortcut or exists.all():
            bodies = replace(bodies, position=self.position[:, 0], velocity=self.velocity[:, 0])
        else:
            prescribed, rebound = None, self.fitted.rebound
        return simulate_perturbed(bodies, exists, self.total, self.perturbations, rebound, prescribed)

    def _perturbations(self, rng: np.random.Generator) -> Perturbations:
        """Those of all runs but the first: each draws its masses, positions, velocities and yaws in this order."""
        c, n = self.config, len(self.states.objects)
        noise = rng.normal(size=(c.runs - 1, 6 * n))
        return Perturbations(
            c.position_noise_world * noise[:, n : 3 * n].reshape(-1, n, 2),
            c.velocity_noise_world_per_s * noise[:, 3 * n : 5 * n].reshape(-1, n, 2),
            c.yaw_noise * noise[:, 5 * n :],
            np.exp(self.mass_noise * noise[:, :n]),
        )

    def _closeness(self, run: SimulatedMotion) -> FloatArray:
        """(n, n) in 0-1: how close pairs come after the video."""
        later = run.position[:, self.frames - 1 :]
        gap = np.linalg.norm(later[:, None] - later[None], axis=-1).min(-1) - 2 * OBJECT_RADIUS_WORLD
        return np.asarray(np.exp(-np.maximum(gap, 0) / self.config.closeness_world))

    def _visible(self, run: SimulatedMotion, exists: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(n, total) bool: as observed until an object is simulated, then as its simulated place is in the image."""
        observed = np.zeros(run.yaw.shape, bool)
        observed[:, : self.frames] = self.smoothed.visible
        simulated = np.arange(self.total) > run.free_from[:, None]
        position = np.where((simulated & exists[:, None])[..., None], run.position, np.nan)
        shown = rollout_in_image([o.shape for o in self.states.objects], position)
        return np.where(simulated, shown, observed) & exists[:, None]

"""A fitted video that can be simulated on, with and without each object."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.collision_search import FoundCollisions
from nsdr.dynamics.physics.physics_config import PhysicsConfig
from nsdr.dynamics.physics.simulator import (
    NO_CONTACT,
    BodyStates,
    Perturbations,
    PrescribedMotion,
    SimulatedMotion,
    simulate_perturbed,
)
from nsdr.dynamics.track_smoothing import SmoothedTracks, rollout_in_image
from nsdr.types import Event, Rollout, UncertainCollision
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD

__all__ = ["MIN_PROBABILITY", "FittedScene"]

FloatArray = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]
MIN_PROBABILITY = 0.005
"""Collisions that are less probable count as ruled out, and those that are more probable than 1 minus this as certain."""


class FittedScene:
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
        self.uncertain = [
            UncertainCollision(event, p) for event, p in found.candidates if MIN_PROBABILITY <= p <= 1 - MIN_PROBABILITY
        ]
        self.collisions = np.array([(*e.objects, e.frame) for e in observed], np.int64).reshape(-1, 3)

    def rollout(self, removed: int | None) -> Rollout:
        """The scene as it is (None), or without an object."""
        return self.rollout_and_yaw(removed)[0]

    def rollout_and_yaw(self, removed: int | None) -> tuple[Rollout, FloatArray]:
        """The scene as it is (None), or without an object; and (n, F) rotations about the vertical axis (radians)."""
        exists = np.ones(len(self.states.objects), bool)
        if removed is not None:
            exists[removed] = False
        first, frames = self._runs(exists)
        pairs = {e.objects for e in self.observed}
        scores = (frames != NO_CONTACT).mean(0)
        collisions = list(self.observed) if removed is None else []
        uncertain = list(self.uncertain) if removed is None else []
        probability = scores if removed is None else self.with_observed_uncertain(scores, exists)
        for event, p in self.probable_collisions(frames, probability):
            if removed is None and event.objects in pairs:
                continue
            if removed is None:
                event = replace(event, frame=max(event.frame, self.frames))
            if p > self.config.collision_threshold:
                collisions.append(event)
            if p <= 1 - MIN_PROBABILITY:
                uncertain.append(UncertainCollision(event, p, removed))
        scores = (len(frames) * scores + self._closeness(first)) / (len(frames) + 1)
        for pair in pairs:  # a pair collides once
            scores[pair] = scores[pair[::-1]] = 0.0
        rollout = Rollout(
            np.where(exists[:, None, None], first.position, np.nan),
            self._visible(first, exists),
            tuple(sorted(collisions, key=lambda e: e.frame)),
            scores if removed is None else None,
            uncertain=tuple(uncertain),
        )
        return rollout, first.yaw

    def probable_collisions(
        self, frames: NDArray[np.integer[Any]], probability: FloatArray
    ) -> list[tuple[Event, float]]:
        """Collisions that are not ruled out, with their probabilities.

        Args:
            frames: (runs, n, n) of first contacts. A collision is at their median, or else where it was uncertain in the video.
            probability: (n, n) of each pair.
        """
        uncertain = {d.event.objects: d.event.frame for d in self.uncertain}
        found = []
        for i, j in np.argwhere(np.triu(probability >= MIN_PROBABILITY, 1)).tolist():
            at = frames[:, i, j][frames[:, i, j] != NO_CONTACT]
            frame = int(np.median(at)) if len(at) else uncertain[i, j]
            found.append((Event("collision", frame, (i, j)), float(probability[i, j])))
        return found

    def with_observed_uncertain(self, share: FloatArray, untouched: BoolArray, after_frame: int = 0) -> FloatArray:
        """(n, n) probabilities of collisions in a changed scene, given the shares of runs with them.

        The runs take the collisions of the video as they were found. One that is uncertain is so in the changed scene, too;
        one that was probably none happens in the runs, or else as probably as in the video.

        Args:
            share: (n, n).
            untouched: (n,) bool, the objects that exist and whose motion is not set.
            after_frame: what is uncertain in the video up to this frame, unless it is 0, concerns what was before the change.
        """
        result, chosen = share.copy(), {e.objects for e in self.observed}
        for one in self.uncertain:
            (i, j), p = one.event.objects, one.probability
            if untouched[[i, j]].all() and (after_frame == 0 or one.event.frame > after_frame):
                result[i, j] = share[i, j] * p if (i, j) in chosen else 1 - (1 - share[i, j]) * (1 - p)
        return result

    def bodies_at(self, frame: int) -> BodyStates:
        """The objects at a frame of the video."""
        motion = self.fitted.motion
        position, velocity = (self.position, self.velocity) if self.shortcut else (motion.position, motion.velocity)
        bodies = replace(self.fitted.bodies, position=position[:, frame], velocity=velocity[:, frame])
        return replace(bodies, yaw=motion.yaw[:, frame], spin=motion.spin[:, frame])

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
        shown = rollout_in_image([o.shape for o in self.states.objects], position, self.states.camera)
        return np.where(simulated, shown, observed) & exists[:, None]

"""The physics backend: a planar simulator fitted to each video answers what comes next, and what happens without an object.

Beyond the paper. A fit explains the video by one run (see `fit`). Whatever cannot be influenced keeps its observed motion; the
rest is simulated on, many times with states disturbed as far as they are uncertain, which gives probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.camera import OBJECT_RADIUS_WORLD
from nsdr.dynamics.explain import ExplainConfig, explain
from nsdr.dynamics.fit import FittedMotion
from nsdr.dynamics.observed import ObservedMotion, observed_motion, with_observed_motion
from nsdr.dynamics.planar import NO_CONTACT, PlanarBodies, PlanarMotion, Script, planar_motion
from nsdr.dynamics.predictor import DynamicsPredictor, in_picture
from nsdr.dynamics.states import MotionStates, states_from_tracks, visible_frames
from nsdr.types import DynamicsPrediction, Event, Rollout, VideoTracks

__all__ = ["PhysicsConfig", "PhysicsPredictor"]

FloatArray = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class PhysicsConfig:
    """How the fitted world is simulated on.

    Attributes:
        horizon_frame: last frame that is predicted (7 s of video time: 179).
        runs: simulations of each course; the first is not disturbed.
        place_noise_world, velocity_noise, yaw_noise: standard deviations of the disturbances.
        mass_noise, unmet_mass_noise: of log masses of objects that were seen to collide, and of others (uniform 0.7-1.3).
        collision_threshold: share of runs from which a collision counts.
        shortcut: what a removal cannot influence keeps its observed motion; otherwise all is simulated from frame 0.
        seed: of the disturbances.
        closeness_world: pairs that hit alike often are told apart by how near they come, on this scale.
        explain: how the observed collisions and the fit are found.
    """

    horizon_frame: int = 179
    runs: int = 30
    place_noise_world: float = 0.004
    velocity_noise: float = 0.015
    yaw_noise: float = 0.1
    mass_noise: float = 0.08
    unmet_mass_noise: float = 0.17
    collision_threshold: float = 0.5
    shortcut: bool = True
    seed: int = 0
    closeness_world: float = 0.4
    explain: ExplainConfig = field(default_factory=ExplainConfig)


class PhysicsPredictor:
    """Simulation of a world that was fitted to the tracks.

    Differs from the paper: a simulator takes the place of the learned dynamics; the network only finds observed collisions.

    Args:
        observer: finds collisions in observed motion.
        config: of the simulation.
    """

    def __init__(self, observer: DynamicsPredictor, config: PhysicsConfig | None = None) -> None:
        self.observer = observer
        self.config = config or PhysicsConfig()

    def predict(self, tracks: VideoTracks, observed: Sequence[Event] | None = None) -> DynamicsPrediction:
        """Observed motion and collisions, their future, and one rollout for each removed object; see `DynamicsPredictor`."""
        states = states_from_tracks(tracks)
        if not states.objects:
            return DynamicsPrediction(states.objects, tracks.n_frames, _empty(tracks.n_frames, self.config), {})
        given = None if observed is None else [(event, 1.0) for event in observed]
        candidates = self.observer.collision_candidates(states) if given is None else given
        observed, fitted = explain(states, candidates, self.config.explain)
        motion = observed_motion(states, observed)
        world = _World(states, motion, fitted, observed, self.config)
        course = with_observed_motion(world.course(None), motion)
        counterfactual = {k: world.course(k) for k in range(len(states.objects))}
        return DynamicsPrediction(states.objects, tracks.n_frames, course, counterfactual)

    def continue_motion(self, states: MotionStates) -> Rollout:
        """The rollout after the last frame of `states`, nothing removed."""
        if not states.objects:
            return _empty(states.present.shape[1], self.config)
        observed, fitted = explain(states, self.observer.collision_candidates(states), self.config.explain)
        return _World(states, observed_motion(states, observed), fitted, observed, self.config).course(None)


def _empty(n_frames: int, config: PhysicsConfig) -> Rollout:
    frames = max(config.horizon_frame + 1, n_frames)
    return Rollout(np.zeros((0, frames, 2)), np.zeros((0, frames), bool), (), np.zeros((0, 0)))


class _World:
    """A fitted video that can be simulated on, with and without each object."""

    def __init__(
        self,
        states: MotionStates,
        motion: ObservedMotion,
        fitted: FittedMotion,
        observed: Sequence[Event],
        config: PhysicsConfig,
    ) -> None:
        self.states, self.fitted, self.observed, self.config = states, fitted, observed, config
        self.visible = visible_frames(states)
        n, self.frames = states.present.shape
        self.total = max(config.horizon_frame + 1, self.frames)
        # Flights fitted between collisions follow the tracks most closely; where there is none, the fitted run steps in.
        seen = np.isfinite(motion.location_world)
        self.place = np.where(seen, motion.location_world, fitted.motion.place)
        self.velocity = np.where(seen, motion.velocity_world_per_s, fitted.motion.velocity)
        met = {i for e in observed for i in e.objects}
        self.mass_noise = np.array([config.mass_noise if i in met else config.unmet_mass_noise for i in range(n)])
        self.collisions = np.array([(*e.objects, e.frame) for e in observed], np.int64).reshape(-1, 3)

    def course(self, removed: int | None) -> Rollout:
        """The course of the world as it is (None), or without an object."""
        n = len(self.states.objects)
        exists = np.ones(n, bool)
        if removed is not None:
            exists[removed] = False
        rng = np.random.default_rng(self.config.seed)
        runs = [self._run(exists, rng if k else None) for k in range(self.config.runs)]
        first = runs[0]
        frames = np.stack([r.contact for r in runs])
        hit = frames != NO_CONTACT
        pairs = {e.objects for e in self.observed}
        scores = hit.mean(0)
        collisions = list(self.observed) if removed is None else []
        for i, j in np.argwhere(np.triu(scores > self.config.collision_threshold, 1)).tolist():
            if removed is None and (i, j) in pairs:
                continue
            frame = int(np.median(frames[hit[:, i, j], i, j]))
            collisions.append(Event("collision", max(frame, self.frames) if removed is None else frame, (i, j)))
        scores = (len(runs) * scores + self._closeness(first)) / (len(runs) + 1)
        for pair in pairs:  # a pair collides once
            scores[pair] = scores[pair[::-1]] = 0.0
        return Rollout(
            np.where(exists[:, None, None], first.place, np.nan),
            self._visible(first, exists),
            tuple(sorted(collisions, key=lambda e: e.frame)),
            scores if removed is None else None,
        )

    def _run(self, exists: NDArray[np.bool_], rng: np.random.Generator | None) -> PlanarMotion:
        c, n = self.config, len(self.states.objects)
        bodies, motion = self.fitted.bodies, self.fitted.motion

        def noise(*shape: int) -> FloatArray:
            return np.zeros(shape) if rng is None else rng.normal(size=shape)

        mass = bodies.mass * np.exp(self.mass_noise * noise(n))
        drift, push, turn = c.place_noise_world * noise(n, 2), c.velocity_noise * noise(n, 2), c.yaw_noise * noise(n)
        moving = np.linalg.norm(self.velocity, axis=-1, keepdims=True) > 0
        if not c.shortcut and not exists.all():
            moves = (np.linalg.norm(bodies.velocity, axis=1) > 0)[:, None]
            start = PlanarBodies(
                bodies.shape, bodies.place + drift, bodies.velocity + push * moves, bodies.yaw + turn, bodies.spin, mass
            )
            return planar_motion(start, exists, self.total, self.fitted.rebound)
        script = Script(
            self.place + drift[:, None],
            self.velocity + push[:, None] * moving,
            motion.yaw + turn[:, None],
            motion.spin,
            np.full(n, self.frames - 1),
            self.collisions,
        )
        start = PlanarBodies(bodies.shape, script.place[:, 0], script.velocity[:, 0], bodies.yaw, bodies.spin, mass)
        return planar_motion(start, exists, self.total, None, script)

    def _closeness(self, run: PlanarMotion) -> FloatArray:
        """(n, n) in 0-1: how near pairs come after the video."""
        later = run.place[:, self.frames - 1 :]
        gap = np.linalg.norm(later[:, None] - later[None], axis=-1).min(-1) - 2 * OBJECT_RADIUS_WORLD
        return np.asarray(np.exp(-np.maximum(gap, 0) / self.config.closeness_world))

    def _visible(self, run: PlanarMotion, exists: NDArray[np.bool_]) -> NDArray[np.bool_]:
        visible = in_picture(run.place)
        for i, free in enumerate(run.free_from):
            visible[i, : free + 1] = self.visible[i, : free + 1]
        return visible & exists[:, None]

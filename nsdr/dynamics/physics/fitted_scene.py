"""The explanation of the physics backend: a fitted video that can be simulated on, as it is and with interventions.

What an intervention cannot influence keeps its observed motion, the rest is simulated: once as it was fitted, and again with
perturbed states and masses, which gives probabilities.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nsdr.dynamics.base import Explanation
from nsdr.dynamics.interventions import with_added
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.changed_bodies import ChangedBodies, change_bodies
from nsdr.dynamics.physics.collision_search import FoundCollisions
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.forces import POSITION, VELOCITY, YAW
from nsdr.dynamics.physics.simulator import (
    NO_CONTACT,
    BodyStates,
    Perturbations,
    PrescribedMotion,
    SimulatedMotion,
    simulate,
)
from nsdr.dynamics.simulation import padded
from nsdr.dynamics.track_smoothing import SmoothedTracks, rollout_in_image, with_smoothed_tracks
from nsdr.io.device import limit_threads
from nsdr.types import Event, ObjectPhysics, Rollout, UncertainCollision
from nsdr.types.interventions import Intervention
from nsdr.validation import BoolArray, FloatArray, IntArray
from nsdr.world.physics_constants import (
    CONTACT_PAUSE_STEPS,
    FRAME_SECONDS,
    LOG_MASS_STD,
    OBJECT_RADIUS_WORLD,
    STEPS_PER_FRAME,
)

MIN_PROBABILITY = 0.005
"""Collisions that are less probable count as ruled out, and those that are more probable than 1 minus this as certain."""
DEGREES_OF_FREEDOM = 4
"""Of Student's t distribution, from which errors are drawn: few are much larger than others. The largest errors below, this and
the noise of `PhysicsConfig` were set on real scenes of `train` that were cut, and on generated ones without an object."""
MAX_POSITION_ERROR_WORLD, MAX_VELOCITY_ERROR_WORLD_PER_S = 0.05, 0.4
"""Largest errors of a stretch's place and velocity."""
VELOCITY_ERROR_WORLD_PER_S = 0.02
"""Standard deviation of each component of the observed velocities (world units/s): 95 % of errors of speeds are within 1.645
of them, rounded (`python benchmarks/extensions.py DATA PROPOSALS --scenes 70 --errors`)."""
CLOSENESS_WORLD = 0.4
"""Scale on which the closest approach tells pairs apart that collide in equally many runs (world units)."""


class FittedScene(Explanation):
    """A fitted video that can be simulated on.

    Args:
        states: the tracks.
        smoothed: the same, smoothed between the collisions.
        found: collisions of the video, and the fit with them.
        config: noise, and number of runs.
    """

    def __init__(
        self, states: MotionStates, smoothed: SmoothedTracks, found: FoundCollisions, config: PhysicsConfig
    ) -> None:
        fitted, observed = self.fitted, self.collisions = found.fit, found.collisions
        physics = ObjectPhysics(
            smoothed.velocity_world_per_s.astype(np.float32),
            VELOCITY_ERROR_WORLD_PER_S,
            np.log(fitted.bodies.mass),
            fitted.log_mass_covariance,
        )
        super().__init__(states.objects, states.n_frames, states.camera, physics)
        self.states, self.smoothed, self.config = states, smoothed, config
        n = len(states.objects)
        # Smoothed stretches follow the tracks most closely; where there is none, the fitted run steps in.
        self.motion = fitted.states.copy()
        known = np.isfinite(smoothed.location_world).all(-1)
        self.motion[known, POSITION] = smoothed.location_world[known]
        self.motion[known, VELOCITY] = smoothed.velocity_world_per_s[known]
        met = {i for e in observed for i in e.objects}
        # Each run draws its masses, positions, velocities and yaws in this order.
        noise = np.random.default_rng(config.seed).standard_t(DEGREES_OF_FREEDOM, size=(config.runs - 1, 6 * n))
        mass_noise = np.array([config.mass_noise if i in met else LOG_MASS_STD for i in range(n)])
        place, velocity = (part.reshape(-1, n, 1, 2) for part in np.split(noise[:, n : 5 * n], 2, axis=1))
        state = self._state_errors(place, velocity, noise[:, 5 * n :, None])
        self.perturbations = Perturbations(state, np.exp(mass_noise * noise[:, :n]))
        self.uncertain = [
            UncertainCollision(event, p) for event, p in found.candidates if MIN_PROBABILITY <= p <= 1 - MIN_PROBABILITY
        ]

    def _state_errors(self, place: FloatArray, velocity: FloatArray, yaw: FloatArray) -> FloatArray:
        """(R, n, F, 6) errors of the states, of standardised ones of positions and velocities (R, n, 1, 2) and yaws (R, n, 1).

        Those of a line fitted to a stretch's detections by least squares: its place in their middle and its velocity. Where
        nothing fits, both have the largest errors.
        """
        noise, shape = self.config.position_noise_world, (len(self.objects), self.n_frames)
        place_error, velocity_error = (
            np.full(shape, MAX_POSITION_ERROR_WORLD),
            np.full(shape, MAX_VELOCITY_ERROR_WORLD_PER_S),
        )
        since_middle = np.zeros(shape)
        for i, stretches in enumerate(self.smoothed.stretches):
            for start, end, s in stretches:
                place_error[i, start:end] = min(s.middle_variance(noise) ** 0.5, MAX_POSITION_ERROR_WORLD)
                velocity_error[i, start:end] = min(s.velocity_variance(noise) ** 0.5, MAX_VELOCITY_ERROR_WORLD_PER_S)
                since_middle[i, start:end] = FRAME_SECONDS * (np.arange(start, end) - s.middle_frame)
        errors = np.zeros((len(yaw), *shape, 6))
        errors[..., VELOCITY] = velocity_error[..., None] * velocity
        errors[..., POSITION] = place_error[..., None] * place + since_middle[..., None] * errors[..., VELOCITY]
        errors[..., YAW] = self.config.yaw_noise * yaw
        return errors

    @limit_threads(1)
    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """The video as it is, or with interventions.

        Raises:
            DataError: an intervention is impossible (see `change_bodies`).
        """
        if changes:
            return self._with_changes(changes, from_frame, frames)
        rollout = self._unchanged(frames)
        return self._with_repetitions(rollout, from_frame) if from_frame else rollout

    def _unchanged(self, total: int) -> Rollout:
        """The video as it is and its continuation: each pair collides once."""
        n = len(self.objects)
        every = np.ones(n, bool)
        motion = self._prescribed(np.full(n, self.n_frames - 1))
        run = simulate(self._bodies_at(0), every, total, prescribed=motion, perturbations=self.perturbations)
        frames, position = run.contacts, run.states[..., POSITION]
        pairs, share = {e.objects for e in self.collisions}, (frames != NO_CONTACT).mean(0)
        later = [
            (replace(event, frame=max(event.frame, self.n_frames)), p)
            for event, p in self._probable_collisions(frames, share)
            if event.objects not in pairs
        ]
        collisions, uncertain = self._judged(later)
        gap = position[:, self.n_frames - 1 :]
        gap = np.linalg.norm(gap[:, None] - gap[None], axis=-1).min(-1) - 2 * OBJECT_RADIUS_WORLD
        scores = (len(frames) * share + np.exp(-np.maximum(gap, 0) / CLOSENESS_WORLD)) / (len(frames) + 1)
        for pair in pairs:  # a pair collides once
            scores[pair] = scores[pair[::-1]] = 0.0
        rollout = Rollout(
            position,
            self._visible(run, every, np.zeros(n, bool), 0),
            tuple(sorted([*self.collisions, *collisions], key=lambda e: e.frame)),
            scores,
            uncertain=(*self.uncertain, *uncertain),
            yaw=run.states[..., YAW],
        )
        return with_smoothed_tracks(rollout, self.smoothed)

    def _with_repetitions(self, rollout: Rollout, from_frame: int) -> Rollout:
        """The rollout of the video with the first collision after a frame also of pairs that collided before.

        Rollouts with interventions at that frame have these collisions, too.
        """
        unchanged = change_bodies(self._bodies_at(from_frame), self.objects, ())
        earlier = {e.objects for e in self._earlier(from_frame, unchanged.exists)}
        if not earlier:
            return rollout
        later = self._later_collisions(unchanged, from_frame, rollout.visible.shape[1])[1]
        repeated = [(event, p) for event, p in later if event.objects in earlier and event not in self.collisions]
        collisions, uncertain = self._judged(repeated)
        return replace(
            rollout,
            collisions=tuple(sorted([*rollout.collisions, *collisions], key=lambda e: e.frame)),
            uncertain=(*(rollout.uncertain or ()), *uncertain),
        )

    def _with_changes(self, changes: Sequence[Intervention], from_frame: int, total: int) -> Rollout:
        """The rollout with interventions at a frame of the video."""
        changed = change_bodies(self._bodies_at(from_frame), self.objects, changes)
        run, later = self._later_collisions(changed, from_frame, total)
        collisions, uncertain = self._judged(later)
        extra = len(changed.exists) - len(self.objects)
        location, speed = run.states[..., POSITION].copy(), np.linalg.norm(run.states[..., VELOCITY], axis=-1)
        location[~changed.exists] = np.nan
        location[:, :from_frame] = padded(self.motion[:, :from_frame, POSITION], extra, np.nan)
        observed_speed = padded(np.linalg.norm(self.smoothed.velocity_world_per_s, axis=-1), extra, np.nan)
        as_observed = _as_observed(run, changed.simulated, from_frame)[:, : self.n_frames]
        speed[:, : self.n_frames] = np.where(as_observed, observed_speed, speed[:, : self.n_frames])
        yaw = run.states[..., YAW].copy()
        yaw[:, :from_frame] = padded(self.motion[:, :from_frame, YAW], extra, 0.0)
        shapes = [o.shape for o in with_added(self.objects, changes)]
        return Rollout(
            location,
            self._visible(run, changed.exists, changed.simulated, from_frame, shapes),
            tuple(sorted([*self._earlier(from_frame, changed.exists), *collisions], key=lambda e: e.frame)),
            None,
            speed,
            (*(one for one in self.uncertain if _is_earlier(one.event, from_frame, changed.exists)), *uncertain),
            yaw,
        )

    def _judged(self, found: list[tuple[Event, float]]) -> tuple[list[Event], list[UncertainCollision]]:
        """Those of possible collisions that count, and those that are not certain."""
        collisions = [event for event, p in found if p > self.config.collision_threshold]
        return collisions, [UncertainCollision(event, p) for event, p in found if p <= 1 - MIN_PROBABILITY]

    def _earlier(self, from_frame: int, exists: BoolArray) -> list[Event]:
        """Collisions that interventions at a frame, after which the objects (n,) exist, cannot change."""
        return [e for e in self.collisions if _is_earlier(e, from_frame, exists)]

    def _later_collisions(
        self, changed: ChangedBodies, from_frame: int, total: int
    ) -> tuple[SimulatedMotion, list[tuple[Event, float]]]:
        """The runs from a frame on, and the collisions after it that are not ruled out, with their probabilities."""
        run = self._run(changed, from_frame, total)
        frames = run.contacts
        earlier = self._earlier(from_frame, changed.exists)
        for event in earlier:  # while they touch or soon after, it is the same collision
            i, j = event.objects
            continued = frames[:, i, j] <= max(event.frame + CONTACT_PAUSE_STEPS // STEPS_PER_FRAME, from_frame + 1)
            frames[continued, i, j] = frames[continued, j, i] = NO_CONTACT
        untouched = (changed.exists & ~changed.simulated)[: len(self.objects)]
        share, found = (frames != NO_CONTACT).mean(0), {e.objects for e in self.collisions}
        # The runs take the collisions of the video as they were found. One that is uncertain is so in the changed scene, too;
        # one that was probably none happens in the runs, or else as probably as in the video.
        for one in self.uncertain:
            (i, j), p = one.event.objects, one.probability
            if untouched[[i, j]].all() and not _is_earlier(one.event, from_frame, changed.exists):
                share[i, j] = share[i, j] * p if (i, j) in found else 1 - (1 - share[i, j]) * (1 - p)
        return run, [*self._probable_collisions(frames, share), *self._repeated(run, changed, from_frame)]

    def _repeated(self, run: SimulatedMotion, changed: ChangedBodies, from_frame: int) -> list[tuple[Event, float]]:
        """Further collisions of pairs in the video that the runs keep, with their shares of runs."""
        later = [e for e in self.collisions if not _is_earlier(e, from_frame, changed.exists)]
        pairs = [e.objects for e in later]
        again = [e for k, e in enumerate(later) if e.objects in pairs[:k] and changed.exists[list(e.objects)].all()]
        kept = [(e, float((run.free_from[:, e.objects] >= e.frame).all(1).mean())) for e in again]
        return [(event, p) for event, p in kept if p >= MIN_PROBABILITY]

    def _probable_collisions(self, frames: IntArray, probability: FloatArray) -> list[tuple[Event, float]]:
        """Collisions that are not ruled out, with their probabilities.

        Args:
            frames: (runs, n, n) of first contacts. A collision is at their median, or else where it was uncertain in the video.
            probability: (n, n) of each pair.
        """
        in_video = {one.event.objects: one.event.frame for one in self.uncertain}
        found = []
        for i, j in np.argwhere(np.triu(probability >= MIN_PROBABILITY, 1)).tolist():
            at = frames[:, i, j][frames[:, i, j] != NO_CONTACT]
            frame = int(np.median(at)) if len(at) else in_video[i, j]
            found.append((Event("collision", frame, (i, j)), float(probability[i, j])))
        return found

    def _bodies_at(self, frame: int) -> BodyStates:
        """The objects at a frame of the video."""
        return BodyStates(self.fitted.bodies.shape, self.motion[:, frame], self.fitted.bodies.mass)

    def _prescribed(self, until: IntArray) -> PrescribedMotion:
        """The motion of the video, that each object, and further ones, keep until a frame (n,)."""
        motion = padded(self.motion, len(until) - len(self.motion), 0.0)
        return PrescribedMotion(
            motion, until, np.array([(*e.objects, e.frame) for e in self.collisions]).reshape(-1, 3)
        )

    def _run(self, changed: ChangedBodies, from_frame: int, total: int) -> SimulatedMotion:
        n, old = len(changed.exists), len(self.objects)
        rebound, prescribed = np.full((n, n), np.nan), self._prescribed(self._until(changed, from_frame))
        for i, j in self._unchanged_collisions(changed, from_frame):
            rebound[i, j] = rebound[j, i] = self.fitted.rebound[i, j]
        # Added objects and what interventions give exactly are not perturbed.
        runs = self.config.runs - 1
        state, mass = np.zeros((runs, n, self.n_frames, 6)), np.ones((runs, n))
        state[:, :old], mass[:, :old] = self.perturbations.state, self.perturbations.mass
        state *= ~changed.exact[:, None]
        mass[:, changed.exact_mass] = 1.0
        perturbations = Perturbations(state, mass)
        return simulate(changed.bodies, changed.exists, total, rebound, prescribed, from_frame, perturbations)

    def _unchanged_collisions(self, changed: ChangedBodies, from_frame: int) -> list[tuple[int, ...]]:
        """Pairs whose next collision in the video is at unchanged velocities, one of them having another mass.

        How strongly they rebound depends on the moment within a step of the simulation, which is as in the video.
        """
        first: dict[int, Event] = {}
        for event in self.collisions:
            if event.frame > from_frame:
                for i in event.objects:
                    first.setdefault(i, event)
        as_before = changed.exists & ~changed.simulated
        events = {first[i] for i in np.flatnonzero(changed.reweighed).tolist() if i in first}
        return [e.objects for e in events if as_before[list(e.objects)].all() and all(first[i] == e for i in e.objects)]

    def _until(self, changed: ChangedBodies, from_frame: int) -> IntArray:
        """(n,) frame from which each object is simulated: objects of another mass from their next collision in the video."""
        until = np.full(len(changed.exists), self.n_frames - 1)
        for i in np.flatnonzero(changed.reweighed):
            hits = [e.frame for e in self.collisions if i in e.objects and e.frame > from_frame]
            until[i] = min([frame - 1 for frame in hits], default=self.n_frames - 1)
        until[changed.simulated] = 0
        return until

    def _visible(
        self,
        run: SimulatedMotion,
        exists: BoolArray,
        simulated: BoolArray,
        from_frame: int,
        shapes: list[str] | None = None,
    ) -> BoolArray:
        """(n, F) bool: as observed until an object is simulated, then as its simulated position is in the image."""
        shapes = shapes or [o.shape for o in self.objects]
        observed = np.zeros(run.states.shape[:2], bool)
        observed[: len(self.objects), : self.n_frames] = self.smoothed.visible
        as_observed = _as_observed(run, simulated, from_frame)
        there = exists[:, None] | (np.arange(run.states.shape[1]) < from_frame)
        position = np.where((~as_observed & there)[..., None], run.states[..., POSITION], np.nan)
        return np.where(as_observed, observed, rollout_in_image(shapes, position, self.states.camera)) & there


def _is_earlier(event: Event, from_frame: int, exists: BoolArray) -> bool:
    """Whether interventions at a frame, after which the objects (n,) exist, leave a collision as it was.

    What is removed at the first frame was never there.
    """
    return event.frame <= from_frame and (from_frame > 0 or bool(exists[list(event.objects)].all()))


def _as_observed(run: SimulatedMotion, simulated: BoolArray, from_frame: int) -> BoolArray:
    """(n, F) bool: where objects keep the motion of the video."""
    frame = np.arange(run.states.shape[1])
    return (frame < from_frame) | ((frame <= run.free_from[0, :, None]) & ~simulated[:, None])

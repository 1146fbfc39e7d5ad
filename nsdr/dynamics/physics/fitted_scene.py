"""The explanation of the physics backend: a fitted video whose simulation can be continued, as it is or with interventions.

Objects that an intervention cannot influence keep their observed motion. All others are simulated: once as fitted, and many
times with perturbed states and masses, which gives probabilities.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nsdr.dynamics.base import Explanation
from nsdr.dynamics.interventions import with_added
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.body_state import POSITION, STATE_SIZE, VELOCITY, YAW
from nsdr.dynamics.physics.changed_bodies import ChangedBodies, change_bodies
from nsdr.dynamics.physics.collision_search import FoundCollisions
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.simulated_view import as_observed, uncertain_borders, visible_in_runs
from nsdr.dynamics.physics.simulator import (
    NO_CONTACT,
    BodyStates,
    Perturbations,
    PrescribedMotion,
    SimulatedMotion,
    simulate,
)
from nsdr.dynamics.simulation import padded
from nsdr.dynamics.track_smoothing import SmoothedTracks, with_smoothed_tracks
from nsdr.types import Event, ObjectPhysics, Rollout, SceneObject, UncertainEvent
from nsdr.types.interventions import Intervention
from nsdr.validation import BoolArray, FloatArray, IntArray

MIN_PROBABILITY = 0.005
"""An event that is less probable than this is ruled out, and one that is more probable than 1 - this is certain."""
DEGREES_OF_FREEDOM = 4
"""Degrees of freedom of Student's t distribution, from which errors are drawn, as a few errors are much larger than the others.
Set, like `MAX_POSITION_ERROR_WORLD`, `MAX_VELOCITY_ERROR_WORLD_PER_S` and the noise in `PhysicsConfig`, on truncated real
scenes of `train` and on generated scenes with an object removed."""
MAX_POSITION_ERROR_WORLD, MAX_VELOCITY_ERROR_WORLD_PER_S = 0.05, 0.4
"""Largest errors of the position and velocity of a stretch (world units, world units/s in CLEVRER)."""
VELOCITY_ERROR_WORLD_PER_S = 0.02
"""Standard deviation of each component of the observed velocities (world units/s in CLEVRER), rounded: 95 % of the errors of
speeds are within 1.645 standard deviations (`python -m benchmarks.extensions DATA PROPOSALS --scenes 70 --errors`)."""
CLOSENESS_WORLD = 0.4
"""Length scale of the closest approach in the score that orders pairs that collide in equally many runs (world units in
CLEVRER)."""


class FittedScene(Explanation):
    """A fitted video whose simulation can be continued.

    Args:
        states: motion states of the objects.
        smoothed: tracks smoothed between the collisions.
        found: collisions of the video, and the fit with them.
        config: noise levels and number of runs.
    """

    def __init__(
        self, states: MotionStates, smoothed: SmoothedTracks, found: FoundCollisions, config: PhysicsConfig
    ) -> None:
        fitted, observed = self.fitted, self.collisions = found.fit, found.collisions
        self.scales = states.world.scales
        self.radius = np.array([states.world.vocabulary.shape(o.shape).radius_world for o in states.objects])
        physics = ObjectPhysics(
            smoothed.velocity_world_per_s.astype(np.float32),
            VELOCITY_ERROR_WORLD_PER_S * self.scales.speed,
            np.log(fitted.bodies.mass),
            fitted.log_mass_covariance,
        )
        super().__init__(states.objects, states.n_frames, states.world, physics)
        self.states, self.smoothed, self.config = states, smoothed, config
        n = len(states.objects)
        # Smoothed stretches follow the tracks most closely; where there is none, the fitted run is used.
        self.motion = fitted.states.copy()
        known = np.isfinite(smoothed.location_world).all(-1)
        self.motion[known, POSITION] = smoothed.location_world[known]
        self.motion[known, VELOCITY] = smoothed.velocity_world_per_s[known]
        met = {i for e in observed for i in e.objects}
        # Each run draws its masses, positions, velocities and yaws in this order.
        noise = np.random.default_rng(config.seed).standard_t(DEGREES_OF_FREEDOM, size=(config.runs - 1, 6 * n))
        mass_noise = np.array([config.mass_noise if i in met else states.world.physics.log_mass_std for i in range(n)])
        place, velocity = (part.reshape(-1, n, 1, 2) for part in np.split(noise[:, n : 5 * n], 2, axis=1))
        state = self._state_errors(place, velocity, noise[:, 5 * n :, None])
        self.perturbations = Perturbations(state, np.exp(mass_noise * noise[:, :n]))
        self.uncertain = [
            UncertainEvent(event, p) for event, p in found.candidates if MIN_PROBABILITY <= p <= 1 - MIN_PROBABILITY
        ]

    def _state_errors(self, place: FloatArray, velocity: FloatArray, yaw: FloatArray) -> FloatArray:
        """Errors (R, n, F, 6) of the states from standardised errors.

        The errors are those of a least-squares line through the detections of a stretch:

            position error(t) = σ_position · place + (t - middle) · velocity error, velocity error = σ_velocity · velocity

        Frames without a fitted stretch have the largest errors.

        Args:
            place: (R, n, 1, 2) standardised errors of positions at the middle of a stretch.
            velocity: (R, n, 1, 2) standardised errors of velocities.
            yaw: (R, n, 1) standardised errors of yaws.
        """
        noise, shape = self.config.position_noise_world * self.scales.size, (len(self.objects), self.n_frames)
        most = MAX_POSITION_ERROR_WORLD * self.scales.size, MAX_VELOCITY_ERROR_WORLD_PER_S * self.scales.speed
        place_error, velocity_error = np.full(shape, most[0]), np.full(shape, most[1])
        frame_seconds = self.world.physics.frame_seconds
        since_middle = np.zeros(shape)
        for i, stretches in enumerate(self.smoothed.stretches):
            for start, end, s in stretches:
                place_error[i, start:end] = min(s.middle_variance(noise) ** 0.5, most[0])
                velocity_error[i, start:end] = min(s.velocity_variance(noise) ** 0.5, most[1])
                since_middle[i, start:end] = frame_seconds * (np.arange(start, end) - s.middle_frame)
        errors = np.zeros((len(yaw), *shape, STATE_SIZE))
        errors[..., VELOCITY] = velocity_error[..., None] * velocity
        errors[..., POSITION] = place_error[..., None] * place + since_middle[..., None] * errors[..., VELOCITY]
        errors[..., YAW] = self.config.yaw_noise * yaw
        return errors

    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """Roll out the video as it is, or with interventions.

        Raises:
            DataError: an intervention is impossible (see `change_bodies`).
        """
        if changes:
            return self._with_changes(changes, from_frame, frames)
        rollout = self._unchanged(frames)
        return self._with_repetitions(rollout, from_frame) if from_frame else rollout

    def _unchanged(self, total: int) -> Rollout:
        """The rollout of the video as it is and its continuation, in which each pair collides at most once."""
        n = len(self.objects)
        every = np.ones(n, bool)
        motion = self._prescribed(every, np.full(n, self.n_frames - 1))
        run = simulate(self._bodies_at(0), every, total, prescribed=motion, perturbations=self.perturbations)
        frames, position = run.contacts, run.states[..., POSITION]
        pairs, share = {e.objects for e in self.collisions}, (frames != NO_CONTACT).mean(0)
        later = [
            (replace(event, frame=max(event.frame, self.n_frames)), p)
            for event, p in self._probable_collisions(frames, share)
            if event.objects not in pairs
        ]
        collisions, uncertain = self._split(later)
        visible = self._visible(run, every, ~every, 0, self.objects)
        gap = position[:, self.n_frames - 1 :]
        gap = np.linalg.norm(gap[:, None] - gap[None], axis=-1).min(-1) - np.add.outer(self.radius, self.radius)
        scores = (len(frames) * share + np.exp(-np.maximum(gap, 0) / (CLOSENESS_WORLD * self.scales.size))) / (
            len(frames) + 1
        )
        for pair in pairs:  # a pair collides once
            scores[pair] = scores[pair[::-1]] = 0.0
        rollout = Rollout(
            position,
            visible[0],
            tuple(sorted([*self.collisions, *collisions], key=lambda e: e.frame)),
            scores,
            uncertain=(*self.uncertain, *uncertain, *uncertain_borders(visible, self.n_frames, MIN_PROBABILITY)),
            yaw=run.states[..., YAW],
        )
        return with_smoothed_tracks(rollout, self.smoothed)

    def _with_repetitions(self, rollout: Rollout, from_frame: int) -> Rollout:
        """Add to the rollout of the video the first collision after a frame of pairs that also collided before it.

        Rollouts with interventions at that frame have such collisions, so a comparison needs them here, too.
        """
        unchanged = change_bodies(self._bodies_at(from_frame), self.objects, (), self.world)
        earlier = {e.objects for e in self._earlier(from_frame, unchanged.exists)}
        if not earlier:
            return rollout
        later = self._later_collisions(unchanged, from_frame, rollout.visible.shape[1])[1]
        repeated = [(event, p) for event, p in later if event.objects in earlier and event not in self.collisions]
        collisions, uncertain = self._split(repeated)
        return replace(
            rollout,
            collisions=tuple(sorted([*rollout.collisions, *collisions], key=lambda e: e.frame)),
            uncertain=(*(rollout.uncertain or ()), *uncertain),
        )

    def _with_changes(self, changes: Sequence[Intervention], from_frame: int, total: int) -> Rollout:
        """The rollout of `total` frames with interventions at a frame of the video."""
        changed = change_bodies(self._bodies_at(from_frame), self.objects, changes, self.world)
        run, later = self._later_collisions(changed, from_frame, total)
        collisions, uncertain = self._split(later)
        extra = len(changed.exists) - len(self.objects)
        location, speed = run.states[..., POSITION].copy(), np.linalg.norm(run.states[..., VELOCITY], axis=-1)
        location[~changed.exists] = np.nan
        location[:, :from_frame] = padded(self.motion[:, :from_frame, POSITION], extra, np.nan)
        observed_speed = padded(np.linalg.norm(self.smoothed.velocity_world_per_s, axis=-1), extra, np.nan)
        follows = as_observed(run, changed.simulated, from_frame)[0, :, : self.n_frames]
        speed[:, : self.n_frames] = np.where(follows, observed_speed, speed[:, : self.n_frames])
        yaw = run.states[..., YAW].copy()
        yaw[:, :from_frame] = padded(self.motion[:, :from_frame, YAW], extra, 0.0)
        objects = with_added(self.objects, changes)
        visible = self._visible(run, changed.exists, changed.simulated, from_frame, objects)
        earlier = [one for one in self.uncertain if _is_earlier(one.event, from_frame, changed.exists)]
        return Rollout(
            location,
            visible[0],
            tuple(sorted([*self._earlier(from_frame, changed.exists), *collisions], key=lambda e: e.frame)),
            None,
            speed,
            (*earlier, *uncertain, *uncertain_borders(visible, from_frame + 1, MIN_PROBABILITY)),
            yaw,
        )

    def _split(self, found: list[tuple[Event, float]]) -> tuple[list[Event], list[UncertainEvent]]:
        """From possible collisions and their probabilities: the collisions that count, and those that are not certain."""
        collisions = [event for event, p in found if p > self.config.collision_threshold]
        return collisions, [UncertainEvent(event, p) for event, p in found if p <= 1 - MIN_PROBABILITY]

    def _earlier(self, from_frame: int, exists: BoolArray) -> list[Event]:
        """Collisions of the video that interventions at a frame cannot change (see `_is_earlier`)."""
        return [e for e in self.collisions if _is_earlier(e, from_frame, exists)]

    def _later_collisions(
        self, changed: ChangedBodies, from_frame: int, total: int
    ) -> tuple[SimulatedMotion, list[tuple[Event, float]]]:
        """The runs from a frame on, and the collisions after it that are not ruled out, with their probabilities."""
        run = self._run(changed, from_frame, total)
        frames = run.contacts
        earlier = self._earlier(from_frame, changed.exists)
        for event in earlier:  # contact continues, or resumes soon after: the same collision
            i, j = event.objects
            continued = frames[:, i, j] <= max(event.frame + self.world.physics.contact_pause_frames, from_frame + 1)
            frames[continued, i, j] = frames[continued, j, i] = NO_CONTACT
        untouched = (changed.exists & ~changed.simulated)[: len(self.objects)]
        share, found = (frames != NO_CONTACT).mean(0), {e.objects for e in self.collisions}
        # The runs assume the collisions that were found in the video. With probability p of a collision in the video and share
        # s of
        # runs with it, its probability in the changed scene is s p if it was found, and 1 - (1 - s)(1 - p) if it was not.
        for one in self.uncertain:
            (i, j), p = one.event.objects, one.probability
            if untouched[[i, j]].all() and not _is_earlier(one.event, from_frame, changed.exists):
                share[i, j] = share[i, j] * p if (i, j) in found else 1 - (1 - share[i, j]) * (1 - p)
        return run, [*self._probable_collisions(frames, share), *self._repeated(run, changed, from_frame)]

    def _repeated(self, run: SimulatedMotion, changed: ChangedBodies, from_frame: int) -> list[tuple[Event, float]]:
        """Second and later collisions of pairs in the video, with the share of runs that keep them."""
        later = [e for e in self.collisions if not _is_earlier(e, from_frame, changed.exists)]
        pairs = [e.objects for e in later]
        again = [e for k, e in enumerate(later) if e.objects in pairs[:k] and changed.exists[list(e.objects)].all()]
        kept = [(e, float((run.free_from[:, e.objects] >= e.frame).all(1).mean())) for e in again]
        return [(event, p) for event, p in kept if p >= MIN_PROBABILITY]

    def _probable_collisions(self, frames: IntArray, probability: FloatArray) -> list[tuple[Event, float]]:
        """Collisions that are not ruled out, with their probabilities.

        Args:
            frames: (runs, n, n) frames of first contacts. A collision is at their median, or, if no run has it, in the frame of
                the uncertain collision in the video.
            probability: (n, n) probability of a collision of each pair.
        """
        in_video = {one.event.objects: one.event.frame for one in self.uncertain}
        found = []
        for i, j in np.argwhere(np.triu(probability >= MIN_PROBABILITY, 1)).tolist():
            at = frames[:, i, j][frames[:, i, j] != NO_CONTACT]
            frame = int(np.median(at)) if len(at) else in_video[i, j]
            found.append((Event("collision", frame, (i, j)), float(probability[i, j])))
        return found

    def _bodies_at(self, frame: int) -> BodyStates:
        """The bodies in a frame of the video."""
        return BodyStates(self.fitted.bodies.body, self.motion[:, frame], self.fitted.bodies.mass)

    def _prescribed(self, is_prescribed: BoolArray, free_at_latest: IntArray) -> PrescribedMotion:
        """The motion of the video for n objects, including added ones, as `PrescribedMotion`."""
        motion = padded(self.motion, len(is_prescribed) - len(self.motion), 0.0)
        collisions = np.array([(*e.objects, e.frame) for e in self.collisions]).reshape(-1, 3)
        return PrescribedMotion(motion, is_prescribed, free_at_latest, collisions)

    def _run(self, changed: ChangedBodies, from_frame: int, total: int) -> SimulatedMotion:
        """Simulate changed bodies from a frame up to, not including, frame `total`."""
        n, old = len(changed.exists), len(self.objects)
        prescribed = self._prescribed(~changed.simulated, self._free_at_latest(changed, from_frame))
        rebound = np.full((n, n), np.nan)
        for i, j in self._unchanged_collisions(changed, from_frame):
            rebound[i, j] = rebound[j, i] = self.fitted.rebound[i, j]
        # Added objects, and states and masses that interventions set, are not perturbed.
        runs = self.config.runs - 1
        state, mass = np.zeros((runs, n, self.n_frames, STATE_SIZE)), np.ones((runs, n))
        state[:, :old], mass[:, :old] = self.perturbations.state, self.perturbations.mass
        state *= ~changed.exact[:, None]
        mass[:, changed.exact_mass] = 1.0
        perturbations = Perturbations(state, mass)
        return simulate(changed.bodies, changed.exists, total, rebound, prescribed, from_frame, perturbations)

    def _unchanged_collisions(self, changed: ChangedBodies, from_frame: int) -> list[tuple[int, ...]]:
        """Pairs with a changed mass whose next collision in the video happens at unchanged velocities.

        Their rebound depends on when in a time step of the simulation they touch, which is as in the video.
        """
        first: dict[int, Event] = {}
        for event in self.collisions:
            if event.frame > from_frame:
                for i in event.objects:
                    first.setdefault(i, event)
        as_before = changed.exists & ~changed.simulated
        events = {first[i] for i in np.flatnonzero(changed.reweighed).tolist() if i in first}
        return [e.objects for e in events if as_before[list(e.objects)].all() and all(first[i] == e for i in e.objects)]

    def _free_at_latest(self, changed: ChangedBodies, from_frame: int) -> IntArray:
        """(n,) frame in which each object is set free at the latest: before its next collision if its mass is changed.

        All other objects keep the motion of the video to its last frame unless something happens to them.
        """
        free_at_latest = np.full(len(changed.exists), self.n_frames - 1)
        for i in np.flatnonzero(changed.reweighed):
            hits = [e.frame for e in self.collisions if i in e.objects and e.frame > from_frame]
            free_at_latest[i] = min([frame - 1 for frame in hits], default=self.n_frames - 1)
        return free_at_latest

    def _visible(
        self,
        run: SimulatedMotion,
        exists: BoolArray,
        simulated: BoolArray,
        from_frame: int,
        objects: Sequence[SceneObject],
    ) -> BoolArray:
        """(1 + R, n, F) bool, whether each object is in the image in each run (see `visible_in_runs`)."""
        shapes, camera = [self.world.vocabulary.shape(o.shape) for o in objects], self.camera
        return visible_in_runs(run, self.smoothed.visible, exists, simulated, from_frame, shapes, camera)


def _is_earlier(event: Event, from_frame: int, exists: BoolArray) -> bool:
    """Whether interventions at a frame cannot change a collision of the video.

    `exists` (n,) says which objects exist afterwards. An object removed in frame 0 was never there, so it had no collisions.
    """
    return event.frame <= from_frame and (from_frame > 0 or bool(exists[list(event.objects)].all()))

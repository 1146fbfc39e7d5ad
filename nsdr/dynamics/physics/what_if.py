"""Interventions on a fitted scene: what cannot be influenced by them keeps its observed motion, the rest is simulated."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.interventions import Changes
from nsdr.dynamics.physics.changed_bodies import ChangedBodies, change_bodies
from nsdr.dynamics.physics.fitted_scene import MIN_PROBABILITY, FittedScene
from nsdr.dynamics.physics.simulator import (
    NO_CONTACT,
    Perturbations,
    PrescribedMotion,
    SimulatedMotion,
    simulate_perturbed,
)
from nsdr.dynamics.track_smoothing import rollout_in_image
from nsdr.types import Event, Rollout, UncertainCollision
from nsdr.world.physics_constants import CONTACT_PAUSE_STEPS, STEPS_PER_FRAME

__all__ = ["original", "what_if"]

FloatArray = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]


def original(scene: FittedScene, extra: int, from_frame: int) -> tuple[Rollout, FloatArray]:
    """The rollout without interventions, and its yaws (radians), with a number of further objects that are absent.

    Like the rollout with interventions, it has the first collision of each pair after their frame, too.
    """
    rollout, yaw = scene.rollout_and_yaw(None)
    repeated = _repeated_collisions(scene, from_frame)
    collisions = [*rollout.collisions, *(event for event, p in repeated if p > scene.config.collision_threshold)]
    uncertain = [
        *(rollout.uncertain or ()),
        *(UncertainCollision(event, p) for event, p in repeated if p <= 1 - MIN_PROBABILITY),
    ]
    speed = np.full(yaw.shape, np.nan)
    speed[:, : scene.frames] = _observed_speed(scene)
    visible = rollout.visible.copy()
    visible[:, : scene.frames] = scene.smoothed.visible
    padded = Rollout(
        _padded(rollout.location_world, extra, np.nan),
        _padded(visible, extra, False),
        tuple(sorted(collisions, key=lambda e: e.frame)),
        None,
        _padded(speed, extra, np.nan),
        tuple(uncertain),
    )
    return padded, _padded(yaw, extra, 0.0)


def what_if(scene: FittedScene, changes: Changes, from_frame: int) -> tuple[Rollout, FloatArray]:
    """The rollout with interventions at a frame of the video, and its yaws (radians).

    Raises:
        DataError: an intervention is impossible (see `change_bodies`).
    """
    changed = change_bodies(scene.bodies_at(from_frame), changes)
    first, later = _later_collisions(scene, changed, from_frame)
    collisions = _earlier_collisions(scene, from_frame)
    uncertain = [d for d in scene.uncertain if 0 < d.event.frame <= from_frame]
    for event, p in later:
        if p > scene.config.collision_threshold:
            collisions.append(event)
        if p <= 1 - MIN_PROBABILITY:
            uncertain.append(UncertainCollision(event, p))
    extra = len(changed.exists) - len(scene.states.objects)
    location, speed = first.position.copy(), np.linalg.norm(first.velocity, axis=-1)
    location[~changed.exists] = np.nan
    location[:, :from_frame] = _padded(scene.position[:, :from_frame], extra, np.nan)
    observed_speed = _padded(_observed_speed(scene), extra, np.nan)
    as_observed = _as_observed(scene, changed, first, from_frame)[:, : scene.frames]
    speed[:, : scene.frames] = np.where(as_observed, observed_speed, speed[:, : scene.frames])
    yaw = first.yaw.copy()
    yaw[:, :from_frame] = _padded(scene.fitted.motion.yaw[:, :from_frame], extra, 0.0)
    rollout = Rollout(
        location,
        _visible(scene, changes, changed, first, from_frame),
        tuple(sorted(collisions, key=lambda e: e.frame)),
        None,
        speed,
        tuple(uncertain),
    )
    return rollout, yaw


def _earlier_collisions(scene: FittedScene, from_frame: int) -> list[Event]:
    """Those that interventions at a frame cannot change."""
    return [e for e in scene.observed if 0 < e.frame <= from_frame]


def _later_collisions(
    scene: FittedScene, changed: ChangedBodies, from_frame: int
) -> tuple[SimulatedMotion, list[tuple[Event, float]]]:
    """The first run from a frame on, and the collisions after it that are not ruled out, with their probabilities."""
    first, frames = _runs(scene, changed, from_frame)
    for event in _earlier_collisions(scene, from_frame):  # while they touch or soon after, it is the same collision
        i, j = event.objects
        continued = frames[:, i, j] <= max(event.frame + CONTACT_PAUSE_STEPS // STEPS_PER_FRAME, from_frame + 1)
        frames[continued, i, j] = frames[continued, j, i] = NO_CONTACT
    untouched = (changed.exists & ~changed.simulated)[: len(scene.states.objects)]
    n, share = len(untouched), (frames != NO_CONTACT).mean(0)
    share[:n, :n] = scene.with_observed_uncertain(share[:n, :n], untouched, from_frame)
    return first, scene.probable_collisions(frames, share)


def _repeated_collisions(scene: FittedScene, from_frame: int) -> list[tuple[Event, float]]:
    """Collisions after a frame, without interventions, of pairs that collided before it; with their probabilities.

    `FittedScene.rollout` leaves them out.
    """
    pairs = {e.objects for e in _earlier_collisions(scene, from_frame)}
    if not pairs:
        return []
    unchanged = change_bodies(scene.bodies_at(from_frame), Changes((), scene.states.objects))
    later = _later_collisions(scene, unchanged, from_frame)[1]
    return [(event, p) for event, p in later if event.objects in pairs]


def _runs(
    scene: FittedScene, changed: ChangedBodies, from_frame: int
) -> tuple[SimulatedMotion, NDArray[np.integer[Any]]]:
    """The first run from a frame on, and the frames (runs, n, n) of first contacts of all."""
    motion, n, extra = scene.fitted.motion, len(changed.exists), len(changed.exists) - len(scene.states.objects)
    rebound, prescribed = np.full((n, n), np.nan), None
    if scene.shortcut:
        prescribed = PrescribedMotion(
            _padded(scene.position, extra, 0.0),
            _padded(scene.velocity, extra, 0.0),
            _padded(motion.yaw, extra, 0.0),
            _padded(motion.spin, extra, 0.0),
            _until(scene, changed, from_frame),
            scene.collisions,
        )
        for i, j in _unchanged_collisions(scene, changed, from_frame):
            rebound[i, j] = rebound[j, i] = scene.fitted.rebound[i, j]
    else:
        rebound[: n - extra, : n - extra] = scene.fitted.rebound
    return simulate_perturbed(
        changed.bodies, changed.exists, scene.total, _perturbations(scene, changed), rebound, prescribed, from_frame
    )


def _unchanged_collisions(scene: FittedScene, changed: ChangedBodies, from_frame: int) -> list[tuple[int, ...]]:
    """Pairs whose next collision in the video is at unchanged velocities, one of them having another mass.

    How strongly they rebound depends on the moment within a step of the simulation, which is as in the video.
    """
    first: dict[int, Event] = {}
    for event in scene.observed:
        if event.frame > from_frame:
            for i in event.objects:
                first.setdefault(i, event)
    as_before = changed.exists & ~changed.simulated
    events = {first[i] for i in np.flatnonzero(changed.reweighed).tolist() if i in first}
    return [e.objects for e in events if as_before[list(e.objects)].all() and all(first[i] == e for i in e.objects)]


def _until(scene: FittedScene, changed: ChangedBodies, from_frame: int) -> NDArray[np.integer[Any]]:
    """(n,) frame from which each object is simulated: objects of another mass from their next collision in the video."""
    until = np.full(len(changed.exists), scene.frames - 1)
    for i in np.flatnonzero(changed.reweighed):
        hits = [e.frame for e in scene.observed if i in e.objects and e.frame > from_frame]
        until[i] = min([frame - 1 for frame in hits], default=scene.frames - 1)
    until[changed.simulated] = 0
    return until


def _perturbations(scene: FittedScene, changed: ChangedBodies) -> Perturbations:
    """Those of the scene's rollouts; what interventions give exactly is not perturbed."""
    p, extra = scene.perturbations, len(changed.exists) - len(scene.states.objects)

    def exact(values: FloatArray, known: BoolArray, neutral: float) -> FloatArray:
        values = np.concatenate([values, np.full((len(values), extra, *values.shape[2:]), neutral)], 1)
        values[:, known] = neutral
        return values

    return Perturbations(
        exact(p.position, changed.exact_position, 0.0),
        exact(p.velocity, changed.exact_velocity, 0.0),
        exact(p.yaw, np.zeros(len(changed.exists), bool), 0.0),
        exact(p.mass, changed.exact_mass, 1.0),
    )


def _as_observed(scene: FittedScene, changed: ChangedBodies, run: SimulatedMotion, from_frame: int) -> BoolArray:
    """(n, F) bool: where objects keep the motion of the video."""
    frame = np.arange(scene.total)
    return (frame < from_frame) | ((frame <= run.free_from[:, None]) & ~changed.simulated[:, None])


def _visible(
    scene: FittedScene, changes: Changes, changed: ChangedBodies, run: SimulatedMotion, from_frame: int
) -> BoolArray:
    """(n, F) bool: as observed until an object is simulated, then as its simulated position is in the image."""
    extra = len(changed.exists) - len(scene.states.objects)
    observed = np.zeros(run.yaw.shape, bool)
    observed[:, : scene.frames] = _padded(scene.smoothed.visible, extra, False)
    as_observed = _as_observed(scene, changed, run, from_frame)
    there = changed.exists[:, None] | (np.arange(scene.total) < from_frame)
    position = np.where((~as_observed & there)[..., None], run.position, np.nan)
    shown = rollout_in_image([o.shape for o in changes.objects], position, scene.states.camera)
    return np.where(as_observed, observed, shown) & there


def _observed_speed(scene: FittedScene) -> FloatArray:
    """(n, frames of the video) world units/s; NaN where nothing fits."""
    return np.linalg.norm(scene.smoothed.velocity_world_per_s, axis=-1)


def _padded(values: NDArray[Any], extra: int, value: float | bool) -> NDArray[Any]:
    """(n, …) values with a number of further rows that hold one value."""
    return np.concatenate([values, np.full((extra, *values.shape[1:]), value, values.dtype)])

"""A fast planar simulator of CLEVRER's physics: rigid bodies on the ground plane with Bullet's contact rule, compiled by Numba.

All objects stand upright at one height, so what Bullet does in space happens in the plane: they slide, lose speed, and cubes
spin. Bullet steps 0.004 s at a time and handles contacts at a distance: once the gap is below a threshold, the speed after a
contact is at most the rebound minus gap / step. So the same collision rebounds with anything from 0 to 0.64 of the approach
speed, depending on where in a step it falls; where cubes and cylinders tip it depends less (`speed_after`). `rebound` replaces
this rule for a pair by a given rebound at a given gap, so that the motion is a smooth function of the initial state, as a fit
needs it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import CORNER_WORLD, CUBE, ROUND
from nsdr.dynamics.physics.forces import GIVEN_GAP_WORLD, approach, drift, push, rebound_at, slow_down, speed_after
from nsdr.validation import FloatArray, IntArray
from nsdr.world.physics_constants import CONTACT_THRESHOLD_WORLD, STEP_SECONDS, STEPS_PER_FRAME

NO_CONTACT = -1
"""Frame of the first contact of a pair that never touches."""
_STEP_REACH_WORLD = 0.03
"""Distance that two fast bodies cover in a step (world units, rounded up)."""
_MOST_STEPS = 10**6
"""Steps until the next look at two bodies that rest."""
_MAX_SWEEPS = 2
"""Passes over the contacts of a step: a second one where several press on each other."""


@dataclass(frozen=True)
class BodyStates:
    """Objects at the start of a run.

    Attributes:
        shape: (n,) int, index into `nsdr.world.vocabulary.SHAPES`.
        state: (n, 6) rows (x, y, vx, vy, yaw, spin): world units, radians and seconds.
        mass: (n,) relative.
    """

    shape: IntArray
    state: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class PrescribedMotion:
    """Motion that objects keep until one that does not keep its own collides with them.

    Attributes:
        states: (n, F, 6) rows at every frame of a video.
        until: (n,) int, the frame from which each object is simulated; 0 for an object that is simulated from the start.
        collisions: (E, 3) int, (i, j, frame) of prescribed collisions in order of time. If either object is absent or already
            simulated by then, the other is simulated from the frame before.
    """

    states: FloatArray
    until: IntArray
    collisions: IntArray


@dataclass(frozen=True)
class Perturbations:
    """Changes of the start of further runs.

    Attributes:
        state: (R, n, F, 6) added to rows at each frame, where motion is prescribed, and at the start; the last is that of later
            frames, too. Bodies at rest get no velocity.
        mass: (R, n) factors.
    """

    state: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class SimulatedMotion:
    """Result of a run, and of those with perturbations.

    Attributes:
        states: (n, F, 6) rows; zero before the first frame.
        contacts: (1 + R, n, n) int, the frame of each pair's first contact in each run, `NO_CONTACT` for none.
        free_from: (1 + R, n) int, the frame from which each object is simulated in each run.
    """

    states: FloatArray
    contacts: IntArray
    free_from: IntArray


def simulate(
    bodies: BodyStates,
    exists: NDArray[np.bool_],
    n_frames: int,
    rebound: FloatArray | None = None,
    prescribed: PrescribedMotion | None = None,
    start: int = 0,
    perturbations: Perturbations | None = None,
) -> SimulatedMotion:
    """Run the bodies from frame `start` to frame `n_frames - 1`, and again with each of R perturbations.

    Args:
        bodies: their state at frame `start`.
        exists: (n,) bool; the others are absent.
        n_frames: end of the run.
        rebound: (n, n) rebound of each pair as a share of its approach speed; NaN for Bullet's rule, None for it everywhere.
        prescribed: motion of objects until they are simulated.
        start: first frame.
        perturbations: of the further runs.
    """
    n, mass = len(bodies.shape), np.asarray(bodies.mass, float)
    rebound = np.full((n, n), np.nan) if rebound is None else rebound
    kept = prescribed or PrescribedMotion(np.zeros((n, 1, 6)), np.zeros(n, int), np.zeros((0, 3), int))
    runs = [(np.zeros((n, 1, 6)), mass)]
    if perturbations is not None:
        runs += zip(perturbations.state, mass * perturbations.mass, strict=True)
    shape, until, collisions = (np.ascontiguousarray(a, np.int64) for a in (bodies.shape, kept.until, kept.collisions))
    state, rebound, rows = (np.ascontiguousarray(a, float) for a in (bodies.state, rebound, kept.states))
    results = [
        _run(shape, state, change, own_mass, exists, rebound, rows, until, collisions, start, n_frames)
        for change, own_mass in runs
    ]
    _, contacts, free_from = zip(*results, strict=True)
    return SimulatedMotion(results[0][0], np.stack(contacts), np.stack(free_from))


@cached_njit
def _collide(shape, state, mass, i, j, given, used):  # type: ignore[no-untyped-def]
    """Apply the impulse of two bodies on each other if they touch in this step.

    With a given rebound it acts at a moment within the step, otherwise at its start. Returns whether they touched, and how far
    they must still move, both together, until they can touch (world units).
    """
    dx, dy = state[j, 0] - state[i, 0], state[j, 1] - state[i, 1]
    reach = 2 * ROUND + _STEP_REACH_WORLD
    reach += (CORNER_WORLD if shape[i] == CUBE else 0.0) + (CORNER_WORLD if shape[j] == CUBE else 0.0)
    distance = np.sqrt(dx * dx + dy * dy)
    if distance > reach:
        return False, distance - reach
    gap, apart, nx, ny, ci, cj = approach(shape, state, i, j)
    if not np.isnan(given):
        if apart >= 0 or gap + apart * STEP_SECONDS > GIVEN_GAP_WORLD:
            return False, gap - GIVEN_GAP_WORLD
        rebound_at(shape, state, mass, i, j, max(gap - GIVEN_GAP_WORLD, 0.0) / -apart, 0.0 if used else given)
        return True, 0.0
    if gap > CONTACT_THRESHOLD_WORLD:
        return False, gap - CONTACT_THRESHOLD_WORLD
    wanted = speed_after(shape, i, j, gap, apart)
    touched = wanted > apart
    if touched:
        push(shape, state, mass, i, j, wanted - apart, nx, ny, ci, cj)
    return touched, 0.0


@cached_njit
def _steps_apart(state, i, j, distance):  # type: ignore[no-untyped-def]
    """Steps in which two bodies surely do not touch that must move by a distance for it: their speeds only fall."""
    speed = np.sqrt(state[i, 2] ** 2 + state[i, 3] ** 2) + np.sqrt(state[j, 2] ** 2 + state[j, 3] ** 2)
    speed += (ROUND + CORNER_WORLD) * (abs(state[i, 5]) + abs(state[j, 5]))
    if distance >= _MOST_STEPS * STEP_SECONDS * speed:
        return _MOST_STEPS
    return max(int(distance / (STEP_SECONDS * speed)) - 1, 1) if distance > 0 else 1


@cached_njit
def _changed(row, change, i, frame, out):  # type: ignore[no-untyped-def]
    """Write a state (6,) with body i's change at a frame, of `change` (n, F, 6), to row i of `out`; a body at rest stays so."""
    rests = row[2] == 0.0 and row[3] == 0.0
    frame = min(frame, change.shape[1] - 1)
    for k in range(6):
        out[i, k] = row[k] if rests and (k == 2 or k == 3) else row[k] + change[i, frame, k]


@cached_njit
def _follow_prescribed(rows, change, collisions, until, frame, exists, state, contact, touched, free_from):  # type: ignore[no-untyped-def]
    """Bring a frame's prescribed collisions and states, with the run's change (n, F, 6), to the bodies."""
    for e in range(len(collisions)):
        i, j, when = collisions[e, 0], collisions[e, 1], collisions[e, 2]
        if when - 1 == frame:
            if exists[i] and exists[j] and frame < free_from[i] and frame < free_from[j]:
                touched[i, j] = True
                if contact[i, j] == NO_CONTACT:
                    contact[i, j] = contact[j, i] = when
            else:
                free_from[i] = min(free_from[i], frame)
                free_from[j] = min(free_from[j], frame)
    for i in range(len(until)):
        if frame <= free_from[i] and until[i] > 0:
            _changed(rows[i, frame], change, i, frame, state)


@cached_njit
def _run(shape, state, change, mass, exists, rebound, rows, until, collisions, start, n_frames):  # type: ignore[no-untyped-def]
    """States (n, n_frames, 6), first contacts (n, n) and ends (n,) of prescribed motion, with a change (n, F, 6) of states."""
    n = len(shape)
    states = np.zeros((n, n_frames, 6))
    contact, touched = np.full((n, n), NO_CONTACT), np.zeros((n, n), np.bool_)
    next_look = np.zeros((n, n), np.int64)
    free_from, given, state = until.copy(), state, np.empty((n, 6))
    for i in range(n):
        _changed(given[i], change, i, start, state)
    step_number = start * STEPS_PER_FRAME
    for frame in range(start, n_frames):
        _follow_prescribed(rows, change, collisions, until, frame, exists, state, contact, touched, free_from)
        any_free = False
        for i in range(n):
            any_free |= exists[i] and free_from[i] <= frame
            for k in range(6):
                states[i, frame, k] = state[i, k]
        if frame == n_frames - 1 or not any_free:
            step_number += STEPS_PER_FRAME
            continue
        last_step = step_number + STEPS_PER_FRAME
        for _ in range(STEPS_PER_FRAME):
            step_number += 1
            for i in range(n):
                if exists[i] and frame >= free_from[i]:
                    slow_down(shape[i], state, i)
            for sweep in range(_MAX_SWEEPS):
                hits = 0
                for i in range(n):
                    for j in range(i + 1, n):
                        if step_number < next_look[i, j] or not (exists[i] and exists[j]):
                            continue
                        if frame < free_from[i] and frame < free_from[j]:
                            continue
                        used = touched[i, j] and sweep == 0
                        touch, distance = _collide(shape, state, mass, i, j, rebound[i, j], used)
                        if not touch:
                            next_look[i, j] = step_number + _steps_apart(state, i, j, distance)
                            if frame < free_from[i] or frame < free_from[j]:
                                next_look[i, j] = min(next_look[i, j], last_step + 1)
                            continue
                        hits += 1
                        touched[i, j] = True
                        if contact[i, j] == NO_CONTACT:
                            contact[i, j] = contact[j, i] = int(step_number / STEPS_PER_FRAME + 0.5)
                        for body in (i, j):
                            free_from[body] = min(free_from[body], frame)
                            for other in range(n):
                                next_look[body, other] = next_look[other, body] = step_number
                if hits < 2:  # one contact needs no second look; several may press on each other
                    break
            for i in range(n):
                if exists[i]:
                    drift(state, i, STEP_SECONDS)
    return states, contact, free_from

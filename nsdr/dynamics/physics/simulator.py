"""A fast planar simulator of a world's physics: rigid bodies on the ground plane with Bullet's contact rule. Compiled by Numba.

All objects stand upright and meet at vertical walls or at equal heights, so their motion in Bullet is planar: they slide and
lose speed, and boxes spin. Bullet handles contacts at a distance: once the gap is below a threshold, the separation speed
after a contact is at most the rebound minus gap / step. So the same collision in CLEVRER rebounds with 0 to 0.64 of the
approach speed, depending on when in a time step it happens; the dependence is weaker where boxes and cylinders tip
(`speed_after`). A given `rebound` replaces this rule for a pair: the bodies then make contact at a given gap, and the motion is
a smooth function of the initial state, as a fit requires.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.body_state import POSITION, SPIN, STATE_SIZE, VX, VY, X, Y
from nsdr.dynamics.physics.forces import approach, drift, push, rebound_at, slow_down, speed_after
from nsdr.validation import BoolArray, FloatArray, IntArray

NO_CONTACT = -1
"""Frame of the first contact of pairs that never touch."""
_MAX_STEPS = 10**6
"""Number of Bullet steps until the next check of two bodies at rest."""
_MAX_SWEEPS = 2
"""Passes over the contacts in a Bullet step; the second is needed if several bodies press on each other."""


@dataclass(frozen=True)
class BodyStates:
    """The bodies at the start of a run.

    Attributes:
        body: (n,) records of `BODY`.
        state: (n, 6) states (x, y, vx, vy, yaw, spin), in world units, radians and seconds.
        mass: (n,) relative masses.
    """

    body: NDArray[np.void]
    state: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class PrescribedMotion:
    """Motion that objects keep until they are set free.

    In each frame, an object is in one of two states:

    - prescribed: it moves as in `states`, and nothing pushes it;
    - free: it is simulated, from the state that it had in the frame in which it was set free.

    An object without prescribed motion is free from the start. Any other object is set free in the first of these frames:

    - the frame `free_at_latest`;
    - the frame in which a free object touches it;
    - the frame before one of its prescribed collisions, if the other object is absent or free by then.

    A free object stays free.

    Attributes:
        states: (n, F, 6) prescribed states in every frame of a video.
        is_prescribed: (n,) bool, whether each object has prescribed motion.
        free_at_latest: (n,) int, the frame, below F, in which each object with prescribed motion is set free at the latest.
        collisions: (E, 3) int, prescribed collisions (i, j, frame) in order of time.
    """

    states: FloatArray
    is_prescribed: BoolArray
    free_at_latest: IntArray
    collisions: IntArray


@dataclass(frozen=True)
class Perturbations:
    """Perturbations of R further runs.

    Attributes:
        state: (R, n, F, 6) differences that are added to the states at the start and, for prescribed motion, in every frame.
            The last frame also stands for all later ones. Bodies at rest stay at rest.
        mass: (R, n) factors by which the masses are multiplied.
    """

    state: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class SimulatedMotion:
    """Result of a run and of R perturbed runs.

    Attributes:
        states: (n, F, 6) states in the unperturbed run; zero before its first frame.
        contacts: (1 + R, n, n) int, the frame of the first contact of each pair in each run, or `NO_CONTACT`.
        free_from: (1 + R, n) int, the frame in which each object was set free in each run (see `PrescribedMotion`); 0 for
            objects without prescribed motion.
        location_world: (1 + R, n, F, 2) positions in each run, of which the first is the unperturbed one.
    """

    states: FloatArray
    contacts: IntArray
    free_from: IntArray
    location_world: FloatArray


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
        bodies: the bodies in frame `start`.
        exists: (n,) bool, whether each body exists; the others are absent.
        n_frames: number of frames, counted from frame 0.
        rebound: (n, n) ratio of separation speed to approach speed for each pair; NaN for Bullet's rule. None for Bullet's rule
            everywhere.
        prescribed: motion of objects until they are set free; None if all are free from the start.
        start: first frame of the run.
        perturbations: perturbations of further runs; None for a single run.
    """
    n, mass = len(bodies.body), np.asarray(bodies.mass, float)
    rebound = np.full((n, n), np.nan) if rebound is None else rebound
    if prescribed is None:
        prescribed = PrescribedMotion(
            np.zeros((n, 1, STATE_SIZE)), np.zeros(n, bool), np.zeros(n, int), np.zeros((0, 3), int)
        )
    latest = np.where(prescribed.is_prescribed, prescribed.free_at_latest, 0)
    runs = [(np.zeros((n, 1, STATE_SIZE)), mass)]
    if perturbations is not None:
        runs += zip(perturbations.state, mass * perturbations.mass, strict=True)
    latest, collisions = (np.ascontiguousarray(a, np.int64) for a in (latest, prescribed.collisions))
    state, rebound, rows = (np.ascontiguousarray(a, float) for a in (bodies.state, rebound, prescribed.states))
    motion = rows, np.ascontiguousarray(prescribed.is_prescribed), latest, collisions
    results = [
        _run(bodies.body, state, change, own_mass, exists, rebound, *motion, start, n_frames)
        for change, own_mass in runs
    ]
    states, contacts, free_from = zip(*results, strict=True)
    location_world = np.stack([of_run[..., POSITION] for of_run in states])
    return SimulatedMotion(states[0], np.stack(contacts), np.stack(free_from), location_world)


@cached_njit
def _collide(body, state, mass, i, j, given, used):  # type: ignore[no-untyped-def]
    """Apply the impulse between bodies i and j if they touch in this Bullet step.

    With a given rebound (`given`, NaN for Bullet's rule) the impulse acts at a time within the step, otherwise at its start. If
    the given rebound is already `used`, the bodies do not rebound again. Returns whether they touched, and the distance that
    both together must still move before they can touch (world units).
    """
    dx, dy = state[j, X] - state[i, X], state[j, Y] - state[i, Y]
    step, given_gap = body[i].step_seconds, body[i].given_gap
    reach = body[i].round + body[j].round + body[i].step_reach + (body[i].corner + body[j].corner)
    distance = np.sqrt(dx * dx + dy * dy)
    if distance > reach:
        return False, distance - reach
    gap, apart, nx, ny, ci, cj = approach(body, state, i, j)
    if not np.isnan(given):
        if apart >= 0 or gap + apart * step > given_gap:
            return False, gap - given_gap
        rebound_at(body, state, mass, i, j, max(gap - given_gap, 0.0) / -apart, 0.0 if used else given)
        return True, 0.0
    threshold = min(body[i].threshold, body[j].threshold)
    if gap > threshold:
        return False, gap - threshold
    wanted = speed_after(body[i], body[j], gap, apart)
    touched = wanted > apart
    if touched:
        push(body, state, mass, i, j, wanted - apart, nx, ny, ci, cj)
    return touched, 0.0


@cached_njit
def _steps_apart(body, state, i, j, distance):  # type: ignore[no-untyped-def]
    """Number of Bullet steps in which bodies i and j cannot cover a distance that separates them, as speeds only fall."""
    speed = np.sqrt(state[i, VX] ** 2 + state[i, VY] ** 2) + np.sqrt(state[j, VX] ** 2 + state[j, VY] ** 2)
    lever = max(body[i].round + body[i].corner, body[j].round + body[j].corner)
    speed += lever * (abs(state[i, SPIN]) + abs(state[j, SPIN]))
    step = body[i].step_seconds
    if distance >= _MAX_STEPS * step * speed:
        return _MAX_STEPS
    return max(int(distance / (step * speed)) - 1, 1) if distance > 0 else 1


@cached_njit
def _changed(row, change, i, frame, out):  # type: ignore[no-untyped-def]
    """Write a state (6,) plus the perturbation of body i in a frame, from `change` (n, F, 6), to row i of `out`.

    A body at rest stays at rest.
    """
    rests = row[VX] == 0.0 and row[VY] == 0.0
    frame = min(frame, change.shape[1] - 1)
    for k in range(STATE_SIZE):
        out[i, k] = row[k] if rests and k in (VX, VY) else row[k] + change[i, frame, k]


@cached_njit
def _follow_prescribed(  # type: ignore[no-untyped-def]
    rows, change, collisions, is_prescribed, frame, exists, state, contact, touched, free_from
):
    """Apply the prescribed collisions and states of a frame to the bodies, with the perturbation `change` (n, F, 6)."""
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
    for i in range(len(is_prescribed)):
        if is_prescribed[i] and frame <= free_from[i]:
            _changed(rows[i, frame], change, i, frame, state)


@cached_njit
def _run(  # type: ignore[no-untyped-def]
    body, state, change, mass, exists, rebound, rows, is_prescribed, free_at_latest, collisions, start, n_frames
):
    """One run with a perturbation `change` (n, F, 6) of the states.

    Returns the states (n, n_frames, 6), the frames of first contacts (n, n), and the frames in which bodies were set free (n,).
    """
    n, steps_per_frame = len(body), body[0].steps_per_frame
    states = np.zeros((n, n_frames, STATE_SIZE))
    contact, touched = np.full((n, n), NO_CONTACT), np.zeros((n, n), np.bool_)
    next_look = np.zeros((n, n), np.int64)
    free_from, given, state = free_at_latest.copy(), state, np.empty((n, STATE_SIZE))
    for i in range(n):
        _changed(given[i], change, i, start, state)
    step_number = start * steps_per_frame
    for frame in range(start, n_frames):
        _follow_prescribed(rows, change, collisions, is_prescribed, frame, exists, state, contact, touched, free_from)
        any_free = False
        for i in range(n):
            any_free |= exists[i] and free_from[i] <= frame
            for k in range(STATE_SIZE):
                states[i, frame, k] = state[i, k]
        if frame == n_frames - 1 or not any_free:
            step_number += steps_per_frame
            continue
        last_step = step_number + steps_per_frame
        for _ in range(steps_per_frame):
            step_number += 1
            for i in range(n):
                if exists[i] and frame >= free_from[i]:
                    slow_down(body[i], state, i)
            for sweep in range(_MAX_SWEEPS):
                hits = 0
                for i in range(n):
                    for j in range(i + 1, n):
                        if step_number < next_look[i, j] or not (exists[i] and exists[j]):
                            continue
                        if frame < free_from[i] and frame < free_from[j]:
                            continue
                        used = touched[i, j] and sweep == 0
                        touch, distance = _collide(body, state, mass, i, j, rebound[i, j], used)
                        if not touch:
                            next_look[i, j] = step_number + _steps_apart(body, state, i, j, distance)
                            if frame < free_from[i] or frame < free_from[j]:
                                next_look[i, j] = min(next_look[i, j], last_step + 1)
                            continue
                        hits += 1
                        touched[i, j] = True
                        if contact[i, j] == NO_CONTACT:
                            contact[i, j] = contact[j, i] = int(step_number / steps_per_frame + 0.5)
                        for hit in (i, j):
                            free_from[hit] = min(free_from[hit], frame)
                            for other in range(n):
                                next_look[hit, other] = next_look[other, hit] = step_number
                if hits < 2:  # one contact needs no second pass; several may press on each other
                    break
            for i in range(n):
                if exists[i]:
                    drift(state, i, body[i].step_seconds)
    return states, contact, free_from

"""One run of the fit, from event to event, with its sensitivity to the parameters: compiled by Numba.

Between contacts bodies move by themselves, so the run needs no steps: a body's motion is a chain of segments, each a
function of the state at the segment's start. `sensitivity` carries the derivatives of that state by all parameters from segment
to segment: through a segment by the derivatives of the free motion, through a contact by those of the exchange of momentum. A
contact has a given rebound and happens at a given gap, so the motion is a smooth function of the parameters.

States are rows (x, y, vx, vy, yaw, spin).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import CORNER_WORLD, CUBE, ROUND
from nsdr.dynamics.physics.forces import (
    GIVEN_GAP_WORLD,
    MIN_SPIN_RAD_PER_S,
    SPIN,
    YAW,
    approach,
    drift,
    push,
    slow_down,
)
from nsdr.dynamics.sliding import slide_one
from nsdr.world.physics_constants import FRAME_SECONDS, STEP_SECONDS

_NEWTON_STEPS = 3
"""Refinements of the moment of a contact."""
_MIN_APPROACH_WORLD_PER_S = 0.02
"""The moment of a slower contact is not derived: it would move too far with the parameters."""
_TIMED_GAP_WORLD = 1e-4
"""The moment of a contact at a gap farther off that of contacts is not derived: the bodies overlapped before."""
_SPIN_DIFFERENCE = 1e-4
"""Step of the numerical derivatives of a spinning cube's motion (world units/s, radians, radians/s)."""
_CONTACT_DIFFERENCE = 1e-6
"""Step of the numerical derivatives of an exchange."""


class Bodies(NamedTuple):
    """The bodies' current segments; arrays that the functions below change.

    Attributes:
        shape, mass: (n,).
        start: (n,) seconds, when the segment starts.
        end: (n,) seconds, when a spinning segment ends; infinite otherwise.
        state: (n, 6) at the segment's start.
        steps: (n, T, 6) states after every Bullet step of a spinning segment.
        sensitivity: (n, 6, P) derivatives of `state` by the parameters.
    """

    shape: NDArray[np.int64]
    mass: NDArray[np.float64]
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    state: NDArray[np.float64]
    steps: NDArray[np.float64]
    sensitivity: NDArray[np.float64]


@cached_njit
def new_bodies(shape, n_parameters, n_steps):  # type: ignore[no-untyped-def]
    """Bodies at rest at the origin, for runs of at most `n_steps` Bullet steps."""
    n = len(shape)
    return Bodies(
        shape,
        np.ones(n),
        np.zeros(n),
        np.full(n, np.inf),
        np.zeros((n, 6)),
        np.empty((n, n_steps + 2, 6)),
        np.zeros((n, 6, n_parameters)),
    )


@cached_njit
def copy_state(source, target):  # type: ignore[no-untyped-def]
    """Copy a state (6,); far faster than an assignment of slices."""
    for k in range(6):
        target[k] = source[k]


@cached_njit
def _spin_steps(state, count, rows):  # type: ignore[no-untyped-def]
    """Fill `rows` (T, 6) with the states of a spinning cube, at most `count` steps; returns the number done until it stops."""
    copy_state(state, rows[0])
    for k in range(1, count + 1):
        for c in range(6):
            rows[k, c] = rows[k - 1, c]
        slow_down(CUBE, rows, k)
        drift(rows, k, STEP_SECONDS)
        if rows[k, SPIN] == 0.0:
            return k
    return count


@cached_njit
def _between(rows, elapsed, whole, out):  # type: ignore[no-untyped-def]
    """Write the state at a time, between two rows (T, 6) of steps up to the time `whole`, to `out` (6,)."""
    k = min(int(elapsed / STEP_SECONDS), int(whole / STEP_SECONDS + 0.5) - 1)
    share = elapsed / STEP_SECONDS - k
    for c in range(6):
        out[c] = rows[k, c] + share * (rows[k + 1, c] - rows[k, c])


@cached_njit
def start_segment(bodies, i, seconds, horizon):  # type: ignore[no-untyped-def]
    """Start the segment of body i at a time with the state that is there already."""
    bodies.start[i] = seconds
    bodies.end[i] = np.inf
    if bodies.shape[i] == CUBE and abs(bodies.state[i, SPIN]) >= MIN_SPIN_RAD_PER_S:
        count = min(int((horizon - seconds) / STEP_SECONDS) + 1, bodies.steps.shape[1] - 1)
        done = _spin_steps(bodies.state[i], count, bodies.steps[i])
        bodies.end[i] = seconds + done * STEP_SECONDS
    else:
        bodies.state[i, SPIN] = 0.0


@cached_njit
def state_at(bodies, i, seconds, out):  # type: ignore[no-untyped-def]
    """Write the state of body i at a time of its segment to `out` (6,)."""
    elapsed = seconds - bodies.start[i]
    state = bodies.state[i]
    if bodies.end[i] < np.inf:
        _between(bodies.steps[i], elapsed, bodies.end[i] - bodies.start[i], out)
        return
    copy_state(state, out)
    speed = np.sqrt(state[2] ** 2 + state[3] ** 2)
    if speed == 0.0:
        return
    distance, later, _, _ = slide_one(bodies.shape[i], speed, elapsed)
    for k in range(2):
        out[k] = state[k] + distance * state[2 + k] / speed
        out[2 + k] = later * state[2 + k] / speed


@cached_njit
def slide_derivatives(shape, state, elapsed, after, out):  # type: ignore[no-untyped-def]
    """Write a sliding body's state (6,) after a time to `after`, and its derivatives (6, 6) by that before to `out`."""
    copy_state(state, after)
    for r in range(6):
        for c in range(6):
            out[r, c] = 0.0
    out[0, 0] = out[1, 1] = out[YAW, YAW] = 1.0
    speed = np.sqrt(state[2] ** 2 + state[3] ** 2)
    if speed == 0.0:
        return
    distance, later, d_distance, d_later = slide_one(shape, speed, elapsed)
    ux, uy = state[2] / speed, state[3] / speed
    after[0] += distance * ux
    after[1] += distance * uy
    after[2], after[3] = later * ux, later * uy
    for row, along, across in ((0, d_distance, distance / speed), (2, d_later, later / speed)):
        out[row, 2] = across + (along - across) * ux * ux
        out[row, 3] = out[row + 1, 2] = (along - across) * ux * uy
        out[row + 1, 3] = across + (along - across) * uy * uy


@cached_njit
def spin_derivatives(bodies, i, seconds, first_frame, out):  # type: ignore[no-untyped-def]
    """Write the derivatives of a spinning cube's states by that at the start to `out` (T, 6, 6).

    The states are those at the frames from `first_frame` on, and the last one is that at a time `seconds`.
    """
    count = int((seconds - bodies.start[i]) / STEP_SECONDS) + 1
    rows = np.empty((count + 1, 6))
    base, changed, state = np.empty(6), np.empty(6), bodies.state[i].copy()
    for t in range(len(out)):
        for r in range(6):
            for c in range(6):
                out[t, r, c] = 1.0 if r == c and c < 2 else 0.0
    for c in range(2, 6):
        state[c] += _SPIN_DIFFERENCE
        done = _spin_steps(state, count, rows)
        state[c] -= _SPIN_DIFFERENCE
        for k in range(done, count):  # it stops a step or two before the unchanged one
            copy_state(rows[k], rows[k + 1])
        for t in range(len(out)):
            when = (first_frame + t) * FRAME_SECONDS if t < len(out) - 1 else seconds
            state_at(bodies, i, when, base)
            _between(rows, when - bodies.start[i], count * STEP_SECONDS, changed)
            for r in range(6):
                out[t, r, c] = (changed[r] - base[r]) / _SPIN_DIFFERENCE


@cached_njit
def advance(bodies, i, seconds, state, derivatives):  # type: ignore[no-untyped-def]
    """Move the segment's start of body i to a later time, where its state has derivatives (6, 6) by that at the start."""
    copy_state(state, bodies.state[i])
    bodies.start[i] = seconds
    moved = np.empty(6)
    for p in range(bodies.sensitivity.shape[2]):
        for r in range(6):
            moved[r] = 0.0
            for c in range(6):
                moved[r] += derivatives[r, c] * bodies.sensitivity[i, c, p]
        for r in range(6):
            bodies.sensitivity[i, r, p] = moved[r]


@cached_njit
def _refined(bodies, i, j, shape, state, seconds, left, apart):  # type: ignore[no-untyped-def]
    """The moment at which the gap is that of contacts, not before `seconds`."""
    when = seconds
    for _ in range(_NEWTON_STEPS):
        if apart > -_MIN_APPROACH_WORLD_PER_S:
            break
        when = max(min(when - left / apart, seconds + 2 * STEP_SECONDS), seconds)
        state_at(bodies, i, when, state[0])
        state_at(bodies, j, when, state[1])
        gap, apart, _, _, _, _ = approach(shape, state, 0, 1)
        left = gap - GIVEN_GAP_WORLD
    return when


@cached_njit
def find_contact(bodies, i, j, since, until):  # type: ignore[no-untyped-def]
    """Time of the first contact of bodies i and j in their present segments between two times; infinite without one.

    Bodies that are apart by a distance can't touch before they have covered it at their present speeds, which only fall. Where
    they are near, they are looked at after every Bullet step.
    """
    shape, state = np.array([bodies.shape[i], bodies.shape[j]]), np.empty((2, 6))
    corners = (CORNER_WORLD if shape[0] == CUBE else 0.0) + (CORNER_WORLD if shape[1] == CUBE else 0.0)
    reach = 2 * ROUND + GIVEN_GAP_WORLD + corners
    seconds = since
    while seconds <= until:
        state_at(bodies, i, seconds, state[0])
        state_at(bodies, j, seconds, state[1])
        speed = np.sqrt(state[0, 2] ** 2 + state[0, 3] ** 2) + np.sqrt(state[1, 2] ** 2 + state[1, 3] ** 2)
        spin = abs(state[0, SPIN]) + abs(state[1, SPIN])
        if speed == 0.0 and spin == 0.0:
            return np.inf
        apart_world = np.sqrt((state[1, 0] - state[0, 0]) ** 2 + (state[1, 1] - state[0, 1]) ** 2) - reach
        if apart_world > speed * STEP_SECONDS:
            seconds += apart_world / speed if speed > 0.0 else np.inf
            continue
        gap, apart, _, _, _, _ = approach(shape, state, 0, 1)
        left = gap - GIVEN_GAP_WORLD
        if apart < 0 and left + apart * STEP_SECONDS <= 0:
            return min(_refined(bodies, i, j, shape, state, seconds, left, apart), until)
        seconds += max(left / (speed + spin * (ROUND + CORNER_WORLD)), STEP_SECONDS)
    return np.inf


@cached_njit
def _rates(shape, states, out):  # type: ignore[no-untyped-def]
    """Write the rates of change of two states (2, 6) to `out` (2, 6): damping and friction change velocities and spins."""
    slowed = states.copy()
    for b in range(2):
        slow_down(shape[b], slowed, b)
        for c in range(2):
            out[b, c] = states[b, 2 + c]
            out[b, 2 + c] = (slowed[b, 2 + c] - states[b, 2 + c]) / STEP_SECONDS
        out[b, YAW] = states[b, SPIN]
        out[b, SPIN] = (slowed[b, SPIN] - states[b, SPIN]) / STEP_SECONDS


@cached_njit
def _exchange_derivatives(shape, before, mass, rebound, after, out):  # type: ignore[no-untyped-def]
    """Write the states (2, 6) after a contact to `after`, and to `out` (2, 6, 15) their derivatives.

    They are those by the states before (12), by both masses, and by the rebound. Another state before makes the contact
    earlier or later: the bodies then move on as before it until then, and as after it from then on, and they slow down
    differently before and after.
    """
    gap, apart, _, _, _, _ = approach(shape, before, 0, 1)
    timed = apart < -_MIN_APPROACH_WORLD_PER_S and abs(gap - GIVEN_GAP_WORLD) < _TIMED_GAP_WORLD
    rate, rate_after = np.empty((2, 6)), np.empty((2, 6))
    _rates(shape, before, rate)
    masses, state = mass.copy(), np.empty((2, 6))
    for k in range(-1, 15):
        if 0 <= k < 12 and k % 6 >= YAW and shape[k // 6] != CUBE:
            continue
        for b in range(2):
            copy_state(before[b], state[b])
            masses[b] = mass[b] + (_CONTACT_DIFFERENCE if k == 12 + b else 0.0)
        if 0 <= k < 12:
            state[k // 6, k % 6] += _CONTACT_DIFFERENCE
        seconds = 0.0
        if timed:  # it happens when the gap is that of contacts
            gap, apart, _, _, _, _ = approach(shape, state, 0, 1)
            seconds = (gap - GIVEN_GAP_WORLD) / -apart
        for b in range(2):
            for r in range(6):
                state[b, r] += seconds * rate[b, r]
        _, apart, nx, ny, ci, cj = approach(shape, state, 0, 1)
        share = rebound + (_CONTACT_DIFFERENCE if k == 14 else 0.0)
        push(shape, state, masses, 0, 1, -(1 + share) * apart, nx, ny, ci, cj)
        if k < 0:
            _rates(shape, state, rate_after)
        for b in range(2):
            for r in range(6):
                state[b, r] -= seconds * rate_after[b, r]
                if k < 0:
                    after[b, r] = state[b, r]
                else:
                    out[b, r, k] = (state[b, r] - after[b, r]) / _CONTACT_DIFFERENCE


@cached_njit
def exchange(bodies, i, j, rebound, by_parameter):  # type: ignore[no-untyped-def]
    """Apply the contact of bodies i and j, both at their segments' starts, to their states and sensitivities.

    `by_parameter` (3, P) are the derivatives of the masses of i and j and of the rebound.
    """
    shape = np.array([bodies.shape[i], bodies.shape[j]])
    mass = np.array([bodies.mass[i], bodies.mass[j]])
    before, after = np.empty((2, 6)), np.empty((2, 6))
    copy_state(bodies.state[i], before[0])
    copy_state(bodies.state[j], before[1])
    by_input = np.zeros((2, 6, 15))
    _exchange_derivatives(shape, before, mass, rebound, after, by_input)
    moved = np.empty((2, 6))
    for p in range(bodies.sensitivity.shape[2]):
        for b in range(2):
            for r in range(6):
                total = 0.0
                for c in range(6):
                    total += by_input[b, r, c] * bodies.sensitivity[i, c, p]
                    total += by_input[b, r, 6 + c] * bodies.sensitivity[j, c, p]
                for k in range(3):
                    total += by_input[b, r, 12 + k] * by_parameter[k, p]
                moved[b, r] = total
        for r in range(6):
            bodies.sensitivity[i, r, p] = moved[0, r]
            bodies.sensitivity[j, r, p] = moved[1, r]
    copy_state(after[0], bodies.state[i])
    copy_state(after[1], bodies.state[j])

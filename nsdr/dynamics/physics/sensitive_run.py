"""A simulation run from event to event with its sensitivity to the parameters of the fit. Compiled by Numba.

Between contacts each body moves independently, so the run needs no time steps: the motion of a body is a chain of segments, and
each segment is a function of the state at its start. `Bodies.sensitivity` holds the derivatives of that state with respect to
all parameters. The chain rule carries them through a segment by the derivatives of free motion, and through a contact by the
derivatives of the exchange of momentum. A contact has a given rebound and happens at a given gap, so the motion is a smooth
function of the parameters.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.body_state import SPIN, STATE_SIZE, VX, VY, YAW, X, Y
from nsdr.dynamics.physics.forces import MIN_SPIN_RAD_PER_S, approach, drift, push, slow_down
from nsdr.dynamics.sliding import slide_one

_NEWTON_STEPS = 3
"""Number of Newton steps that refine the time of a contact."""
_TIMED_GAP_WORLD = 1e-4
"""The time of a contact is not differentiated if the gap differs from the given one by more (world units): such bodies
overlapped before."""
_SPIN_DIFFERENCE = 1e-4
"""Step of the numerical derivatives of the motion of a spinning box (world units/s, radians, radians/s)."""
_CONTACT_DIFFERENCE = 1e-6
"""Step of the numerical derivatives of an exchange of momentum (units of its inputs)."""
_MASS_INPUT, _REBOUND_INPUT = 2 * STATE_SIZE, 2 * STATE_SIZE + 2
"""Inputs of an exchange of momentum: both states (0 to 11), then both masses, then the rebound."""
_INPUTS = _REBOUND_INPUT + 1
"""Number of inputs of an exchange of momentum."""


class Bodies(NamedTuple):
    """The current segments of n bodies. The functions below change these arrays.

    Attributes:
        body: (n,) records of `BODY`.
        mass: (n,) relative masses.
        start: (n,) times at which the segments start (s).
        end: (n,) times at which the spinning of boxes ends (s); infinite for segments without spin.
        state: (n, 6) states at the start of the segments.
        steps: (n, T, 6) states after every Bullet step of a segment with spin.
        sensitivity: (n, 6, P) derivatives of `state` with respect to the P parameters.
    """

    body: NDArray[np.void]
    mass: NDArray[np.float64]
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    state: NDArray[np.float64]
    steps: NDArray[np.float64]
    sensitivity: NDArray[np.float64]


@cached_njit
def new_bodies(body, n_parameters, n_steps):  # type: ignore[no-untyped-def]
    """Bodies at rest at the origin, with arrays for runs of at most `n_steps` Bullet steps."""
    n = len(body)
    return Bodies(
        body,
        np.ones(n),
        np.zeros(n),
        np.full(n, np.inf),
        np.zeros((n, 6)),
        np.empty((n, n_steps + 2, 6)),
        np.zeros((n, 6, n_parameters)),
    )


@cached_njit
def copy_state(source, target):  # type: ignore[no-untyped-def]
    """Copy a state (6,). A loop is much faster than an assignment of slices."""
    for k in range(6):
        target[k] = source[k]


@cached_njit
def _spin_steps(body, state, count, rows):  # type: ignore[no-untyped-def]
    """Write the states of a spinning box after each Bullet step to `rows` (T, 6).

    It ends when the spin is 0, or after `count` steps. Returns the number of steps done.
    """
    copy_state(state, rows[0])
    for k in range(1, count + 1):
        for c in range(6):
            rows[k, c] = rows[k - 1, c]
        slow_down(body, rows, k)
        drift(rows, k, body.step_seconds)
        if rows[k, SPIN] == 0.0:
            return k
    return count


@cached_njit
def _between(rows, step, elapsed, whole, out):  # type: ignore[no-untyped-def]
    """Interpolate between the Bullet steps of a segment.

    Args:
        rows: (T, 6) states after each step.
        step: duration of a step (s).
        elapsed: time since the start of the segment (s).
        whole: duration of the segment (s).
        out: (6,) the state, which is written.
    """
    k = min(int(elapsed / step), int(whole / step + 0.5) - 1)
    share = elapsed / step - k
    for c in range(6):
        out[c] = rows[k, c] + share * (rows[k + 1, c] - rows[k, c])


@cached_njit
def start_segment(bodies, i, seconds, horizon):  # type: ignore[no-untyped-def]
    """Start a new segment of body i at a time (s) with the state in `bodies.state`."""
    bodies.start[i] = seconds
    bodies.end[i] = np.inf
    body = bodies.body[i]
    if body.is_box and abs(bodies.state[i, SPIN]) >= MIN_SPIN_RAD_PER_S:
        count = min(int((horizon - seconds) / body.step_seconds) + 1, bodies.steps.shape[1] - 1)
        done = _spin_steps(body, bodies.state[i], count, bodies.steps[i])
        bodies.end[i] = seconds + done * body.step_seconds
    else:
        bodies.state[i, SPIN] = 0.0


@cached_njit
def state_at(bodies, i, seconds, out):  # type: ignore[no-untyped-def]
    """Write the state of body i at a time (s) in its segment to `out` (6,)."""
    elapsed = seconds - bodies.start[i]
    state = bodies.state[i]
    if bodies.end[i] < np.inf:
        _between(bodies.steps[i], bodies.body[i].step_seconds, elapsed, bodies.end[i] - bodies.start[i], out)
        return
    copy_state(state, out)
    speed = np.sqrt(state[VX] ** 2 + state[VY] ** 2)
    if speed == 0.0:
        return
    distance, later, _, _ = slide_one(bodies.body[i].law, speed, elapsed)
    for k in range(2):
        out[X + k] = state[X + k] + distance * state[VX + k] / speed
        out[VX + k] = later * state[VX + k] / speed


@cached_njit
def slide_derivatives(law, state, elapsed, after, out):  # type: ignore[no-untyped-def]
    """Write the state (6,) of a sliding body after `elapsed` seconds to `after`, and its derivatives (6, 6) to `out`.

    The derivatives are with respect to the state before.
    """
    copy_state(state, after)
    for r in range(6):
        for c in range(6):
            out[r, c] = 0.0
    out[X, X] = out[Y, Y] = out[YAW, YAW] = 1.0
    speed = np.sqrt(state[VX] ** 2 + state[VY] ** 2)
    if speed == 0.0:
        return
    distance, later, d_distance, d_later = slide_one(law, speed, elapsed)
    ux, uy = state[VX] / speed, state[VY] / speed
    after[X] += distance * ux
    after[Y] += distance * uy
    after[VX], after[VY] = later * ux, later * uy
    for row, along, across in ((X, d_distance, distance / speed), (VX, d_later, later / speed)):
        out[row, VX] = across + (along - across) * ux * ux
        out[row, VY] = out[row + 1, VX] = (along - across) * ux * uy
        out[row + 1, VY] = across + (along - across) * uy * uy


@cached_njit
def spin_derivatives(bodies, i, seconds, first_frame, out):  # type: ignore[no-untyped-def]
    """Write the derivatives of T states of a spinning box with respect to its state at the start to `out` (T, 6, 6).

    The first T - 1 states are those in the frames from `first_frame` on, and the last is the one at the time `seconds`.
    """
    body = bodies.body[i]
    step, count = body.step_seconds, int((seconds - bodies.start[i]) / body.step_seconds) + 1
    rows = np.empty((count + 1, 6))
    base, changed, state = np.empty(6), np.empty(6), bodies.state[i].copy()
    for t in range(len(out)):
        for r in range(6):
            for c in range(6):
                out[t, r, c] = 1.0 if r == c and c < VX else 0.0
    for c in range(VX, STATE_SIZE):
        state[c] += _SPIN_DIFFERENCE
        done = _spin_steps(body, state, count, rows)
        state[c] -= _SPIN_DIFFERENCE
        for k in range(done, count):  # it may stop a step or two before the unperturbed box
            copy_state(rows[k], rows[k + 1])
        for t in range(len(out)):
            when = (first_frame + t) * body.law.frame_seconds if t < len(out) - 1 else seconds
            state_at(bodies, i, when, base)
            _between(rows, step, when - bodies.start[i], count * step, changed)
            for r in range(6):
                out[t, r, c] = (changed[r] - base[r]) / _SPIN_DIFFERENCE


@cached_njit
def advance(bodies, i, seconds, state, derivatives):  # type: ignore[no-untyped-def]
    """Move the start of body i's segment to a later time (s).

    Args:
        bodies: the bodies.
        i: index of the body.
        seconds: the later time (s).
        state: (6,) state at that time.
        derivatives: (6, 6) derivatives of `state` with respect to the state at the old start.
    """
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
def _refined(bodies, i, j, body, state, seconds, left, apart):  # type: ignore[no-untyped-def]
    """The time from `seconds` on at which the gap is the given one, by Newton's method (s).

    `left` is the gap minus the given one at `seconds`, and `apart` the separation speed there. `body` (2,) and `state`
    (2, 6) are those of bodies i and j; `state` is overwritten.
    """
    when, two_steps = seconds, 2 * body[0].step_seconds
    for _ in range(_NEWTON_STEPS):
        if apart > -body[0].min_approach:
            break
        when = max(min(when - left / apart, seconds + two_steps), seconds)
        state_at(bodies, i, when, state[0])
        state_at(bodies, j, when, state[1])
        gap, apart, _, _, _, _ = approach(body, state, 0, 1)
        left = gap - body[0].given_gap
    return when


@cached_njit
def _two(bodies, i, j):  # type: ignore[no-untyped-def]
    """The records (2,) of bodies i and j."""
    body = bodies.body[:2].copy()
    body[0], body[1] = bodies.body[i], bodies.body[j]
    return body


@cached_njit
def find_contact(bodies, i, j, since, until):  # type: ignore[no-untyped-def]
    """Time of the first contact of bodies i and j in their current segments from `since` to `until` (s); infinite without one.

    Speeds only fall, so two bodies cannot touch before they have covered the distance between them at their current speeds.
    Bodies that are near each other are checked after every Bullet step.
    """
    body, state = _two(bodies, i, j), np.empty((2, 6))
    step, given_gap = body[0].step_seconds, body[0].given_gap
    lever = max(body[0].round + body[0].corner, body[1].round + body[1].corner)
    reach = body[0].round + body[1].round + given_gap + (body[0].corner + body[1].corner)
    seconds = since
    while seconds <= until:
        state_at(bodies, i, seconds, state[0])
        state_at(bodies, j, seconds, state[1])
        speed = np.sqrt(state[0, VX] ** 2 + state[0, VY] ** 2) + np.sqrt(state[1, VX] ** 2 + state[1, VY] ** 2)
        spin = abs(state[0, SPIN]) + abs(state[1, SPIN])
        if speed == 0.0 and spin == 0.0:
            return np.inf
        apart_world = np.sqrt((state[1, X] - state[0, X]) ** 2 + (state[1, Y] - state[0, Y]) ** 2) - reach
        if apart_world > speed * step:
            seconds += apart_world / speed if speed > 0.0 else np.inf
            continue
        gap, apart, _, _, _, _ = approach(body, state, 0, 1)
        left = gap - given_gap
        if apart < 0 and left + apart * step <= 0:
            return min(_refined(bodies, i, j, body, state, seconds, left, apart), until)
        seconds += max(left / (speed + spin * lever), step)
    return np.inf


@cached_njit
def _rates(body, states, out):  # type: ignore[no-untyped-def]
    """Write the time derivatives of two states (2, 6) to `out` (2, 6). Damping and friction change velocities and spins."""
    slowed = states.copy()
    for b in range(2):
        slow_down(body[b], slowed, b)
        for c in range(2):
            out[b, X + c] = states[b, VX + c]
            out[b, VX + c] = (slowed[b, VX + c] - states[b, VX + c]) / body[b].step_seconds
        out[b, YAW] = states[b, SPIN]
        out[b, SPIN] = (slowed[b, SPIN] - states[b, SPIN]) / body[b].step_seconds


@cached_njit
def _exchange_derivatives(body, before, mass, rebound, after, out):  # type: ignore[no-untyped-def]
    """Write the states (2, 6) after a contact to `after`, and their derivatives with respect to all inputs to `out` (2, 6, 15).

    The inputs are the states before (12), both masses, and the rebound. A change of a state before the contact also changes the
    time of the contact. The bodies then move by the old rates of change until the new time, and by the new rates after it.
    """
    gap, apart, _, _, _, _ = approach(body, before, 0, 1)
    given_gap = body[0].given_gap
    timed = apart < -body[0].min_approach and abs(gap - given_gap) < _TIMED_GAP_WORLD
    rate, rate_after = np.empty((2, 6)), np.empty((2, 6))
    _rates(body, before, rate)
    masses, state = mass.copy(), np.empty((2, 6))
    for k in range(-1, _INPUTS):  # -1: no input is changed
        is_state = 0 <= k < _MASS_INPUT
        if is_state and k % STATE_SIZE >= YAW and not body[k // STATE_SIZE].is_box:
            continue
        for b in range(2):
            copy_state(before[b], state[b])
            masses[b] = mass[b] + (_CONTACT_DIFFERENCE if k == _MASS_INPUT + b else 0.0)
        if is_state:
            state[k // STATE_SIZE, k % STATE_SIZE] += _CONTACT_DIFFERENCE
        seconds = 0.0
        if timed:  # time until the gap is the given one
            gap, apart, _, _, _, _ = approach(body, state, 0, 1)
            seconds = (gap - given_gap) / -apart
        for b in range(2):
            for r in range(6):
                state[b, r] += seconds * rate[b, r]
        _, apart, nx, ny, ci, cj = approach(body, state, 0, 1)
        share = rebound + (_CONTACT_DIFFERENCE if k == _REBOUND_INPUT else 0.0)
        push(body, state, masses, 0, 1, -(1 + share) * apart, nx, ny, ci, cj)
        if k < 0:
            _rates(body, state, rate_after)
        for b in range(2):
            for r in range(6):
                state[b, r] -= seconds * rate_after[b, r]
                if k < 0:
                    after[b, r] = state[b, r]
                else:
                    out[b, r, k] = (state[b, r] - after[b, r]) / _CONTACT_DIFFERENCE


@cached_njit
def exchange(bodies, i, j, rebound, by_parameter):  # type: ignore[no-untyped-def]
    """Apply the contact of bodies i and j, both at the start of their segments, to their states and sensitivities.

    `by_parameter` (3, P) holds the derivatives of the masses of i and j and of the rebound with respect to the parameters.
    """
    body = _two(bodies, i, j)
    mass = np.array([bodies.mass[i], bodies.mass[j]])
    before, after = np.empty((2, 6)), np.empty((2, 6))
    copy_state(bodies.state[i], before[0])
    copy_state(bodies.state[j], before[1])
    by_input = np.zeros((2, STATE_SIZE, _INPUTS))
    _exchange_derivatives(body, before, mass, rebound, after, by_input)
    moved = np.empty((2, 6))
    for p in range(bodies.sensitivity.shape[2]):
        for b in range(2):
            for r in range(6):
                total = 0.0
                for c in range(6):
                    total += by_input[b, r, c] * bodies.sensitivity[i, c, p]
                    total += by_input[b, r, STATE_SIZE + c] * bodies.sensitivity[j, c, p]
                for k in range(3):
                    total += by_input[b, r, _MASS_INPUT + k] * by_parameter[k, p]
                moved[b, r] = total
        for r in range(6):
            bodies.sensitivity[i, r, p] = moved[0, r]
            bodies.sensitivity[j, r, p] = moved[1, r]
    copy_state(after[0], bodies.state[i])
    copy_state(after[1], bodies.state[j])

"""One run of the fit, from event to event, with its sensitivity to the parameters: compiled by Numba.

Between contacts bodies move by themselves (`flight`), so the run needs no steps: a body's motion is a chain of segments, each a
function of the state at the segment's start. `sensitivity` carries the derivatives of that state by all parameters from segment
to segment: through a segment by the derivatives of the free motion, through a contact by those of the exchange of momentum. A
contact has a given rebound and happens at a given gap, so the motion is a smooth function of the parameters.

States are rows (x, y, vx, vy, yaw, spin).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.physics.contact_geometry import CUBE, ROUND, outline_gap
from nsdr.dynamics.physics.flight import INERTIA, MIN_SPIN_RAD_PER_S, slide_compiled, slow_down
from nsdr.dynamics.physics.numba_cache import cached_njit
from nsdr.world.physics_constants import STEP_SECONDS

__all__ = ["Bodies", "advance", "exchange", "find_contact", "new_bodies", "start_segment", "state_at"]

CONTACT_GAP_WORLD = 0.003
"""Gap at which contacts happen: the mean gap of Bullet's rule at usual speeds."""
_CORNER_WORLD = 0.07
"""How far a cube's corner extends beyond `ROUND` (world units, rounded up)."""
_NEWTON_STEPS = 3
"""Refinements of the moment of a contact."""
_MIN_APPROACH_WORLD_PER_S = 0.02
"""The moment of a slower contact is not derived: it would move too far with the parameters."""
_SPIN_DIFFERENCE = 1e-4
"""Step of the numerical derivatives of a spinning cube's motion (world units/s, radians, radians/s)."""
_CONTACT_DIFFERENCE = 1e-6
"""Step of the numerical derivatives of an exchange."""
_YAW, _SPIN = 4, 5


class Bodies(NamedTuple):
    """The bodies' current segments; arrays that the functions below change.

    Attributes:
        shape: (n,) int.
        mass: (n,).
        start: (n,) seconds, when the segment starts.
        end: (n,) seconds, when a spinning segment ends; infinite otherwise.
        state: (n, 6) at the segment's start.
        steps: (n, T, 6) states after every Bullet step of a spinning segment.
        sensitivity: (n, 6, P) derivatives of `state` by the parameters.
        active: (n, P) bool, parameters that the state depends on.
    """

    shape: NDArray[np.int64]
    mass: NDArray[np.float64]
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    state: NDArray[np.float64]
    steps: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    active: NDArray[np.bool_]


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
        np.zeros((n, n_parameters), np.bool_),
    )


@cached_njit
def _spin_steps(shape, state, count, rows):  # type: ignore[no-untyped-def]
    """Fill `rows` (T, 6) with the states of a spinning cube, at most `count` steps; returns the number done until it stops."""
    position, velocity = state[:2].copy(), np.empty((1, 2))
    velocity[0, 0], velocity[0, 1] = state[2], state[3]
    kind, yaw, spin = np.array([shape]), np.array([state[_YAW]]), np.array([state[_SPIN]])
    rows[0] = state
    for k in range(1, count + 1):
        slow_down(kind, velocity, spin, yaw, 0)
        position += STEP_SECONDS * velocity[0]
        yaw[0] += STEP_SECONDS * spin[0]
        rows[k, 0], rows[k, 1] = position[0], position[1]
        rows[k, 2], rows[k, 3] = velocity[0, 0], velocity[0, 1]
        rows[k, _YAW], rows[k, _SPIN] = yaw[0], spin[0]
        if spin[0] == 0.0:
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
    if bodies.shape[i] == CUBE and abs(bodies.state[i, _SPIN]) >= MIN_SPIN_RAD_PER_S:
        count = min(int((horizon - seconds) / STEP_SECONDS) + 1, bodies.steps.shape[1] - 1)
        done = _spin_steps(CUBE, bodies.state[i], count, bodies.steps[i])
        bodies.end[i] = seconds + done * STEP_SECONDS
    else:
        bodies.state[i, _SPIN] = 0.0


@cached_njit
def state_at(bodies, i, seconds, out):  # type: ignore[no-untyped-def]
    """Write the state of body i at a time of its segment to `out` (6,)."""
    elapsed = seconds - bodies.start[i]
    state = bodies.state[i]
    if bodies.end[i] < np.inf:
        _between(bodies.steps[i], elapsed, bodies.end[i] - bodies.start[i], out)
        return
    out[:] = state
    speed = np.sqrt(state[2] ** 2 + state[3] ** 2)
    if speed == 0.0:
        return
    distance, later, _, _ = slide_compiled(bodies.shape[i], speed, elapsed)
    for k in range(2):
        out[k] = state[k] + distance * state[2 + k] / speed
        out[2 + k] = later * state[2 + k] / speed


@cached_njit
def slide_derivatives(shape, state, elapsed, out):  # type: ignore[no-untyped-def]
    """Write the derivatives (6, 6) of a sliding body's state after a time by its state before to `out`."""
    out[:] = 0.0
    out[0, 0] = out[1, 1] = out[_YAW, _YAW] = 1.0
    speed = np.sqrt(state[2] ** 2 + state[3] ** 2)
    if speed == 0.0:
        return
    distance, later, d_distance, d_later = slide_compiled(shape, speed, elapsed)
    ux, uy = state[2] / speed, state[3] / speed
    for row, along, across in ((0, d_distance, distance / speed), (2, d_later, later / speed)):
        out[row, 2] = across + (along - across) * ux * ux
        out[row, 3] = out[row + 1, 2] = (along - across) * ux * uy
        out[row + 1, 3] = across + (along - across) * uy * uy


@cached_njit
def spin_derivatives(bodies, i, seconds, times, out):  # type: ignore[no-untyped-def]
    """Write the derivatives (T, 6, 6) of a spinning cube's states at times (T,) and at the end by that at the start to `out`.

    The last row of `out` (T + 1, 6, 6) belongs to `seconds`, the end.
    """
    count = int((seconds - bodies.start[i]) / STEP_SECONDS) + 1
    rows = np.empty((count + 1, 6))
    base, changed, state = np.empty(6), np.empty(6), bodies.state[i].copy()
    out[:] = 0.0
    for t in range(len(times) + 1):
        out[t, 0, 0] = out[t, 1, 1] = 1.0
    for c in range(2, 6):
        state[c] += _SPIN_DIFFERENCE
        done = _spin_steps(CUBE, state, count, rows)
        state[c] -= _SPIN_DIFFERENCE
        for k in range(done, count):  # it stops a step or two before the unchanged one
            rows[k + 1] = rows[k]
        for t in range(len(times) + 1):
            when = times[t] if t < len(times) else seconds
            state_at(bodies, i, when, base)
            _between(rows, when - bodies.start[i], count * STEP_SECONDS, changed)
            for r in range(6):
                out[t, r, c] = (changed[r] - base[r]) / _SPIN_DIFFERENCE


@cached_njit
def advance(bodies, i, seconds, derivatives):  # type: ignore[no-untyped-def]
    """Move the segment's start of body i, state and sensitivity, to a later time; `derivatives` (6, 6) of the state."""
    state = np.empty(6)
    state_at(bodies, i, seconds, state)
    bodies.state[i] = state
    bodies.start[i] = seconds
    moved = np.empty(6)
    for p in range(bodies.sensitivity.shape[2]):
        if bodies.active[i, p]:
            for r in range(6):
                moved[r] = 0.0
                for c in range(6):
                    moved[r] += derivatives[r, c] * bodies.sensitivity[i, c, p]
            bodies.sensitivity[i, :, p] = moved


@cached_njit
def _approach(shape, state, position, yaw):  # type: ignore[no-untyped-def]
    """Gap of two bodies (2, 6), separation speed, normal from the first, levers of the normal; fills position and yaw."""
    for b in range(2):
        position[b, 0], position[b, 1], yaw[b] = state[b, 0], state[b, 1], state[b, _YAW]
    gap, nx, ny, px, py = outline_gap(shape, position, yaw, 0, 1)
    ix, iy = px - state[0, 0], py - state[0, 1]
    jx, jy = px - state[1, 0], py - state[1, 1]
    ux = state[1, 2] - state[1, _SPIN] * jy - state[0, 2] + state[0, _SPIN] * iy
    uy = state[1, 3] + state[1, _SPIN] * jx - state[0, 3] - state[0, _SPIN] * ix
    return gap, ux * nx + uy * ny, nx, ny, ix * ny - iy * nx, jx * ny - jy * nx


@cached_njit
def _refined(bodies, i, j, shape, state, position, yaw, seconds, left, apart):  # type: ignore[no-untyped-def]
    """The moment at which the gap is that of contacts, not before `seconds`."""
    when = seconds
    for _ in range(_NEWTON_STEPS):
        if apart > -_MIN_APPROACH_WORLD_PER_S:
            break
        when = max(min(when - left / apart, seconds + 2 * STEP_SECONDS), seconds)
        state_at(bodies, i, when, state[0])
        state_at(bodies, j, when, state[1])
        gap, apart, _, _, _, _ = _approach(shape, state, position, yaw)
        left = gap - CONTACT_GAP_WORLD
    return when


@cached_njit
def find_contact(bodies, i, j, since, until):  # type: ignore[no-untyped-def]
    """Time of the first contact of bodies i and j in their present segments between two times; infinite without one.

    Bodies that are apart by a distance can't touch before they have covered it at their present speeds, which only fall. Where
    they are near, they are looked at after every Bullet step.
    """
    shape = np.array([bodies.shape[i], bodies.shape[j]])
    state, position, yaw = np.empty((2, 6)), np.empty((2, 2)), np.empty(2)
    corners = (_CORNER_WORLD if shape[0] == CUBE else 0.0) + (_CORNER_WORLD if shape[1] == CUBE else 0.0)
    reach = 2 * ROUND + CONTACT_GAP_WORLD + corners
    seconds = since
    while seconds <= until:
        state_at(bodies, i, seconds, state[0])
        state_at(bodies, j, seconds, state[1])
        speed = np.sqrt(state[0, 2] ** 2 + state[0, 3] ** 2) + np.sqrt(state[1, 2] ** 2 + state[1, 3] ** 2)
        spin = abs(state[0, _SPIN]) + abs(state[1, _SPIN])
        if speed == 0.0 and spin == 0.0:
            return np.inf
        apart_world = np.sqrt((state[1, 0] - state[0, 0]) ** 2 + (state[1, 1] - state[0, 1]) ** 2) - reach
        if apart_world > speed * STEP_SECONDS:
            seconds += apart_world / speed if speed > 0.0 else np.inf
            continue
        gap, apart, _, _, _, _ = _approach(shape, state, position, yaw)
        left = gap - CONTACT_GAP_WORLD
        if apart < 0 and left + apart * STEP_SECONDS <= 0:
            return min(_refined(bodies, i, j, shape, state, position, yaw, seconds, left, apart), until)
        seconds += max(left / (speed + spin * (ROUND + _CORNER_WORLD)), STEP_SECONDS)
    return np.inf


@cached_njit
def _exchanged(shape, state, mass, rebound, timed, position, yaw, out):  # type: ignore[no-untyped-def]
    """Write the states (2, 6) after a contact to `out`; `timed` contacts happen at the gap of contacts, others at once."""
    gap, apart, nx, ny, ci, cj = _approach(shape, state, position, yaw)
    out[:] = state
    before = (gap - CONTACT_GAP_WORLD) / -apart if timed else 0.0
    if timed:
        for b in range(2):
            out[b, 0] += before * out[b, 2]
            out[b, 1] += before * out[b, 3]
            out[b, _YAW] += before * out[b, _SPIN]
        _, apart, nx, ny, ci, cj = _approach(shape, out, position, yaw)
    spin_i = ci * ci / (INERTIA * mass[0]) if shape[0] == CUBE else 0.0
    spin_j = cj * cj / (INERTIA * mass[1]) if shape[1] == CUBE else 0.0
    impulse = -(1 + rebound) * apart / (1 / mass[0] + 1 / mass[1] + spin_i + spin_j)
    out[0, 2] -= impulse * nx / mass[0]
    out[0, 3] -= impulse * ny / mass[0]
    out[1, 2] += impulse * nx / mass[1]
    out[1, 3] += impulse * ny / mass[1]
    if shape[0] == CUBE:
        out[0, _SPIN] -= impulse * ci / (INERTIA * mass[0])
    if shape[1] == CUBE:
        out[1, _SPIN] += impulse * cj / (INERTIA * mass[1])
    if timed:
        for b in range(2):
            out[b, 0] -= before * out[b, 2]
            out[b, 1] -= before * out[b, 3]
            out[b, _YAW] -= before * out[b, _SPIN]


@cached_njit
def exchange(bodies, i, j, rebound, parameters, d_mass, d_rebound):  # type: ignore[no-untyped-def]
    """Apply the contact of bodies i and j, both at their segments' starts, to their states and sensitivities.

    Args:
        bodies: changed.
        i, j: which two.
        rebound: share of the approach speed that they part with.
        parameters: (3,) int, those of the masses of i and j and of the rebound; -1 for none.
        d_mass: (2,) derivatives of the masses by their parameters.
        d_rebound: the same for the rebound.
    """
    shape = np.array([bodies.shape[i], bodies.shape[j]])
    mass = np.array([bodies.mass[i], bodies.mass[j]])
    state, after, changed = np.empty((2, 6)), np.empty((2, 6)), np.empty((2, 6))
    position, yaw = np.empty((2, 2)), np.empty(2)
    state[0], state[1] = bodies.state[i], bodies.state[j]
    gap, apart, _, _, _, _ = _approach(shape, state, position, yaw)
    timed = apart < -_MIN_APPROACH_WORLD_PER_S and abs(gap - CONTACT_GAP_WORLD) < 1e-4
    _exchanged(shape, state, mass, rebound, timed, position, yaw, after)
    by_input = np.zeros((2, 6, 15))  # the last three: both masses and the rebound
    for k in range(15):
        if k < 12:
            b, c = k // 6, k % 6
            if c >= _YAW and shape[b] != CUBE:
                continue
            state[b, c] += _CONTACT_DIFFERENCE
            _exchanged(shape, state, mass, rebound, timed, position, yaw, changed)
            state[b, c] = bodies.state[i if b == 0 else j, c]
        elif k < 14:
            mass[k - 12] += _CONTACT_DIFFERENCE
            _exchanged(shape, state, mass, rebound, timed, position, yaw, changed)
            mass[k - 12] -= _CONTACT_DIFFERENCE
        else:
            _exchanged(shape, state, mass, rebound + _CONTACT_DIFFERENCE, timed, position, yaw, changed)
        for b in range(2):
            for r in range(6):
                by_input[b, r, k] = (changed[b, r] - after[b, r]) / _CONTACT_DIFFERENCE
    moved = np.empty((2, 6))
    for p in range(bodies.sensitivity.shape[2]):
        if not (bodies.active[i, p] or bodies.active[j, p]):
            continue
        for b in range(2):
            for r in range(6):
                total = 0.0
                for c in range(6):
                    total += by_input[b, r, c] * bodies.sensitivity[i, c, p]
                    total += by_input[b, r, 6 + c] * bodies.sensitivity[j, c, p]
                moved[b, r] = total
        bodies.sensitivity[i, :, p] = moved[0]
        bodies.sensitivity[j, :, p] = moved[1]
        bodies.active[i, p] = bodies.active[j, p] = True
    for k in range(3):
        p = parameters[k]
        if p >= 0:
            unit = d_mass[k] if k < 2 else d_rebound
            for r in range(6):
                bodies.sensitivity[i, r, p] += by_input[0, r, 12 + k] * unit
                bodies.sensitivity[j, r, p] += by_input[1, r, 12 + k] * unit
            bodies.active[i, p] = bodies.active[j, p] = True
    bodies.state[i], bodies.state[j] = after[0], after[1]

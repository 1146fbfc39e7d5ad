"""What changes the motion of a body in the plane: damping and friction in a Bullet step, and contacts. Compiled by Numba.

The motion of a body that slides without spinning has a closed form (`nsdr.dynamics.sliding`). The motion of a spinning box has
none, because friction at its four corners depends on both speed and spin, so it is simulated step by step.
"""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.body_state import SPIN, VX, VY, YAW, X, Y
from nsdr.dynamics.physics.bullet_rules import ERROR_REDUCTION, MIN_REBOUND_SPEED
from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.world.physics import DECIMALS

MIN_SPIN_RAD_PER_S = 1e-3
"""A slower spin counts as 0 (radians/s)."""
WALLS_REBOUND, WALLS_SLOPE = 0.40625, 0.30
"""Rebound of two objects with upright walls: `WALLS_REBOUND` times their coefficient of restitution and their flatness (at most
1: the lower one's height over the mean of their widths), 0.26 in CLEVRER, + `WALLS_SLOPE` times the rebound by Bullet's rule.
Rebounds are ratios of separation speed to approach speed. Measured by `python -m benchmarks.rebounds`; in 27 pairs of shapes
and materials with coefficients of 0.25 to 0.9 and flatness from 0.32 on, this leaves errors of 0.15, and the line that fits
each pair best 0.13."""


@cached_njit
def _brake(body, state, i):  # type: ignore[no-untyped-def]
    """Let the torsional friction of one Bullet step act on body i."""
    brake = body.step_seconds * body.spinning / body.inertia
    state[i, SPIN] = np.copysign(max(abs(state[i, SPIN]) - brake, 0.0), state[i, SPIN])


@cached_njit
def slow_down(body, state, i):  # type: ignore[no-untyped-def]
    """Apply the damping and friction of one Bullet step to body i.

    Args:
        body: the record of body i, of `BODY`.
        state: (n, 6) states of all bodies; taking a slice of one row would cost as much as the step.
        i: index of the body.
    """
    speed = np.sqrt(state[i, VX] * state[i, VX] + state[i, VY] * state[i, VY])
    abs_spin = abs(state[i, SPIN])
    if speed == 0.0 and abs_spin == 0.0:
        return
    step, deceleration, damping = body.step_seconds, body.law.deceleration, body.law.damping
    loss = damping * speed + damping * speed * speed
    state[i, SPIN] -= step * body.angular_damping * state[i, SPIN] * (1 + abs_spin)
    if deceleration == 0.0:
        factor = 1 - step * loss / speed if speed > 0 else 0.0
        state[i, VX] *= factor
        state[i, VY] *= factor
        if body.is_box:
            _brake(body, state, i)
        return
    if abs_spin < MIN_SPIN_RAD_PER_S or speed + body.lever * abs_spin < step * deceleration:
        factor = max(0.0, 1 - step * (loss + deceleration) / speed) if speed > 0 else 0.0
        state[i, VX] *= factor
        state[i, VY] *= factor
        state[i, SPIN] = 0.0
        return
    c, s = np.cos(state[i, YAW]), np.sin(state[i, YAW])
    fx, fy, torque, flat_x, flat_y = 0.0, 0.0, 0.0, body.flat[0], body.flat[1]
    for k in range(4):  # a quarter of the weight on each corner of the flat face
        kx, ky = (flat_x if k % 2 else -flat_x), (flat_y if k // 2 else -flat_y)
        rx, ry = c * kx - s * ky, s * kx + c * ky
        ux, uy = state[i, VX] - state[i, SPIN] * ry, state[i, VY] + state[i, SPIN] * rx
        u = max(np.sqrt(ux * ux + uy * uy), 2 * step * deceleration)
        gx, gy = -deceleration / 4 * ux / u, -deceleration / 4 * uy / u
        fx += gx
        fy += gy
        torque += rx * gy - ry * gx
    if speed > 0:
        state[i, VX] *= 1 - step * loss / speed
        state[i, VY] *= 1 - step * loss / speed
    state[i, VX] += step * fx
    state[i, VY] += step * fy
    state[i, SPIN] += step * torque / body.inertia
    _brake(body, state, i)


@cached_njit
def approach(body, state, i, j):  # type: ignore[no-untyped-def]
    """How bodies i and j approach each other.

    Returns:
        The gap (world units); the separation speed at the contact point (world units/s); the normal (x, y) from i to j; and
        the lever arms of a force along the normal about the centres of i and j (world units).
    """
    gap, nx, ny, px, py = outline_gap(body, state, i, j)
    ix, iy = px - state[i, X], py - state[i, Y]
    jx, jy = px - state[j, X], py - state[j, Y]
    ux = state[j, VX] - state[j, SPIN] * jy - state[i, VX] + state[i, SPIN] * iy
    uy = state[j, VY] + state[j, SPIN] * jx - state[i, VY] - state[i, SPIN] * ix
    return gap, ux * nx + uy * ny, nx, ny, ix * ny - iy * nx, jx * ny - jy * nx


@cached_njit
def push(body, state, mass, i, j, change, nx, ny, ci, cj):  # type: ignore[no-untyped-def]
    """Apply the impulse along the normal that changes the separation speed of bodies i and j by `change`.

    There is no friction between the bodies, and only boxes spin. `ci` and `cj` are the lever arms from `approach`.
    impulse = change / (1/mᵢ + 1/mⱼ + cᵢ²/Iᵢ + cⱼ²/Iⱼ)
    """
    spin_i = ci * ci / (body[i].inertia * mass[i]) if body[i].is_box else 0.0
    spin_j = cj * cj / (body[j].inertia * mass[j]) if body[j].is_box else 0.0
    impulse = change / (1 / mass[i] + 1 / mass[j] + spin_i + spin_j)
    state[i, VX] -= impulse * nx / mass[i]
    state[i, VY] -= impulse * ny / mass[i]
    state[j, VX] += impulse * nx / mass[j]
    state[j, VY] += impulse * ny / mass[j]
    if body[i].is_box:
        state[i, SPIN] -= impulse * ci / (body[i].inertia * mass[i])
    if body[j].is_box:
        state[j, SPIN] += impulse * cj / (body[j].inertia * mass[j])


@cached_njit
def drift(state, i, seconds):  # type: ignore[no-untyped-def]
    """Move body i for a time at its current velocity and spin, without forces."""
    state[i, X] += seconds * state[i, VX]
    state[i, Y] += seconds * state[i, VY]
    state[i, YAW] += seconds * state[i, SPIN]


@cached_njit
def rebound_at(body, state, mass, i, j, seconds, rebound):  # type: ignore[no-untyped-def]
    """Let bodies i and j rebound from each other `seconds` from now.

    Afterwards their separation speed is `rebound` times the approach speed. Positions are moved so that motion at the new
    velocities from now on passes through the contact.
    """
    drift(state, i, seconds)
    drift(state, j, seconds)
    _, apart, nx, ny, ci, cj = approach(body, state, i, j)
    push(body, state, mass, i, j, -(1 + rebound) * apart, nx, ny, ci, cj)
    drift(state, i, -seconds)
    drift(state, j, -seconds)


@cached_njit
def pair_restitution(one, other):  # type: ignore[no-untyped-def]
    """Coefficient of restitution of a collision of two bodies, given their records of `BODY`: 0.64 in CLEVRER."""
    return np.round(one.restitution * other.restitution, DECIMALS)


@cached_njit
def speed_after(one, other, gap, apart):  # type: ignore[no-untyped-def]
    """Separation speed of bodies i and j after a Bullet step (world units/s).

    Bullet lets two bodies close the gap within the step and then rebound. Upright walls, those of boxes and cylinders, touch
    only at their top or bottom end in Bullet: both bodies tip a little and touch at the other end a step later. So they rebound
    less than Bullet's rule says if it says much, and more if it says little.

    Args:
        one, other: records of the two bodies, of `BODY`.
        gap: gap between them at the start of the step (world units).
        apart: separation speed at the start of the step (world units/s); negative while they approach each other.
    """
    step = one.step_seconds
    rule = -gap / step if gap > 0 else -gap * ERROR_REDUCTION / step
    if apart >= -MIN_REBOUND_SPEED:
        return rule
    restitution = pair_restitution(one, other)
    rule -= restitution * apart
    if one.is_sphere or other.is_sphere:
        return rule
    flatness = min(min(one.height, other.height) / (one.lever + other.lever), 1.0)
    return max(WALLS_SLOPE * rule - WALLS_REBOUND * restitution * flatness * apart, 0.0)

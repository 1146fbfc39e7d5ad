"""What changes a body's motion in the plane: damping and friction in a Bullet step, and contacts with others (by Numba).

A body that only slides needs no steps (`nsdr.dynamics.sliding`). A spinning cube does: its four corners rub on the ground with
forces that depend on both speed and spin, so its motion has no closed form.
"""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import CUBE, FLAT, ROUND, SPHERE, outline_gap
from nsdr.world.physics_constants import (
    ANGULAR_DAMPING,
    ERROR_REDUCTION,
    GRAVITY,
    LINEAR_DAMPING,
    MIN_REBOUND_SPEED,
    PAIR_RESTITUTION,
    SLIDING_DECELERATION,
    SPINNING_FRICTION,
    STEP_SECONDS,
)

POSITION, VELOCITY, YAW, SPIN = slice(0, 2), slice(2, 4), 4, 5
"""Columns of a body's state, a row (x, y, vx, vy, yaw, spin): world units, radians and seconds."""
_SPINNING_DECELERATION = SPINNING_FRICTION * GRAVITY
"""Torque per mass by which the ground resists spinning (world units²/s²)."""
INERTIA = 2 * (2 * ROUND) ** 2 / 12
"""Moment of inertia per mass; Bullet takes that of the bounding box (world units²)."""
_SPIN_SLIDING_WORLD = 0.2
"""Lever (world units) by which spin adds to the speed over the ground in the test for rest."""
MIN_SPIN_RAD_PER_S = 1e-3
"""Slower spin counts as none."""
GIVEN_GAP_WORLD = 0.003
"""Gap at which given rebounds happen: the mean gap of Bullet's rule at usual speeds (world units)."""
WALLS_REBOUND, WALLS_SLOPE = 0.26, 0.30
"""Rebound of two objects with upright walls where Bullet's rule gives none, and by how much it grows with the rule's (both are
shares of the approach speed; `python benchmarks/rebounds.py`)."""


@cached_njit
def slow_down(shape, state, i):  # type: ignore[no-untyped-def]
    """Apply the damping and friction of one Bullet step to body i.

    Args:
        shape: of the body, index into `nsdr.world.vocabulary.SHAPES`.
        state: (n, 6) rows; not a row, because a slice costs as much as the step.
        i: which.
    """
    speed = np.sqrt(state[i, 2] * state[i, 2] + state[i, 3] * state[i, 3])
    abs_spin = abs(state[i, 5])
    if speed == 0.0 and abs_spin == 0.0:
        return
    loss = LINEAR_DAMPING * speed + LINEAR_DAMPING * speed * speed
    state[i, 5] -= STEP_SECONDS * ANGULAR_DAMPING * state[i, 5] * (1 + abs_spin)
    if shape == SPHERE:
        factor = 1 - STEP_SECONDS * loss / speed if speed > 0 else 0.0
        state[i, 2] *= factor
        state[i, 3] *= factor
        return
    if abs_spin < MIN_SPIN_RAD_PER_S or speed + _SPIN_SLIDING_WORLD * abs_spin < STEP_SECONDS * SLIDING_DECELERATION:
        factor = max(0.0, 1 - STEP_SECONDS * (loss + SLIDING_DECELERATION) / speed) if speed > 0 else 0.0
        state[i, 2] *= factor
        state[i, 3] *= factor
        state[i, 5] = 0.0
        return
    c, s = np.cos(state[i, 4]), np.sin(state[i, 4])
    fx, fy, torque = 0.0, 0.0, 0.0
    for k in range(4):  # a quarter of the weight on each corner of the flat face
        kx, ky = (FLAT if k % 2 else -FLAT), (FLAT if k // 2 else -FLAT)
        rx, ry = c * kx - s * ky, s * kx + c * ky
        ux, uy = state[i, 2] - state[i, 5] * ry, state[i, 3] + state[i, 5] * rx
        u = max(np.sqrt(ux * ux + uy * uy), 2 * STEP_SECONDS * SLIDING_DECELERATION)
        gx, gy = -SLIDING_DECELERATION / 4 * ux / u, -SLIDING_DECELERATION / 4 * uy / u
        fx += gx
        fy += gy
        torque += rx * gy - ry * gx
    if speed > 0:
        state[i, 2] *= 1 - STEP_SECONDS * loss / speed
        state[i, 3] *= 1 - STEP_SECONDS * loss / speed
    state[i, 2] += STEP_SECONDS * fx
    state[i, 3] += STEP_SECONDS * fy
    state[i, 5] += STEP_SECONDS * torque / INERTIA
    brake = STEP_SECONDS * _SPINNING_DECELERATION / INERTIA
    state[i, 5] = np.copysign(max(abs(state[i, 5]) - brake, 0.0), state[i, 5])


@cached_njit
def approach(shape, state, i, j):  # type: ignore[no-untyped-def]
    """Gap, separation speed, normal from i to j (x, y), and the levers of the contact point's normal about both centres."""
    gap, nx, ny, px, py = outline_gap(shape, state, i, j)
    ix, iy = px - state[i, 0], py - state[i, 1]
    jx, jy = px - state[j, 0], py - state[j, 1]
    ux = state[j, 2] - state[j, 5] * jy - state[i, 2] + state[i, 5] * iy
    uy = state[j, 3] + state[j, 5] * jx - state[i, 3] - state[i, 5] * ix
    return gap, ux * nx + uy * ny, nx, ny, ix * ny - iy * nx, jx * ny - jy * nx


@cached_njit
def push(shape, state, mass, i, j, change, nx, ny, ci, cj):  # type: ignore[no-untyped-def]
    """Change the separation speed of i and j by an impulse along their normal; without friction, and only cubes spin."""
    spin_i = ci * ci / (INERTIA * mass[i]) if shape[i] == CUBE else 0.0
    spin_j = cj * cj / (INERTIA * mass[j]) if shape[j] == CUBE else 0.0
    impulse = change / (1 / mass[i] + 1 / mass[j] + spin_i + spin_j)
    state[i, 2] -= impulse * nx / mass[i]
    state[i, 3] -= impulse * ny / mass[i]
    state[j, 2] += impulse * nx / mass[j]
    state[j, 3] += impulse * ny / mass[j]
    if shape[i] == CUBE:
        state[i, 5] -= impulse * ci / (INERTIA * mass[i])
    if shape[j] == CUBE:
        state[j, 5] += impulse * cj / (INERTIA * mass[j])


@cached_njit
def drift(state, i, seconds):  # type: ignore[no-untyped-def]
    """Move body i on at its present velocity and spin."""
    state[i, 0] += seconds * state[i, 2]
    state[i, 1] += seconds * state[i, 3]
    state[i, 4] += seconds * state[i, 5]


@cached_njit
def rebound_at(shape, state, mass, i, j, seconds, share):  # type: ignore[no-untyped-def]
    """Bodies i and j part at a share of their approach speed, at a moment so many seconds ahead; positions are of now."""
    drift(state, i, seconds)
    drift(state, j, seconds)
    _, apart, nx, ny, ci, cj = approach(shape, state, i, j)
    push(shape, state, mass, i, j, -(1 + share) * apart, nx, ny, ci, cj)
    drift(state, i, -seconds)
    drift(state, j, -seconds)


@cached_njit
def speed_after(shape, i, j, gap, apart):  # type: ignore[no-untyped-def]
    """Separation speed of i and j after a step that begins at a gap, while they separate at `apart` (world units per second).

    Bullet lets two bodies close the gap within the step, then rebound. Upright walls (of cubes and cylinders) it lets touch at
    their top or bottom end only: both tip a little and touch at the other end a step later, so they rebound less than the rule
    where it says much, and more where it says little.
    """
    rule = -gap / STEP_SECONDS if gap > 0 else -gap * ERROR_REDUCTION / STEP_SECONDS
    if apart >= -MIN_REBOUND_SPEED:
        return rule
    rule -= PAIR_RESTITUTION * apart
    if shape[i] == SPHERE or shape[j] == SPHERE:
        return rule
    return max(WALLS_SLOPE * rule - WALLS_REBOUND * apart, 0.0)

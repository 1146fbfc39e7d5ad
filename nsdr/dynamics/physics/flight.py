"""One Bullet step of a body that touches no other, compiled by Numba.

A body that only slides needs no steps (`nsdr.dynamics.sliding`). A spinning cube does: its four corners rub on the ground with
forces that depend on both speed and spin, so its motion has no closed form.
"""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import FLAT, ROUND, SPHERE
from nsdr.world.physics_constants import (
    ANGULAR_DAMPING,
    GRAVITY,
    GROUND_FRICTION,
    LINEAR_DAMPING,
    SPINNING_FRICTION,
    STEP_SECONDS,
)

__all__ = ["INERTIA", "MIN_SPIN_RAD_PER_S", "slow_down"]

_DECELERATION = GROUND_FRICTION["cube"] * GRAVITY
_SPINNING_DECELERATION = SPINNING_FRICTION * GRAVITY
"""Torque per mass by which the ground resists spinning (world units²/s²)."""
INERTIA = 2 * (2 * ROUND) ** 2 / 12
"""Moment of inertia per mass; Bullet takes that of the bounding box (world units²)."""
_SPIN_SLIDING_WORLD = 0.2
"""Lever (world units) by which spin adds to the speed over the ground in the test for rest."""
MIN_SPIN_RAD_PER_S = 1e-3
"""Slower spin counts as none."""


@cached_njit
def slow_down(shape, state, i):  # type: ignore[no-untyped-def]
    """Apply the damping and friction of one Bullet step to body i.

    Args:
        shape: of the body, index into `nsdr.world.vocabulary.SHAPES`.
        state: (n, 6) rows (x, y, vx, vy, yaw, spin); not a row, because a slice costs as much as the step.
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
    if abs_spin < MIN_SPIN_RAD_PER_S or speed + _SPIN_SLIDING_WORLD * abs_spin < STEP_SECONDS * _DECELERATION:
        factor = max(0.0, 1 - STEP_SECONDS * (loss + _DECELERATION) / speed) if speed > 0 else 0.0
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
        u = max(np.sqrt(ux * ux + uy * uy), 2 * STEP_SECONDS * _DECELERATION)
        gx, gy = -_DECELERATION / 4 * ux / u, -_DECELERATION / 4 * uy / u
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

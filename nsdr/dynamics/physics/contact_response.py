"""How two touching bodies act on each other in the plane, compiled by Numba; states are rows (x, y, vx, vy, yaw, spin)."""

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import CUBE, SPHERE, outline_gap
from nsdr.dynamics.physics.flight import INERTIA
from nsdr.world.physics_constants import ERROR_REDUCTION, MIN_REBOUND_SPEED, PAIR_RESTITUTION, STEP_SECONDS

__all__ = ["GIVEN_GAP_WORLD", "approach", "drift", "push", "speed_after"]

GIVEN_GAP_WORLD = 0.003
"""Gap at which given rebounds happen: the mean gap of Bullet's rule at usual speeds (world units)."""
WALLS_REBOUND, WALLS_SLOPE = 0.26, 0.30
"""Rebound of two objects with upright walls where Bullet's rule gives none, and by how much it grows with the rule's (both are
shares of the approach speed; `python benchmarks/rebounds.py`)."""


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

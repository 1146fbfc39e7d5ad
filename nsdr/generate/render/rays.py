"""Compiled intersections of rays with solids, one ray at a time; the geometry is that of `nsdr.generate.render.raycast`.

Points and directions are (x, y, z) tuples in world units. `solids` is an array (n, SOLID): kind, centre and, row by row, the
rotation from the solid's axes to the world's. A whole row is never taken: views of arrays cost more than the arithmetic.
"""

import math

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD

__all__ = [
    "CUBE",
    "CYLINDER",
    "SOLID",
    "SPHERE",
    "direction_in",
    "first_hit",
    "hit",
    "near_edge",
    "point_in",
    "rounded_normal",
]

CUBE, SPHERE, CYLINDER = 0, 1, 2
"""Kinds of solids."""
SOLID = 13
"""Numbers that describe a solid."""
R = OBJECT_RADIUS_WORLD
CUBE_EDGE_WORLD, CYLINDER_EDGE_WORLD = 0.12 * R, 0.03 * R
"""Width of the strip along the edges of cubes and cylinders in which the normal turns from one face to the next. CLEVR's
shapes have rounded edges there; the outlines stay those of the exact masks."""
BOUND_WORLD = 1.75 * R
"""Radius of a sphere around every shape; a cube's corner is at sqrt(3) R."""
MIN_DISTANCE = 1e-9
"""Hits nearer to a ray's start are not counted (multiples of the direction's length)."""


@cached_njit
def direction_in(solids, i, d):  # type: ignore[no-untyped-def]
    """A world direction in the axes of solid `i`."""
    return (
        solids[i, 4] * d[0] + solids[i, 7] * d[1] + solids[i, 10] * d[2],
        solids[i, 5] * d[0] + solids[i, 8] * d[1] + solids[i, 11] * d[2],
        solids[i, 6] * d[0] + solids[i, 9] * d[1] + solids[i, 12] * d[2],
    )


@cached_njit
def point_in(solids, i, p):  # type: ignore[no-untyped-def]
    """A world point in the axes of solid `i`, from its centre."""
    return direction_in(solids, i, (p[0] - solids[i, 1], p[1] - solids[i, 2], p[2] - solids[i, 3]))


@cached_njit
def _slab(o, d):  # type: ignore[no-untyped-def]
    """Where a ray enters and leaves the space between two faces of a cube."""
    if d == 0.0:
        return (-math.inf, math.inf) if abs(o) < R else (math.inf, -math.inf)
    a, b = (-R - o) / d, (R - o) / d
    return (a, b) if a < b else (b, a)


@cached_njit
def hit(kind, o, d):  # type: ignore[no-untyped-def]
    """Distance of the first hit of a ray from outside, in multiples of the direction's length; infinite for a miss.

    Args:
        kind: the shape.
        o: start of the ray in the solid's axes.
        d: direction in the solid's axes.
    """
    ox, oy, oz = o
    dx, dy, dz = d
    if kind == CUBE:
        enter_x, leave_x = _slab(ox, dx)
        enter_y, leave_y = _slab(oy, dy)
        enter_z, leave_z = _slab(oz, dz)
        enter, leave = max(enter_x, enter_y, enter_z), min(leave_x, leave_y, leave_z)
        return enter if MIN_DISTANCE < enter < leave else math.inf
    if kind == SPHERE:
        a, b, c = dx * dx + dy * dy + dz * dz, dx * ox + dy * oy + dz * oz, ox * ox + oy * oy + oz * oz - R * R
        h = b * b - a * c
        t = (-b - math.sqrt(h)) / a if h > 0.0 else -1.0
        return t if t > MIN_DISTANCE else math.inf
    best = math.inf
    a, b, c = dx * dx + dy * dy, dx * ox + dy * oy, ox * ox + oy * oy - R * R
    h = b * b - a * c
    if h > 0.0 and a > 0.0:
        t = (-b - math.sqrt(h)) / a
        if t > MIN_DISTANCE and abs(oz + t * dz) <= R:
            best = t
    if dz != 0.0:
        t = ((R if dz < 0.0 else -R) - oz) / dz
        x, y = ox + t * dx, oy + t * dy
        if MIN_DISTANCE < t < best and x * x + y * y <= R * R:
            best = t
    return best


@cached_njit
def first_hit(solids, p, d, besides):  # type: ignore[no-untyped-def]
    """Index of the solid that a ray meets first and the distance; -1 and infinity for none.

    Args:
        solids: the solids.
        p: start of the ray.
        d: unit direction.
        besides: index of a solid that is left out.
    """
    nearest, index = math.inf, -1
    for i in range(len(solids)):
        if i == besides:
            continue
        x, y, z = p[0] - solids[i, 1], p[1] - solids[i, 2], p[2] - solids[i, 3]
        along = x * d[0] + y * d[1] + z * d[2]
        if along > 0.0 or x * x + y * y + z * z - along * along > BOUND_WORLD * BOUND_WORLD:
            continue
        t = hit(solids[i, 0], direction_in(solids, i, (x, y, z)), direction_in(solids, i, d))
        if t < nearest:
            nearest, index = t, i
    return index, nearest


@cached_njit
def near_edge(solids, i, p, margin):  # type: ignore[no-untyped-def]
    """Whether a point of a solid's surface is on a rounded edge or less than `margin` (world units) away from one."""
    x, y, z = point_in(solids, i, p)
    if solids[i, 0] == CUBE:
        inner = R - CUBE_EDGE_WORLD - margin
        return (abs(x) > inner) + (abs(y) > inner) + (abs(z) > inner) > 1
    inner = R - CYLINDER_EDGE_WORLD - margin
    return solids[i, 0] == CYLINDER and abs(z) > inner and x * x + y * y > inner * inner


@cached_njit
def rounded_normal(solids, i, p):  # type: ignore[no-untyped-def]
    """Unit outward normal at a point of a solid's surface; near edges it turns from one face to the next."""
    x, y, z = point_in(solids, i, p)
    if solids[i, 0] == CUBE:
        inner = R - CUBE_EDGE_WORLD
        x = math.copysign(max(abs(x) - inner, 0.0), x)
        y = math.copysign(max(abs(y) - inner, 0.0), y)
        z = math.copysign(max(abs(z) - inner, 0.0), z)
    elif solids[i, 0] == CYLINDER:
        inner = R - CYLINDER_EDGE_WORLD
        radius = math.sqrt(x * x + y * y)
        share = max(radius - inner, 0.0) / radius if radius > 0.0 else 0.0
        x, y, z = x * share, y * share, math.copysign(max(abs(z) - inner, 0.0), z)
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return 0.0, 0.0, 1.0
    x, y, z = x / length, y / length, z / length
    return (
        solids[i, 4] * x + solids[i, 5] * y + solids[i, 6] * z,
        solids[i, 7] * x + solids[i, 8] * y + solids[i, 9] * z,
        solids[i, 10] * x + solids[i, 11] * y + solids[i, 12] * z,
    )

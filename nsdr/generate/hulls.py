"""Collision shapes of CLEVRER's objects, as the vertices of convex hulls.

Sizes, rounded edges and the directions of the axes were recovered from the release's annotation files; the number of vertices
is a compromise between speed and a contact that starts where the true shape's would.
"""

import itertools
import math
from functools import lru_cache

from nsdr.clevrer.camera import OBJECT_RADIUS_WORLD

__all__ = ["hull_vertices"]

CUBE_EDGE, CUBE_POWER, CUBE_STEPS = 0.05, 3.0, 6
"""Width of a cube's rounded edge, the superellipse's exponent, and points along a quarter of it."""
CYLINDER_RIM, CYLINDER_WALL_END, CYLINDER_SIDES = 0.012, 0.02, 256
"""How far the end face and the wall stop before the corner between them."""
SPHERE_RADIUS, SPHERE_SIDES = 0.19984, 96
SPHERE_LATITUDES = (0.0, 3.75, 7.5, 15.0, 30.0, 50.0, 70.0, 82.0)
"""Degrees. Spheres slide without turning and meet others at the equator, so that is where the points are."""

Vertex = tuple[float, float, float]


@lru_cache
def hull_vertices(shape: str) -> tuple[Vertex, ...]:
    """Vertices (x, y, z) in world units around the object's centre. Cylinders lie along local y, as annotated."""
    return {"cube": _cube, "cylinder": _cylinder, "sphere": _sphere}[shape]()


def _cube() -> tuple[Vertex, ...]:
    flat = OBJECT_RADIUS_WORLD - CUBE_EDGE
    angles = [math.pi / 2 * k / CUBE_STEPS for k in range(CUBE_STEPS + 1)]
    arc = [(max(math.cos(a), 0.0) ** (2 / CUBE_POWER), math.sin(a) ** (2 / CUBE_POWER)) for a in angles]
    corner = {(st * cp, st * sp, ct) for ct, st in arc for cp, sp in arc}
    signs = itertools.product((-1, 1), repeat=3)
    points = {
        (sx * (flat + CUBE_EDGE * x), sy * (flat + CUBE_EDGE * y), sz * (flat + CUBE_EDGE * z))
        for sx, sy, sz in signs
        for x, y, z in corner
    }
    return tuple(sorted(points))


def _cylinder() -> tuple[Vertex, ...]:
    r = OBJECT_RADIUS_WORLD
    rim = [(r, r - CYLINDER_WALL_END), (r - CYLINDER_RIM, r)]
    angles = [2 * math.pi * k / CYLINDER_SIDES for k in range(CYLINDER_SIDES)]
    return tuple(
        (radius * math.cos(a), side * height, radius * math.sin(a))
        for a in angles
        for side in (-1, 1)
        for radius, height in rim
    )


def _sphere() -> tuple[Vertex, ...]:
    angles = [2 * math.pi * k / SPHERE_SIDES for k in range(SPHERE_SIDES)]
    r = SPHERE_RADIUS
    rings = [math.radians(sign * degrees) for degrees in SPHERE_LATITUDES for sign in ((1, -1) if degrees else (1,))]
    points = [
        (r * math.cos(t) * math.cos(a), r * math.cos(t) * math.sin(a), r * math.sin(t)) for t in rings for a in angles
    ]
    return (*points, (0.0, 0.0, r), (0.0, 0.0, -r))

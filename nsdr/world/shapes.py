"""Solids of a world's shapes: collision hulls, surface points, extents, and the rotation of a rendered object.

Functions take a `Shape` or the word of one of CLEVRER's. Hull sizes, rounded edges and axis directions were recovered from the
release's annotation files; those of other sizes are in proportion. More vertices make contacts start closer to where the true
shape's would, and cost speed.
"""

import itertools
import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nsdr.world.vocabulary import CLEVRER, Shape

FloatArray = NDArray[np.floating[Any]]

RADIUS_WORLD = CLEVRER.shapes[0].radius_world
"""Half the width of CLEVRER's objects (world units), which the lengths below belong to."""
CUBE_EDGE_WORLD = 0.05
"""Width of a cube's rounded edge (world units)."""
CUBE_EXPONENT = 3.0
"""Exponent of the superellipse that rounds a cube's edge."""
CUBE_STEPS = 6
"""Segments of the quarter ellipse that rounds a cube's edge."""
CYLINDER_RIM_WORLD = 0.012
"""Radius of a cylinder's wall minus the radius of its flat end face (world units)."""
CYLINDER_WALL_END_WORLD = 0.02
"""Distance between a cylinder's end face and the end of its straight wall (world units)."""
CYLINDER_SIDES = 256
"""Sides of a cylinder's hull."""
SPHERE_RADIUS_WORLD = 0.19984
"""Radius of a sphere's hull (world units); with Bullet's margin its contacts start where the true sphere's do."""
SPHERE_SIDES = 96
"""Vertices on each ring of a sphere's hull."""
SPHERE_LATITUDES_DEGREES = (0.0, 3.75, 7.5, 15.0, 30.0, 50.0, 70.0, 82.0)
"""Latitudes of the rings of a sphere's hull (degrees). Spheres slide without rotating and touch others near the equator, so
most rings are there."""
_OUTLINE_POINTS = 48
"""Points on each circle of `surface_points`."""

Vertex = tuple[float, float, float]


def shape_of(shape: Shape | str) -> Shape:
    """The shape itself, or that of a word of CLEVRER's."""
    return CLEVRER.shape(shape) if isinstance(shape, str) else shape


@lru_cache
def hull_vertices(shape: Shape | str) -> tuple[Vertex, ...]:
    """Vertices (x, y, z) of a collision hull, relative to the object's centre (world units).

    Cylinders lie along the local y axis, as in the annotation files.
    """
    shape = shape_of(shape)
    return {"box": _box, "cylinder": _cylinder, "sphere": _sphere}[shape.solid](shape)


def _box(shape: Shape) -> tuple[Vertex, ...]:
    halves = [edge / 2 for edge in shape.size_world]
    round_ = CUBE_EDGE_WORLD * (min(halves) / RADIUS_WORLD)
    flat = [half - round_ for half in halves]
    angles = [math.pi / 2 * k / CUBE_STEPS for k in range(CUBE_STEPS + 1)]
    arc = [(max(math.cos(a), 0.0) ** (2 / CUBE_EXPONENT), math.sin(a) ** (2 / CUBE_EXPONENT)) for a in angles]
    corner = {(st * cp, st * sp, ct) for ct, st in arc for cp, sp in arc}
    signs = itertools.product((-1, 1), repeat=3)
    points = {
        (sx * (flat[0] + round_ * x), sy * (flat[1] + round_ * y), sz * (flat[2] + round_ * z))
        for sx, sy, sz in signs
        for x, y, z in corner
    }
    return tuple(sorted(points))


def _cylinder(shape: Shape) -> tuple[Vertex, ...]:
    r, half_height = shape.radius_world, shape.height_world
    scale = min(r, half_height) / RADIUS_WORLD
    rim = [(r, half_height - CYLINDER_WALL_END_WORLD * scale), (r - CYLINDER_RIM_WORLD * scale, half_height)]
    angles = [2 * math.pi * k / CYLINDER_SIDES for k in range(CYLINDER_SIDES)]
    return tuple(
        (radius * math.cos(a), side * height, radius * math.sin(a))
        for a in angles
        for side in (-1, 1)
        for radius, height in rim
    )


def _sphere(shape: Shape) -> tuple[Vertex, ...]:
    angles = [2 * math.pi * k / SPHERE_SIDES for k in range(SPHERE_SIDES)]
    r = SPHERE_RADIUS_WORLD * (shape.radius_world / RADIUS_WORLD)
    latitudes = SPHERE_LATITUDES_DEGREES
    rings = [math.radians(sign * degrees) for degrees in latitudes for sign in ((1, -1) if degrees else (1,))]
    points = [
        (r * math.cos(t) * math.cos(a), r * math.cos(t) * math.sin(a), r * math.sin(t)) for t in rings for a in angles
    ]
    return (*points, (0.0, 0.0, r), (0.0, 0.0, -r))


def surface_points(shape: Shape | str, yaw: float = 0.0) -> FloatArray:
    """Points (N, 3) relative to an object's centre whose convex hull is the rendered object (world units).

    Args:
        shape: the shape.
        yaw: rotation about the vertical axis (radians); matters for boxes only.
    """
    shape = shape_of(shape)
    r, height = shape.radius_world, shape.height_world
    if shape.solid == "box":
        c, s = np.cos(yaw), np.sin(yaw)
        a, b = shape.size_world[0] / 2, shape.size_world[1] / 2
        turned = [(a * c - b * s, a * s + b * c), (-a * c - b * s, -a * s + b * c)]
        corners = np.array([*turned, *((-one, -other) for one, other in turned)])
        return np.concatenate([np.c_[corners, np.full(4, z)] for z in (-height, height)])
    n = _OUTLINE_POINTS
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    if shape.solid == "cylinder":
        return np.concatenate([np.c_[r * np.cos(angle), r * np.sin(angle), np.full(n, z)] for z in (-height, height)])
    polar = np.linspace(0, np.pi, n // 2)[:, None]
    x, y = r * np.sin(polar) * np.cos(angle), r * np.sin(polar) * np.sin(angle)
    return np.stack([x, y, r * np.cos(polar) + 0 * angle], -1).reshape(-1, 3)


def extent(shape: Shape | str, direction: FloatArray, yaw: FloatArray) -> FloatArray:
    """How far upright objects reach from their centre in some directions: the support function of the rendered shape.

    Args:
        shape: the shape.
        direction: (D, 3), of any length, by which the extent is multiplied.
        yaw: (F,) rotations about the vertical axis (radians); matter for boxes only.

    Returns:
        (F, D) world units, or (1, D) for shapes that are the same after each rotation.
    """
    shape = shape_of(shape)
    across, up = np.hypot(direction[:, 0], direction[:, 1]), np.abs(direction[:, 2])
    r, height = shape.radius_world, shape.height_world
    if shape.solid == "sphere":
        return r * np.hypot(across, up)[None]
    if shape.solid == "cylinder":
        return r * (across + height / r * up)[None]
    turned = np.arctan2(direction[:, 1], direction[:, 0]) - yaw[:, None]
    x, y, z = (edge / (2 * r) for edge in shape.size_world)
    return r * (across * (x * np.abs(np.cos(turned)) + y * np.abs(np.sin(turned))) + z * up)


def rendered_rotation(shape: Shape | str, orientation: FloatArray) -> Rotation:
    """Rotation of a rendered shape, whose axis is z, from annotated Euler angles (3,) (radians).

    Annotated cylinders lie along their local y axis.
    """
    rotation = Rotation.from_euler("xyz", orientation)
    return rotation * Rotation.from_euler("x", -np.pi / 2) if shape_of(shape).solid == "cylinder" else rotation

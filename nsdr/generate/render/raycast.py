"""Ray casting of cubes, spheres and cylinders: exact masks, and depths and normals for the preview renderer."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.world.camera import Camera
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD

__all__ = ["Solid", "cast", "image_box", "instance_ids"]

FloatArray = NDArray[np.floating[Any]]
R = OBJECT_RADIUS_WORLD
MIN_DEPTH_WORLD = 3 * R
"""Objects whose centre is nearer to the camera are not in the image."""
BOUNDING_RADIUS_WORLD = 1.8 * R
"""Radius of a sphere that contains every shape; a cube's corner is at sqrt(3) R."""
BOX_RADIUS_WORLD = 1.9 * R
"""Half-size of an image box at the nearest depth of the bounding sphere, with a margin."""
CAP_TOLERANCE_WORLD = 1e-6
"""Points this close to a cylinder's end face lie on it."""


@dataclass(frozen=True)
class Solid:
    """Geometry of an object in one frame.

    Attributes:
        shape: "cube", "sphere" or "cylinder".
        location_world: (3,) centre.
        rotation: (3, 3) rotation matrix from the object's axes to the world's.
    """

    shape: str
    location_world: FloatArray
    rotation: FloatArray


def cast(solid: Solid, origin: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Intersect rays with a solid.

    Args:
        solid: the object.
        origin: (3,) or (N, 3) start points.
        directions: (N, 3) directions of any length.

    Returns:
        Distance (N,) to the first hit in multiples of the direction's length, infinite for a miss, and the outward normals
        (N, 3) in the solid's axes.
    """
    o = (origin - solid.location_world) @ solid.rotation
    d = directions @ solid.rotation
    o = np.broadcast_to(o, d.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = {"sphere": _sphere, "cube": _cube, "cylinder": _cylinder}[solid.shape](o, d)
        t = np.where(t > 0, t, np.inf)
        hit = o + np.where(np.isfinite(t), t, 0.0)[:, None] * d
    return t, _normal(solid.shape, hit)


def _sphere(o: FloatArray, d: FloatArray) -> FloatArray:
    a, b = (d * d).sum(1), (d * o).sum(1)
    h = b * b - a * ((o * o).sum(1) - R * R)
    return np.where(h > 0, (-b - np.sqrt(np.maximum(h, 0))) / a, np.inf)


def _cube(o: FloatArray, d: FloatArray) -> FloatArray:
    low, high = (-R - o) / d, (R - o) / d
    enter, leave = np.minimum(low, high).max(1), np.maximum(low, high).min(1)
    return np.where((enter < leave) & (leave > 0), enter, np.inf)


def _cylinder(o: FloatArray, d: FloatArray) -> FloatArray:
    a = d[:, 0] ** 2 + d[:, 1] ** 2
    b = d[:, 0] * o[:, 0] + d[:, 1] * o[:, 1]
    h = b * b - a * (o[:, 0] ** 2 + o[:, 1] ** 2 - R * R)
    wall = np.where(h > 0, (-b - np.sqrt(np.maximum(h, 0))) / a, np.inf)
    wall = np.where((np.abs(o[:, 2] + wall * d[:, 2]) <= R) & (wall > 0), wall, np.inf)
    best = wall
    for end in (-R, R):
        cap = (end - o[:, 2]) / d[:, 2]
        inside = (o[:, 0] + cap * d[:, 0]) ** 2 + (o[:, 1] + cap * d[:, 1]) ** 2 <= R * R
        best = np.minimum(best, np.where(inside & (cap > 0), cap, np.inf))
    return best


def _normal(shape: str, hit: FloatArray) -> FloatArray:
    if shape == "sphere":
        return hit / R
    if shape == "cube":
        axis = np.abs(hit).argmax(1)
        rows = np.arange(len(hit))
        normal = np.zeros_like(hit)
        normal[rows, axis] = np.sign(hit[rows, axis])
        return normal
    on_cap = np.abs(hit[:, 2]) > R - CAP_TOLERANCE_WORLD
    normal = hit / R
    normal[:, 2] = 0.0
    normal[on_cap] = np.stack([0 * hit[on_cap, 2], 0 * hit[on_cap, 2], np.sign(hit[on_cap, 2])], 1)
    return normal


def image_box(solid: Solid, camera: Camera) -> tuple[int, int, int, int] | None:
    """Box (left, top, right, bottom) in pixels, end exclusive, that contains the solid; None when it is outside the image."""
    depth = float(camera.depth(solid.location_world))
    if depth < MIN_DEPTH_WORLD:
        return None
    column, row = camera.pixels(solid.location_world)
    half = BOX_RADIUS_WORLD / (depth - BOUNDING_RADIUS_WORLD) * camera.focal_px
    left, right = max(int(column - half), 0), min(int(column + half) + 1, camera.width)
    top, bottom = max(int(row - half), 0), min(int(row + half) + 1, camera.height)
    return (left, top, right, bottom) if left < right and top < bottom else None


def instance_ids(solids: list[Solid], camera: Camera) -> NDArray[np.int64]:
    """Index (height, width) of the solid seen at each pixel's centre, -1 for none."""
    ids = np.full((camera.height, camera.width), -1, np.int64)
    nearest = np.full((camera.height, camera.width), np.inf)
    for i, solid in enumerate(solids):
        box = image_box(solid, camera)
        if box is None:
            continue
        left, top, right, bottom = box
        columns, rows = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
        t, _ = cast(solid, np.array(camera.eye_world), camera.rays(columns, rows).reshape(-1, 3))
        t = t.reshape(columns.shape)
        window = np.s_[top:bottom, left:right]
        closer = t < nearest[window]
        nearest[window][closer] = t[closer]
        ids[window][closer] = i
    return ids

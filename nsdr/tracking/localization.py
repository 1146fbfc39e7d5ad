"""From what a mask shows to the object's position on the ground.

The centroid of an object's outline is not the image of its centre, and an outline cut by the image's border or by a
nearer object has a false centroid. Both corrections follow from the known camera and shapes: outlines are projected on a
grid of positions, and polynomials in the pixel are fitted to the offsets. No measured constants are needed.
"""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.tracking.visibility import cut_sides
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX, ground_from_pixels, pixels_from_world
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.shapes import surface_points
from nsdr.world.vocabulary import SHAPES

__all__ = ["ground_location", "outline"]

FloatArray = NDArray[np.floating[Any]]


def outline(shape: str, x: float, y: float, yaw: float = 0.0) -> FloatArray:
    """Outline of an object at (x, y) on the ground as a convex polygon (N, 2) in pixels."""
    points = surface_points(shape, yaw) + np.array([x, y, OBJECT_RADIUS_WORLD])
    return cv2.convexHull(pixels_from_world(points).astype(np.float32))[:, 0].astype(float)


def _centroid(polygon: FloatArray) -> FloatArray:
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]
    return ((polygon + following) * cross[:, None]).sum(0) / (3 * cross.sum())


def _terms(pixels: FloatArray) -> FloatArray:
    """Cubic polynomial terms (N, 10) of pixels (N, 2)."""
    u, v = (pixels[:, 0] - WIDTH_PX / 2) / WIDTH_PX, (pixels[:, 1] - HEIGHT_PX / 2) / HEIGHT_PX
    return np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], 1)


@lru_cache(maxsize=1)
def _calibration() -> dict[str, tuple[FloatArray, FloatArray]]:
    """For each shape: coefficients (10, 2) of the centre minus the centroid, at the centroid; and (10, 4) of the outline's
    box (left, top, right, bottom) minus the centre, at the centre. Cubes are averaged over their yaw."""
    columns, rows = np.meshgrid(np.linspace(-20, WIDTH_PX + 20, 15), np.linspace(10, HEIGHT_PX + 20, 12))
    centres = np.stack([columns.ravel(), rows.ravel()], 1)
    result = {}
    for shape in SHAPES:
        yaws = np.linspace(0, np.pi / 2, 6, endpoint=False) if shape == "cube" else [0.0]
        centroids, edges = [], []
        for x, y in ground_from_pixels(centres):
            polygons = [outline(shape, x, y, yaw) for yaw in yaws]
            centroids.append(np.mean([_centroid(p) for p in polygons], 0))
            edges.append(np.mean([[*p.min(0), *p.max(0)] for p in polygons], 0))
        to_centre = np.linalg.lstsq(_terms(np.array(centroids)), centres - centroids, rcond=None)[0]
        to_edges = np.linalg.lstsq(_terms(centres), np.array(edges) - np.tile(centres, 2), rcond=None)[0]
        result[shape] = (to_centre, to_edges)
    return result


def ground_location(
    shape: str,
    centroid_px: FloatArray,
    box_xyxy_px: NDArray[np.integer[Any]],
    hidden: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """Ground-plane positions of objects of one shape.

    Args:
        shape: "cube", "sphere" or "cylinder".
        centroid_px: (N, 2) mask centroids (column, row).
        box_xyxy_px: (N, 4) mask bounds.
        hidden: (N, 4) bool from `hidden_sides`; None looks at the image's border only. Where a side is hidden the
            centroid is false: the free sides and the size that the shape has at that position give the position.

    Returns:
        (N, 2) world (x, y) of the object's centre.
    """
    to_centre, to_edges = _calibration()[shape]
    centroid = np.asarray(centroid_px, float).reshape(-1, 2)
    box = np.asarray(box_xyxy_px, float).reshape(-1, 4)
    centre = centroid + _terms(centroid) @ to_centre
    size = np.array([WIDTH_PX, HEIGHT_PX])
    if hidden is None:
        hidden = cut_sides(box)
    cut = hidden.any(1)
    low, high = hidden[cut, :2], hidden[cut, 2:]
    for _ in range(8 if cut.any() else 0):
        offset = _terms(np.clip(centre[cut], -40, size + 40)) @ to_edges
        from_high, from_low = box[cut, 2:] - offset[:, 2:], box[cut, :2] - offset[:, :2]
        by_edges = np.where(low, from_high, np.where(high, from_low, (from_high + from_low) / 2))
        centre[cut] = np.where(low & high, centre[cut], by_edges)
    return ground_from_pixels(centre)

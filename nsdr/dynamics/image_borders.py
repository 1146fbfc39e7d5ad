"""In which frames objects are in the image, to the frame: fitted motions meet the image's border.

An object enters when the first bit of its outline crosses the border, some frames before it is detected. At the left, right
and bottom borders the leading side of its box is measured; the fitted outline is shifted to it, because a cube's yaw is not
known and fits are off by some pixels where objects are near. At the top border objects are far away: fits are better there than
masks.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.world.camera import CLEVRER_CAMERA, HEIGHT_PX, WIDTH_PX, on_ground
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.shapes import surface_points

__all__ = ["frames_in_image"]

FloatArray = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]

LEADING_SIDE = (2, 3, 0, 1)
"""Index into (left, top, right, bottom) of the side of a box that is the first one inside each border, in the same order."""
SIDE_SHIFT_PX = (0.4, -0.25, -0.5)
"""Added to how far a measured side is inside the left, right and bottom border (pixels): what the side of a mask lacks to the
true outline's. `python benchmarks/objects.py --shifts` prints it; set on scenes 1 and 3 of every 10 of `train`."""
TOP_SHIFT_PX = {"cube": 0.65, "cylinder": 1.4, "sphere": 0.4}
"""The same for the fitted outline at the top border (pixels)."""
SAMPLES, MAX_SAMPLE_FRAMES = 2, 30
"""Detections that the shift is measured on, and the largest number of frames between them and the track's end."""
CUBE_YAW = 0.4
"""Yaw (radians) of cubes relative to the line of sight, which gives about their mean width."""
MARGIN_WORLD = 3 * OBJECT_RADIUS_WORLD
"""Objects whose centre is further outside the image, or nearer to the camera, are not in the image (world units)."""


def frames_in_image(
    shape: str, location_world: FloatArray, detected: BoolArray, box_xyxy_px: FloatArray, hidden: BoolArray
) -> BoolArray:
    """Frames of a track, and those before and after it in which the fitted outline is in the image.

    Args:
        shape: "cube", "sphere" or "cylinder".
        location_world: (F, 2) fitted positions; NaN where nothing fits.
        detected: (F,) bool.
        box_xyxy_px: (F, 4) boxes of the detections.
        hidden: (F, 4) bool, sides of the boxes that are not the object's own, see `hidden_sides`.

    Returns:
        (F,) bool.
    """
    visible = np.zeros(len(detected), bool)
    seen = np.flatnonzero(detected)
    if not len(seen):
        return visible
    first, last = int(seen[0]), int(seen[-1])
    visible[first : last + 1] = True
    for end, outside in ((first, np.arange(first)[::-1]), (last, np.arange(last + 1, len(detected)))):
        if len(outside):
            near = seen[np.argsort(np.abs(seen - end), kind="stable")]
            near = near[np.abs(near - end) <= MAX_SAMPLE_FRAMES]
            inside = _inside(shape, location_world, outside, near, box_xyxy_px, hidden)
            visible[outside[: _leading(inside)]] = True
    return visible


def _leading(true: BoolArray) -> int:
    """Number of True before the first False."""
    return len(true) if bool(true.all()) else int(true.argmin())


def _inside(
    shape: str, location: FloatArray, wanted: NDArray[Any], near: NDArray[Any], box: FloatArray, hidden: BoolArray
) -> BoolArray:
    """Whether the outline is in the image at the wanted frames; `near` are the detections next to them, nearest first."""
    sides = _outline_sides(shape, location[wanted])
    seen = _outline_sides(shape, location[near])
    borders = np.array([0.0, 0.0, WIDTH_PX, HEIGHT_PX])
    inside = np.isfinite(sides).all(1)
    for border, side in enumerate(LEADING_SIDE):
        inward = 1.0 if side >= 2 else -1.0
        depth_px = inward * (sides[:, side] - borders[border])
        if border == 1:
            inside &= depth_px + TOP_SHIFT_PX[shape] > 0
            continue
        lack = (box[near, side] - seen[:, side])[~hidden[near, side] & np.isfinite(seen[:, side])]
        if len(lack):
            depth_px += inward * lack[:SAMPLES].mean() + SIDE_SHIFT_PX[border - (border > 1)]
        inside &= depth_px > 0
    return np.asarray(inside)


def _outline_sides(shape: str, location_world: FloatArray) -> FloatArray:
    """Left, top, right and bottom (N, 4) of outlines in pixels; NaN where a position is not known or far from the image."""
    centre = on_ground(location_world)
    sides = np.full((len(centre), 4), np.nan)
    with np.errstate(invalid="ignore"):
        depth, pixel = CLEVRER_CAMERA.depth(centre), CLEVRER_CAMERA.pixels(centre)
        margin = CLEVRER_CAMERA.focal_px * MARGIN_WORLD / depth[:, None]
        near = ((pixel > -margin) & (pixel < np.array([WIDTH_PX, HEIGHT_PX]) + margin)).all(1)
        known = np.flatnonzero(near & (depth > MARGIN_WORLD))
    if not len(known):
        return sides
    points = np.repeat(surface_points(shape, CUBE_YAW)[None], len(known) if shape == "cube" else 1, axis=0)
    if shape == "cube":
        x, y = (centre[known, :2] - CLEVRER_CAMERA.eye_world[:2]).T
        cos, sin = x / np.hypot(x, y), y / np.hypot(x, y)
        turn = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], 1)
        points[..., :2] = points[..., :2] @ turn
    outline = CLEVRER_CAMERA.pixels(points + centre[known, None])
    sides[known] = np.concatenate([outline.min(1), outline.max(1)], 1)
    return sides

"""Visibility of objects: inside the image, cut by its border, or occluded by another object. One rule each."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.validation import BoolArray, FloatArray
from nsdr.world.camera import CLEVRER_CAMERA, Camera
from nsdr.world.shapes import extent, shape_of
from nsdr.world.vocabulary import Shape

CUT_MARGIN_PX = 2.0
"""A box side closer than this to the image border may be cut by it (pixels). Like `TOUCH_PX`, chosen by the accuracy of
answers on `dev` scenes."""
TOUCH_PX = 2.0
"""Boxes closer than this touch each other (pixels)."""
COVERED_SHARE = 0.6
"""A nearer box hides another box's top only when it covers more than this share of its width."""
MIN_DEPTH_RADII = 3.0
"""Objects whose centre has a smaller depth are not in the image (halves of their largest size)."""


def in_image(
    shape: Shape | str, location_world: FloatArray, yaw: FloatArray, camera: Camera = CLEVRER_CAMERA
) -> BoolArray:
    """Whether a part of an object is in the image, for each frame: CLEVRER's `inside_camera_view`.

    It is where the object reaches across each of the four planes through the camera and a border of the image.

    With CLEVRER's camera this agrees with 6,394 of 6,400 values in ten of the release's annotation files; the other six are
    off by one frame.

    Args:
        shape: a shape, or the word of one of CLEVRER's.
        location_world: (F, 3) centre; in frames with NaN the object is not in the image.
        yaw: (F,) radians; or (1,), the same in all frames.
        camera: the camera that takes the image.

    Returns:
        (F,) bool.
    """
    planes = camera.border_planes
    inside = location_world @ planes[:, :3].T + planes[:, 3]
    reaches = (inside + extent(shape, planes[:, :3], yaw) > 0).all(1)
    radius = max(shape_of(shape).size_world) / 2
    return np.asarray(reaches & (camera.depth(location_world) > MIN_DEPTH_RADII * radius))


def cut_sides(box_xyxy_px: NDArray[Any], camera: Camera) -> BoolArray:
    """Which sides of boxes (..., 4) the border of a camera's images may cut: (..., 4) bool for left, top, right, bottom."""
    box = np.asarray(box_xyxy_px, float)
    inside = np.concatenate([box[..., :2], np.array([camera.width, camera.height]) - box[..., 2:]], -1)
    with np.errstate(invalid="ignore"):
        return np.asarray(inside < CUT_MARGIN_PX)


def hidden_sides(box_xyxy_px: NDArray[Any], camera: Camera) -> BoolArray:
    """Which sides of the boxes of each frame are hidden: not a side of the object itself.

    A side is hidden when the image border cuts it, or when it lies inside the box of a nearer object. Of two objects, the
    nearer one is the one whose bottom edge is lower in the image.

    Args:
        box_xyxy_px: (..., N, 4) mask bounds of all objects in a frame; rows of NaN stand for objects that were not detected.
        camera: the camera that took the images.

    Returns:
        (..., N, 4) bool: left, top, right, bottom.
    """
    box = np.asarray(box_xyxy_px, float)
    x0, y0, x1, y1 = np.moveaxis(box, -1, 0)
    mine, other = np.s_[..., :, None], np.s_[..., None, :]
    with np.errstate(invalid="ignore"):
        width = np.minimum(x1[mine], x1[other]) - np.maximum(x0[mine], x0[other])
        height = np.minimum(y1[mine], y1[other]) - np.maximum(y0[mine], y0[other])
        nearer = y1[other] > y1[mine]
        beside = nearer & (height > TOUCH_PX) & (width > -TOUCH_PX)
        below = nearer & (width > TOUCH_PX) & (height > -TOUCH_PX)
        covers = below & (width > COVERED_SHARE * (x1 - x0)[mine])
        left = beside & (x0[other] <= x0[mine]) & (x0[mine] <= x1[other] + TOUCH_PX)
        right = beside & (x0[other] - TOUCH_PX <= x1[mine]) & (x1[mine] <= x1[other])
        bottom = below & (y0[other] - TOUCH_PX <= y1[mine])
        top = covers & (y0[other] <= y0[mine])
    hidden = np.stack([side.any(-1) for side in (left, top, right, bottom)], -1)
    return np.asarray(hidden | cut_sides(box, camera))

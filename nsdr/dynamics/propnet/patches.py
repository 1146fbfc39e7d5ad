"""The inputs of the paper's dynamics networks: the box of each object, and patches of the image and its mask."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pycocotools import mask as rle

from nsdr.dynamics.motion_states import MotionStates, VideoPixels, extrapolate
from nsdr.dynamics.propnet.patch_model import PATCH_CHANNELS, PatchPropNetConfig, box_scale
from nsdr.errors import DataError
from nsdr.tracking.tracker import rows_of
from nsdr.validation import FloatArray
from nsdr.world.camera import on_ground
from nsdr.world.world import World

FAR = 3.0
"""Limit to which the coordinates of boxes are clamped (units of `box_scale`)."""
MAX_VALUE = 255
"""Value of a cell that the mask covers completely."""


def patch_boxes(
    location_world: FloatArray,
    height_world: ArrayLike,
    box_px: FloatArray,
    reliable: NDArray[np.bool_],
    margin: int,
    world: World,
) -> FloatArray:
    """The boxes that objects would have if nothing hid them.

    The centre of a box is the image of the object's position. Its size is interpolated between the frames in which the object
    was seen reliably.

    Args:
        location_world: (..., F, 2) positions on the ground (world units).
        height_world: (...) heights of the centres, or one number for all (world units).
        box_px: (..., F, 4) centre (column, row), width and height of the boxes, as in `MotionStates`.
        reliable: (..., F) bool, whether each detection is reliable.
        margin: number of frames before the video, into which the motion is continued in a straight line.
        world: the world that the video is of.

    Returns:
        (..., margin + F, 4) boxes in units of `box_scale`.
    """
    position = extrapolate(location_world, margin)[..., : margin + location_world.shape[-2], :]
    pixels = world.camera.pixels(on_ground(position, np.asarray(height_world)[..., None]))
    scale = box_scale(world)
    every, size = np.arange(-margin, box_px.shape[-2]), np.zeros((*pixels.shape[:-1], 2))
    for index in np.ndindex(*reliable.shape[:-1]):
        seen = np.flatnonzero(reliable[index])
        seen = seen if len(seen) else np.arange(box_px.shape[-2])
        for axis in range(2):
            size[(*index, slice(None), axis)] = np.interp(every, seen, box_px[index][seen, 2 + axis])
    scaled = np.concatenate([pixels - np.array(scale[:2]), size], -1) / np.array(scale)
    return np.asarray(np.clip(np.nan_to_num(scaled, nan=FAR), -FAR, FAR))


def boxes_of(states: MotionStates, margin: int) -> FloatArray:
    """The boxes (n, margin + F, 4) of a video, as `patch_boxes` makes them."""
    heights = [states.world.vocabulary.shape(o.shape).height_world for o in states.objects]
    return patch_boxes(states.location_world, np.array(heights), states.box_px, states.reliable, margin, states.world)


def object_patches(pixels: VideoPixels, states: MotionStates, config: PatchPropNetConfig) -> NDArray[np.uint8]:
    """Cut a patch around every object in every frame. It shows the object alone: pixels outside its mask are black.

    In a frame without a reliable detection, an object has its patch of the nearest frame with one.

    Args:
        pixels: images, proposals and tracks of the video.
        states: motion states made from the tracks of `pixels`.
        config: number and size of the cells of a patch.

    Returns:
        (n, F, 4, cells, cells) uint8: red, green, blue, and the share of each cell that the mask covers, scaled to 0-255.

    Raises:
        DataError: the proposals have no masks or lack detections of the tracks, or the video has fewer frames than the tracks.
    """
    proposals, tracks = pixels.proposals, pixels.tracks
    if proposals.masks is None:
        raise DataError("patches of images need proposals with masks; give proposal_N.json files or videos")
    (n, n_frames), camera = states.present.shape, states.camera
    middle = np.array(box_scale(states.world)[:2])
    centre = boxes_of(states, 0)[..., :2] * middle + middle
    rows = [dict(zip(t.frame_index.tolist(), rows_of(t, proposals).tolist(), strict=True)) for t in tracks.tracks]
    whole = np.where(states.reliable.any(1, keepdims=True), states.reliable, states.detected)
    patches = np.zeros((n, n_frames, PATCH_CHANNELS, config.patch_cells, config.patch_cells), np.uint8)
    count = 0
    for f, frame in enumerate(pixels.frames):
        if f >= n_frames:
            break
        count += 1
        for i in np.flatnonzero(whole[:, f]).tolist():
            row = rows[i][f]
            if row < 0:
                known = f"frame {f}: the proposals have no detection of track {i}"
                raise DataError(f"{known}; give the proposals that the tracks were made from")
            mask = rle.decode({"size": [camera.height, camera.width], "counts": proposals.masks[row].encode()})
            patches[i, f] = _patch(frame, mask, centre[i, f], config)
    if count < n_frames:
        raise DataError(
            f"the video has {count} frames, and the tracks have {n_frames}; give the video that they were made from"
        )
    for i in range(n):
        seen = np.flatnonzero(whole[i])
        patches[i] = patches[i, seen[np.abs(seen - np.arange(n_frames)[:, None]).argmin(1)]]
    return patches


def _patch(
    frame: NDArray[np.uint8], mask: NDArray[np.uint8], centre: NDArray[Any], config: PatchPropNetConfig
) -> NDArray[np.uint8]:
    """The patch (4, cells, cells) around a centre (column, row) in the image; 0 outside the image."""
    side, (height, width) = round(config.patch_cells * config.cell_px), mask.shape
    low = np.floor(centre - side / 2).astype(int) - 1
    left, top = np.clip(low, 0, (width - 1, height - 1)).tolist()
    right, bottom = np.clip(low + side + 3, (left + 1, top + 1), (width, height)).tolist()
    around, covered = frame[top:bottom, left:right], mask[top:bottom, left:right, None]
    image = np.concatenate([around * covered, covered * np.uint8(MAX_VALUE)], -1)
    move = np.array([[1.0, 0.0, left + side / 2 - centre[0]], [0.0, 1.0, top + side / 2 - centre[1]]])
    cut = cv2.warpAffine(image, move, (side, side), borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0, 0))
    cells = cv2.resize(cut, (config.patch_cells, config.patch_cells), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(np.asarray(cells, np.uint8).transpose(2, 0, 1))

"""Does the camera stand still, and are there captions, logos or other marks on the image?"""

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.frame_parser.check.ground import COLUMNS, KEPT, ROWS, FloatArray, GroundFit, cells
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

__all__ = ["camera_motion", "marked_px"]

CELL_PX = WIDTH_PX / COLUMNS
"""Width and height of a cell (pixels of a 480x320 image)."""
ROUNDS = 8
"""Rounds of fitting and choosing the cells that fit best, as of `ground.fit_ground`."""
SPACING = 2
"""Every second frame is looked at, which saves time."""
RIDGE = 1e-9
"""Added to squares (levels squared), for frames that are all the same."""
STROKE = np.ones((9, 9), np.uint8)
"""Marks are thinner than this square, objects are not (pixels of 480x320)."""
CONTRAST, TOUCHED = 25.0, 12.0
"""Difference of brightness from the ground of a mark, and of anything that is not ground (levels of 255 at the reference's
contrast)."""
BORDER_PX = 6
"""Objects that leave the image are thin at its border, which is not looked at (pixels)."""


def camera_motion(frames: NDArray[np.uint8]) -> float:
    """How far the image moves from its usual place: median over frames (pixels of 480x320).

    Each frame's difference from the median over time is fitted by a shift and a zoom of the median and a change of its
    exposure, on the cells that fit best. A frame's motion counts as far as it explains the difference: objects and their
    shadows make differences that no motion of the image explains.

    Args:
        frames: (F, height, width, 3) uint8.
    """
    images = np.stack([cells(frame).mean(2) for frame in frames[::SPACING]])
    base = np.median(images, 0)
    down, right = np.gradient(base)
    y, x = np.mgrid[:ROWS, :COLUMNS] - np.array([ROWS - 1, COLUMNS - 1])[:, None, None] / 2
    motion = np.stack([right, down, right * x + down * y], -1).reshape(base.size, -1)
    exposure = np.stack([np.ones_like(base), base], -1).reshape(base.size, -1)
    reach = np.array([1.0, 1.0, float(np.mean(x * x + y * y))])
    distances = []
    for image in images:
        found, explained = _fitted((image - base).ravel(), motion, exposure)
        distances.append(explained * float(np.sqrt(reach @ np.square(found))))
    return CELL_PX * float(np.median(distances))


def _fitted(difference: FloatArray, motion: FloatArray, exposure: FloatArray) -> tuple[FloatArray, float]:
    """How much of each motion (N, 3) is in a difference (N,), and the share that motion explains beyond exposure (N, 2)."""
    both = np.concatenate([motion, exposure], 1)
    ground = np.arange(len(difference))
    found = _least_squares(both, difference)
    for _ in range(ROUNDS):
        ground = np.argsort(np.abs(difference - both @ found))[: int(KEPT * len(difference))]
        found = _least_squares(both[ground], difference[ground])
    left = np.square(difference - both @ found)[ground].sum()
    without = difference[ground] - exposure[ground] @ _least_squares(exposure[ground], difference[ground])
    return found[: motion.shape[1]], max(1 - float(left / (np.square(without).sum() + RIDGE)), 0.0)


def _least_squares(ways: FloatArray, difference: FloatArray) -> FloatArray:
    return np.linalg.solve(ways.T @ ways + RIDGE * np.eye(ways.shape[1]), ways.T @ difference)


def marked_px(image: FloatArray, reference: FloatArray, fit: GroundFit) -> int:
    """Number of pixels, of 480x320, that are parts of thin marks on the ground.

    Args:
        image: (height, width, 3) median frame.
        reference: (32, 48, 3) scene without objects.
        fit: how they compare.
    """
    size = (WIDTH_PX, HEIGHT_PX)
    ground = cv2.resize(reference.mean(2), size, interpolation=cv2.INTER_LINEAR)
    found = cv2.resize(image.mean(2), size, interpolation=cv2.INTER_AREA)
    difference = (found - fit.level) / fit.gain + fit.level - fit.brightness - ground
    objects = cv2.dilate(_thick(np.abs(difference) > TOUCHED).astype(np.uint8), STROKE) > 0
    bright, dark = difference > CONTRAST, difference < -CONTRAST
    marks = (bright & ~_thick(bright) | dark & ~_thick(dark)) & ~objects
    return int(marks[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX].sum())


def _thick(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, STROKE)) > 0

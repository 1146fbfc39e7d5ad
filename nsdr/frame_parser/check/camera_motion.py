"""Does the camera stand still? Measured on the ground's pattern of light, which moves with the camera."""

import numpy as np
from numpy.typing import NDArray

from nsdr.frame_parser.check.ground import COLUMNS, KEPT, ROWS, FloatArray, cells
from nsdr.world.camera import WIDTH_PX

__all__ = ["camera_motion"]

CELL_PX = WIDTH_PX / COLUMNS
"""Width and height of a cell (pixels of a 480x320 image)."""
ROUNDS = 8
"""Rounds of fitting and choosing the cells that fit best, as of `empty_scene.fit_ground`."""
SPACING = 2
"""Every second frame is looked at, which saves time."""
RIDGE = 1e-9
"""Added to squares (levels squared), for frames that are all the same."""


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

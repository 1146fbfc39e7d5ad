"""Captions, logos and other marks on a video's image: thin strokes on the ground, where CLEVRER has only objects."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.frame_parser.check.ground import FloatArray, GroundFit
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

__all__ = ["marked_px"]

STROKE_PX = 9
"""Marks are thinner than this, objects are not (pixels of 480x320)."""
CONTRAST, TOUCHED = 25.0, 12.0
"""Difference of brightness from the ground of a mark, and of anything that is not ground (levels of 255 at the reference's
contrast)."""
BORDER_PX = 6
"""Objects that leave the image are thin at its border, which is not looked at (pixels)."""


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
    objects = cv2.dilate(_thick(np.abs(difference) > TOUCHED), _square()) > 0
    marks = (_thin(difference > CONTRAST) | _thin(difference < -CONTRAST)) & ~objects
    return int(marks[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX].sum())


def _square() -> NDArray[np.uint8]:
    return np.ones((STROKE_PX, STROKE_PX), np.uint8)


def _thick(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _square()))


def _thin(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return mask & (_thick(mask) == 0)

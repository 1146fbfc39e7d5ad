"""Where in a video's frames the image is: bars around a video's image, and images of another shape than the camera's."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.frame_parser.check.ground import CELL_COLUMNS, CELL_ROWS, best_fit, cells, over_channels
from nsdr.io.video import Layout
from nsdr.validation import FloatArray

Box = tuple[int, int, int, int]
"""Left, top, right and bottom (pixels)."""
ASPECT_TOLERANCE = 0.02
"""Images whose aspect differs by less (as a share) have the camera's: bars are found to a pixel or two."""
MAX_DEVIATION = 8.0
"""Pixels of a bar differ by at most this from its colour, in each channel (levels of 255)."""
OUTLIERS = 0.02
"""Share of a bar's pixels that may differ more."""
MIN_BAR_STEP = 12.0
"""Brightness changes by more than this from a bar to the image (levels of 255); the ground of CLEVRER has no such step."""
STEP_QUANTILE = 0.6
"""Quantile of the step along the bar's edge; bars at two sides share corners, where there is no step."""
FLAT = 0.5
"""Pixels of a bar differ by at most this where the image has its colour, and the bar no step (levels of 255): the borders of
CLEVRER's images differ by 5 to 27, and by 2 at half the exposure."""
MIN_FLAT_PX = 4
"""Width of a bar without a step, at least (pixels)."""
EDGE_PX = 2
"""Width of the blurred edge between bar and image (pixels)."""
FINE = 8
"""Parts that a cell is divided into along each axis when a reference is cut."""
MIN_CONTENT = 0.25
"""Share of width and height that the image has at least."""


def content_box(median: NDArray[Any]) -> Box:
    """The part of a video's median frame (height, width, 3) within bars of one colour; all of it if there are none."""
    image = median.astype(np.float32)
    height, width = image.shape[:2]
    left, right = _bar(image), _bar(image[:, ::-1])
    upright = image.transpose(1, 0, 2)
    top, bottom = _bar(upright), _bar(upright[:, ::-1])
    if left + right > (1 - MIN_CONTENT) * width or top + bottom > (1 - MIN_CONTENT) * height:
        return 0, 0, width, height
    return left, top, width - right, height - bottom


def _bar(image: FloatArray) -> int:
    """Width of the bar at the left side (pixels)."""
    color = np.median(image[:, 0], 0)
    deviation = np.quantile(over_channels(np.maximum, np.abs(image - color)), 1 - OUTLIERS, axis=0)
    width = int(np.argmax(deviation > MAX_DEVIATION))
    inside = min(width + EDGE_PX, image.shape[1] - 1)
    step = np.quantile(np.abs(image[:, inside] - color).mean(1), STEP_QUANTILE)
    if step > MIN_BAR_STEP:
        return width
    return int(np.argmax(deviation > MAX_DEVIATION / 2)) if np.argmax(deviation > FLAT) >= MIN_FLAT_PX else 0


def _middle_of(reference: FloatArray, share: float) -> FloatArray:
    """The largest part of a reference (32, 48, 3) around its middle with this share of its aspect, as (32, 48, 3)."""
    columns, rows = CELL_COLUMNS * min(share, 1.0), CELL_ROWS * min(1 / share, 1.0)
    fine = np.repeat(np.repeat(reference, FINE, 0), FINE, 1)
    left, top = round(FINE * (CELL_COLUMNS - columns) / 2), round(FINE * (CELL_ROWS - rows) / 2)
    return cells(fine[top : FINE * CELL_ROWS - top, left : FINE * CELL_COLUMNS - left])


def part_of(images: NDArray[Any], box: Box) -> NDArray[Any]:
    """What is within a box of an image (height, width, 3) or of several (F, height, width, 3)."""
    left, top, right, bottom = box
    return images[..., top:bottom, left:right, :]


def find_layout(
    median: FloatArray, size_px: tuple[int, int], known: Sequence[FloatArray], aspect: float
) -> tuple[Box, Layout, Sequence[FloatArray], list[str]]:
    """Where the image is in the median and in the video, what it is to be compared with, and what is unusual about it.

    Args:
        median: (height, width, 3) median frame of the sample.
        size_px: width and height of the video.
        known: (32, 48, 3) images of the scene without objects.
        aspect: width of the camera's images relative to their height.
    """
    inner = content_box(median)
    image = part_of(median, inner)
    left, top, right, bottom = np.multiply(inner, np.tile(np.divide(size_px, median.shape[1::-1]), 2))
    warned: list[str] = []
    box: Box | None = None
    if image.shape != median.shape:
        x0, y0, x1, y1 = box = round(left), round(top), round(right), round(bottom)
        remains = f"{x1 - x0}x{y1 - y0} of {size_px[0]}x{size_px[1]} px are left"
        warned.append(f"bars around the image are cut off: {remains}")
    found = (right - left) / (bottom - top)
    if abs(found / aspect - 1) < ASPECT_TOLERANCE:
        return inner, Layout(box, stretched=True), known, warned
    middle = [_middle_of(reference, found / aspect) for reference in known]
    shape = f"an image of {found:.2f}:1, not {aspect:.3g}:1"
    if best_fit(image, known)[0].distance <= best_fit(image, middle)[0].distance:
        warned.append(f"{shape}: taken as stretched, and stretched back")
        return inner, Layout(box, stretched=True), known, warned
    warned.append(f"{shape}: taken as the middle of one; what was cut off is not seen")
    return inner, Layout(box), middle, warned

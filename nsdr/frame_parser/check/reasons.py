"""What speaks against a video being one of CLEVRER's scenes, in words."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.frame_parser.check.ground import (
    CELL_COLUMNS,
    CELL_ROWS,
    FloatArray,
    GroundFit,
    cells,
    corrected_levels,
    fit_cells,
)
from nsdr.frame_parser.check.shots import change, small_gray
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX


class Reason(NamedTuple):
    """What speaks against a video.

    Attributes:
        is_certain: whether it certainly is of another scene.
        text: why.
        unfit: whether it spoils the places or the words of objects, so that it cannot be judged.
    """

    is_certain: bool
    text: str
    unfit: bool = False


SPACING_FRAMES = 2
"""Every second frame of a video is looked at, and for the motion of the camera every second of these, which saves time."""
NOISE_SPACING_PX = 3
"""Every third row and column is looked at for noise, which saves time."""

# The following values lie between the kinds of video that `python -m benchmarks.videos check CLIPS` prints with their figures.
MAX_GROUND_DISTANCE, FOREIGN_GROUND_DISTANCE = 0.48, 1.0
"""`GroundFit.distance` up to which the ground is CLEVRER's, and above which it certainly is not."""
MIN_COLOR, FOREIGN_COLOR = 0.75, 0.5
"""`GroundFit.color` down to which colours are CLEVRER's, and below which they certainly are not."""
MAX_TINT = 6.0
"""`GroundFit.tint` up to which white is white (levels of 255)."""
MAX_BRIGHTNESS, FOREIGN_BRIGHTNESS = 15.0, 112.0
"""`GroundFit.brightness` up to which a video is as bright as CLEVRER's, and above which nothing is to be seen."""
MIN_GAIN, MAX_GAIN = 0.8, 1.25
"""`GroundFit.gain` of videos with CLEVRER's contrast."""
MAX_NOISE, FOREIGN_NOISE = 4.0, 18.0
"""Change of an unmoved pixel between sampled frames, up to which it is compression, and above which objects drown (levels)."""
MIN_MOTION = 0.0005
"""Share of pixels that changes at least between some sampled frames, if anything moves."""
MAX_CAMERA_PX, FOREIGN_CAMERA_PX = 0.25, 1.2
"""`camera_motion` up to which the camera stands still, and above which places mean nothing (pixels of 480x320)."""
MAX_MARKED_PX = 200
"""`marked_px` of an image without captions and logos."""
MAX_EDGE_PX = 2.05
"""`edge_width_px` up to which words are read well enough to judge changes of them: 1.4 to 1.7 in CLEVRER's videos, up to 2.0
blurred by a pixel, 2.1 and more at 128x86 or blurred by 2 pixels (`python -m benchmarks.videos judge CLIPS`)."""
SMOOTHING_PX, EDGE_QUANTILE, EDGE_SPACING = 1.5, 0.99, 4
"""Edges are measured after so much smoothing, against blocks and noise (pixels of 480x320), where the image changes most, in
every fourth frame that is looked at."""

CELL_PX = WIDTH_PX / CELL_COLUMNS
"""Width and height of a cell (pixels of a 480x320 image)."""
TINY = 1e-9
"""Added to a divisor (levels squared), for frames that are all the same."""
STROKE = np.ones((9, 9), np.uint8)
"""Marks are thinner than this square, objects are not (pixels of 480x320)."""
CONTRAST, TOUCHED = 25.0, 12.0
"""Difference of brightness from the ground of a mark, and of anything that is not ground (levels of 255 at the reference's
contrast)."""
BEND = np.array([[1, -2, 1]], np.float32)
"""Second derivative along rows."""
IGNORED_BORDER_PX = 6
"""Objects that leave the image are thin at its border, which is not looked at (pixels)."""


def is_foreign(ground: GroundFit) -> bool:
    """Whether the ground certainly is not CLEVRER's."""
    return abs(ground.brightness) > FOREIGN_BRIGHTNESS or ground.distance > FOREIGN_GROUND_DISTANCE


def needed_levels(frames: NDArray[np.uint8], ground: GroundFit) -> NDArray[np.uint8] | None:
    """What each level has to become to have CLEVRER's exposure, (256,); None if they are right."""
    has_other_brightness = abs(ground.brightness) > MAX_BRIGHTNESS
    if is_foreign(ground) or not (has_other_brightness or not MIN_GAIN < ground.gain < MAX_GAIN):
        return None
    return corrected_levels(frames, ground, may_be_right=not has_other_brightness)


def reasons(
    frames: NDArray[np.uint8], image: FloatArray, reference: FloatArray, ground: GroundFit, is_corrected: bool, fps: int
) -> Iterator[Reason]:
    """All that speaks against a video.

    Args:
        frames: (F, height, width, 3) uint8 RGB, every `SPACING_FRAMES`-th of its first seconds, without bars.
        image: (height, width, 3), their median, mirrored back if the video is mirrored.
        reference: (32, 48, 3) scene without objects that it is compared with.
        ground: how they compare.
        is_corrected: whether its exposure is corrected, by `needed_levels`.
        fps: frames per second of the video.
    """
    yield from _of_the_ground(ground, "; corrected" if is_corrected else "")
    if not is_foreign(ground):
        yield from _of_the_colors(ground)
    sparse = frames[:, ::NOISE_SPACING_PX, ::NOISE_SPACING_PX]
    noise = np.median([np.median(cv2.absdiff(a, b)) for a, b in pairwise(sparse)] or [0.0])
    if noise > MAX_NOISE:
        yield Reason(bool(noise > FOREIGN_NOISE), f"it is noisy: still pixels change by {noise:.0f} of 255 levels")
        return
    first, *others = map(small_gray, frames)
    if others and max(change(first, other) for other in others) < MIN_MOTION:
        yield Reason(False, f"nothing moves in the first {len(frames) * SPACING_FRAMES / fps:.1f} s")
    if not is_foreign(ground):
        moved = camera_motion(frames)
        if moved > MAX_CAMERA_PX:
            text = f"the camera moves, by {moved:.1f} pixels of 480x320; it must stand still"
            yield Reason(moved > FOREIGN_CAMERA_PX, text, unfit=True)
        elif marked_px(image, reference, ground) > MAX_MARKED_PX:
            yield Reason(False, "a caption, logo or other marks are on the image; they may be taken for objects")


def _of_the_ground(ground: GroundFit, corrected: str) -> Iterator[Reason]:
    way = "darker" if ground.brightness < 0 else "brighter"
    exposure = f"{way} than CLEVRER's videos by {abs(ground.brightness):.0f} of 255 levels"
    if abs(ground.brightness) > FOREIGN_BRIGHTNESS:
        yield Reason(True, exposure)
        return
    if ground.distance > FOREIGN_GROUND_DISTANCE:
        figure = f"{ground.distance:.1f} levels" if np.isfinite(ground.distance) else "no such pattern"
        yield Reason(True, f"the background is not the empty scene ({figure}; at most {FOREIGN_GROUND_DISTANCE})")
        return
    if ground.distance > MAX_GROUND_DISTANCE:
        why = "cropped, zoomed, tilted, or another camera or other lamps; positions and sizes may be wrong"
        text = f"the background differs from the empty scene ({ground.distance:.1f} levels): {why}"
        yield Reason(False, text, unfit=True)
    if abs(ground.brightness) > MAX_BRIGHTNESS:
        yield Reason(False, exposure + corrected)
    elif not MIN_GAIN < ground.gain < MAX_GAIN:
        why = corrected or ": cropped, or other levels"
        yield Reason(False, f"the background has {ground.gain:.0%} of the contrast of the empty scene{why}")


def _of_the_colors(ground: GroundFit) -> Iterator[Reason]:
    if ground.color < MIN_COLOR:
        meaning = "1 if they are, about 0 in shades of grey, -1 if red and blue are exchanged"
        text = f"the colours of the background are not those of the empty scene (correlation {ground.color:.2f}; {meaning})"
        yield Reason(ground.color < FOREIGN_COLOR, text, unfit=True)
    elif abs(ground.tint) > MAX_TINT:
        yield Reason(False, f"its tint is {'reddish' if ground.tint > 0 else 'bluish'}; colours may be wrong")


def camera_motion(frames: NDArray[np.uint8]) -> float:
    """How far the image moves from its usual place: median over frames (pixels of 480x320).

    Each frame's difference from the median over time is fitted by a shift and a zoom of the median and a change of its
    exposure, on the cells that fit best. The fit is sought from a camera that stands still, and from the motion that explains
    all cells best: from the latter alone, an object that moves may be taken for the ground. A frame's motion counts as far as
    it explains the difference: objects and their shadows make differences that no motion of the image explains.

    Args:
        frames: (F, height, width, 3) uint8.
    """
    images = np.stack([cells(frame).mean(2).astype(float) for frame in frames[::SPACING_FRAMES]])
    base = np.median(images, 0)
    down, right = np.gradient(base)
    y, x = np.mgrid[:CELL_ROWS, :CELL_COLUMNS] - np.array([CELL_ROWS - 1, CELL_COLUMNS - 1])[:, None, None] / 2
    ways = [right, down, right * x + down * y, np.ones_like(base), base]
    motion_and_exposure = np.stack([way.ravel() for way in ways], 1)
    exposure = motion_and_exposure[:, 3:]
    reach = np.array([1.0, 1.0, float(np.mean(x * x + y * y))])
    distances = []
    for difference in (images - base).reshape(len(images), -1):
        starts = np.zeros(len(ways)), np.linalg.lstsq(motion_and_exposure, difference)[0]
        fits = (fit_cells(motion_and_exposure, difference, start) for start in starts)
        left, found, ground = min(
            ((_squares(difference - motion_and_exposure @ found, ground), found, ground) for found, ground in fits),
            key=lambda fit: fit[0],
        )
        without = difference[ground] - exposure[ground] @ np.linalg.lstsq(exposure[ground], difference[ground])[0]
        explained = max(1 - left / (np.square(without).sum() + TINY), 0.0)
        distances.append(explained * np.sqrt(reach @ np.square(found[:3])))
    return CELL_PX * float(np.median(distances))


def _squares(values: FloatArray, ground: NDArray[np.intp]) -> float:
    """Sum of the squares of the cells (N,) that are taken as ground."""
    return float(np.square(values[ground]).sum())


def edge_width_px(frames: NDArray[np.uint8]) -> float:
    """How wide the sharpest edges are: standard deviation of the blur that a step would have (pixels of 480x320).

    The second derivative of a blurred step is at most exp(-1/2) / width times its first one.

    Args:
        frames: (F, height, width, 3) uint8.
    """
    widths = []
    for frame in frames[::EDGE_SPACING]:
        gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
        smooth = cv2.GaussianBlur(
            cv2.resize(gray, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_CUBIC), (0, 0), SMOOTHING_PX
        )
        slope = np.hypot(*(cv2.Sobel(smooth, cv2.CV_32F, dx, 1 - dx, ksize=3) / 8 for dx in (0, 1)))
        bend = np.maximum(*(np.abs(cv2.filter2D(smooth, -1, kernel)) for kernel in (BEND, BEND.T)))
        inner = slice(IGNORED_BORDER_PX, -IGNORED_BORDER_PX)
        most = (np.quantile(image[inner, inner], EDGE_QUANTILE) for image in (slope, bend))
        widths.append(np.exp(-0.5) * next(most) / (next(most) + TINY))
    return float(np.median(widths))


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
    return int(marks[IGNORED_BORDER_PX:-IGNORED_BORDER_PX, IGNORED_BORDER_PX:-IGNORED_BORDER_PX].sum())


def _thick(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, STROKE)) > 0

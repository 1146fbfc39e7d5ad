"""The scene without objects, and how far the ground of a video is from it.

The ground is compared in cells, after a gain and an offset of the brightness, on the cells that fit best: objects, noise and
exposure then matter little, and what is left is the pattern of light that lamps and camera make.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.io.files import check_name
from nsdr.validation import FloatArray

CELL_COLUMNS, CELL_ROWS = 48, 32
"""Number of cells that images are compared in."""
KEPT = 0.6
"""Share of the cells, those that fit best, that are taken as ground. Objects cover at most 30 % of CLEVRER's images."""
ROUNDS = 15
"""Rounds of fitting and choosing cells; they converge in fewer."""
MIN_PATTERN_GAIN = 0.1
"""Least contrast, relative to the reference's, with which there is a pattern to compare."""
MIN_SPREAD = 1e-6
"""Standard deviation of red minus blue of cells below which there is no colour (levels of 255)."""
DARK_QUANTILE, DARKEST = 0.001, 42.0
"""Brightness of CLEVRER's darkest pixels: this quantile over a video's first seconds is 24 to 68 in 14 videos (mean 42)."""
GAMMA = (0.5, 2.5)
"""Least and largest exponent of a power law that is thought of."""


@dataclass(frozen=True)
class GroundFit:
    """How a video's ground compares with a reference.

    Attributes:
        distance: difference of the brightness after gain and offset, root of the mean square over cells taken as ground
            (levels of 255 at the reference's contrast); infinite where there is no pattern. Of darker videos it is less by
            their exposure: encoders keep less of dark patterns.
        gain: contrast relative to the reference's.
        level: mean brightness of the ground (levels of 255).
        brightness: mean brightness of the ground minus the reference's (levels of 255).
        color: correlation of red minus blue with the reference's over the ground; 1 for the same colours, -1 where red and
            blue are exchanged, 0 without colour.
        tint: mean of red minus blue of the ground minus the reference's (levels of 255).
    """

    distance: float
    gain: float
    level: float
    brightness: float
    color: float
    tint: float


def cells(image: NDArray[Any]) -> FloatArray:
    """An image (height, width, 3) as (32, 48, 3) means."""
    return np.asarray(cv2.resize(image.astype(np.float32), (CELL_COLUMNS, CELL_ROWS), interpolation=cv2.INTER_AREA))


def over_channels(pick: np.ufunc, images: NDArray[Any]) -> NDArray[Any]:
    """`pick`, such as `np.maximum`, over the three channels of images.

    NumPy's `max(-1)` takes ten times as long.

    Args:
        pick: a function of two arrays.
        images: (F, H, W, 3) or another array whose last axis has the channels.

    Returns:
        (F, H, W), or the same without the last axis.
    """
    return np.asarray(pick(pick(images[..., 0], images[..., 1]), images[..., 2]))


def fit_cells(ways: FloatArray, values: FloatArray, start: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """How much (K,) of each of K ways (N, K) is in the values (N,) of cells, and the cells that are taken as ground.

    Fits and choices of the cells that fit best take turns, from the fit `start` (K,) on.
    """
    found, ground = start, np.zeros(0, np.intp)
    for _ in range(ROUNDS):
        before, ground = ground, np.argsort(np.abs(values - ways @ found))[: int(KEPT * len(values))]
        if np.array_equal(before, ground):
            break
        found = np.linalg.lstsq(ways[ground], values[ground])[0]
    return found, ground


def fit_ground(image: NDArray[Any], reference: FloatArray) -> GroundFit:
    """Compare an image (height, width, 3) with a reference (32, 48, 3), both RGB of 0-255."""
    found = cells(image)
    x, y = (of.mean(2).ravel().astype(float) for of in (reference, found))
    ways = np.stack([x - x.mean(), np.ones_like(x)], 1)
    fit, ground = fit_cells(ways, y, np.array([1.0, x.mean() + np.median(y - x)]))
    gain, rms = float(fit[0]), float(np.sqrt(np.square(y - ways @ fit)[ground].mean()))
    warm, expected = ((of[..., 0] - of[..., 2]).ravel()[ground] for of in (found, reference))  # red minus blue
    exposure = min(float(y[ground].mean() / x[ground].mean()), 1.0)
    is_colored = min(warm.std(), expected.std()) > MIN_SPREAD
    return GroundFit(
        distance=rms * exposure / gain if gain > MIN_PATTERN_GAIN else float("inf"),
        gain=gain,
        level=float(y[ground].mean()),
        brightness=float(np.mean(y[ground] - x[ground])),
        color=float(np.corrcoef(warm, expected)[0, 1]) if is_colored else 0.0,
        tint=float(np.mean(warm - expected)),
    )


def corrected_levels(frames: NDArray[np.uint8], fit: GroundFit, may_be_right: bool) -> NDArray[np.uint8] | None:
    """What each level of 0-255 has to become, (256,) uint8; None if the levels are right.

    The ground tells mean and slope of how levels were changed. A line and a power law agree with both; the darkest pixels,
    which every scene's shadows have, tell which of them it was.

    Args:
        frames: (F, height, width, 3) uint8.
        fit: of their ground.
        may_be_right: whether they may be right as they are: cropped videos have another contrast, but the same levels.
    """
    levels = np.arange(256, dtype=np.float64)
    before = fit.level - fit.brightness
    tables = [before + (levels - fit.level) / fit.gain]
    gamma = fit.gain * before / fit.level
    if GAMMA[0] <= gamma <= GAMMA[1]:
        tables.append(before * (levels / fit.level) ** (1 / gamma))
    if may_be_right:
        tables.append(levels)
    darkest = float(np.quantile(frames.mean(3), DARK_QUANTILE))
    best = min(tables, key=lambda table: abs(float(np.interp(darkest, levels, table)) - DARKEST))
    return None if best is levels else np.clip(np.round(best), 0, 255).astype(np.uint8)


def best_fit(image: FloatArray, expected: Sequence[FloatArray]) -> tuple[GroundFit, FloatArray]:
    """The fit of an image (H, W, 3) to the reference (32, 48, 3) that fits it best, and this reference."""
    return min(((fit_ground(image, reference), reference) for reference in expected), key=lambda f: f[0].distance)


@lru_cache(maxsize=1)
def references() -> dict[str, FloatArray]:
    """(32, 48, 3) images of CLEVRER's scene without objects, by renderer: "clevrer" and "preview".

    `python -m benchmarks.videos references CLIPS` made them: the median over time and over clips rendered by us with
    Blender (500000-500005), and an image of the preview renderer.
    """
    with (resources.files("nsdr.frame_parser.check") / "empty_scenes.npz").open("rb") as file, np.load(file) as stored:
        return {name: stored[name].astype(np.float32) for name in stored.files}


def read_background(path: str | Path) -> FloatArray:
    """An image file of another camera's empty scene, as a reference (32, 48, 3).

    Raises:
        DataError: no such file, or not an image.
    """
    check_name(path)
    if not Path(path).is_file():
        raise DataError(f"{path}: no such file; expected an image of the scene without objects")
    image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise DataError(f"{path}: not an image that OpenCV can read; expected the scene without objects")
    return cells(image)

"""Undoing another exposure, contrast or gamma, so that the networks see the levels that they were trained on."""

import numpy as np
from numpy.typing import NDArray

from nsdr.frame_parser.check.ground import GroundFit

__all__ = ["corrected_levels"]

DARK_QUANTILE, DARKEST = 0.001, 42.0
"""Brightness of CLEVRER's darkest pixels: this quantile over a video's first seconds is 24 to 68 in 14 videos (mean 42)."""
GAMMA = (0.5, 2.5)
"""Least and largest exponent of a power law that is thought of."""


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

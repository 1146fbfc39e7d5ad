"""Confidence intervals of accuracies."""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray

__all__ = ["accuracy_interval", "difference_interval", "wilson_interval"]

Z_95 = 1.959964
"""Standard normal quantile of a two-sided 95 % interval."""
RESAMPLES = 2000
"""Number of bootstrap samples, drawn with a fixed seed."""


def wilson_interval(accuracy: float, n: int, z: float = Z_95) -> tuple[float, float]:
    """Wilson's score interval (low, high) of a proportion.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 1927.

    Args:
        accuracy: measured proportion, 0-1.
        n: number of independent trials.
        z: standard normal quantile.
    """
    if n == 0:
        return 0.0, 1.0
    centre = (accuracy + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * sqrt(accuracy * (1 - accuracy) / n + z * z / (4 * n * n))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def accuracy_interval(correct: Sequence[bool], scenes: Sequence[int]) -> tuple[float, float]:
    """95 % interval (low, high) of the share that is correct: the wider of Wilson's and a bootstrap over scenes.

    Answers about one video are not independent: one missed collision makes several of them wrong. The bootstrap draws whole
    videos; Wilson's interval holds where all or nearly all are right.

    Args:
        correct: of each answer.
        scenes: index of each answer's scene.
    """
    if not correct:
        return 0.0, 1.0
    low, high = _bootstrap(np.asarray(correct, float), scenes)
    least, most = wilson_interval(sum(map(bool, correct)) / len(correct), len(correct))
    return min(low, least), max(high, most)


def difference_interval(first: Sequence[bool], second: Sequence[bool], scenes: Sequence[int]) -> tuple[float, float]:
    """95 % interval (low, high) of the second system's accuracy minus the first one's on the same questions.

    The wider of a bootstrap over scenes, which keeps both answers to a question together, and of Agresti and Min's interval of
    independent questions, which holds for few scenes and few differences. Where both are right on the same questions, it
    reaches as far as Wilson's interval of no difference in as many questions.

    Source: A. Agresti and Y. Min, "Simple improved confidence intervals for comparing matched proportions", Statistics in
    Medicine 2005: Wald's interval after half a question is added to each of the four outcomes.

    Args:
        first: whether the first system is right, for each question.
        second: the same for the second system.
        scenes: index of each question's scene.
    """
    difference = np.asarray(second, float) - np.asarray(first, float)
    if not difference.any():
        reach = wilson_interval(0.0, len(difference))[1]
        return -reach, reach
    low, high = _bootstrap(difference, scenes)
    n = len(difference) + 2
    centre = float(difference.sum()) / n
    half = Z_95 * sqrt(((difference != 0).sum() + 1) / n - centre**2) / sqrt(n)
    return max(min(low, centre - half), -1.0), min(max(high, centre + half), 1.0)


def _bootstrap(values: NDArray[np.float64], scenes: Sequence[int]) -> tuple[float, float]:
    """95 % interval (low, high) of the mean, by drawing whole scenes."""
    index = np.unique(np.asarray(scenes), return_inverse=True)[1]
    n = np.bincount(index).astype(float)
    total = np.bincount(index, values)
    drawn = np.random.default_rng(0).multinomial(len(n), np.full(len(n), 1 / len(n)), RESAMPLES)
    low, high = np.quantile((drawn @ total) / (drawn @ n), [0.025, 0.975])
    return float(low), float(high)

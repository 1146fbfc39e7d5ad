"""Confidence intervals of accuracies."""

from math import sqrt

__all__ = ["wilson_interval"]

Z_95 = 1.959964
"""Standard normal quantile of a two-sided 95 % interval."""


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

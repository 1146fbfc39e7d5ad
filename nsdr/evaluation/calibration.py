"""How well probabilities fit the truth: of statements given p, a share p should be true."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nsdr.clevrer.files.questions import QUESTION_TYPES

__all__ = ["BINS", "calibration", "calibration_text"]

BINS = 15
"""Bins of equal width of the expected calibration error (Guo et al., On Calibration of Modern Neural Networks, ICML 2017)."""


def calibration(probability: Sequence[float], true: Sequence[bool]) -> dict[str, Any]:
    """Calibration of statements.

    Args:
        probability: of each statement, in 0-1; at least one.
        true: whether it is true.

    Returns:
        `ece`, the expected calibration error: the distance of mean probability and share that is true, averaged over all
        statements of `BINS` bins; `brier`, the Brier score; `n`, the number of statements; `bins`, for each that is not
        empty the mean probability, the share that is true, and the number.
    """
    p, y = np.array(probability, float), np.array(true, float)
    bin_of = np.minimum((p * BINS).astype(int), BINS - 1)
    n = np.bincount(bin_of, minlength=BINS)
    used = n > 0
    mean, share = (np.bincount(bin_of, v, BINS)[used] / n[used] for v in (p, y))
    bins = list(zip(mean.tolist(), share.tolist(), n[used].tolist(), strict=True))
    ece = float(np.sum(n[used] * np.abs(mean - share)) / len(p))
    return {"ece": ece, "brier": float(np.mean((p - y) ** 2)), "n": len(p), "bins": [list(row) for row in bins]}


def calibration_text(table: Mapping[str, Any]) -> str:
    """Error and Brier score of each question type of a table that has them: "descriptive 0.4 % (0.008), …"."""
    found = ((kind, table[kind]["calibration"]) for kind in QUESTION_TYPES if "calibration" in table[kind])
    return ", ".join(f"{kind} {100 * c['ece']:.1f} % ({c['brier']:.3f})" for kind, c in found)

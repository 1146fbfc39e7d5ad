"""Numbers about sets of answers: intervals, calibration, and the difference of two systems."""

from collections.abc import Mapping, Sequence
from math import sqrt
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES
from nsdr.errors import DataError

Z_95 = 1.959964
"""Standard normal quantile of a two-sided 95 % interval."""
RESAMPLES = 2000
"""Number of bootstrap samples, drawn with a fixed seed."""


def wilson_interval(accuracy: float, n: int) -> tuple[float, float]:
    """Wilson's 95 % score interval (low, high) of a proportion 0-1 in `n` independent trials.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 1927.
    """
    if n == 0:
        return 0.0, 1.0
    z = Z_95
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
    low, high = mean_interval(np.asarray(correct, float), scenes)
    least, most = wilson_interval(sum(map(bool, correct)) / len(correct), len(correct))
    return min(low, least), max(high, most)


def difference_interval(first: Sequence[bool], second: Sequence[bool], scenes: Sequence[int]) -> tuple[float, float]:
    """95 % interval (low, high) of the second system's accuracy minus the first one's on the same questions.

    The wider of a bootstrap over scenes, which keeps both answers to a question together, and of Agresti and Min's interval of
    independent questions, which holds for few scenes and few differences ("Simple improved confidence intervals for comparing
    matched proportions", Statistics in Medicine 2005: Wald's interval after half a question is added to each of the four
    outcomes). Where both are right on the same questions, it reaches as far as Wilson's of no difference in as many.

    Args:
        first, second: whether each system is right, for each question.
        scenes: index of each question's scene.
    """
    difference = np.asarray(second, float) - np.asarray(first, float)
    if not difference.any():
        reach = wilson_interval(0.0, len(difference))[1]
        return -reach, reach
    low, high = mean_interval(difference, scenes)
    n = len(difference) + 2
    centre = float(difference.sum()) / n
    half = Z_95 * sqrt(((difference != 0).sum() + 1) / n - centre**2) / sqrt(n)
    return max(min(low, centre - half), -1.0), min(max(high, centre + half), 1.0)


def mean_interval(values: NDArray[np.float64], scenes: Sequence[int]) -> tuple[float, float]:
    """95 % interval (low, high) of the mean of values, by a bootstrap that draws whole scenes.

    Args:
        values: (n,) float.
        scenes: index of each value's scene.
    """
    index = np.unique(np.asarray(scenes), return_inverse=True)[1]
    return ratio_interval(np.bincount(index, values).astype(float), np.bincount(index).astype(float))


def ratio_interval(above: NDArray[np.float64], below: NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval (low, high) of the ratio of two sums over scenes, by a bootstrap that draws scenes.

    Args:
        above, below: (scenes,) what each scene adds to both sums; some of `below` are positive, none negative.
    """
    drawn = np.random.default_rng(0).multinomial(len(below), np.full(len(below), 1 / len(below)), RESAMPLES)
    total = drawn @ below
    low, high = np.quantile((drawn @ above)[total > 0] / total[total > 0], [0.025, 0.975])
    return float(low), float(high)


BINS = 15
"""Bins of equal width of the expected calibration error (Guo et al., On Calibration of Modern Neural Networks, ICML 2017)."""
SURE = 0.99
"""Statements with this probability or more, or with 1 minus this or less, count as sure."""


def calibration(probability: Sequence[float], true: Sequence[bool]) -> dict[str, Any]:
    """Calibration of statements.

    Args:
        probability: of each statement, in 0-1; at least one.
        true: whether it is true.

    Returns:
        `ece`, the expected calibration error: the distance of mean probability and share that is true, averaged over all
        statements of `BINS` bins; `brier`, the Brier score; `n`, the number of statements; `bins`, for each that is not
        empty the mean probability, the share that is true, and the number; `sure`, the number of sure statements (`SURE`),
        and `sure_wrong`, of those among them whose opposite is true.
    """
    p, y = np.array(probability, float), np.array(true, float)
    bin_of = np.minimum((p * BINS).astype(int), BINS - 1)
    n = np.bincount(bin_of, minlength=BINS)
    used = n > 0
    mean, share = (np.bincount(bin_of, v, BINS)[used] / n[used] for v in (p, y))
    bins = list(zip(mean.tolist(), share.tolist(), n[used].tolist(), strict=True))
    ece = float(np.sum(n[used] * np.abs(mean - share)) / len(p))
    error, sure = np.abs(p - y), (p >= SURE) | (p <= 1 - SURE)
    return {
        "ece": ece,
        "brier": float(np.mean(error**2)),
        "n": len(p),
        "bins": [list(row) for row in bins],
        "sure": int(sure.sum()),
        "sure_wrong": int((error >= SURE).sum()),
    }


def calibration_text(table: Mapping[str, Any]) -> str:
    """Error and Brier score of each question type of a table that has them: "descriptive 0.4 % (0.008), …"."""
    found = ((kind, table[kind]["calibration"]) for kind in QUESTION_TYPES if "calibration" in table[kind])
    return ", ".join(f"{kind} {100 * c['ece']:.1f} % ({c['brier']:.3f})" for kind, c in found)


Row = Mapping[str, Any]


def percent(row: Row, name: str, interval: str = "") -> str:
    """A share (0-1) of a row in %, "-" for None; and its interval in the form `interval`, where that is measured."""
    if row[name] is None:
        return "-"
    limits = row.get("interval" if name == "accuracy" else f"{name}_interval") if interval else None
    return f"{100 * row[name]:.1f}" + (interval.format(*(100 * v for v in limits)) if limits else "")


Pair = tuple[int, bool, bool]
"""Scene index; whether the first and the second system are right."""


def compare_results(first: Sequence[Row], second: Sequence[Row]) -> dict[str, Any]:
    """The difference of two systems by question type: the second one's accuracy minus the first one's.

    Args:
        first: results of a report (`nsdr.evaluation.Report`), on any questions.
        second: the other system's; only questions that are scored in both are compared.

    Returns:
        By type `per_question`, of multiple choice also `per_option`, and of tagged options each of `OPTION_TAGS`:
        `difference` (fraction), its 95 % `interval` as in `difference_interval`, the number `n`, and in how many `only_first`
        and `only_second` is right.

    Raises:
        DataError: they have no scored question in common.
    """
    key = itemgetter("scene_index", "question_id")
    others = {key(r): r for r in second}
    both = [(r, others[key(r)]) for r in first if key(r) in others]
    if not both:
        raise DataError("the two files have no scored question in common; are they of the same split?")
    result: dict[str, Any] = {}
    for kind in QUESTION_TYPES:
        rows = [(a, b) for a, b in both if a["question_type"] == kind]
        result[kind] = {"per_question": _difference([(a["scene_index"], a["correct"], b["correct"]) for a, b in rows])}
        if kind == QUESTION_TYPES[0]:
            continue
        options = [
            (c.get("tag"), (a["scene_index"], c["correct"], d["correct"]))
            for a, b in rows
            for c, d in zip(a["choices"], b["choices"], strict=True)
        ]
        result[kind]["per_option"] = _difference([pair for _, pair in options])
        if any(tag for tag, _ in options):
            result[kind] |= {tag: _difference([pair for t, pair in options if t == tag]) for tag in OPTION_TAGS}
    return result


def format_comparison(comparison: Mapping[str, Any], first: str, second: str) -> str:
    """The differences of `compare_results` as a table in percentage points; with the names of both systems."""
    title = f"{second} minus {first}, in percentage points, with 95 % intervals:"
    header = f"{'':<28}{'difference':>24}{'only first':>12}{'only second':>13}{'of':>8}"
    lines = [title, header]
    for kind, parts in comparison.items():
        for name, part in parts.items():
            if not part["n"]:
                continue
            low, high = part["interval"]
            cell = f"{100 * part['difference']:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"
            label = f"{kind}, {name.replace('_', ' ')}" if name.startswith("per_") else f"  {name}"
            lines.append(f"{label:<28}{cell:>24}{part['only_first']:>12}{part['only_second']:>13}{part['n']:>8}")
    lines.append("only first, only second: answers that only one of the two has right")
    return "\n".join(lines)


def _difference(pairs: Sequence[Pair]) -> dict[str, Any]:
    if not pairs:
        return {"difference": None, "n": 0}
    scenes, first, second = zip(*pairs, strict=True)
    return {
        "difference": (sum(second) - sum(first)) / len(pairs),
        "interval": difference_interval(first, second, scenes),
        "only_first": sum(a and not b for a, b in zip(first, second, strict=True)),
        "only_second": sum(b and not a for a, b in zip(first, second, strict=True)),
        "n": len(pairs),
    }

"""Compares two systems on the same questions."""

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES
from nsdr.errors import DataError
from nsdr.evaluation.measures import difference_interval

__all__ = ["compare_reports", "format_comparison"]

Pair = tuple[int, bool, bool]
"""Scene index; whether the first and the second system are right."""


def compare_reports(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """The difference of two systems by question type: the second one's accuracy minus the first one's.

    Args:
        first: report of `nsdr.evaluation.score`, on any questions.
        second: the other system's; only questions that both reports score are compared.

    Returns:
        By type `per_question`, of multiple choice also `per_option`, and of tagged options each of `OPTION_TAGS`:
        `difference` (fraction), its 95 % `interval` as of `difference_interval`, the number `n`, and in how many `only_first`
        and `only_second` is right.

    Raises:
        DataError: they have no scored question in common.
    """
    key = itemgetter("scene_index", "question_id")
    others = {key(r): r for r in second["results"]}
    both = [(r, others[key(r)]) for r in first["results"] if key(r) in others]
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
    """The differences of `compare_reports` as a table in percentage points; with the names of both systems."""
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

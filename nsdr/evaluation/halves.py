"""Halves of a question set: counterfactual options by their tags, and all answers by whether the texts alone predict them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES, Question

__all__ = ["BLIND_HALVES", "blind_text", "by_halves", "tags_of"]

BLIND_HALVES = {"text alone right": True, "text alone wrong": False}
"""Names of the halves by `Question.blind` and `Choice.blind`."""
Row = Mapping[str, Any]


def tags_of(question: Question) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What the question file says of the question, and of each of its options: `tag` and `blind`, where they are known."""
    choices = [_known(tag=c.tag, blind=c.blind) for c in question.choices]
    return _known(blind=question.blind), choices


def _known(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def by_halves(rows: Sequence[Row], accuracy: Callable[[Sequence[Row]], Row]) -> dict[str, dict[str, Row]]:
    """Accuracies by `tags` (of `OPTION_TAGS`) and by `blind` (of `BLIND_HALVES`); without those that no row has.

    Args:
        rows: answers or options.
        accuracy: of some of them.
    """
    halves = {}
    if any("tag" in row for row in rows):
        halves["tags"] = {tag: accuracy([r for r in rows if r.get("tag") == tag]) for tag in OPTION_TAGS}
    if any("blind" in row for row in rows):
        named = BLIND_HALVES.items()
        halves["blind"] = {name: accuracy([r for r in rows if r.get("blind") == value]) for name, value in named}
    return halves


def blind_text(table: Mapping[str, Any]) -> str:
    """Accuracies where the text alone is right / wrong, of each question type that has them: "predictive 99.0 / 97.5 %, …"."""
    parts = []
    for kind in QUESTION_TYPES:
        if halves := table[kind].get("blind"):
            name = "accuracy" if kind == "descriptive" else "per_option"
            shares = [halves[half][name] for half in BLIND_HALVES]
            parts.append(f"{kind} {' / '.join('-' if s is None else f'{100 * s:.1f}' for s in shares)} %")
    return ", ".join(parts)

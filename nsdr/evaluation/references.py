"""What systems that see nothing reach on a question set, for comparison."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from nsdr.baselines.q_type import ANSWERS, q_type_answers
from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.evaluation.score import score_answers
from nsdr.types import Answer, ChoiceAnswer

__all__ = ["constant_answers", "format_references", "reference_rows"]

CONSTANT = {"always-yes": ("yes", "correct"), "always-no": ("no", "wrong")}
"""The answer to every open question and to every option."""
HALF = 0.5
"""Chance of a random judgement of an option."""
COLUMN = 15
"""Width of a column of the printed table (characters)."""


def constant_answers(scenes: Sequence[SceneQuestions], name: str) -> Iterator[tuple[SceneQuestions, dict[int, Answer]]]:
    """Each scene's questions with the answers of "always-yes" or "always-no" by question id."""
    word, judgement = CONSTANT[name]
    for scene in scenes:
        yield scene, {q.id: _constant(q, word, judgement) for q in scene.questions}


def reference_rows(scenes: Sequence[SceneQuestions]) -> dict[str, dict[str, Any]]:
    """By system that sees nothing its accuracies (0-1) by question type.

    The systems are "always-yes" and "always-no"; "frequent", which gives the most frequent answer of these same questions to
    each type (and so is an upper bound of what the types alone tell); and "random", whose expectation is given. The latter
    two are left out where open questions have no CLEVRER subtypes.

    Args:
        scenes: questions with answers.
    """
    reports = {name: score_answers(constant_answers(scenes, name)) for name in CONSTANT}
    with suppress(DataError):
        reports["frequent"] = score_answers(q_type_answers(scenes, "frequent"))
    rows: dict[str, dict[str, Any]] = {
        name: {kind: report[kind] for kind in QUESTION_TYPES} for name, report in reports.items()
    }
    return {**rows, "random": _random(scenes)} if "frequent" in rows else rows


def format_references(rows: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Lines of a table: percentages, of multiple choice per option / per question; of tagged options per option."""
    lines = ["systems that see nothing, on the same questions (per option / per question):"]
    header = [*QUESTION_TYPES, *(OPTION_TAGS if any("tags" in row["counterfactual"] for row in rows.values()) else ())]
    lines.append(f"  {'':<11}" + "".join(f"{name:>{COLUMN}}" for name in header))
    for name, row in rows.items():
        cells = [_share(row["descriptive"]["accuracy"])]
        cells += [f"{_share(row[k]['per_option'])} / {_share(row[k]['per_question'])}" for k in QUESTION_TYPES[1:]]
        tags = row["counterfactual"].get("tags", {})
        cells += [_share(tags[tag]["per_option"]) for tag in OPTION_TAGS if tag in tags]
        lines.append(f"  {name:<11}" + "".join(f"{cell:>{COLUMN}}" for cell in cells))
    return lines


def _constant(question: Question, word: str, judgement: str) -> Answer:
    judged = tuple(ChoiceAnswer(c.text, judgement, (), ()) for c in question.choices)
    return Answer(question.text, (), None if judged else word, choices=judged)


def _random(scenes: Sequence[SceneQuestions]) -> dict[str, Any]:
    """Expected accuracies of uniform answers: to the subtype of an open question, and of right or wrong for each option."""
    questions = [q for scene in scenes for q in scene.questions]
    opens = [1 / len(ANSWERS[q.subtype]) for q in questions if q.subtype in ANSWERS and not q.choices]
    row: dict[str, Any] = {"descriptive": {"accuracy": _mean(opens)}}
    for kind in QUESTION_TYPES[1:]:
        sizes = [len(q.choices) for q in questions if q.type == kind]
        row[kind] = {"per_option": HALF if sizes else None, "per_question": _mean([HALF**n for n in sizes])}
    tags = {c.tag for q in questions for c in q.choices if c.tag is not None}
    if tags:
        row["counterfactual"]["tags"] = {tag: {"per_option": HALF if tag in tags else None} for tag in OPTION_TAGS}
    return row


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f}"

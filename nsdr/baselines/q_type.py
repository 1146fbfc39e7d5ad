"""The paper's Q-type baselines, which answer from the question's type alone and so measure the bias of a question set."""

import random
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

from nsdr.clevrer.questions import QUESTION_TYPES, Question, SceneQuestions

__all__ = ["PUBLISHED_Q_TYPE", "q_type_baselines"]

PUBLISHED_Q_TYPE = {
    "random": {
        "descriptive": 29.2,
        "explanatory": (50.1, 8.1),
        "predictive": (50.7, 25.5),
        "counterfactual": (50.1, 10.3),
    },
    "frequent": {
        "descriptive": 33.0,
        "explanatory": (50.2, 16.5),
        "predictive": (50.0, 0.0),
        "counterfactual": (50.2, 1.0),
    },
}
"""Accuracies on the test split (%) from the paper's table of baselines; multiple choice as (per option, per question)."""


def q_type_baselines(
    scenes: Sequence[SceneQuestions], seed: int = 0, training: Sequence[SceneQuestions] | None = None
) -> dict[str, dict[str, Any]]:
    """Accuracies (0-1) of "random" and "frequent" answers, as {baseline: {type: accuracy or (per option, per question)}}.

    "random" draws an answer with its frequency among the answers to the question's subtype, or to the options of its type.
    "frequent" gives the most frequent answer.

    Args:
        scenes: questions with answers.
        seed: seed of the random answers.
        training: questions on which the frequencies are counted; None uses `scenes`.
    """
    answers: dict[str, Counter[str]] = defaultdict(Counter)
    for question in _questions(training if training is not None else scenes):
        answers[_key(question)].update(_answers(question))
    rng = random.Random(seed)
    result: dict[str, dict[str, Any]] = {}
    for baseline in ("random", "frequent"):
        correct: dict[str, list[list[bool]]] = {kind: [] for kind in QUESTION_TYPES}
        for question in _questions(scenes):
            counts = answers[_key(question)]
            guesses = [_guess(counts, baseline, rng) for _ in _answers(question)]
            correct[question.type].append([g == a for g, a in zip(guesses, _answers(question), strict=True)])
        result[baseline] = {kind: _accuracy(kind, rows) for kind, rows in correct.items() if rows}
    return result


def _questions(scenes: Sequence[SceneQuestions]) -> list[Question]:
    return [q for scene in scenes for q in scene.questions]


def _key(question: Question) -> str:
    return question.subtype or question.type


def _answers(question: Question) -> list[str]:
    return [str(c.answer) for c in question.choices] or [str(question.answer)]


def _guess(counts: Counter[str], baseline: str, rng: random.Random) -> str:
    if not counts:
        return ""
    if baseline == "random":
        return rng.choices(list(counts), list(counts.values()))[0]
    return max(sorted(counts), key=lambda answer: counts[answer])


def _accuracy(kind: str, rows: list[list[bool]]) -> Any:
    options = [correct for row in rows for correct in row]
    per_option = sum(options) / len(options)
    return per_option if kind == "descriptive" else (per_option, sum(map(all, rows)) / len(rows))

"""The paper's Q-type baselines, which know only the type of a question, and so measure the bias of a question set."""

import random
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

from nsdr.clevrer.files.questions import PLAIN, QUESTION_TYPES, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.types import Answer, ChoiceAnswer
from nsdr.types.answers import answer_from_word
from nsdr.validation import expect
from nsdr.world.vocabulary import NAMES
from nsdr.world.world import CLEVRER_WORLD, World

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
"""Accuracies on the test split (%) from the paper's Table 2; multiple choice as (per option, per question)."""
SUBTYPES = ("count", "exist", *(f"query_{name}" for name in NAMES))
"""Subtypes of CLEVRER's descriptive questions."""
OPTION_ANSWERS = ("correct", "wrong")
"""Answers to an option of a multiple-choice question."""


def subtype_answers(world: World) -> dict[str, tuple[str, ...]]:
    """A world's answers to each descriptive subtype; counts end below its largest number of objects.

    With the release's numbers of questions, uniform answers would be right in 29.0 % of CLEVRER's descriptive questions; the
    paper reports 29.2 %.
    """
    answers = (tuple(map(str, range(world.layout.most_objects))), ("yes", "no"), *world.vocabulary.words.values())
    return dict(zip(SUBTYPES, answers, strict=True))


def q_type_answers(
    scenes: Sequence[SceneQuestions],
    name: str,
    seed: int = 0,
    training: Sequence[SceneQuestions] | None = None,
    world: World = CLEVRER_WORLD,
) -> Iterator[tuple[SceneQuestions, dict[int, Answer]]]:
    """Each scene's questions with a baseline's answers by question id, as `nsdr.evaluation.score.score_answers` takes them.

    "random" draws uniformly from the answers to the question's subtype (`subtype_answers`), or "correct" or "wrong" for each
    option.
    "frequent" gives the most frequent answer in the training set to questions of the subtype, or to options of the type; of
    equally frequent answers, the first in the alphabet.

    Args:
        scenes: questions with answers.
        name: "random" or "frequent".
        seed: seed of the random answers.
        training: the training set, with answers; its plain questions do not count. None counts the answers in `scenes`
            themselves, which is not the paper's baseline.
        world: that the questions are about.

    Raises:
        DataError: another name, a question without its answer, an unknown subtype, or a type or subtype that the training set
            lacks.
    """
    expect(name in PUBLISHED_Q_TYPE, "name", f"one of {', '.join(PUBLISHED_Q_TYPE)}", name)
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for question in (q for scene in (scenes if training is None else training) for q in scene.questions):
        if question.subtype != PLAIN:
            counts[_key(question)].update(_answers(question))
    rng, answers = random.Random(seed), subtype_answers(world)
    for scene in scenes:
        given = {}
        for question in scene.questions:
            key, n = _key(question), len(_answers(question))
            if key not in counts:
                raise DataError(
                    f"the training questions have no {key!r}, which is to be answered; give a complete training set"
                )
            possible = OPTION_ANSWERS if question.choices else answers[key]
            frequent = min(counts[key], key=lambda answer: (-counts[key][answer], answer))
            words = [rng.choice(possible) if name == "random" else frequent for _ in range(n)]
            judged = [
                ChoiceAnswer(c.text, w, c.program or (), ()) for c, w in zip(question.choices, words, strict=False)
            ]
            program = question.program or ()
            given[question.id] = (
                Answer.of_choices(question.text, program, judged)
                if judged
                else Answer(question.text, program, answer_from_word(words[0]))
            )
        yield scene, given


def q_type_baselines(
    scenes: Sequence[SceneQuestions],
    seed: int = 0,
    training: Sequence[SceneQuestions] | None = None,
    world: World = CLEVRER_WORLD,
) -> dict[str, dict[str, Any]]:
    """Accuracies (0-1) of both baselines, as {baseline: {type: accuracy or (per option, per question)}}.

    Arguments and errors are those of `q_type_answers`.
    """
    found: dict[str, dict[str, Any]] = {}
    for name in PUBLISHED_Q_TYPE:
        right: dict[str, list[list[bool]]] = defaultdict(list)
        for scene, given in q_type_answers(scenes, name, seed, training, world):
            for question in scene.questions:
                words = [c.answer for c in given[question.id].choices] or [given[question.id].text]
                right[question.type].append([a == b for a, b in zip(words, _answers(question), strict=True)])
        found[name] = {kind: _accuracy(kind, right[kind]) for kind in QUESTION_TYPES if kind in right}
    return found


def _key(question: Question) -> str:
    if question.choices:
        return question.type
    if question.subtype not in SUBTYPES:
        raise DataError(f"{question.text!r} has the subtype {question.subtype}; expected one of {', '.join(SUBTYPES)}")
    return question.subtype


def _answers(question: Question) -> list[str]:
    answers = [choice.answer for choice in question.choices] or [question.answer]
    if None in answers:
        raise DataError(f"{question.text!r} has no answer; Q-type baselines need questions with answers")
    return [str(answer) for answer in answers]


def _accuracy(kind: str, rows: list[list[bool]]) -> Any:
    options = [correct for row in rows for correct in row]
    per_option = sum(options) / len(options)
    return per_option if kind == "descriptive" else (per_option, sum(map(all, rows)) / len(rows))

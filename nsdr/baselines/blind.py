"""What the questions' texts alone predict: a bag of words that sees no video.

A question set is biased as far as this baseline is better than the most frequent answer. It is fitted without the scene whose
answers it predicts, so it knows what a question set repeats, not what one video shows.
"""

import random
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from nsdr.clevrer.files.questions import QUESTION_TYPES, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.io.files import check_installed

__all__ = ["FOLDS", "tag_blind"]

FOLDS = 5
"""Parts of the scenes; each is predicted by what was fitted on the others. Also the min number of scenes of a question type."""
NGRAMS = (1, 3)
"""Shortest and longest sequence of words that is a feature."""
MAX_STEPS = 1000
"""Max number of steps of the fit."""


@dataclass(frozen=True)
class _Text:
    """A text to predict an answer from: `scene`, `question` and `choice` (None for a descriptive question) say whose it is."""

    scene: int
    question: int
    choice: int | None
    text: str
    answer: str


def tag_blind(
    scenes: Sequence[SceneQuestions], training: Sequence[SceneQuestions] | None = None, seed: int = 0
) -> list[SceneQuestions]:
    """The questions with `blind` of every descriptive question and every option: whether its text alone predicts the answer.

    Logistic regression on sequences of one to three words, fitted for each question type. An option's text is its question's
    with its own; questions with "not", which turns the answers round, have features of their own.

    Args:
        scenes: questions with answers.
        training: questions of other scenes, with answers, to fit on; None fits on all scenes but those of the same fold.
        seed: of the folds.

    Raises:
        DataError: scikit-learn is missing, a question has no answer, a type has fewer than `FOLDS` scenes to be fitted on, or
            a scene is among `training` too.
    """
    check_installed("sklearn", "blind tags need scikit-learn", "blind")
    shared = {s.scene_index for s in scenes} & {s.scene_index for s in training or ()}
    if shared:
        raise DataError(
            f"{len(shared)} scenes, such as {min(shared)}, are among the training questions too, so their answers are known;"
            " give questions of other scenes, or none to leave out each scene in turn"
        )
    right: dict[tuple[int, int, int | None], bool] = {}
    for kind in QUESTION_TYPES:
        texts = [t for scene in scenes for t in _texts(scene, kind)]
        known = texts if training is None else [t for scene in training for t in _texts(scene, kind)]
        if texts:
            _check_enough(kind, known)
            for fitted, asked in _folds(texts, seed) if training is None else [(known, texts)]:
                answers = _answers(fitted, asked)
                right |= {(t.scene, t.question, t.choice): a == t.answer for t, a in zip(asked, answers, strict=True)}
    return [_tagged(scene, right) for scene in scenes]


def _texts(scene: SceneQuestions, kind: str) -> list[_Text]:
    found = []
    for q in (q for q in scene.questions if q.type == kind):
        options = [(c.id, _option_text(q, c.text), c.answer) for c in q.choices]
        for choice, text, answer in options or ((None, q.text, q.answer),):
            if answer is None:
                raise DataError(f"scene {scene.scene_index}, question {q.id}: has no answer, so none can be predicted")
            found.append(_Text(scene.scene_index, q.id, choice, text, answer))
    return found


def _option_text(question: Question, choice: str) -> str:
    words = re.findall(r"\w+", f"{question.text.lower()} | {choice.lower()}")
    return " ".join(f"not_{word}" for word in words) if "not" in words else " ".join(words)


def _check_enough(kind: str, known: Sequence[_Text]) -> None:
    n = len({t.scene for t in known})
    if n < FOLDS:
        raise DataError(
            f"{n} scenes with {kind} questions are too few to predict answers from; expected at least {FOLDS}"
        )


def _folds(texts: Sequence[_Text], seed: int) -> Iterator[tuple[list[_Text], list[_Text]]]:
    """(the texts to fit on, the texts to predict) of each fold of the scenes."""
    scenes = sorted({t.scene for t in texts})
    random.Random(seed).shuffle(scenes)
    fold_of = {scene: i % FOLDS for i, scene in enumerate(scenes)}
    for fold in range(FOLDS):
        yield [t for t in texts if fold_of[t.scene] != fold], [t for t in texts if fold_of[t.scene] == fold]


def _answers(known: Sequence[_Text], asked: Sequence[_Text]) -> list[str]:
    """The predicted answers."""
    from sklearn.feature_extraction.text import CountVectorizer
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline

    answers = [t.answer for t in known]
    if len(set(answers)) == 1:
        return answers[:1] * len(asked)
    words = CountVectorizer(ngram_range=NGRAMS, binary=True)
    model: Any = make_pipeline(words, LogisticRegression(max_iter=MAX_STEPS))
    model.fit([t.text for t in known], answers)
    return [str(answer) for answer in model.predict([t.text for t in asked])]


def _tagged(scene: SceneQuestions, right: Mapping[tuple[int, int, int | None], bool]) -> SceneQuestions:
    questions = []
    for q in scene.questions:
        about = (scene.scene_index, q.id)
        choices = tuple(replace(c, blind=right[*about, c.id]) for c in q.choices)
        questions.append(replace(q, choices=choices, blind=None if choices else right[*about, None]))
    return replace(scene, questions=tuple(questions))

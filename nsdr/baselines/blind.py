"""What the questions' texts alone predict: a bag of words that sees no video.

A question set is biased as far as this baseline is better than the most frequent answer. It is fitted without the scene whose
answers it predicts, so it knows what a question set repeats, not what one video shows.
"""

import random
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from msgspec.structs import replace

from nsdr.clevrer.files.questions import QUESTION_TYPES, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.io.files import check_installed

FOLDS = 5
"""Parts of the scenes; each is predicted by what was fitted on the others. Also the min number of scenes of a question type."""
NGRAMS = (1, 3)
"""Shortest and longest sequence of words that is a feature."""
MAX_STEPS = 1000
"""Max number of steps of the fit."""
Key = tuple[int, int, int | None]
"""Scene, question and choice (None for a descriptive question)."""


class _Text(NamedTuple):
    key: Key
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
    right: dict[Key, bool] = {}
    for kind in QUESTION_TYPES:
        texts = [t for scene in scenes for t in _texts(scene, kind)]
        known = texts if training is None else [t for scene in training for t in _texts(scene, kind)]
        known_scenes = sorted({t.key[0] for t in known})
        if texts and len(known_scenes) < FOLDS:
            raise DataError(
                f"{len(known_scenes)} scenes with {kind} questions are too few to predict answers from; expected at least "
                f"{FOLDS}"
            )
        if training is not None:
            right |= _predicted(known, texts)
            continue
        random.Random(seed).shuffle(known_scenes)
        for fold in range(FOLDS):
            left_out = set(known_scenes[fold::FOLDS])
            asked = [t for t in texts if t.key[0] in left_out]
            right |= _predicted([t for t in texts if t.key[0] not in left_out], asked)
    return [_tagged(scene, right) for scene in scenes]


def _texts(scene: SceneQuestions, kind: str) -> list[_Text]:
    found = []
    for q in (q for q in scene.questions if q.type == kind):
        options = [(c.id, _option_text(q, c.text), c.answer) for c in q.choices]
        for choice, text, answer in options or ((None, q.text, q.answer),):
            if answer is None:
                raise DataError(f"scene {scene.scene_index}, question {q.id}: has no answer, so none can be predicted")
            found.append(_Text((scene.scene_index, q.id, choice), text, answer))
    return found


def _option_text(question: Question, choice: str) -> str:
    words = re.findall(r"\w+", f"{question.text.lower()} | {choice.lower()}")
    return " ".join(f"not_{word}" for word in words) if "not" in words else " ".join(words)


def _predicted(known: Sequence[_Text], asked: Sequence[_Text]) -> dict[Key, bool]:
    """Of each text, whether its answer is predicted by what is fitted on the known ones."""
    from sklearn.feature_extraction.text import CountVectorizer
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline

    answers = [t.answer for t in known]
    predictions = answers[:1] * len(asked)
    if asked and len(set(answers)) > 1:
        words = CountVectorizer(ngram_range=NGRAMS, binary=True)
        model: Any = make_pipeline(words, LogisticRegression(max_iter=MAX_STEPS))
        predictions = model.fit([t.text for t in known], answers).predict([t.text for t in asked])
    return {t.key: str(answer) == t.answer for t, answer in zip(asked, predictions, strict=True)}


def _tagged(scene: SceneQuestions, right: dict[Key, bool]) -> SceneQuestions:
    questions = []
    for q in scene.questions:
        choices = tuple(replace(c, blind=right[scene.scene_index, q.id, c.id]) for c in q.choices)
        blind = None if choices else right[scene.scene_index, q.id, None]
        questions.append(replace(q, choices=choices, blind=blind))
    return replace(scene, questions=tuple(questions))

"""CLEVRER's question files: `train.json`, `validation.json` and `test.json`."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec.structs import replace

from nsdr.clevrer.files.schema import FileName, Id, Program, RecordId, check_lines, check_unique
from nsdr.errors import DataError
from nsdr.io.files import write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.validation import expect, one_of
from nsdr.world.vocabulary import (
    ATTRIBUTES,
    COLORS,
    DIRECTIONS,
    IMAGE_DIRECTIONS,
    MATERIALS,
    SHAPES,
    SPEED_UNIT,
    STATIONARY,
)

__all__ = [
    "OPTION_TAGS",
    "PAIR_KINDS",
    "PLAIN",
    "QUESTION_TYPES",
    "Choice",
    "Question",
    "SceneQuestions",
    "read_questions",
    "without_answers",
    "write_questions",
]

QUESTION_TYPES = ("descriptive", "explanatory", "predictive", "counterfactual")
"""CLEVRER's question types; all but descriptive questions are multiple choice."""
PLAIN = "plain"
"""Subtype of questions about objects alone, which the release does not have; baselines may learn from them first."""
OPTION_TAGS = ("observational", "inferential")
"""Kinds of counterfactual options: those that the recording without the removed object answers rightly (see
`nsdr.baselines.recording`), and those where it fails because the removal changes what else happens."""
PAIR_KINDS = ("changed", "mirrored", "noisy")
"""What the second video of a pair is: the first one without an object, where the answers differ; mirrored; or with other light
and noise, where they are the same."""
LARGEST_COUNT = 15
"""Largest number that is accepted as an answer. CLEVRER's answers end at 5; scenes with more objects have larger ones."""
ANSWERS = frozenset(
    ["yes", "no", *map(str, range(LARGEST_COUNT + 1)), *(word for words in ATTRIBUTES.values() for word in words)]
)
"""Answers of descriptive questions."""
_OBJECT = " ".join(f"({'|'.join(words)})" for words in (COLORS, MATERIALS, SHAPES))
BEYOND = re.compile(rf"\d+\.\d {SPEED_UNIT}|{'|'.join((*DIRECTIONS, *IMAGE_DIRECTIONS, STATIONARY))}|{_OBJECT}")
"""Answers of descriptive questions beyond CLEVRER: a speed, a direction or an object, such as "1.8 world units per second"."""


class Choice(msgspec.Struct, frozen=True, omit_defaults=True, rename={"id": "choice_id", "text": "choice"}):
    """A choice of a multiple-choice question, as in a question file.

    Attributes:
        id: id within the question.
        text: the choice's text.
        program: postfix tokens; None in the test split.
        answer: "correct" or "wrong"; None in the test split.
        tag: one of `OPTION_TAGS` of a counterfactual option; None where it is not known. The release has no tags.
        blind: whether the texts alone predict the answer; None where it is not known.
    """

    id: Id
    text: str
    program: Program | None = None
    answer: Annotated[str, one_of(("correct", "wrong"))] | None = None
    tag: Annotated[str, one_of(OPTION_TAGS)] | None = None
    blind: bool | None = None


_QUESTION_KEYS = {name: f"question_{name}" for name in ("id", "type", "subtype")} | {"text": "question"}


class Question(msgspec.Struct, frozen=True, omit_defaults=True, rename=_QUESTION_KEYS):
    """A question, as in a question file.

    Attributes:
        id: id within the scene.
        text: the question's text.
        type: one of `QUESTION_TYPES`.
        subtype: subtype of a descriptive question; None for multiple choice.
        program: postfix tokens; None in the test split.
        answer: the answer word; None in the test split and for multiple choice.
        choices: the choices; empty for a descriptive question.
        blind: whether the text alone predicts the answer of a descriptive question; None where it is not known.
        pair: of a question about the second video of a pair, `SCENE_INDEX-QUESTION_ID` of the same question about the first
            one; None of all others. The release has no pairs.
        pair_kind: one of `PAIR_KINDS`, with `pair`.
    """

    id: Id
    text: str
    type: Annotated[str, one_of(QUESTION_TYPES)]
    subtype: str | None = None
    program: Program | None = None
    answer: str | None = None
    choices: tuple[Choice, ...] = ()
    blind: bool | None = None
    pair: RecordId | None = None
    pair_kind: Annotated[str, one_of(PAIR_KINDS)] | None = None


class SceneQuestions(msgspec.Struct, frozen=True):
    """All questions of one video, as in a question file.

    Attributes:
        scene_index: index of the video.
        video_filename: file name of the video.
        questions: the questions.
    """

    scene_index: Id
    video_filename: FileName
    questions: tuple[Question, ...]


def read_questions(path: str | Path) -> list[SceneQuestions]:
    """Read all scenes of a question file.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    scenes: list[SceneQuestions] = read_json(path, list[SceneQuestions])
    check_unique([scene.scene_index for scene in scenes], f"{path}: ", ".scene_index")
    if not any(scene.questions for scene in scenes):
        raise DataError(f"{path}: expected at least 1 question, found {len(scenes)} scenes without one")
    for s, scene in enumerate(scenes):
        place = f"{path}: [{s}].questions"
        check_unique([q.id for q in scene.questions], place, ".question_id")
        for i, question in enumerate(scene.questions):
            _check_question(question, f"{place}[{i}]")
    return scenes


def _check_question(q: Question, place: str) -> None:
    check_lines(place, question=q.text, question_subtype=q.subtype)
    for i, choice in enumerate(q.choices):
        check_lines(f"{place}.choices[{i}]", choice=choice.text)
        check_limit(len(choice.program or ()), "program_tokens", f"{place}.choices[{i}].program")
    check_limit(len(q.program or ()), "program_tokens", f"{place}.program")
    expect((q.pair is None) == (q.pair_kind is None), place, "both pair and pair_kind or neither", "one of them")
    fits = bool(q.choices) != (q.type == "descriptive")
    expect(fits, f"{place}.choices", f"those of a {q.type} question", f"{len(q.choices)} choices")
    check_unique([c.id for c in q.choices], f"{place}.choices", ".choice_id")
    expect(len({c.answer is None for c in q.choices}) < 2, f"{place}.choices", "answers of all or none", "of some")
    fits = bool(q.choices) or q.answer is None or q.answer in ANSWERS or BEYOND.fullmatch(q.answer) is not None
    expect(fits, f"{place}.answer", f"0 to {LARGEST_COUNT}, yes, no or an attribute word", repr(q.answer))


def write_questions(path: str | Path, scenes: Iterable[SceneQuestions]) -> None:
    """Write a question file in the official schema, atomically; inverse of `read_questions`.

    Tags that are known are added to it as `tag` and `blind`, which other readers skip.
    """
    write_json(path, msgspec.to_builtins(list(scenes)))


def without_answers(scene: SceneQuestions) -> SceneQuestions:
    """The same questions without answers, programs and tags, as in the test split."""
    questions = []
    for q in scene.questions:
        choices = tuple(replace(c, program=None, answer=None, tag=None, blind=None) for c in q.choices)
        questions.append(replace(q, program=None, answer=None, choices=choices, blind=None))
    return replace(scene, questions=tuple(questions))

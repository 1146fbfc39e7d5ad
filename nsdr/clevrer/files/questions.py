"""CLEVRER's question files: `train.json`, `validation.json` and `test.json`."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import msgspec

from nsdr.clevrer.files.schema import FileName, Id, Program, check_lines, check_unique
from nsdr.errors import DataError
from nsdr.io.files import write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.validation import expect
from nsdr.world.vocabulary import ATTRIBUTES, COLORS, DIRECTIONS, MATERIALS, SHAPES, SPEED_UNIT

__all__ = [
    "OPTION_TAGS",
    "QUESTION_TYPES",
    "Choice",
    "Question",
    "SceneQuestions",
    "by_type",
    "read_questions",
    "without_answers",
    "write_questions",
]

QUESTION_TYPES = ("descriptive", "explanatory", "predictive", "counterfactual")
"""CLEVRER's question types; all but descriptive questions are multiple choice."""
OPTION_TAGS = ("observational", "inferential")
"""Kinds of counterfactual options: those that the recording without the removed object answers rightly (see
`nsdr.baselines.recording`), and those where it fails because the removal changes what else happens."""
LARGEST_COUNT = 15
"""Largest number that is accepted as an answer. CLEVRER's answers end at 5; scenes with more objects have larger ones."""
ANSWERS = frozenset(
    ["yes", "no", *map(str, range(LARGEST_COUNT + 1)), *(word for words in ATTRIBUTES.values() for word in words)]
)
"""Answers of descriptive questions."""
_OBJECT = " ".join(f"({'|'.join(words)})" for words in (COLORS, MATERIALS, SHAPES))
BEYOND = re.compile(rf"\d+\.\d {SPEED_UNIT}|{'|'.join(DIRECTIONS)}|{_OBJECT}")
"""Answers of descriptive questions beyond CLEVRER: a speed, a direction or an object, such as "1.8 world units per second"."""


@dataclass(frozen=True)
class Choice:
    """A choice of a multiple-choice question.

    Attributes:
        id: id within the question.
        text: the choice's text.
        program: postfix tokens; None in the test split.
        answer: "correct" or "wrong"; None in the test split.
        tag: one of `OPTION_TAGS` of a counterfactual option; None where it is not known. The release has no tags.
        blind: whether the texts alone predict the answer; None where it is not known.
    """

    id: int
    text: str
    program: tuple[str, ...] | None
    answer: str | None
    tag: str | None = None
    blind: bool | None = None


@dataclass(frozen=True)
class Question:
    """A question.

    Attributes:
        id: id within the scene.
        text: the question's text.
        type: one of `QUESTION_TYPES`.
        subtype: subtype of a descriptive question; None for multiple choice.
        program: postfix tokens; None in the test split.
        answer: the answer word; None in the test split and for multiple choice.
        choices: the choices; empty for a descriptive question.
        blind: whether the text alone predicts the answer of a descriptive question; None where it is not known.
    """

    id: int
    text: str
    type: str
    subtype: str | None
    program: tuple[str, ...] | None
    answer: str | None
    choices: tuple[Choice, ...]
    blind: bool | None = None


@dataclass(frozen=True)
class SceneQuestions:
    """All questions of one video.

    Attributes:
        scene_index: index of the video.
        video_filename: file name of the video.
        questions: the questions.
    """

    scene_index: int
    video_filename: str
    questions: tuple[Question, ...]


class _ChoiceRow(msgspec.Struct):
    choice_id: Id
    choice: str
    program: Program | None = None
    answer: Literal["correct", "wrong"] | None = None
    tag: Literal["observational", "inferential"] | None = None
    blind: bool | None = None

    def __post_init__(self) -> None:
        check_lines(choice=self.choice)
        check_limit(len(self.program or ()), "program_tokens", ".program")


class _QuestionRow(msgspec.Struct):
    question_id: Id
    question: str
    question_type: Literal["descriptive", "explanatory", "predictive", "counterfactual"]
    question_subtype: str | None = None
    program: Program | None = None
    answer: str | None = None
    choices: list[_ChoiceRow] | None = None
    blind: bool | None = None

    def __post_init__(self) -> None:
        check_lines(question=self.question, question_subtype=self.question_subtype)
        check_limit(len(self.program or ()), "program_tokens", ".program")
        choices, answer = self.choices or [], self.answer
        fits = bool(choices) != (self.question_type == "descriptive")
        expect(fits, ".choices", f"those of a {self.question_type} question", f"{len(choices)} choices")
        check_unique([c.choice_id for c in choices], ".choices", ".choice_id")
        expect(len({c.answer is None for c in choices}) < 2, ".choices", "answers of all or none", "of some")
        fits = bool(choices) or answer is None or answer in ANSWERS or BEYOND.fullmatch(answer) is not None
        expect(fits, ".answer", f"0 to {LARGEST_COUNT}, yes, no or an attribute word", repr(answer))


class _SceneRow(msgspec.Struct):
    scene_index: Id
    video_filename: FileName
    questions: list[_QuestionRow]

    def __post_init__(self) -> None:
        check_unique([q.question_id for q in self.questions], ".questions", ".question_id")


def read_questions(path: str | Path) -> list[SceneQuestions]:
    """Read all scenes of a question file.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    rows: list[_SceneRow] = read_json(path, list[_SceneRow])
    check_unique([row.scene_index for row in rows], f"{path}: ", ".scene_index")
    if not any(row.questions for row in rows):
        raise DataError(f"{path}: expected at least 1 question, found {len(rows)} scenes without one")
    return [
        SceneQuestions(row.scene_index, row.video_filename, tuple(_question(q) for q in row.questions)) for row in rows
    ]


def _question(row: _QuestionRow) -> Question:
    choices = tuple(
        Choice(c.choice_id, c.choice, c.program, c.answer, c.tag, c.blind) for c in row.choices or ()
    )  # fmt: skip
    subtype, answer = row.question_subtype, None if choices else row.answer
    return Question(row.question_id, row.question, row.question_type, subtype, row.program, answer, choices, row.blind)


def write_questions(path: str | Path, scenes: Iterable[SceneQuestions]) -> None:
    """Write a question file in the official schema, atomically; inverse of `read_questions`.

    Tags that are known are added to it as `tag` and `blind`, which other readers skip.
    """
    write_json(path, [_scene_row(scene) for scene in scenes])


def without_answers(scene: SceneQuestions) -> SceneQuestions:
    """The same questions without answers, programs and tags, as in the test split."""
    questions = []
    for q in scene.questions:
        choices = tuple(replace(c, program=None, answer=None, tag=None, blind=None) for c in q.choices)
        questions.append(replace(q, program=None, answer=None, choices=choices, blind=None))
    return replace(scene, questions=tuple(questions))


def by_type(counts: Mapping[str, float]) -> dict[str, float]:
    """Numbers of questions of each type, from those of each descriptive sub-type and each other type."""
    others = {name: counts.get(name, 0) for name in QUESTION_TYPES[1:]}
    return {QUESTION_TYPES[0]: sum(counts.values()) - sum(others.values()), **others}


def _scene_row(scene: SceneQuestions) -> dict[str, Any]:
    rows = []
    for q in scene.questions:
        row: dict[str, Any] = {"question_id": q.id, "question": q.text, "question_type": q.type}
        row |= _known(question_subtype=q.subtype, program=q.program, answer=q.answer, blind=q.blind)
        if q.choices:
            row["choices"] = [_choice_row(c) for c in q.choices]
        rows.append(row)
    return {"scene_index": scene.scene_index, "video_filename": scene.video_filename, "questions": rows}


def _choice_row(choice: Choice) -> dict[str, Any]:
    known = _known(program=choice.program, answer=choice.answer, tag=choice.tag, blind=choice.blind)
    return {"choice_id": choice.id, "choice": choice.text, **known}


def _known(**values: Any) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}

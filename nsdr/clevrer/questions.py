"""CLEVRER's question files: `train.json`, `validation.json` and `test.json`."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nsdr.clevrer.schema import get, iterate_list
from nsdr.errors import DataError
from nsdr.io.files import write_json

__all__ = [
    "QUESTION_TYPES",
    "Choice",
    "Question",
    "SceneQuestions",
    "iterate_questions",
    "read_questions",
    "without_answers",
    "write_questions",
]

QUESTION_TYPES = ("descriptive", "explanatory", "predictive", "counterfactual")
"""CLEVRER's question types; all but descriptive questions are multiple choice."""


@dataclass(frozen=True)
class Choice:
    """A choice of a multiple-choice question.

    Attributes:
        id: id within the question.
        text: the choice's text.
        program: postfix tokens; None in the test split.
        answer: "correct" or "wrong"; None in the test split.
    """

    id: int
    text: str
    program: tuple[str, ...] | None
    answer: str | None


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
    """

    id: int
    text: str
    type: str
    subtype: str | None
    program: tuple[str, ...] | None
    answer: str | None
    choices: tuple[Choice, ...]


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


def iterate_questions(path: str | Path) -> Iterator[SceneQuestions]:
    """Yield the scenes of a question file one by one, without reading the whole file into memory.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    for i, scene in enumerate(iterate_list(path)):
        yield _scene(scene, f"{path}: [{i}]")


def read_questions(path: str | Path) -> list[SceneQuestions]:
    """Read all scenes of a question file.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    return list(iterate_questions(path))


def write_questions(path: str | Path, scenes: Iterable[SceneQuestions]) -> None:
    """Write a question file in the official schema, atomically; inverse of `read_questions`."""
    write_json(path, [_scene_row(scene) for scene in scenes])


def without_answers(scene: SceneQuestions) -> SceneQuestions:
    """The same questions without answers and programs, as in the test split."""
    questions = []
    for q in scene.questions:
        choices = tuple(replace(c, program=None, answer=None) for c in q.choices)
        questions.append(replace(q, program=None, answer=None, choices=choices))
    return replace(scene, questions=tuple(questions))


def _scene_row(scene: SceneQuestions) -> dict[str, Any]:
    rows = []
    for q in scene.questions:
        row: dict[str, Any] = {"question_id": q.id, "question": q.text, "question_type": q.type}
        row |= _known(question_subtype=q.subtype, program=q.program, answer=q.answer)
        if q.choices:
            row["choices"] = [
                {"choice_id": c.id, "choice": c.text, **_known(program=c.program, answer=c.answer)} for c in q.choices
            ]
        rows.append(row)
    return {"scene_index": scene.scene_index, "video_filename": scene.video_filename, "questions": rows}


def _known(**values: Any) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _scene(scene: Any, where: str) -> SceneQuestions:
    questions = get(scene, "questions", list, where)
    return SceneQuestions(
        get(scene, "scene_index", int, where),
        get(scene, "video_filename", str, where),
        tuple(_question(q, f"{where}.questions[{i}]") for i, q in enumerate(questions)),
    )


def _question(question: Any, where: str) -> Question:
    kind = get(question, "question_type", str, where)
    if kind not in QUESTION_TYPES:
        raise DataError(f"{where}.question_type: {kind!r}; expected one of {', '.join(QUESTION_TYPES)}")
    choices = []
    for i, choice in enumerate(question.get("choices") or []):
        choice_where = f"{where}.choices[{i}]"
        answer = choice.get("answer") if isinstance(choice, dict) else None
        if answer not in (None, "correct", "wrong"):
            raise DataError(f"{choice_where}.answer: {answer!r}; expected correct or wrong")
        text, number = get(choice, "choice", str, choice_where), get(choice, "choice_id", int, choice_where)
        choices.append(Choice(number, text, _program(choice, choice_where), answer))
    if bool(choices) == (kind == "descriptive"):
        raise DataError(f"{where}: a {kind} question with {len(choices)} choices")
    return Question(
        get(question, "question_id", int, where),
        get(question, "question", str, where),
        kind,
        question.get("question_subtype"),
        _program(question, where),
        question.get("answer"),
        tuple(choices),
    )


def _program(holder: Any, where: str) -> tuple[str, ...] | None:
    program = holder.get("program")
    if program is None:
        return None
    if not isinstance(program, Sequence) or not all(isinstance(token, str) for token in program):
        raise DataError(f"{where}.program: expected a list of strings")
    return tuple(program)

"""CLEVRER's question files (schema: `train.json`, `validation.json`, `test.json`)."""

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


@dataclass(frozen=True)
class Choice:
    """An option of a multiple-choice question; `program` and `answer` ("correct" or "wrong") are None in the test split."""

    id: int
    text: str
    program: tuple[str, ...] | None
    answer: str | None


@dataclass(frozen=True)
class Question:
    """A question; `program` is None in the test split, `answer` there and for multiple choice, `subtype` for the latter."""

    id: int
    text: str
    type: str
    subtype: str | None
    program: tuple[str, ...] | None
    answer: str | None
    choices: tuple[Choice, ...]


@dataclass(frozen=True)
class SceneQuestions:
    """All questions of one video."""

    scene_index: int
    video_filename: str
    questions: tuple[Question, ...]


def iterate_questions(path: str | Path) -> Iterator[SceneQuestions]:
    """Scenes of a question file one by one; large files are never held whole.

    Raises:
        DataError: names the file, the position inside the JSON, and what was expected there.
    """
    for i, scene in enumerate(iterate_list(path)):
        yield _scene(scene, f"{path}: [{i}]")


def read_questions(path: str | Path) -> list[SceneQuestions]:
    """All scenes of a question file; raises as `iterate_questions`."""
    return list(iterate_questions(path))


def write_questions(path: str | Path, scenes: Iterable[SceneQuestions]) -> None:
    """Write a question file in the official schema, atomically; inverse of `read_questions`."""
    write_json(path, [_scene_row(scene) for scene in scenes])


def without_answers(scene: SceneQuestions) -> SceneQuestions:
    """The same questions as the test split has them: without answers and programs."""
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
        position = f"{where}.choices[{i}]"
        answer = choice.get("answer") if isinstance(choice, dict) else None
        if answer not in (None, "correct", "wrong"):
            raise DataError(f"{position}.answer: {answer!r}; expected correct or wrong")
        text, number = get(choice, "choice", str, position), get(choice, "choice_id", int, position)
        choices.append(Choice(number, text, _program(choice, position), answer))
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

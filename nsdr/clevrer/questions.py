"""CLEVRER's question files (schema: `train.json`, `validation.json`, `test.json`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nsdr.errors import DataError
from nsdr.files import read_json

__all__ = ["QUESTION_TYPES", "Choice", "Question", "SceneQuestions", "read_questions"]

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


def read_questions(path: str | Path) -> list[SceneQuestions]:
    """Read a question file.

    Raises:
        DataError: names the file, the place inside the JSON, and what was expected there.
    """
    content = read_json(path)
    if not isinstance(content, list):
        raise DataError(f"{path}: expected a list of scenes, got {type(content).__name__}")
    return [_scene(scene, f"{path}: [{i}]") for i, scene in enumerate(content)]


def _scene(scene: Any, where: str) -> SceneQuestions:
    questions = _get(scene, "questions", list, where)
    return SceneQuestions(
        _get(scene, "scene_index", int, where),
        _get(scene, "video_filename", str, where),
        tuple(_question(q, f"{where}.questions[{i}]") for i, q in enumerate(questions)),
    )


def _question(question: Any, where: str) -> Question:
    kind = _get(question, "question_type", str, where)
    if kind not in QUESTION_TYPES:
        raise DataError(f"{where}.question_type: {kind!r}; expected one of {', '.join(QUESTION_TYPES)}")
    choices = []
    for i, choice in enumerate(question.get("choices") or []):
        place = f"{where}.choices[{i}]"
        answer = choice.get("answer") if isinstance(choice, dict) else None
        if answer not in (None, "correct", "wrong"):
            raise DataError(f"{place}.answer: {answer!r}; expected correct or wrong")
        text, number = _get(choice, "choice", str, place), _get(choice, "choice_id", int, place)
        choices.append(Choice(number, text, _program(choice, place), answer))
    if bool(choices) == (kind == "descriptive"):
        raise DataError(f"{where}: a {kind} question with {len(choices)} choices")
    return Question(
        _get(question, "question_id", int, where),
        _get(question, "question", str, where),
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


def _get(holder: Any, key: str, kind: type, where: str) -> Any:
    if not isinstance(holder, dict):
        raise DataError(f"{where}: expected an object, got {type(holder).__name__}")
    if key not in holder:
        raise DataError(f"{where}: missing key {key!r}")
    if not isinstance(holder[key], kind) or (kind is int and isinstance(holder[key], bool)):
        raise DataError(f"{where}.{key}: expected {kind.__name__}, got {holder[key]!r}")
    return holder[key]

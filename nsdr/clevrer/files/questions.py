"""CLEVRER's question files: `train.json`, `validation.json` and `test.json`."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.schema import LARGEST_ID, check_new, get, get_name, get_scene_index, get_text, get_whole, shown
from nsdr.errors import DataError
from nsdr.io.files import write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import iterate_json_list
from nsdr.world.vocabulary import ATTRIBUTES, COLORS, DIRECTIONS, MATERIALS, SHAPES, SPEED_UNIT

__all__ = [
    "OPTION_TAGS",
    "QUESTION_TYPES",
    "Choice",
    "Question",
    "SceneQuestions",
    "by_type",
    "iterate_questions",
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


def iterate_questions(path: str | Path) -> Iterator[SceneQuestions]:
    """Yield the scenes of a question file one by one, without reading the whole file into memory.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    seen: set[int] = set()
    n_questions = 0
    for i, row in enumerate(iterate_json_list(path)):
        scene = _scene(row, f"{path}: [{i}]")
        check_new(scene.scene_index, seen, f"{path}: [{i}].scene_index")
        seen.add(scene.scene_index)
        n_questions += len(scene.questions)
        yield scene
    if not n_questions:
        raise DataError(f"{path}: expected at least 1 question, found {len(seen)} scenes without one")


def read_questions(path: str | Path) -> list[SceneQuestions]:
    """Read all scenes of a question file.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    return list(iterate_questions(path))


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


def _scene(scene: Any, where: str) -> SceneQuestions:
    index = get_scene_index(scene, "scene_index", where)
    questions = []
    seen: set[int] = set()
    for i, row in enumerate(get(scene, "questions", list, where)):
        question = _question(row, f"{where}.questions[{i}]", f"scene {index}")
        check_new(question.id, seen, f"{where}.questions[{i}].question_id")
        seen.add(question.id)
        questions.append(question)
    return SceneQuestions(index, get_name(scene, "video_filename", where), tuple(questions))


def _question(question: Any, where: str, scene: str) -> Question:
    kind = get(question, "question_type", str, where)
    if kind not in QUESTION_TYPES:
        raise DataError(f"{where}.question_type: {shown(kind)}; expected one of {', '.join(QUESTION_TYPES)}")
    choices: dict[int, Choice] = {}
    for i, row in enumerate(get(question, "choices", list, where) if question.get("choices") is not None else ()):
        choice_where = f"{where}.choices[{i}]"
        number = get_whole(row, "choice_id", choice_where, 0, LARGEST_ID)
        check_new(number, choices, f"{choice_where}.choice_id")
        text, program = get_text(row, "choice", choice_where), _program(row, choice_where, scene)
        answer, tag = _answer(row, ("correct", "wrong"), choice_where), _tag(row, choice_where)
        choices[number] = Choice(number, text, program, answer, tag, _blind(row, choice_where))
    if bool(choices) == (kind == "descriptive"):
        raise DataError(f"{where}: a {kind} question with {len(choices)} choices")
    if len({choice.answer is None for choice in choices.values()}) > 1:
        raise DataError(f"{where}: some choices have answers and some have none; expected all or none")
    subtype = question.get("question_subtype")
    return Question(
        get_whole(question, "question_id", where, 0, LARGEST_ID),
        get_text(question, "question", where),
        kind,
        None if subtype is None else get_text(question, "question_subtype", where),
        _program(question, where, scene),
        None if choices else _answer(question, ANSWERS, where),
        tuple(choices.values()),
        _blind(question, where),
    )


def _answer(holder: dict[str, Any], known: Collection[str], where: str) -> str | None:
    answer = holder.get("answer")
    if answer is None:
        return None
    if not isinstance(answer, str) or not (answer in known or (known is ANSWERS and BEYOND.fullmatch(answer))):
        expected = f"0 to {LARGEST_COUNT}, yes, no or an attribute word" if known is ANSWERS else " or ".join(known)
        raise DataError(f"{where}.answer: {shown(answer)}; expected {expected}")
    return answer


def _tag(holder: dict[str, Any], where: str) -> str | None:
    tag = holder.get("tag")
    if tag is not None and tag not in OPTION_TAGS:
        raise DataError(f"{where}.tag: {shown(tag)}; expected {' or '.join(OPTION_TAGS)}")
    return tag


def _blind(holder: dict[str, Any], where: str) -> bool | None:
    blind = holder.get("blind")
    if blind is not None and not isinstance(blind, bool):
        raise DataError(f"{where}.blind: {shown(blind)}; expected true or false")
    return blind


def _program(holder: dict[str, Any], where: str, scene: str) -> tuple[str, ...] | None:
    program = holder.get("program")
    if program is None:
        return None
    where = f"{where}.program ({scene})"
    if not isinstance(program, list) or not program or not all(isinstance(token, str) for token in program):
        raise DataError(f"{where}: expected a list of tokens, got {shown(program)}")
    check_limit(len(program), "program_tokens", where)
    return tuple(program)

"""The released question parser's output (`parsed_programs/*.json`): one file for descriptive questions, one for the others.

A file maps scene indices to `{questions: [...]}`. A row is `{program}` for a descriptive question, and
`{question_program, choices: [{program}]}` for a multiple-choice question; rows are in the order of the scene's questions of
that sort. Programs may stand between `<START>` and `<END>` or `<NULL>`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.questions import Question, SceneQuestions
from nsdr.clevrer.files.schema import get, shown
from nsdr.errors import DataError
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json

__all__ = ["with_parsed_programs"]


def with_parsed_programs(scenes: Iterable[SceneQuestions], files: Sequence[str | Path]) -> list[SceneQuestions]:
    """Questions with the programs of the released question parser in place of their own.

    Args:
        scenes: questions of any types.
        files: files of parsed programs, plain or gzipped. Questions that none of them holds have no program.

    Raises:
        DataError: a malformed file, or one whose rows are not the questions of a scene; names the file and the place.
    """
    contents = {str(path): _content(path) for path in files}
    result = []
    for scene in scenes:
        questions = [
            replace(q, program=None, choices=tuple(replace(c, program=None) for c in q.choices))
            for q in scene.questions
        ]
        for name, content in contents.items():
            where = f"{name}: {scene.scene_index}"
            if str(scene.scene_index) in content:
                rows = get(content[str(scene.scene_index)], "questions", list, where)
                _fill(questions, rows, f"{where}.questions")
        result.append(replace(scene, questions=tuple(questions)))
    scenes_found = {str(scene.scene_index) for scene in result}
    for name, content in contents.items():
        if scenes_found and not scenes_found & content.keys():
            raise DataError(f"{name}: holds none of the {len(scenes_found)} scenes, such as {min(scenes_found)}")
    return result


def _content(path: str | Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise DataError(f"{path}: expected an object with scene indices as keys, got a {type(content).__name__}")
    for key in content:
        if not (key.isascii() and key.isdigit()):
            raise DataError(f"{path}: key {shown(key)}: expected the index of a scene")
    return content


def _fill(questions: list[Question], rows: Sequence[Any], where: str) -> None:
    """Put the rows' programs into the questions of their sort."""
    for i, row in enumerate(rows):
        if not isinstance(row, dict):
            raise DataError(f"{where}[{i}]: expected an object, got {shown(row)}")
    for of_choices in (False, True):
        numbered = [(i, row) for i, row in enumerate(rows) if ("choices" in row) == of_choices]
        places = [i for i, q in enumerate(questions) if bool(q.choices) == of_choices]
        if numbered and len(numbered) != len(places):
            sort = "multiple-choice" if of_choices else "descriptive"
            raise DataError(f"{where}: {len(numbered)} rows for the scene's {len(places)} {sort} questions")
        for place, (i, row) in zip(places, numbered, strict=False):
            question, row_where = questions[place], f"{where}[{i}]"
            program = _tokens(row, "question_program" if of_choices else "program", row_where)
            choices = get(row, "choices", list, row_where) if of_choices else []
            if len(choices) != len(question.choices):
                raise DataError(f"{row_where}.choices: expected {len(question.choices)}, got {len(choices)}")
            programs = [_tokens(c, "program", f"{row_where}.choices[{k}]") for k, c in enumerate(choices)]
            filled = tuple(replace(c, program=p) for c, p in zip(question.choices, programs, strict=True))
            questions[place] = replace(question, program=program, choices=filled)


def _tokens(row: Any, key: str, where: str) -> tuple[str, ...]:
    tokens = get(row, key, list, where)
    if not all(isinstance(token, str) for token in tokens):
        raise DataError(f"{where}.{key}: expected a list of strings, got {shown(tokens)}")
    check_limit(len(tokens), "program_tokens", f"{where}.{key}")
    return tuple(tokens)

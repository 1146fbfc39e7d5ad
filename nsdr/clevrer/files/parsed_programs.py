"""The released question parser's output (`parsed_programs/*.json`): one file for descriptive questions, one for the others.

A file maps scene indices to `{questions: [...]}`. A row is `{program}` for a descriptive question, and
`{question_program, choices: [{program}]}` for a multiple-choice question; rows are in the order of the scene's questions of
that sort. Programs may stand between `<START>` and `<END>` or `<NULL>`.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from nsdr.clevrer.files.questions import Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.validation import expect

__all__ = ["with_parsed_programs"]

SceneKey = Annotated[str, Meta(pattern="^[0-9]+$", title="the index of a scene")]


class _Choice(msgspec.Struct):
    program: tuple[str, ...]

    def __post_init__(self) -> None:
        check_limit(len(self.program), "program_tokens", ".program")


class _Row(msgspec.Struct):
    program: tuple[str, ...] | None = None
    question_program: tuple[str, ...] | None = None
    choices: list[_Choice] | None = None

    def __post_init__(self) -> None:
        key, program = (
            (".program", self.program) if self.choices is None else (".question_program", self.question_program)
        )
        expect(program is not None, key, "a list of tokens", "none")
        check_limit(len(program or ()), "program_tokens", key)


class _Scene(msgspec.Struct):
    questions: list[_Row]


def with_parsed_programs(scenes: Iterable[SceneQuestions], files: Sequence[str | Path]) -> list[SceneQuestions]:
    """Questions with the programs of the released question parser in place of their own.

    Args:
        scenes: questions of any types.
        files: files of parsed programs, plain or gzipped. Questions that none of them holds have no program.

    Raises:
        DataError: a malformed file, or one whose rows are not the questions of a scene; names the file and the place.
    """
    contents: dict[str, dict[str, _Scene]] = {str(path): read_json(path, dict[SceneKey, _Scene]) for path in files}
    result = []
    for scene in scenes:
        questions = [
            replace(q, program=None, choices=tuple(replace(c, program=None) for c in q.choices))
            for q in scene.questions
        ]
        for name, content in contents.items():
            where = f"{name}: {scene.scene_index}"
            if str(scene.scene_index) in content:
                _fill(questions, content[str(scene.scene_index)].questions, f"{where}.questions")
        result.append(replace(scene, questions=tuple(questions)))
    scenes_found = {str(scene.scene_index) for scene in result}
    for name, content in contents.items():
        if scenes_found and not scenes_found & content.keys():
            raise DataError(f"{name}: holds none of the {len(scenes_found)} scenes, such as {min(scenes_found)}")
    return result


def _fill(questions: list[Question], rows: Sequence[_Row], where: str) -> None:
    """Put the rows' programs into the questions of their sort."""
    for of_choices in (False, True):
        numbered = [(i, row) for i, row in enumerate(rows) if (row.choices is not None) == of_choices]
        places = [i for i, q in enumerate(questions) if bool(q.choices) == of_choices]
        if numbered and len(numbered) != len(places):
            sort = "multiple-choice" if of_choices else "descriptive"
            raise DataError(f"{where}: {len(numbered)} rows for the scene's {len(places)} {sort} questions")
        for place, (i, row) in zip(places, numbered, strict=False):
            question, choices = questions[place], row.choices or ()
            expect(
                len(choices) == len(question.choices), f"{where}[{i}].choices", str(len(question.choices)), len(choices)
            )
            filled = tuple(replace(c, program=r.program) for c, r in zip(question.choices, choices, strict=True))
            program = row.question_program if of_choices else row.program
            questions[place] = replace(question, program=program, choices=filled)

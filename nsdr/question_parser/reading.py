"""A question and its choices as programs, from texts or as they are given."""

from collections.abc import Sequence
from typing import Protocol

from nsdr.errors import NsdrError, QuestionError
from nsdr.question_parser.suggestions import suggestion
from nsdr.symbolic import Program
from nsdr.symbolic.program import ProgramSource
from nsdr.types import Scene

__all__ = ["Parser", "read_programs"]


class Parser(Protocol):
    """Turns texts into programs, as `QuestionParser` does."""

    def parse(self, text: str, kind: str) -> Program:
        """The program of a text."""


def read_programs(
    parser: Parser,
    question: str,
    choices: Sequence[str] | None = None,
    program: ProgramSource | None = None,
    choice_programs: Sequence[ProgramSource] | None = None,
    scene: Scene | None = None,
) -> tuple[Program, list[Program | NsdrError] | None]:
    """The program of a question, and those of its choices (None for a descriptive question) or why one has none.

    Args:
        parser: of the texts that have no given program.
        question: text of the question.
        choices: texts of the choices of a multiple-choice question.
        program, choice_programs: programs in place of parsing the texts.
        scene: whose objects suggestions may name; None for none.

    Raises:
        QuestionError: the question fits no program (names the nearest texts that do), a multiple-choice question has no choices
            or the reverse, there are not as many programs as choices, or a text stands in place of a list.
        ProgramError: a given program is malformed.
    """
    for name, given in (("choices", choices), ("choice_programs", choice_programs)):
        if isinstance(given, str):
            raise QuestionError(f"{name}: expected a list, such as [{given!r:.60}], got a text")
    multiple_choice = bool(choices) or bool(choice_programs)
    if program is not None:
        parsed = Program.parse(program)
    else:
        found = _parsed(parser, question, "multiple_choice" if multiple_choice else "descriptive", scene)
        if isinstance(found, QuestionError):
            raise found
        parsed = found
    if parsed.needs_choice != multiple_choice:
        missing = "give choices with it" if parsed.needs_choice else "ask it without choices"
        kind = "a multiple-choice" if parsed.needs_choice else "a descriptive"
        raise QuestionError(f"{question or str(parsed)!r} is {kind} question; {missing}")
    if not multiple_choice:
        return parsed, None
    if choice_programs is not None:
        if choices is not None and len(choices) != len(choice_programs):
            raise QuestionError(f"{len(choices)} choices but {len(choice_programs)} choice programs")
        return parsed, [Program.parse(p) for p in choice_programs]
    return parsed, [_parsed(parser, choice, "choice", scene) for choice in choices or ()]


def _parsed(parser: Parser, text: str, kind: str, scene: Scene | None) -> Program | QuestionError:
    """The text's program, or why it has none and the nearest texts that have one."""
    try:
        return parser.parse(text, kind)
    except QuestionError as e:
        if type(e) is not QuestionError:  # of the parser, whatever the text is
            raise
        return QuestionError(f"{e}{suggestion(text, scene, kind)}")

"""What question parsers have in common, and a question with its choices as programs."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress

from nsdr.errors import DataError, EndpointError, NsdrError, ProgramError, QuestionError
from nsdr.io.description import described
from nsdr.io.registry import checked_result
from nsdr.question_parser.suggestions import QUESTION_KINDS, intervention_hint, nearest_questions
from nsdr.symbolic import Program
from nsdr.symbolic.program import CHOICE_KINDS, SAID_KINDS, TOLD_KINDS, ProgramSource
from nsdr.types import Scene
from nsdr.world.vocabulary import CLEVRER, Vocabulary
from nsdr.world.world import CLEVRER_WORLD


class Parser(ABC):
    """Turns texts into programs.

    Attributes:
        vocabulary: the words of objects that it knows.
    """

    vocabulary: Vocabulary = CLEVRER
    __repr__ = described

    @abstractmethod
    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """Programs of many texts of one kind; for a text that has none, the error of `parse`.

        Raises:
            EndpointError: the server of the parser fails, whatever the texts are.
        """

    def parse(self, text: str, kind: str = "descriptive") -> Program:
        """The program of one text.

        Args:
            text: a question or choice in English.
            kind: "descriptive", "multiple_choice" or "choice".

        Raises:
            QuestionError: an unknown kind, an empty text, an unknown word or character, a text of another kind, or one that no
                program stands for.
            DataError: a text longer than `Limits.text_characters`.
        """
        (program,) = self.parse_batch([text], kind)
        if isinstance(program, NsdrError):
            raise program
        return program

    def in_words(self, vocabulary: Vocabulary) -> "Parser | None":
        """This parser for other words of objects; None where it only knows its own, like trained networks.

        Raises:
            DataError: questions cannot have the vocabulary.
        """
        return None


def vocabulary_of(parser: Parser) -> Vocabulary:
    """The words of objects that any parser knows: CLEVRER's, if it does not say them."""
    vocabulary: Vocabulary = getattr(parser, "vocabulary", CLEVRER)
    return vocabulary


def parse_texts(parser: Parser, texts: Sequence[str], kind: str) -> list[Program | NsdrError]:
    """Programs of many texts, or their errors, by any parser, also one that only has `parse`."""
    if isinstance(parser, Parser):
        return parser.parse_batch(texts, kind)
    programs: list[Program | NsdrError] = []
    for text in texts:
        try:
            programs.append(checked_result(parser.parse(text, kind), Program, parser, "parse"))
        except QuestionError as e:
            programs.append(e)
    return programs


def read_programs(
    parser: Parser,
    question: str,
    choices: Sequence[str] | None = None,
    program: ProgramSource | None = None,
    choice_programs: Sequence[ProgramSource] | None = None,
    scene: Scene | None = None,
) -> tuple[Program, list[Program | NsdrError] | None]:
    """The program of a question, and those of its choices or why one has none; None for the choices of a descriptive question,
    which are candidates for its answer and have no programs.

    Args:
        parser: of the texts that have no given program.
        question: text of the question, which may be a program.
        choices: texts of the choices of a multiple-choice question, which may be programs; or candidates for the answer of a
            descriptive one.
        program, choice_programs: programs in place of parsing the texts.
        scene: whose words are read and whose objects suggestions may name; None for the words of the parser.

    Raises:
        QuestionError: the question fits no program (names the nearest texts that do), a multiple-choice question has no
            choices, a descriptive one has choice programs, there are not as many programs as choices, or a text stands in
            place of a list.
        ProgramError: a given program is malformed.
        DataError: the parser only knows the words of another world than the scene's; names both.
    """
    for name, given in (("choices", choices), ("choice_programs", choice_programs)):
        if isinstance(given, str):
            raise QuestionError(f"{name}: expected a list, such as [{given!r:.60}], got a text")
    vocabulary = vocabulary_of(parser) if scene is None else scene.world.vocabulary
    if program is not None:
        parsed = Program.parse(program, vocabulary)
    else:
        found = _parsed(parser, question, "multiple_choice" if choices or choice_programs else "descriptive", scene)
        if isinstance(found, QuestionError) and choices:
            candidates_for = _parsed(parser, question, "descriptive", scene)
            if isinstance(candidates_for, Program) and candidates_for.result not in TOLD_KINDS:
                found = candidates_for
        if isinstance(found, QuestionError):
            raise found
        parsed = found
    if parsed.needs_choice and not (choices or choice_programs):
        raise QuestionError(f"{question or str(parsed)!r} is a multiple-choice question; give choices with it")
    if not parsed.needs_choice and choice_programs:
        raise QuestionError(f"{question or str(parsed)!r} is a descriptive question; ask it without choice programs")
    if not parsed.needs_choice:
        return parsed, None
    if choice_programs is not None:
        if choices is not None and len(choices) != len(choice_programs):
            raise QuestionError(f"{len(choices)} choices but {len(choice_programs)} choice programs")
        return parsed, [Program.parse(p, vocabulary) for p in choice_programs]
    return parsed, [_parsed(parser, choice, "choice", scene) for choice in choices or ()]


def _parsed(parser: Parser, text: str, kind: str, scene: Scene | None) -> Program | QuestionError:
    """The program that the text is or stands for; or why it has none, and the nearest texts that have one."""
    vocabulary = vocabulary_of(parser) if scene is None else scene.world.vocabulary
    with suppress(ProgramError):
        program = Program.parse(text, vocabulary)
        if program.result in (CHOICE_KINDS if kind == "choice" else SAID_KINDS):
            return program
    if scene is not None:
        parser = _in_words_of(scene, parser)
    try:
        return checked_result(parser.parse(text, kind), Program, parser, "parse")
    except QuestionError as e:
        if isinstance(e, EndpointError):  # of the parser, whatever the text is
            raise
        kinds, what = ((kind,), "options") if kind == "choice" else (QUESTION_KINDS, "questions")
        hint = "" if kind == "choice" else intervention_hint(text, vocabulary)
        return QuestionError(str(e) + hint, nearest_questions(text, scene, *kinds, vocabulary=vocabulary), what)


def _in_words_of(scene: Scene, parser: Parser) -> Parser:
    """The parser for the words of the scene's world; raises `DataError` if it only knows others."""
    theirs, known = scene.world.vocabulary, vocabulary_of(parser)
    if known == theirs:
        return parser
    other = parser.in_words(theirs) if isinstance(parser, Parser) else None
    if other is not None:
        return other
    if known.words == theirs.words:
        return parser
    own = getattr(parser, "world", CLEVRER_WORLD)
    raise DataError(
        f"the scene is of the world {scene.world.name}, and {type(parser).__name__} only reads the words of the world "
        f"{own.name}; give weights of the world {scene.world.name} (--checkpoint), or take the question parser grammar, which "
        "reads the words of any scene"
    )

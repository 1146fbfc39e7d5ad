"""Texts that the rules refuse."""

import random
import warnings

import pytest

from nsdr import DataError, ProgramError, QuestionError
from nsdr.language.texts import TEXT_KINDS, sample
from nsdr.question_parser.grammar import GrammarParser, check_text, readings
from nsdr.symbolic import Program
from nsdr.world.vocabulary import CLEVRER


@pytest.fixture(scope="module")
def parser() -> GrammarParser:
    return GrammarParser()


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        (
            "How many collisions do not happen?",
            "descriptive",
            "How many collisions happen; the words 'do not' were not used",
        ),
        ("How many cubes do not enter the scene?", "descriptive", "the words 'do not' were not used"),
        ("The cube does not collide with the sphere", "choice", "the words 'does not' were not used"),
        (
            "What will happen if the cube is not removed?",
            "multiple_choice",
            "without the cube; the word 'not' was not used",
        ),
        ("What will happen with the cube?", "multiple_choice", "the words 'with the cube' were not used"),
        ("What will happen if the cube were blue?", "multiple_choice", "fits no program"),
        (
            "What happens if the red cube and the sphere are removed?",
            "multiple_choice",
            "the words 'cube and the' were not",
        ),
        ("What did the collision between the cube and the sphere cause?", "multiple_choice", "fits no program"),
        (
            "How many big cubes are there?",
            "descriptive",
            "unknown word 'big'.*How many cubes are there; the word 'big'",
        ),
        ("How many red and blue cubes are there?", "descriptive", "cubes are there; the words '.*and.*' were not used"),
        ("What color are the cubes?", "descriptive", "fits no program"),
        ("Do the cubes collide?", "descriptive", "fits no program"),
        ("happen collisions many How?", "descriptive", "fits no program"),
        ("What is the color of a object that does not enter?", "descriptive", "fits no program"),
        ("How many cubes enter the scene? \U0001f389", "descriptive", "party popper"),
        ("How many \x00cubes enter the scene?", "descriptive", r"'\\x00'"),
        ("How many \u202ecubes enter the scene?", "descriptive", "right-to-left override"),
    ],
)
def test_texts_that_no_program_stands_for_are_refused(parser, text, kind, message) -> None:
    with pytest.raises(QuestionError, match=message):
        parser.parse(text, kind)


def test_long_texts_are_refused(parser) -> None:
    with pytest.raises(DataError, match="text_characters"):
        parser.parse("How many cubes enter the scene? " * 100)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("How many cubes are not moving?", "descriptive"),
        (
            "Which of the following is not responsible for the collision between the cube and the sphere?",
            "multiple_choice",
        ),
        ("What would not happen if there were no sphere?", "multiple_choice"),
        ("How many balls enter the scene?", "descriptive"),
        ("What is the shape of the last object to collide with the metal ball?", "descriptive"),
    ],
)
def test_other_wordings_are_still_parsed(parser, text, kind) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parser.parse(text, kind)


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_no_text_of_the_grammar_is_refused(kind) -> None:
    rng = random.Random(kind)
    for _ in range(1000):
        text, program = sample(kind, rng, CLEVRER)
        check_text(text, kind)
        assert readings(text, kind, CLEVRER) == [program]


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("Count(" * 100_000, r"expected calls such as count\("),
        ("objects " * 100_000, "more than 1000 tokens"),
        (["objects"] * 100_000, "more than 1000 tokens"),
        (["objects", 1], "a token is 1; expected texts"),
        ([["objects"]], "expected texts"),
        ("objects \U0001f389 count", "unknown module or word"),
        ("x" * 1_000_000, "unknown module or word 'xxx"),
    ],
)
def test_hostile_programs_are_refused_in_a_short_line(program, message) -> None:
    with pytest.raises(ProgramError, match=message) as caught:
        Program.parse(program)
    assert len(str(caught.value)) < 200

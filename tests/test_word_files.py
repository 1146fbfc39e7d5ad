"""The word files: each line does what the sentence below it says, and nothing stands twice."""

import pytest

from nsdr import DataError
from nsdr.language.normal import normal_form
from nsdr.language.texts import in_words
from nsdr.language.words import read_replacements, read_word_lists, replacements, rewritten
from nsdr.question_parser.contents import SYMBOLS, content_readings
from nsdr.world.vocabulary import CLEVRER


def said_by_contents(text: str) -> str:
    (program,) = [program for kind in SYMBOLS for program in content_readings(text, kind, CLEVRER)]
    return in_words(program, CLEVRER)


RESULTS = {
    "spellings": lambda text: normal_form(text).text,
    "hedges": lambda text: normal_form(text).text,
    "phrases": lambda text: normal_form(text).text,
    "spellings_beyond": lambda text: normal_form(rewritten(text.lower(), "spellings_beyond"), keep_unknown=True).text,
    "contents": said_by_contents,
}


@pytest.mark.parametrize("name", RESULTS)
def test_each_line_does_what_its_sentence_says(name: str) -> None:
    lines = replacements(name)
    assert [RESULTS[name](line.text) for line in lines] == [line.result for line in lines]


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("a => b\n    A? -> b\nc\n    C? -> d\n", "'c' has no replacement"),
        ("a => b\nc => d\n    C? -> d\n", "'a => b' has no sentence"),
        ("a => b\n    A?\n", "'a => b' has no sentence"),
        ("<x> = a\n<x> => b\n    A? -> b\na => c\n    A? -> c\n", "'a => c' stands twice"),
    ],
)
def test_lines_without_a_sentence_and_double_ones_are_refused(content: str, named: str) -> None:
    with pytest.raises(DataError, match=rf"words\.txt: {named}"):
        read_replacements(content, "words")


def test_words_that_stand_twice_are_refused() -> None:
    lists = read_word_lists("be: is\n  am are\nOTHER: is is_not\n", "words")
    assert lists == {"be": ["is", "am", "are"], "OTHER": ["is", "is_not"]}
    for content in ("be: is isnt\nbe not: isnt\n", "be: is is\n", "OTHER: a\nbe: is\nOTHER: a\n"):
        with pytest.raises(DataError, match=r"words\.txt: '(isnt|is|a)' stands under"):
            read_word_lists(content, "words")

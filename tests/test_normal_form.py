"""Normal forms: one spelling, one word for each meaning, noun phrases, the question before its clauses."""

import doctest
import random
from dataclasses import replace

import pytest

from nsdr.language import normal
from nsdr.language.normal import OTHER_WORDS, POSTMODIFIERS, corrected, normal_form
from nsdr.language.slots import Slot
from nsdr.language.texts import TEXT_KINDS, draw_wording, normal_words
from nsdr.language.words import rewritten_words
from nsdr.question_parser.tokenizer import split_words
from nsdr.world.vocabulary import CLEVRER


@pytest.mark.parametrize(
    ("text", "normal"),
    [
        ("What colour is the grey ball?", "what color be the gray sphere"),
        ("What\u2019s the cube\u2019s material?", "what be the cube 's material"),
        ("How many blocks AREN'T moving?", "how many cubes be stationary"),
        ("Please tell me how many things there are in the video.", "how many objects be there"),
        ("Does the red cube bump into the metallic box?", "do the red cube hit the metal cube"),
        ("Do the cube and the sphere crash into each other?", "do the cube and the sphere collide"),
        ("When the ball comes into view, how many cubes move?", "how many cubes move when the sphere enter"),
        ("At the beginning of the clip, is the cube moving?", "be the cube moving when video begin"),
        ("If there were no red cube, what would happen?", "what will happen without the red cube"),
        ("What won't happen if we take away the cube?", "what will not happen without the cube"),
        ("Which of these isn't a cause of the cube's leaving?", "what not cause the cube 's exiting"),
        ("How many of the objects made of rubber leave the frame?", "how many rubber objects exit"),
        ("the metal red cube", "the red metal cube"),
    ],
)
def test_normal_forms(text: str, normal: str) -> None:
    assert normal_form(text).text == normal


@pytest.mark.parametrize(
    ("typo", "word"),
    [
        ("cylnder", "cylinder"),
        ("stationery", "stationary"),
        ("yelow", "yellow"),
        ("bleu", "blue"),
        ("objcts", "objects"),
        ("sphers", "spheres"),
        ("collison", "collision"),
    ],
)
def test_one_wrong_letter_is_corrected_and_reported(typo: str, word: str) -> None:
    normal = normal_form(f"How many {typo} enter?")
    assert normal.corrections == ((typo, word),)
    assert normal == replace(normal_form(f"How many {word} enter?"), corrections=((typo, word),))


@pytest.mark.parametrize("word", ["black", "mental", "world", "more", "same", "bell", "exsits", "cue", "rd"])
def test_words_with_another_meaning_and_unclear_ones_are_not_corrected(word: str) -> None:
    assert corrected(word, CLEVRER) == ""
    assert normal_form(f"How many {word} cubes enter?").left_out == (word,)
    assert word in normal_form(f"How many {word} cubes enter?", keep_unknown=True).words


def test_each_rewriting_does_what_its_example_says() -> None:
    assert doctest.testmod(normal) == (0, 14)
    examples = dict(POSTMODIFIERS.values())
    assert {text: normal_form(text).text for text in examples} == examples


def test_other_words_are_not_known() -> None:
    for word in OTHER_WORDS:
        assert normal_form(word).left_out == (word,)


def test_an_attribute_named_twice_is_no_noun_phrase() -> None:
    assert normal_form("How many red blue cubes enter?").forms == ("how", "many", "A", "A", "A", "enter")


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_normal_forms_have_words_of_the_vocabulary_only(kind: str) -> None:
    rng = random.Random(kind)
    for _ in range(300):
        assert set(split_words(draw_wording(kind, rng, CLEVRER)[0])) <= set(normal_words(CLEVRER))


@pytest.mark.parametrize(
    ("text", "normal"),
    [
        (
            "Without the red cube, what will happen to the blue sphere?",
            "what will happen to the blue sphere without the red cube",
        ),
        (
            "Were the red cube removed, what would the blue sphere hit?",
            "what will the blue sphere hit without the red cube",
        ),
        (
            "If not for the red cube, which event with the blue sphere happens?",
            "what with the blue sphere happen without the red cube",
        ),
        ("Does the red cube get hit by the blue sphere?", "be the red cube hit by the blue sphere"),
    ],
)
def test_noun_phrases_go_where_the_phrases_put_them(text: str, normal: str) -> None:
    assert normal_form(text).text == normal


def test_normal_forms_are_not_rewritten_again() -> None:
    for text in (draw_wording(kind, random.Random(i), CLEVRER)[0] for kind in TEXT_KINDS for i in range(300)):
        words = normal_form(text).words
        assert [w for w in rewritten_words(words, "phrases") if isinstance(w, Slot)] == [
            w for w in words if isinstance(w, Slot)
        ]

"""The rules of other wordings, programs in words, and the sets of wordings that ship."""

import json
import random
from contextlib import suppress
from pathlib import Path

import pytest

from nsdr import Program, ProgramError
from nsdr.language.normal import normal_form
from nsdr.language.rules import Rules
from nsdr.language.slots import Slot, filled
from nsdr.language.texts import TEXT_KINDS, draw_wording, in_words, read_paraphrases, sample
from nsdr.question_parser.constraint import allowed, first_stack, following
from nsdr.question_parser.grammar import readings
from nsdr.question_parser.tokenizer import END, decoder_tokens
from nsdr.world.vocabulary import CLEVRER

MAX_VALUES = 5
"""Values on the stack of the programs that are drawn at random."""
BY_HAND = Path(__file__).parent.parent / "benchmarks" / "questions_by_hand.json"


def test_the_notation_of_rules() -> None:
    rules = Rules("S: how many NS (enter|come in) [now] => events objects NS filter_in count\n# a comment\n")
    words = ("how", "many", "NS", "come", "in", "now")
    assert rules.readings("S", words) == (("events", "objects", "#2", "filter_in", "count"),)
    assert rules.readings("S", words[:-2]) == ()
    assert rules.words == {"how", "many", "enter", "come", "in", "now"}


def test_rules_write_what_they_read_and_draw_each_content_in_several_wordings() -> None:
    rules = Rules(
        "S*2: (How many NS|What number of NS) ENTER ? => events objects NS ENTER count\nENTER: enter => filter_in\n"
    )

    class Two:
        def words(self, choose, use, without):
            assert (use, without) == ("counted", "")
            return choose.pick([(), ("red", "cube")])

    program = ["events", "objects", "red", "filter_color", "cube", "filter_shape", "filter_in", "count"]
    line = ["events", "objects", "#0", "filter_in", "count"]
    assert rules.write("S", line, [("NS",)]) == ["How", "many", ("NS", 0), "enter", "?"]
    assert rules.write("S", line[:-1], [("NS",)]) is None
    found = list(rules.every("S", Two(), random.Random(0)))
    assert [tokens for _, tokens in found] == [["events", "objects", "filter_in", "count"], program]
    texts = {rules.draw("S", random.Random(i), Two())[0] for i in range(40)}
    assert texts == {f"{a} {b} enter?" for a in ("How many", "What number of") for b in ("objects", "red cubes")}


def test_slots_are_filled_with_filters_in_a_fixed_order() -> None:
    slots = [Slot("NS", ("metal", "cube")), Slot("A", ("red",)), Slot("A", ("blue",))]
    assert filled(["objects", "#0&#1"], slots, CLEVRER) == [
        "objects",
        *["red", "filter_color", "metal", "filter_material", "cube", "filter_shape"],
    ]
    assert filled(["#0"], slots, CLEVRER) == ["metal", "filter_material", "cube", "filter_shape"]
    assert filled(["#1&#2"], slots, CLEVRER) is None
    assert [slot.text(CLEVRER) for slot in slots] == ["metal cubes", "red", "blue"]


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_drawn_texts_have_well_typed_programs_that_the_constraint_permits(kind: str) -> None:
    rng = random.Random(kind)
    index = {t: i for i, t in enumerate(decoder_tokens(CLEVRER))}
    for _ in range(300):
        _, tokens = draw_wording(kind, rng, CLEVRER)
        assert Program.parse(tokens).needs_choice == (kind == "multiple_choice")
        stack = first_stack(kind)
        for step, token in enumerate([index[t] for t in tokens]):
            assert allowed(stack, kind, step == 0, CLEVRER)[token]
            stack = following(stack, token, CLEVRER)
        assert allowed(stack, kind, False, CLEVRER)[END]


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_texts_of_the_grammar_have_one_reading_and_programs_in_words_are_read_as_themselves(kind: str) -> None:
    rng = random.Random(kind)
    for _ in range(300):
        text, tokens = sample(kind, rng, CLEVRER)
        assert readings(text, kind, CLEVRER) == [tokens]
        for program in (tokens, draw_wording(kind, rng, CLEVRER)[1]):
            assert readings(in_words(program, CLEVRER), kind, CLEVRER) == [program]


def test_programs_in_words() -> None:
    assert in_words("objects red filter_color end get_frame filter_moving count", CLEVRER) == (
        "How many moving red objects are there when the video ends?"
    )
    assert in_words("unseen_events", CLEVRER) == "What will happen next?"
    for program in ("objects", "events exist", "events objects unique filter_in"):
        with pytest.raises(ProgramError, match="no question"):
            in_words(program, CLEVRER)


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_any_well_typed_program_is_put_in_words_or_refused(kind: str) -> None:
    rng = random.Random(kind)
    for _ in range(200):
        stack, tokens = first_stack(kind), []
        while len(tokens) < 30:
            permitted = [i for i, ok in enumerate(allowed(stack, kind, False, CLEVRER)) if ok]
            options = [i for i in permitted if i == END or len(following(stack, i, CLEVRER) or ()) <= MAX_VALUES]
            if not options:
                break
            token = rng.choice(options)
            if token == END:
                break
            tokens.append(decoder_tokens(CLEVRER)[token])
            stack = following(stack, token, CLEVRER)
        if token == END and tokens:
            with suppress(ProgramError):
                assert in_words(tokens, CLEVRER)


def test_the_sets_by_hand_are_read_rightly() -> None:
    for row in [*json.loads(BY_HAND.read_text()), *read_paraphrases()]:
        found = [] if normal_form(row["text"]).left_out else readings(row["text"], row["kind"], CLEVRER)
        assert (row["text"], found) == (row["text"], [row["program"].split()] if row["program"] else [])

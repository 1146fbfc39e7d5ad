"""Texts with their programs: CLEVRER's wordings at random, other wordings at random, and any program in words."""

import random
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from nsdr.errors import ProgramError
from nsdr.io.reading import parse_json
from nsdr.language.rules import Chooser, Pair, Rules, load_rules
from nsdr.language.slots import Slot, names_twice, text_of
from nsdr.symbolic.program import CHOICE_KINDS, Program, ProgramSource
from nsdr.world.vocabulary import Vocabulary

START_SYMBOLS = {"descriptive": "DESCRIPTIVE", "multiple_choice": "MULTIPLE", "choice": "CHOICE"}
"""The symbol of each kind of text, in all sets of rules."""
TOLD = "TOLD"
"""The symbol of descriptive questions that only the rules read, and that are answered in several lines."""
TEXT_KINDS = tuple(START_SYMBOLS)
"""The three kinds of text, each with its own network (paper, section 4.3)."""
WORD_PROBABILITIES = {"color": 0.5, "material": 0.5, "shape": 0.6}
"""Probability that a single object is described by each attribute in drawn texts (0-1). Without any, the colour is used."""
BARE_PROBABILITIES = {"one": 0.0, "counted": 0.4, "moves": 0.3, "enters": 0.8}
"""Probability that a noun phrase has no attribute words in CLEVRER's texts, by what it is used for (0-1)."""
BARE_WORDING_PROBABILITIES = {"one": 0.15, "counted": 0.4}
"""The same for other wordings."""
MAX_TOKENS = 40
"""Longest program of another wording that is drawn (tokens)."""


def english(vocabulary: Vocabulary) -> Rules:
    """The rules of texts in normal form."""
    return load_rules(vocabulary, "read_english")


def clevrer(vocabulary: Vocabulary) -> Rules:
    """The rules of CLEVRER's own texts, and of those beyond it that the generator asks."""
    return load_rules(vocabulary, "write_clevrer", "write_beyond")


class _RandomWords:
    """Random attribute words; implements `nsdr.language.rules.Phrases`."""

    def __init__(self, rng: random.Random, bare: dict[str, float], vocabulary: Vocabulary) -> None:
        self.rng, self.bare, self.known = rng, bare, vocabulary.words

    def words(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        if use == "attribute":
            return (self.rng.choice(self.known["color"] + self.known["material"]),)
        if self.rng.random() < self.bare[use]:
            return ()
        used = [name for name, probability in WORD_PROBABILITIES.items() if self.rng.random() < probability]
        chosen = {name: self.rng.choice(self.known[name]) for name in used or ["color"]}
        return tuple(word for name, word in chosen.items() if name != without)


def sample(kind: str, rng: random.Random, vocabulary: Vocabulary) -> Pair:
    """A random text of CLEVRER's wordings and its program's tokens.

    Objects are described by random attribute words, so that a text need not fit any scene.

    Args:
        kind: "descriptive", "multiple_choice" or "choice".
        rng: draws the text.
        vocabulary: of the attribute words.
    """
    words = _RandomWords(rng, BARE_PROBABILITIES, vocabulary)
    return clevrer(vocabulary).draw(START_SYMBOLS[kind], rng, words)


def draw_wording(kind: str, rng: random.Random, vocabulary: Vocabulary) -> Pair:
    """A random text of a kind in normal form, and its program's tokens."""
    words = _RandomWords(rng, BARE_WORDING_PROBABILITIES, vocabulary)
    while True:
        text, tokens = english(vocabulary).draw(START_SYMBOLS[kind], rng, words)
        if len(tokens) <= MAX_TOKENS:
            return text, tokens


@cache
def normal_words(vocabulary: Vocabulary) -> tuple[str, ...]:
    """All words of normal forms."""
    objects: list[tuple[str, ...]] = [(), *((shape,) for shape in vocabulary.words["shape"])]
    nouns = {vocabulary.noun_phrase(words, is_plural) for words in objects for is_plural in (False, True)}
    return tuple(sorted(english(vocabulary).words | nouns | vocabulary.attributes.keys()))


def kind_of(program: Program) -> str:
    """The kind of text that a program stands for."""
    if program.needs_choice:
        return "multiple_choice"
    return "choice" if program.result in CHOICE_KINDS else "descriptive"


def in_words(program: ProgramSource, vocabulary: Vocabulary) -> str:
    """The question or choice that a program stands for, such as "How many moving red cubes are there when the video ends?".

    It is read as that program again, for all programs of CLEVRER's texts and their other wordings.

    Raises:
        ProgramError: the program is not well-formed, or none that a question or choice stands for.
    """
    parsed = Program.parse(program, vocabulary)
    rules = load_rules(vocabulary, "write_clevrer", "write_beyond", "write_other")
    tokens, slots = _with_slots(parsed.tokens, vocabulary)
    forms = [("N", "NS", "A") if words else ("O", "OS", "") for words in slots]
    try:
        found = rules.write(START_SYMBOLS[kind_of(parsed)], tokens, forms)
    except RecursionError:  # hundreds of objects within each other
        found = None
    if found is None:
        raise ProgramError("no question or choice stands for the program")
    written = [w if isinstance(w, str) else Slot("NS" if w[0] == "NS" else "N", slots[w[1]]) for w in found]
    text = text_of(written, vocabulary)
    return text[:1].upper() + text[1:]


def _with_slots(program: Sequence[str], vocabulary: Vocabulary) -> tuple[list[str], list[tuple[str, ...]]]:
    """A program with `#i` after each `objects` for the filters that follow, and the attribute words of each slot."""
    tokens: list[str] = []
    slots: list[tuple[str, ...]] = []
    rest = list(program)
    while rest:
        tokens.append(rest.pop(0))
        if tokens[-1] != "objects":
            continue
        words: list[str] = []
        while rest and rest[1:2] == [f"filter_{vocabulary.attributes.get(rest[0])}"]:
            words.append(rest[0])
            del rest[:2]
        if names_twice(words, vocabulary):
            raise ProgramError("no question or choice stands for the program")
        found = vocabulary.in_order(words)
        slots += [] if found in slots else [found]
        tokens.append(f"#{slots.index(found)}")
    return tokens, slots


def read_paraphrases() -> list[dict[str, Any]]:
    """206 texts written by hand: rows of `kind`, `text` and `program` (postfix tokens). The rules were tuned on them."""
    content: list[dict[str, Any]] = parse_json(
        files("nsdr.language").joinpath("paraphrases.json").read_bytes(), "paraphrases.json"
    )
    return content

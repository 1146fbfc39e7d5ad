"""Texts in other wordings than the release's: drawn at random from the rules of `english`, and a set written by hand.

The set (`paraphrases.json`, 206 texts) was written before the rules and is never trained on, but they were tuned on it.
"""

import random
from importlib.resources import files
from typing import Any

from nsdr.io.reading import parse_json
from nsdr.language.english import ENGLISH, START_SYMBOLS
from nsdr.language.rules import SLOT_FORMS, Slot, filled
from nsdr.language.templates import Pair, random_words
from nsdr.world.vocabulary import COLORS, MATERIALS

__all__ = ["VOCABULARY", "draw_wording", "read_paraphrases"]

BARE_PROBABILITIES = {"N": 0.15, "NS": 0.4}
"""Probability that a drawn noun phrase has no attribute words (0-1)."""
MAX_TOKENS = 40
"""Longest program of a drawn text (tokens); longer ones are drawn again."""
VOCABULARY = tuple(
    sorted(
        ENGLISH.words
        | {"object", "objects"}
        | {*COLORS, *MATERIALS}
        | {f"{shape}{ending}" for shape in ("cube", "sphere", "cylinder") for ending in ("", "s")}
    )
)
"""All words of drawn texts."""


class _RandomSlots:
    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def slot(self, name: str) -> Slot:
        if name == "A":
            return Slot("A", (self.rng.choice(COLORS + MATERIALS),))
        full, *bare = SLOT_FORMS[name]
        if not bare or self.rng.random() < BARE_PROBABILITIES[name]:
            return Slot(SLOT_FORMS[name][-1], ())
        return Slot(full, random_words(self.rng))


def draw_wording(kind: str, rng: random.Random) -> Pair:
    """A random text of a kind ("descriptive", "multiple_choice" or "choice") in normal form, and its program's tokens."""
    while True:
        words: list[str | Slot] = []
        program = ENGLISH.draw(START_SYMBOLS[kind], rng, words, _RandomSlots(rng))
        tokens = filled(program, words)
        if tokens is not None and len(tokens) <= MAX_TOKENS:
            return " ".join(w if isinstance(w, str) else w.text for w in words), tokens


def read_paraphrases() -> list[dict[str, Any]]:
    """The set written by hand: rows of `kind` (of text), `text` and `program` (postfix tokens)."""
    content: list[dict[str, Any]] = parse_json(
        files("nsdr.language").joinpath("paraphrases.json").read_bytes(), "paraphrases.json"
    )
    return content

"""Noun phrases of texts (slots), and their filters in programs."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from nsdr.world.vocabulary import ATTRIBUTES

SLOT_FORMS = {"N": ("N", "O"), "NS": ("NS", "OS"), "OBJ": ("O",), "OBJS": ("OS",), "A": ("A",)}
"""Symbols of noun phrases, and the words of a pattern that stand for them; the last one has no attribute words."""
CATEGORY = {word: name for name, words in ATTRIBUTES.items() for word in words}
"""Attribute of each of its words."""
_NO_SPACE = re.compile(r" (?='s\b|[,?])")


@dataclass(frozen=True)
class Slot:
    """A noun phrase or attribute words of a text.

    Attributes:
        form: "N", "NS", "O", "OS" or "A" (see `SLOT_FORMS`).
        words: attribute words in the order color, material, shape.
    """

    form: str
    words: tuple[str, ...]

    @property
    def text(self) -> str:
        """Such as "red metal cubes", "red object" or, for A, "red metal"."""
        if self.form == "A":
            return " ".join(self.words)
        noun = () if self.words and CATEGORY[self.words[-1]] == "shape" else ("object",)
        return " ".join((*self.words, *noun)) + ("s" if self.form in ("NS", "OS") else "")


def text_of(words: Sequence[str | Slot]) -> str:
    """Words as a text; a question, which ends in "?", starts with a capital letter."""
    text = _NO_SPACE.sub("", " ".join(w if isinstance(w, str) else w.text for w in words))
    return text[:1].upper() + text[1:] if text.endswith("?") else text


def filled(program: Sequence[str], slots: Sequence[str | Slot]) -> list[str] | None:
    """The program with the filters of its slots; None where joined words name an attribute twice.

    Args:
        program: tokens, with `#i` for the slot at word i, `#i&#j` for the words of both.
        slots: words of the text, slots among them.
    """
    tokens: list[str | Slot] = []
    for token in program:
        named = [slots[int(reference[1:])] for reference in token.split("&")] if token.startswith("#") else []
        words = tuple(w for slot in named if isinstance(slot, Slot) for w in slot.words)
        tokens.append(Slot("A", words) if named else token)
    return with_filters(tokens)


def with_filters(program: Sequence[str | Slot]) -> list[str] | None:
    """A program with the filters of its slots; None where a slot names an attribute twice."""
    tokens: list[str] = []
    for token in program:
        if isinstance(token, str):
            tokens.append(token)
            continue
        if len({CATEGORY[w] for w in token.words}) < len(token.words):
            return None
        for word in in_order(token.words):
            tokens += [word, f"filter_{CATEGORY[word]}"]
    return tokens


def in_order(words: Sequence[str]) -> tuple[str, ...]:
    """Attribute words in the order color, material, shape."""
    return tuple(sorted(words, key=lambda word: list(ATTRIBUTES).index(CATEGORY[word])))

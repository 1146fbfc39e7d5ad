"""Noun phrases of texts (slots), and their filters in programs."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from nsdr.world.vocabulary import Vocabulary

SLOT_FORMS = {"N": ("N", "O"), "NS": ("NS", "OS"), "OBJ": ("O",), "OBJS": ("OS",), "A": ("A",)}
"""Symbols of noun phrases, and the words of a pattern that stand for them; the last one has no attribute words."""
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

    def text(self, vocabulary: Vocabulary) -> str:
        """Such as "red metal cubes", "red object" or, for A, "red metal"."""
        if self.form == "A":
            return " ".join(self.words)
        return vocabulary.noun_phrase(self.words, self.form in ("NS", "OS"))


def text_of(words: Sequence[str | Slot], vocabulary: Vocabulary) -> str:
    """Words as a text; a question, which ends in "?", starts with a capital letter."""
    text = _NO_SPACE.sub("", joined(words, vocabulary))
    return text[:1].upper() + text[1:] if text.endswith("?") else text


def joined(words: Sequence[str | Slot], vocabulary: Vocabulary) -> str:
    """Words with spaces between them."""
    return " ".join(w if isinstance(w, str) else w.text(vocabulary) for w in words)


def filled(program: Sequence[str], slots: Sequence[str | Slot], vocabulary: Vocabulary) -> list[str] | None:
    """The program with the filters of its slots; None where joined words name an attribute twice.

    Args:
        program: tokens, with `#i` for the slot at word i, `#i&#j` for the words of both.
        slots: words of the text, slots among them.
        vocabulary: of the slots' words.
    """
    tokens: list[str | Slot] = []
    for token in program:
        named = [slots[int(reference[1:])] for reference in token.split("&")] if token.startswith("#") else []
        words = tuple(w for slot in named if isinstance(slot, Slot) for w in slot.words)
        tokens.append(Slot("A", words) if named else token)
    return with_filters(tokens, vocabulary)


def with_filters(program: Sequence[str | Slot], vocabulary: Vocabulary) -> list[str] | None:
    """A program with the filters of its slots; None where a slot names an attribute twice."""
    tokens: list[str] = []
    for token in program:
        if isinstance(token, str):
            tokens.append(token)
            continue
        if names_twice(token.words, vocabulary):
            return None
        for word in vocabulary.in_order(token.words):
            tokens += [word, f"filter_{vocabulary.attributes[word]}"]
    return tokens


def names_twice(words: Sequence[str], vocabulary: Vocabulary) -> bool:
    """Whether words name an attribute more than once."""
    return len({vocabulary.attributes[w] for w in words}) < len(words)

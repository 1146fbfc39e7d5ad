"""Rules that relate texts and programs, in one notation for both directions: texts are read with them and drawn from them.

A line is `SYMBOL: pattern => program`. A pattern holds words, symbols in capitals (with a digit where one occurs twice),
`(a|b c)` for alternatives and `[a]` for what may be left out. The program holds tokens and the symbols of the pattern, which
stand for their own programs. The symbols N, NS and A are noun phrases and attribute words (`Slot`): N is singular, NS plural,
OBJ and OBJS are N and NS without attribute words, A is attribute words alone; `NS&A` joins the words of both.
"""

import random
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["SLOT_FORMS", "Rules", "Slot", "SlotMaker", "filled"]

SLOT_FORMS = {"N": ("N", "O"), "NS": ("NS", "OS"), "OBJ": ("O",), "OBJS": ("OS",), "A": ("A",)}
"""Symbols of noun phrases, and the words of a pattern that stand for them."""
OPTION_PROBABILITY = 0.6
"""Probability that a drawn text has what a rule permits to leave out (0-1)."""
_TOKEN = re.compile(r"[()\[\]|]|[^\s()\[\]|]+")
_NAMES = {word: name for name, words in ATTRIBUTES.items() for word in words}


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
        noun = () if self.words and _NAMES[self.words[-1]] == "shape" else ("object",)
        return " ".join((*self.words, *noun)) + ("s" if self.form in ("NS", "OS") else "")


@dataclass(frozen=True)
class _Part:
    """A word, a symbol, or alternatives, each a sequence of parts."""

    word: str = ""
    symbol: str = ""
    options: tuple[tuple["_Part", ...], ...] = ()


class SlotMaker(Protocol):
    """Makes the noun phrases of drawn texts."""

    def slot(self, name: str) -> Slot:
        """A noun phrase for a symbol of `SLOT_FORMS`."""
        ...


_Rule = tuple[tuple[_Part, ...], tuple[str, ...]]
_Bound = tuple[tuple[str, tuple[str, ...]], ...]
"""Symbols of a pattern with the programs that they stand for."""


class Rules:
    """A set of rules.

    Args:
        text: lines of the notation; empty lines and lines that start with # are skipped.
    """

    def __init__(self, text: str) -> None:
        self._rules: dict[str, list[_Rule]] = {}
        for line in text.splitlines():
            if not line.strip() or line.startswith("#"):
                continue
            symbol, rest = line.split(":", 1)
            pattern, program = rest.split("=>")
            parts = _sequence(_TOKEN.findall(pattern))
            self._rules.setdefault(symbol.strip(), []).append((parts, tuple(program.split())))
        self.words = frozenset(w for rules in self._rules.values() for parts, _ in rules for w in _words_of(parts))
        self.readings = lru_cache(maxsize=1 << 15)(self._readings)

    def _readings(self, symbol: str, words: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """All programs of a text as a symbol; `#i` in a program stands for the slot at word i."""
        found = _Reader(self._rules, words).symbol(symbol, 0)
        return tuple(dict.fromkeys(program for end, program in found if end == len(words)))

    def draw(self, symbol: str, rng: random.Random, words: list[str | Slot], slots: SlotMaker) -> tuple[str, ...]:
        """Append the words of a random text to `words`; returns its program with `#i` for the slot at word i."""
        parts, program = rng.choice(self._rules[symbol])
        bound: dict[str, tuple[str, ...]] = {}
        self._draw_parts(parts, rng, words, slots, bound)
        return _composed(program, tuple(bound.items()))

    def _draw_parts(
        self,
        parts: Sequence[_Part],
        rng: random.Random,
        words: list[str | Slot],
        slots: SlotMaker,
        bound: dict[str, tuple[str, ...]],
    ) -> None:
        for part in parts:
            if part.word:
                words.append(part.word)
            elif part.options:
                options = [o for o in part.options if o]
                if len(options) == len(part.options) or rng.random() < OPTION_PROBABILITY:
                    self._draw_parts(rng.choice(options), rng, words, slots, bound)
            else:
                name = part.symbol.rstrip("123456789")
                if name in SLOT_FORMS:
                    bound[part.symbol] = (f"#{len(words)}",)
                    words.append(slots.slot(name))
                else:
                    bound[part.symbol] = self.draw(name, rng, words, slots)


class _Reader:
    def __init__(self, rules: dict[str, list[_Rule]], words: tuple[str, ...]) -> None:
        self.rules, self.words = rules, words
        self.known: dict[tuple[str, int], list[tuple[int, tuple[str, ...]]]] = {}

    def symbol(self, name: str, start: int) -> list[tuple[int, tuple[str, ...]]]:
        """Ends and programs of the texts from `start` on that a symbol stands for."""
        if name in SLOT_FORMS:
            fits = start < len(self.words) and self.words[start] in SLOT_FORMS[name]
            return [(start + 1, (f"#{start}",))] if fits else []
        found = self.known.get((name, start))
        if found is None:
            found = [
                (end, _composed(program, bound))
                for parts, program in self.rules[name]
                for end, bound in self.sequence(parts, start, ())
            ]
            self.known[name, start] = found = list(dict.fromkeys(found))
        return found

    def sequence(self, parts: tuple[_Part, ...], start: int, bound: _Bound) -> Iterator[tuple[int, _Bound]]:
        """Ends of the texts from `start` on that a sequence of parts stands for, and the programs of its symbols."""
        if not parts:
            yield start, bound
            return
        part, rest = parts[0], parts[1:]
        if part.word:
            if start < len(self.words) and self.words[start] == part.word:
                yield from self.sequence(rest, start + 1, bound)
        elif part.options:
            for option in part.options:
                for end, more in self.sequence(option, start, bound):
                    yield from self.sequence(rest, end, more)
        else:
            for end, program in self.symbol(part.symbol.rstrip("123456789"), start):
                yield from self.sequence(rest, end, (*bound, (part.symbol, program)))


def filled(program: Sequence[str], slots: Sequence[str | Slot]) -> list[str] | None:
    """The program with the filters of its slots; None where joined words name an attribute twice.

    Args:
        program: tokens, with `#i` for the slot at word i, `#i&#j` for the words of both.
        slots: words of the text, slots among them.
    """
    tokens: list[str] = []
    for token in program:
        if not token.startswith("#"):
            tokens.append(token)
            continue
        words: list[str] = []
        for reference in token.split("&"):
            slot = slots[int(reference[1:])]
            assert isinstance(slot, Slot)
            words += slot.words
        if len({_NAMES[w] for w in words}) < len(words):
            return None
        for name in ATTRIBUTES:
            tokens += [t for w in words if _NAMES[w] == name for t in (w, f"filter_{name}")]
    return tokens


def _composed(program: tuple[str, ...], bound: _Bound) -> tuple[str, ...]:
    values = dict(bound)
    tokens: list[str] = []
    for token in program:
        if "&" in token:
            tokens.append("&".join(values[key][0] for key in token.split("&")))
        else:
            tokens += values.get(token, () if token.isupper() else (token,))
    return tuple(tokens)


def _sequence(tokens: list[str]) -> tuple[_Part, ...]:
    """Parse a pattern; consumes the tokens up to a closing bracket."""
    options: list[tuple[_Part, ...]] = []
    parts: list[_Part] = []
    while tokens:
        token = tokens.pop(0)
        if token in ("(", "["):
            inner = _sequence(tokens)
            choices = inner[0].options if len(inner) == 1 and inner[0].options and not inner[0].word else (inner,)
            parts.append(_Part(options=(*choices, ()) if token == "[" else choices))
        elif token in (")", "]"):
            break
        elif token == "|":
            options.append(tuple(parts))
            parts = []
        elif token.isupper():
            parts.append(_Part(symbol=token))
        else:
            parts.append(_Part(word=token))
    if options:
        return (_Part(options=(*options, tuple(parts))),)
    return tuple(parts)


def _words_of(parts: Sequence[_Part]) -> Iterator[str]:
    for part in parts:
        if part.word:
            yield part.word
        for option in part.options:
            yield from _words_of(option)

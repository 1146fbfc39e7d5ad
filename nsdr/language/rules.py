"""Rules that relate texts and programs, in one notation for both directions: texts are read with them, drawn and written.

A line is `SYMBOL: pattern => program`. A pattern holds words, symbols in capitals (with a digit where one occurs twice),
`(a|b c)` for alternatives and `[a]` for what may be left out. The program holds tokens and the symbols of the pattern, which
stand for their own programs. The symbols N, NS and A are noun phrases and attribute words (`Slot`): N is singular, NS plural,
OBJ and OBJS are N and NS without attribute words, A is attribute words alone; `NS&A` joins the words of both. A set of
rules may have other slots.
"""

import random
import re
from collections.abc import Iterator, Mapping, Sequence
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
    """A word (in normal form, and as it is written), a symbol, or alternatives, each a sequence of parts."""

    word: str = ""
    written: str = ""
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
        slots: symbols of slots, and the words that stand for them in a text that is read.
        normal: normal forms of words. What a pattern writes "enters" is read in its normal form.
    """

    def __init__(
        self, text: str, slots: Mapping[str, Sequence[str]] = SLOT_FORMS, normal: Mapping[str, str] | None = None
    ) -> None:
        self._rules: dict[str, list[_Rule]] = {}
        self.slots = slots
        for line in text.splitlines():
            if not line.strip() or line.startswith("#"):
                continue
            symbol, rest = line.split(":", 1)
            pattern, program = rest.split("=>")
            parts = _sequence(_TOKEN.findall(pattern), normal or {})
            self._rules.setdefault(symbol.strip(), []).append((parts, tuple(program.split())))
        self.words = frozenset(w for rules in self._rules.values() for parts, _ in rules for w in _words_of(parts))
        self.readings = lru_cache(maxsize=1 << 15)(self._readings)

    def _readings(self, symbol: str, words: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """All programs of a text as a symbol; `#i` in a program stands for the slot at word i."""
        found = _Reader(self._rules, self.slots, words).symbol(symbol, 0)
        return tuple(dict.fromkeys(program for end, program in found if end == len(words)))

    def write(self, symbol: str, program: Sequence[str], forms: Sequence[str]) -> tuple[str, ...] | None:
        """The words of the first text with a program, `#i` for its slot i; None if there is none.

        Rules are tried in their order. Of alternatives the first is written, and what may be left out is, unless it holds a
        symbol of the program. Joined slots (`NS&A`) are not written.

        Args:
            symbol: of the text.
            program: tokens, with `#i` for slot i.
            forms: of each slot, the word that stands for it when it is read.
        """
        found = _Writer(self._rules, self.slots, program, forms).symbol(symbol, 0)
        return next((words for end, words in found if end == len(program)), None)

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
                words.append(part.written)
            elif part.options:
                options = [o for o in part.options if o]
                if len(options) == len(part.options) or rng.random() < OPTION_PROBABILITY:
                    self._draw_parts(rng.choice(options), rng, words, slots, bound)
            else:
                name = part.symbol.rstrip("123456789")
                if name in self.slots:
                    bound[part.symbol] = (f"#{len(words)}",)
                    words.append(slots.slot(name))
                else:
                    bound[part.symbol] = self.draw(name, rng, words, slots)


class _Reader:
    def __init__(
        self, rules: dict[str, list[_Rule]], slots: Mapping[str, Sequence[str]], words: tuple[str, ...]
    ) -> None:
        self.rules, self.slots, self.words = rules, slots, words
        self.known: dict[tuple[str, int], list[tuple[int, tuple[str, ...]]]] = {}

    def symbol(self, name: str, start: int) -> list[tuple[int, tuple[str, ...]]]:
        """Ends and programs of the texts from `start` on that a symbol stands for."""
        if name in self.slots:
            fits = start < len(self.words) and self.words[start] in self.slots[name]
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


class _Writer:
    """Reads a program with the rules' programs as patterns, and gives the texts that they stand beside."""

    def __init__(
        self,
        rules: dict[str, list[_Rule]],
        slots: Mapping[str, Sequence[str]],
        program: Sequence[str],
        forms: Sequence[str],
    ) -> None:
        self.rules, self.slots, self.program, self.forms = rules, slots, program, forms
        self.known: dict[tuple[str, int], list[tuple[int, tuple[str, ...]]]] = {}

    def symbol(self, name: str, start: int) -> list[tuple[int, tuple[str, ...]]]:
        """Ends and texts of the programs from `start` on that a symbol stands for."""
        if name in self.slots:
            token = self.program[start] if start < len(self.program) else ""
            fits = token.startswith("#") and self.forms[int(token[1:])] in self.slots[name]
            return [(start + 1, (token,))] if fits else []
        if (name, start) not in self.known:
            self.known[name, start] = []  # a rule that only adds words to its own symbol writes nothing new
            found = []
            for parts, program in self.rules[name]:
                for end, bound in self.sequence(program, start, {}):
                    text = self.text(parts, bound)
                    found += [(end, text)] if text is not None else []
            self.known[name, start] = found
        return self.known[name, start]

    def sequence(
        self, program: tuple[str, ...], start: int, bound: dict[str, tuple[str, ...]]
    ) -> Iterator[tuple[int, dict[str, tuple[str, ...]]]]:
        """Ends of the programs from `start` on that a rule's program stands for, and the texts of its symbols."""
        if not program:
            yield start, bound
        elif program[0].isupper():
            for end, text in self.symbol(program[0].rstrip("123456789"), start):
                yield from self.sequence(program[1:], end, {**bound, program[0]: text})
            yield from self.sequence(program[1:], start, bound)
        elif start < len(self.program) and self.program[start] == program[0]:
            yield from self.sequence(program[1:], start + 1, bound)

    def text(self, parts: Sequence[_Part], bound: Mapping[str, tuple[str, ...]]) -> tuple[str, ...] | None:
        """The words of a pattern; None if it needs a symbol that is neither bound nor has a text with an empty program."""
        words: list[str] = []
        for part in parts:
            found: tuple[str, ...] | None = (part.written,)
            if part.symbol in bound:
                found = bound[part.symbol]
            elif part.symbol:
                end = len(self.program)
                found = next((text for _, text in self.symbol(part.symbol.rstrip("123456789"), end)), None)
            elif part.options:
                needed = set(bound).intersection(_symbols_of([part]))
                options = [o for o in part.options if needed <= set(_symbols_of(o))]
                options = [()] if () in options else options
                found = next((t for t in (self.text(o, bound) for o in options) if t is not None), None)
            if found is None:
                return None
            words += found
        return tuple(words)


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


def _sequence(tokens: list[str], normal: Mapping[str, str]) -> tuple[_Part, ...]:
    """Parse a pattern; consumes the tokens up to a closing bracket."""
    options: list[tuple[_Part, ...]] = []
    parts: list[_Part] = []
    while tokens:
        token = tokens.pop(0)
        if token in ("(", "["):
            inner = _sequence(tokens, normal)
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
            parts.append(_Part(word=normal.get(token, token), written=token))
    if options:
        return (_Part(options=(*options, tuple(parts))),)
    return tuple(parts)


def _words_of(parts: Sequence[_Part]) -> Iterator[str]:
    for part in parts:
        if part.word:
            yield part.word
        for option in part.options:
            yield from _words_of(option)


def _symbols_of(parts: Sequence[_Part]) -> Iterator[str]:
    for part in parts:
        if part.symbol:
            yield part.symbol
        for option in part.options:
            yield from _symbols_of(option)

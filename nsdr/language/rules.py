"""One notation and one engine that relate texts and programs: texts are read, drawn and listed by rules, programs put in words.

A line is `SYMBOL: pattern => program`. A pattern holds words, symbols in capitals (with a digit where one occurs twice),
`(a|b c)` for alternatives and `[a]` for what may be left out. The program holds tokens and the symbols of the pattern, which
stand for their own programs. The symbols N, NS and A are noun phrases and attribute words (`Slot`): N is singular, NS plural,
OBJ and OBJS are N and NS without attribute words, A is attribute words alone; `NS&A` joins the words of both. A set of
rules may have other slots.

`SYMBOL*3` makes a rule three times as frequent in drawn texts; `N:moves:color` says to `Phrases` what a noun phrase is for, and
which attribute it must not name. A line with `<attribute>` (or `<ATTRIBUTE>`) stands for three lines, one for each attribute.
"""

import random
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Protocol, TypeVar

from nsdr.language.slots import SLOT_FORMS, Slot, filled, text_of, with_filters
from nsdr.language.writing import Writer
from nsdr.world.vocabulary import CLEVRER, NAMES, Vocabulary

Pair = tuple[str, list[str]]
"""A text or a part of one, and its postfix tokens."""

USES = {"N": "one", "NS": "counted", "A": "attribute"}
"""What a noun phrase is for, where its rule does not say it."""
OPTION_PROBABILITY = 0.6
"""Probability that a drawn text has what a rule permits to leave out (0-1)."""
_TOKEN = re.compile(r"[()\[\]|]|[^\s()\[\]|]+")
_HEAD = re.compile(r"([A-Z_]+)(?:\*(\d+))?: *(.*)")


T = TypeVar("T")


class Chooser:
    """Makes the choices of texts that are drawn: all at random."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """One of several contents; `weights` are their relative frequencies."""
        return self.rng.choices(options, weights)[0]

    vary = pick  # one of several wordings


class _Replay(Chooser):
    """Repeats a recorded path of picks, then takes the first option of every further one; wordings are drawn at random."""

    def __init__(self, path: list[tuple[int, int]], rng: random.Random) -> None:
        super().__init__(rng)
        self.path, self.depth = path, 0

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """The recorded one, or the first one, which is recorded."""
        if self.depth == len(self.path):
            self.path.append((0, len(options)))
        index = self.path[self.depth][0]
        self.depth += 1
        return options[index]


class Phrases(Protocol):
    """Describes objects in drawn texts."""

    def words(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        """Attribute words in the order color, material, shape, possibly none.

        Args:
            choose: makes the choices.
            use: how the text uses them: "one" (a single object), "attribute" (the words alone) or, of a class of objects,
                "counted", "moves" (the one object of it that moves or rests) or "enters" (the one that enters or exits).
            without: attribute that must not be among the words; "" for none.
        """
        ...


@dataclass(frozen=True)
class _Part:
    """A word (in normal form, and as it is written), a symbol, or alternatives, each a sequence of parts."""

    word: str = ""
    written: str = ""
    symbol: str = ""
    use: str = ""
    without: str = ""
    options: tuple[tuple["_Part", ...], ...] = ()

    @property
    def name(self) -> str:
        """The symbol without its digit."""
        return self.symbol.rstrip("123456789")


@dataclass(frozen=True)
class _Rule:
    parts: tuple[_Part, ...]
    program: tuple[str, ...]
    symbols: Mapping[str, _Part]
    """The symbols of the program, in its order."""
    weight: int


_Words = list[str | Slot]
_Bound = tuple[tuple[str, tuple[str, ...]], ...]
"""Symbols of a pattern with the programs that they stand for."""


class Rules:
    """A set of rules.

    Args:
        text: lines of the notation; empty lines and lines that start with # are skipped.
        slots: symbols of slots, and the words that stand for them in a text that is read.
        normal: normal forms of words. What a pattern writes "enters" is read in its normal form.
        vocabulary: of the words of noun phrases.
    """

    def __init__(
        self,
        text: str,
        slots: Mapping[str, Sequence[str]] = SLOT_FORMS,
        normal: Mapping[str, str] | None = None,
        vocabulary: Vocabulary = CLEVRER,
    ) -> None:
        self.slots, self.vocabulary = slots, vocabulary
        self._rules: dict[str, list[_Rule]] = {}
        for line in _lines(text):
            head = _HEAD.fullmatch(line)
            assert head is not None, f"no rule: {line}"
            pattern, program = head[3].split("=>")
            parts = _sequence(_TOKEN.findall(pattern), normal or {})
            in_pattern = {part.symbol: part for part in _all_parts(parts) if part.symbol}
            used = [name for token in program.split() for name in token.split("&") if name in in_pattern]
            symbols = {name: in_pattern[name] for name in used}
            rule = _Rule(parts, tuple(program.split()), symbols, int(head[2] or 1))
            self._rules.setdefault(head[1], []).append(rule)
        every_part = (part for rules in self._rules.values() for rule in rules for part in _all_parts(rule.parts))
        self.words = frozenset(part.word for part in every_part if part.word)
        self.readings = lru_cache(maxsize=1 << 15)(self._readings)

    def _readings(self, symbol: str, words: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """All programs of a text as a symbol; `#i` in a program stands for the slot at word i."""
        found = _Reader(self._rules, self.slots, words).symbol(symbol, 0)
        return tuple(dict.fromkeys(program for end, program in found if end == len(words)))

    def read(self, symbol: str, words: Sequence[str | Slot]) -> list[list[str]]:
        """All programs of a text as a symbol."""
        forms = tuple(w if isinstance(w, str) else w.form for w in words)
        found = (filled(program, words, self.vocabulary) for program in self.readings(symbol, forms))
        return [list(t) for t in dict.fromkeys(tuple(tokens) for tokens in found if tokens is not None)]

    def write(
        self, symbol: str, program: Sequence[str], forms: Sequence[Sequence[str]]
    ) -> list[str | tuple[str, int]] | None:
        """The words of the first text with a program, (symbol, i) for its slot i; None if there is none.

        Rules are tried in their order. Of alternatives the first is written, and what may be left out is, unless it holds a
        symbol of the program. Joined slots (`NS&A`) are not written.

        Args:
            symbol: of the text.
            program: tokens, with `#i` for slot i.
            forms: of each slot, the words that may stand for it when it is read, with "" if it may be left out.
        """
        found = Writer(self._rules, self.slots, program, forms).symbol(symbol, 0)
        return next((list(words) for end, words in found if end == len(program)), None)

    def draw(self, symbol: str, rng: random.Random, phrases: Phrases) -> Pair:
        """A random text of a symbol with its program."""
        while True:
            words, program = self._made(_Part(symbol=symbol), Chooser(rng), phrases)
            tokens = with_filters(program, self.vocabulary)
            if tokens is not None:
                return text_of(words, self.vocabulary), tokens

    def every(self, symbol: str, phrases: Phrases, rng: random.Random) -> Iterator[Pair]:
        """All contents of a symbol, each in one random wording.

        Args:
            symbol: such as "QUERY".
            phrases: describes objects; it has to choose among descriptions by `pick`.
            rng: draws the wordings.
        """
        path: list[tuple[int, int]] = []
        while True:
            words, program = self._made(_Part(symbol=symbol), _Replay(path, rng), phrases)
            tokens = with_filters(program, self.vocabulary)
            if tokens is not None:
                yield text_of(words, self.vocabulary), tokens
            while path and path[-1][0] + 1 == path[-1][1]:
                path.pop()
            if not path:
                return
            path[-1] = (path[-1][0] + 1, path[-1][1])

    def _made(self, part: _Part, choose: Chooser, phrases: Phrases) -> tuple[_Words, _Words]:
        """Words of a symbol and its program, slots in both."""
        if part.name in self.slots:
            form, bare = self.slots[part.name][0], self.slots[part.name][-1]
            words = () if part.name in ("OBJ", "OBJS") else phrases.words(choose, part.use, part.without)
            slot = Slot(form if words else bare, words)
            return [slot], [slot]
        rules = self._rules[part.name]
        rule = choose.pick(rules, [r.weight for r in rules])
        made = {symbol: self._made(p, choose, phrases) for symbol, p in rule.symbols.items()}
        program: _Words = []
        for token in rule.program:
            if "&" in token:
                slots = [slot for name in token.split("&") for slot in made[name][1] if isinstance(slot, Slot)]
                program.append(Slot("A", tuple(w for slot in slots for w in slot.words)))
            else:
                program += made[token][1] if token in made else [token]
        return self._said(rule.parts, {symbol: words for symbol, (words, _) in made.items()}, choose), program

    def _said(self, parts: Sequence[_Part], bound: Mapping[str, _Words], choose: Chooser) -> _Words:
        """Words of a pattern, given those of its symbols; symbols without a program take any wording."""
        words: _Words = []
        for part in parts:
            if part.word:
                words.append(part.written)
            elif part.options:
                n = len(part.options)
                weights = [OPTION_PROBABILITY / (n - 1)] * (n - 1) + [1 - OPTION_PROBABILITY]
                option = choose.vary(part.options, None if part.options[-1] else weights)
                words += self._said(option, bound, choose)
            elif part.symbol in bound:
                words += bound[part.symbol]
            elif part.name in self.slots:
                words.append(Slot(self.slots[part.name][-1], ()))
            else:
                words += self._said(choose.vary(self._rules[part.name]).parts, {}, choose)
        return words


@cache
def load_rules(vocabulary: Vocabulary, *names: str) -> Rules:
    """The rules of the files `NAME.rules` of this package, joined."""
    text = "\n".join(files("nsdr.language").joinpath(f"{name}.rules").read_text("utf-8") for name in names)
    return Rules(text, vocabulary=vocabulary)


class _Reader:
    def __init__(
        self, rules: Mapping[str, list[_Rule]], slots: Mapping[str, Sequence[str]], words: tuple[str, ...]
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
                (end, _composed(rule.program, bound))
                for rule in self.rules[name]
                for end, bound in self.sequence(rule.parts, start, ())
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
            for end, program in self.symbol(part.name, start):
                yield from self.sequence(rest, end, (*bound, (part.symbol, program)))


def _composed(program: tuple[str, ...], bound: _Bound) -> tuple[str, ...]:
    values = dict(bound)
    tokens: list[str] = []
    for token in program:
        if "&" in token:
            tokens.append("&".join(values[key][0] for key in token.split("&")))
        else:
            tokens += values.get(token, () if token.isupper() else (token,))
    return tuple(tokens)


def _lines(text: str) -> Iterator[str]:
    for line in text.splitlines():
        if "<attribute>" in line.lower() and not line.startswith("#"):
            for name in NAMES:
                yield line.replace("<attribute>", name).replace("<ATTRIBUTE>", name.upper())
        elif line.strip() and not line.startswith("#"):
            yield line


def _sequence(tokens: list[str], normal: Mapping[str, str]) -> tuple[_Part, ...]:
    """Parse a pattern; consumes the tokens up to a closing bracket."""
    options: list[tuple[_Part, ...]] = []
    parts: list[_Part] = []
    while tokens:
        token = tokens.pop(0)
        name, *how = token.split(":")
        if token in ("(", "["):
            inner = _sequence(tokens, normal)
            choices = inner[0].options if len(inner) == 1 and inner[0].options and not inner[0].word else (inner,)
            parts.append(_Part(options=(*choices, ()) if token == "[" else choices))
        elif token in (")", "]"):
            break
        elif token == "|":
            options.append(tuple(parts))
            parts = []
        elif name.isupper():
            use, without = [*how, "", ""][:2]
            parts.append(_Part(symbol=name, use=use or USES.get(name.rstrip("123456789"), ""), without=without))
        else:
            parts.append(_Part(word=normal.get(token, token), written=token))
    if options:
        return (_Part(options=(*options, tuple(parts))),)
    return tuple(parts)


def _all_parts(parts: Sequence[_Part]) -> Iterator[_Part]:
    for part in parts:
        yield part
        for option in part.options:
            yield from _all_parts(option)

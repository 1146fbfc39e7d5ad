"""Programs in words: the rules' programs are read as patterns, and the texts that stand beside them are written."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Words = tuple[str | tuple[str, int], ...]
"""Words of a text, with (symbol, i) for slot i."""


class Writer:
    """The texts of one program by a set of rules.

    Args:
        rules: rules by symbol, as in `nsdr.language.rules.Rules`.
        slots: symbols of slots, and the words that stand for them.
        program: tokens, with `#i` for slot i.
        forms: of each slot, the words that may stand for it, with "" if it may be left out.
    """

    def __init__(
        self,
        rules: Mapping[str, Sequence[Any]],
        slots: Mapping[str, Sequence[str]],
        program: Sequence[str],
        forms: Sequence[Sequence[str]],
    ) -> None:
        self.rules, self.slots, self.program, self.forms = rules, slots, list(program), forms
        self.known: dict[tuple[str, int], list[tuple[int, Words]]] = {}

    def symbol(self, name: str, start: int) -> list[tuple[int, Words]]:
        """Ends and texts of the programs from `start` on that a symbol stands for."""
        if name in self.slots:
            fits = set(self.forms_at(start)).intersection(self.slots[name])
            return [(start + 1, ((name, int(self.program[start][1:])),))] if fits else []
        if (name, start) not in self.known:
            self.known[name, start] = []  # a rule that only adds words to its own symbol writes nothing new
            found: dict[int, Words] = {}  # the first text of each end
            for rule in self.rules[name]:
                if not all(token.isupper() or token in self.program for token in rule.program):
                    continue
                for end, bound in self.sequence(rule.program, start, {}):
                    if end not in found:
                        text = self.text(rule.parts, {symbol: words for symbol, (words, _) in bound.items()})
                        found |= {} if text is None else {end: text}
            self.known[name, start] = list(found.items())
        return self.known[name, start]

    def sequence(
        self, program: tuple[str, ...], start: int, bound: dict[str, tuple[Words, list[str]]]
    ) -> Iterator[tuple[int, dict[str, tuple[Words, list[str]]]]]:
        """Ends of the programs from `start` on that a rule's program stands for, and texts and tokens of its symbols."""
        if not program:
            yield start, bound
            return
        first, rest = program[0], program[1:]
        expected = bound[first][1] if first in bound else [first]
        if first.isupper() and first not in bound:
            for end, text in self.symbol(first.rstrip("123456789"), start):
                yield from self.sequence(rest, end, {**bound, first: (text, self.program[start:end])})
            yield from self.sequence(rest, start, bound)
        elif self.program[start : start + len(expected)] == expected:
            yield from self.sequence(rest, start + len(expected), bound)
        elif "" in self.forms_at(start):
            yield from self.sequence(program, start + 1, bound)

    def forms_at(self, start: int) -> Sequence[str]:
        """The forms of the slot at a token; none for another token."""
        token = self.program[start] if start < len(self.program) else ""
        return self.forms[int(token[1:])] if token.startswith("#") else ()

    def text(self, parts: Sequence[Any], bound: Mapping[str, Words]) -> Words | None:
        """The words of a pattern; None if it needs a symbol that is neither bound nor has a text with an empty program."""
        words: Words = ()
        for part in parts:
            found: Words | None = (part.written,)
            if part.symbol in bound:
                found = bound[part.symbol]
            elif part.symbol:
                found = next((text for _, text in self.symbol(part.name, len(self.program))), None)
            elif part.options:
                needed = set(bound).intersection(_symbols_of([part]))
                options = [o for o in part.options if needed <= set(_symbols_of(o))]
                options = [()] if () in options else options
                found = next((t for t in (self.text(o, bound) for o in options) if t is not None), None)
            if found is None:
                return None
            words += found
        return words


def _symbols_of(parts: Sequence[Any]) -> Iterator[str]:
    for part in parts:
        if part.symbol:
            yield part.symbol
        for option in part.options:
            yield from _symbols_of(option)

"""The default parser: rules, and for texts that they cannot read a second parser, whose programs are checked."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self

from nsdr.errors import NsdrError, ProgramError
from nsdr.io.checkpoint import find_checkpoint, load_description
from nsdr.language.normal import normal_form
from nsdr.language.slots import Slot
from nsdr.language.texts import in_words
from nsdr.question_parser.base import Parser
from nsdr.question_parser.grammar import GrammarParser, NoReadingError
from nsdr.symbolic.program import Program

__all__ = ["AutoParser", "Checked", "says_the_same"]

_MEANINGS = """
enter: enter entering entrance
exit: exit exiting
collision: hit hitting collide colliding collision collisions
moving: moving move
stationary: stationary
before: before until
after: after once
when: when
begin: begin
end: end
not: not no
without: without
next: next
cause: cause caused why
count: many number count often
frame: frame time moment point
color: color
material: material made
shape: shape
"""
MEANINGS = {word: line.split(":")[0] for line in _MEANINGS.strip().splitlines() for word in line.split(":")[1].split()}
"""Words of normal forms that a program must express, and what they mean; orders mean themselves."""
MEANINGS |= {word: word for word in ("first", "second", "last")}
TIMES = ("before", "after", "when")
FUNCTION_WORDS = frozenset(
    """
    a all an and any are as at be between by did do each for from had has have how i if in into involve involving is it its of on
    one or other another out over scene so some such that the their them then there these they this those to up us video was were
    what which while who will with you happen happening happens kind there event events presence exist something anything thing
    's
    """.split()
)
"""Words of normal forms that say nothing by themselves."""


def says_the_same(text: str, program: Program) -> bool:
    """Whether a program, in words, says the same as a text, as far as single words tell: a check weaker than a reading.

    Both have the same attribute words, orders, negations, events and times and ask for the same, with the same objects in the
    same order on the same side of "before", "after" or "when". Every other word of the text is a function word.
    """
    try:
        said = in_words(program)
    except ProgramError:
        return False
    found, expected = _meaning(text), _meaning(said)
    if found is None or expected is None or len(found) != len(expected):
        return False
    for side, other in zip(found, expected, strict=True):
        objects, others = ([m for m in meanings if isinstance(m, Slot)] for meanings in (side, other))
        in_pair = "collision" in side and sorted(objects, key=str) == sorted(others, key=str)
        if Counter(side) != Counter(other) or not (objects == others or in_pair):
            return False
    return _ordered_objects(text) <= _ordered_objects(said)


def _meaning(text: str) -> list[list[str | Slot]] | None:
    """What the words mean before and after each word of `TIMES`; None where a word means nothing known."""
    sides: list[list[str | Slot]] = [[]]
    for word in normal_form(text).words:
        if isinstance(word, Slot):
            if word.words:
                sides[-1].append(Slot("A", word.words))
        elif word in MEANINGS:
            if MEANINGS[word] in TIMES:
                sides.append([])
            sides[-1].append(MEANINGS[word])
        elif word not in FUNCTION_WORDS:
            return None
    return sides


def _ordered_objects(text: str) -> set[tuple[str, tuple[str, ...]]]:
    """Orders with the attribute words that follow them immediately: ("first", ("red", "cube"))."""
    words = normal_form(text).words
    pairs = zip(words, words[1:], strict=False)
    return {(a, b.words) for a, b in pairs if a in ("first", "second", "last") and isinstance(b, Slot) and b.words}


class Checked(Parser):
    """Takes the programs of another parser only if they say the same as the text (`says_the_same`), with a warning in words.

    Args:
        parser: the other parser.
    """

    def __init__(self, parser: Parser) -> None:
        self.parser = parser

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """As of `Parser`."""
        found: list[Program | NsdrError] = []
        for text, program in zip(texts, self.parser.parse_batch(texts, kind), strict=True):
            if isinstance(program, NsdrError):
                found.append(program)
            elif not normal_form(text).left_out and says_the_same(text, program):
                warnings.warn(f"{text!r}: understood as {in_words(program)!r}", stacklevel=4)
                found.append(program)
            else:
                found.append(NoReadingError(f"{text!r} fits no program"))
        return found


class AutoParser(Parser):
    """Parses by rules; a text that they cannot read goes to a second parser, whose program must say the same as the text.

    Args:
        second: the second parser, or a function that loads it when it is first needed.
        extensions: also parse questions beyond CLEVRER, by rules.
    """

    def __init__(self, second: Parser | Callable[[], Parser], extensions: bool = False) -> None:
        self.grammar = GrammarParser(extensions)
        self._second, self._device = second, "cpu"

    @classmethod
    def from_checkpoint(cls, folder: str | Path, extensions: bool = False) -> Self:
        """The rules, and the networks of a checkpoint's folder, which load when they are first needed.

        Raises:
            CheckpointError: `question_parser.json` is missing or corrupt; the weights are read when they are needed.
        """
        load_description(folder, "question_parser")
        return cls(partial(_networks, folder), extensions)

    @classmethod
    def from_pretrained(cls, path_or_id: str | Path = "", device: str = "auto", extensions: bool = False) -> Self:
        """The rules, and the networks of a checkpoint, as of `PretrainedPart.from_pretrained`."""
        return cls.from_checkpoint(find_checkpoint(path_or_id or "default"), extensions).to(device)

    def to(self, device: str) -> Self:
        """Where the networks run, once they are loaded; returns the parser itself."""
        self._device = device
        if "second" in vars(self):
            self._moved(self.second)
        return self

    def save_pretrained(self, folder: str | Path, details: Mapping[str, Any] | None = None) -> None:
        """Write the networks, if the second parser has any."""
        if hasattr(self.second, "save_pretrained"):
            self.second.save_pretrained(folder, details)

    @cached_property
    def second(self) -> Parser:
        """The second parser."""
        return self._moved(self._second if isinstance(self._second, Parser) else self._second())

    def _moved(self, parser: Parser) -> Parser:
        return parser.to(self._device) if hasattr(parser, "to") else parser

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """As of `Parser`. A program of the second parser comes with a warning that says what was understood."""
        found = self.grammar.parse_batch(texts, kind)
        unread = [i for i, f in enumerate(found) if isinstance(f, NoReadingError) and not normal_form(texts[i]).left_out]
        if unread:
            for i, program in zip(unread, Checked(self.second).parse_batch([texts[i] for i in unread], kind), strict=True):
                if isinstance(program, Program):
                    found[i] = program
        return found


def _networks(folder: str | Path) -> Parser:
    from nsdr.question_parser.network import QuestionParser

    return QuestionParser.from_checkpoint(folder)

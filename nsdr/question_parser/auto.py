"""The default parser: rules, then what a text mentions, then a second parser, whose programs are checked."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from nsdr.errors import NsdrError, ProgramError
from nsdr.io.checkpoint import find_checkpoint, load_description
from nsdr.io.device import resolve_device
from nsdr.language.normal import AMBIGUOUS, FUNCTION_WORDS, MEANINGS, normal_form
from nsdr.language.slots import Slot
from nsdr.language.texts import in_words
from nsdr.question_parser.base import Parser
from nsdr.question_parser.contents import content_readings
from nsdr.question_parser.grammar import GrammarParser, NoReadingError
from nsdr.question_parser.tokenizer import split_words
from nsdr.symbolic.program import Program

__all__ = ["AutoParser", "says_the_same"]

TIMES = ("before", "after", "when")
EVENTS = ("enter", "exit", "collision", "moving", "stationary", "cause", "not", "without", "next")


def says_the_same(text: str, program: Program) -> bool:
    """Whether a program, in words, says the same as a text, as far as single words tell: a check weaker than a reading.

    Both have the same attribute words, orders, negations, events and times and ask for the same; objects and events stand in
    the same order, on the same side of "before", "after" or "when". Every other word of the text is a function word.
    """
    if AMBIGUOUS.intersection(split_words(text)) or "objects unique" in str(program):
        return False
    try:
        said = in_words(program)
    except ProgramError:
        return False
    words, expected = normal_form(text).words, normal_form(said).words
    sides, others = _meaning(words), _meaning(expected)
    if sides is None or others is None or len(sides) != len(others):
        return False
    if not _ordered_objects(words) <= _ordered_objects(expected) or _indefinite(words) != _indefinite(expected):
        return False
    return all(_fit(side, other) for side, other in zip(sides, others, strict=True))


def _meaning(words: Sequence[str | Slot]) -> list[list[str | Slot]] | None:
    """What the words mean before and after each word of `TIMES`; None where a word means nothing known."""
    sides: list[list[str | Slot]] = [[]]
    for word in words:
        if isinstance(word, Slot):
            sides[-1].append(word)
        elif word in MEANINGS:
            if MEANINGS[word] in TIMES:
                sides.append([])
            sides[-1].append(MEANINGS[word])
        elif word not in FUNCTION_WORDS:
            return None
    return sides


def _fit(found: list[str | Slot], expected: list[str | Slot]) -> bool:
    """Whether two lists of meanings are the same but for the place of orders, of what is asked for, and of "object"."""
    objects, others = ([m for m in meanings if isinstance(m, Slot) and m.form != "O"] for meanings in (found, expected))
    if objects != others and ("collision" not in found or sorted(objects, key=str) != sorted(others, key=str)):
        return False
    bare = Slot("O", ())
    if bare in found and bare not in expected:
        return False
    words, other_words = ([m for m in meanings if isinstance(m, str)] for meanings in (found, expected))
    events, other_events = ([m for m in meanings if m in EVENTS] for meanings in (words, other_words))
    return Counter(words) == Counter(other_words) and events == other_events


def _ordered_objects(words: Sequence[str | Slot]) -> set[tuple[str, tuple[str, ...]]]:
    """Orders with the attribute words that follow them immediately: ("first", ("red", "cube"))."""
    return {
        (a, b.words) for a, b in pairwise(words) if a in ("first", "second", "last") and isinstance(b, Slot) and b.words
    }


def _indefinite(words: Sequence[str | Slot]) -> set[tuple[str, Slot]]:
    """Singular noun phrases that stand for any object, plural ones with "the", and "the" without a noun phrase."""
    found = set()
    for a, b in pairwise((*words, "")):
        if isinstance(b, Slot) and (a in ("a", "any", "another", "each") if b.form in ("N", "O") else a == "the"):
            found.add((str(a), b))
        elif a == "the" and isinstance(b, str) and b not in MEANINGS:
            found.add((b, Slot("O", ())))
    return found


class AutoParser(Parser):
    """Parses by rules; a text that they cannot read, by what it mentions (`content_readings`).

    What that does not tell goes to a second parser, whose program must say the same as the text.

    Args:
        second: the second parser, or a function that loads it when it is first needed.
        extensions: also parse questions beyond CLEVRER, by rules.
    """

    def __init__(self, second: Parser | Callable[[], Parser], extensions: bool = False) -> None:
        self.grammar = GrammarParser(extensions)
        self._second, self._device = second, ""

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
        """Where the networks run, once they are loaded, as of `PretrainedPart.to`; returns the parser itself."""
        self._device = device if device == "auto" else str(resolve_device(device))
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
        return parser.to(self._device) if self._device and hasattr(parser, "to") else parser

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """As of `Parser`. A program that is not of the rules comes with a warning that says what was understood."""
        found = self.grammar.parse_batch(texts, kind)
        unread: list[int] = []
        for i, text in enumerate(texts):
            if not isinstance(found[i], NoReadingError) or normal_form(text).left_out:
                continue
            readings = content_readings(text, kind)
            if len(readings) == 1:
                found[i] = _understood(text, Program.parse(readings[0]))
            else:
                unread.append(i)
        if unread:
            programs = self.second.parse_batch([texts[i] for i in unread], kind)
            for i, program in zip(unread, programs, strict=True):
                if isinstance(program, Program) and says_the_same(texts[i], program):
                    found[i] = _understood(texts[i], program)
        return found


def _understood(text: str, program: Program) -> Program:
    warnings.warn(f"{text!r}: understood as {in_words(program)!r}", stacklevel=4)
    return program


def _networks(folder: str | Path) -> Parser:
    from nsdr.question_parser.network import QuestionParser

    return QuestionParser.from_checkpoint(folder)

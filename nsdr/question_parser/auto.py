"""The default parser: rules, then what a text mentions, then a second parser, whose programs are checked."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from nsdr.errors import NsdrError, ProgramError
from nsdr.io.checkpoint import find_checkpoint, load_description
from nsdr.io.device import resolve_device
from nsdr.language.normal import AMBIGUOUS, CLAUSE_STARTS, FUNCTION_WORDS, MEANINGS, QUESTION_STARTS, normal_form
from nsdr.language.slots import Slot
from nsdr.language.texts import in_words, kind_of
from nsdr.question_parser.base import Parser
from nsdr.question_parser.contents import ASKED, content_readings
from nsdr.question_parser.grammar import GrammarParser, NoReadingError, read_as
from nsdr.question_parser.tokenizer import split_words
from nsdr.symbolic.program import Program

ANY_OBJECT = Slot("O", ())
"""The noun phrase "object", which programs in words have where a text says "what"."""
_UNREAD = re.compile(
    r"^(?:be|do|have|will|can) not\b|\b(?:you|i|we|they) (?:do|think|say)\b|\bhave to\b|\bthe (?:NS|OS) not\b"
)
"""Normal forms of texts that expect an answer, ask what somebody does, or what has to be: "Doesn't it move?"."""
_TAG = re.compile(
    r", *(?:do|does|did|is|are|was|were|has|have|had|will|would|right|no)(?:n't| not)?(?: (?:it|they|there))?\W*$"
)
"""Of texts such as "It moves, doesn't it?"."""


def says_the_same(text: str, program: Program) -> bool:
    """Whether a program, in words, says the same as a text, as far as single words tell: a check weaker than a reading.

    Both ask for the same, and have the same other meanings and the same noun phrases, each in the same order. Every other word
    of the text is a function word.
    """
    if AMBIGUOUS.intersection(split_words(text)) or "objects unique" in str(program):
        return False
    try:
        said = in_words(program)
    except ProgramError:
        return False
    normal = normal_form(text)
    if _TAG.search(text.lower()) or _UNREAD.search(" ".join(normal.forms)):
        return False
    if kind_of(program) == "choice" and not (QUESTION_STARTS | CLAUSE_STARTS).isdisjoint(normal.forms[:1]):
        return False
    if kind_of(program) == "descriptive" and "will" in normal.forms and "next" not in normal.forms:
        return False
    words, expected = normal.words, normal_form(said).words
    is_known = all(isinstance(word, Slot) or word in MEANINGS or word in FUNCTION_WORDS for word in words)
    is_named = ANY_OBJECT in expected or ANY_OBJECT not in words
    return is_known and is_named and _meanings(words) == _meanings(expected)


def _meanings(words: Sequence[str | Slot]) -> tuple[Collection[object], ...]:
    """What is asked for, the other meanings, and the noun phrases but "object", each in order; and which are indefinite."""
    meanings = [MEANINGS[word] for word in words if isinstance(word, str) and word in MEANINGS]
    asked, others = ([m for m in meanings if (m in ASKED) == is_asked] for is_asked in (True, False))
    return asked, others, [w for w in words if isinstance(w, Slot) and w != ANY_OBJECT], _indefinite(words)


def _indefinite(words: Sequence[str | Slot]) -> set[tuple[str, Slot]]:
    """Singular noun phrases that stand for any object, plural ones with "the", and "the" without a noun phrase."""
    found = set()
    for a, b in pairwise((*words, "")):
        if isinstance(b, Slot) and (a in ("a", "any", "another", "each") if b.form in ("N", "O") else a == "the"):
            found.add((str(a), b))
        elif a == "the" and isinstance(b, str) and b not in MEANINGS:
            found.add((b, ANY_OBJECT))
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
        """The rules, and the networks of a checkpoint, as in `PretrainedPart.from_pretrained`."""
        return cls.from_checkpoint(find_checkpoint(path_or_id or "default"), extensions).to(device)

    def to(self, device: str) -> Self:
        """Where the networks run, once they are loaded, as in `PretrainedPart.to`; returns the parser itself."""
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
        """See `Parser`. A program that is not of the rules has a note that says how its text was read."""
        found = self.grammar.parse_batch(texts, kind)
        unread: list[int] = []
        for i, text in enumerate(texts):
            if not isinstance(found[i], NoReadingError) or normal_form(text).left_out:
                continue
            readings = content_readings(text, kind)
            if len(readings) == 1:
                found[i] = Program.parse(readings[0]).with_notes(read_as(readings[0]))
            else:
                unread.append(i)
        if unread:
            programs = self.second.parse_batch([texts[i] for i in unread], kind)
            for i, program in zip(unread, programs, strict=True):
                if isinstance(program, Program) and says_the_same(texts[i], program):
                    found[i] = program.with_notes(read_as(program))
        return found


def _networks(folder: str | Path) -> Parser:
    from nsdr.question_parser.network import QuestionParser

    return QuestionParser.from_checkpoint(folder)

"""The word files: lists of words, and replacements that stand one after the other, each with the sentence that it is for.

A line of a file of replacements is `pattern => replacement`; `<name>` in a pattern stands for what a line `<name> = ...` says,
and `<adjective>`, `<material>` and `<shape>` for any such word of the vocabulary. A line with `<noun>` stands for one line for
each noun for a shape, and for "object"; `<nouns>` is its plural.
The indented line below it, `text -> result`, is the sentence that the line is for, and what becomes of it. A list of words is
`head: word word ...`, continued on indented lines. Lines that start with # are comments.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files

from nsdr.errors import DataError
from nsdr.language.slots import Slot
from nsdr.world.vocabulary import CLEVRER, Vocabulary

_SLOT = re.compile(r"\b(?:N|NS|O|OS|A)\b")
_GROUP = re.compile(r"\\(\d)")


@dataclass(frozen=True)
class Replacement:
    """A line of a file of replacements.

    Attributes:
        pattern: what is replaced.
        template: what stands for it, with `\\1` for the first group of the pattern.
        text, result: the sentence that the line is for, and what becomes of it.
    """

    pattern: re.Pattern[str]
    template: str
    text: str
    result: str


def read_replacements(content: str, name: str, vocabulary: Vocabulary = CLEVRER) -> tuple[Replacement, ...]:
    """The replacements of a file's content, in its order.

    Args:
        content: of the file.
        name: of the file, for errors.
        vocabulary: of the words of objects.

    Raises:
        DataError: a line has no replacement or no sentence, or a pattern stands twice; names the file and the line.
    """
    names = {
        "<adjective>": _any_of(vocabulary.adjectives),
        **{f"<{attribute}>": _any_of(words) for attribute, words in vocabulary.words.items()},
    }
    nouns = {"object": "objects"} | {one: many for shape in vocabulary.shapes for one, many in shape.plurals.items()}
    found: dict[str, Replacement] = {}
    lines = _lines(content)
    while lines:
        line = lines.pop(0)
        if line.startswith("<") and " = " in line:
            key, _, value = line.partition(" = ")
            names[key] = value
            continue
        pattern, arrow, template = line.partition(" =>")
        text, to, result = (lines.pop(0) if lines and lines[0].startswith(" ") else "").partition("->")
        if not arrow:
            raise DataError(f"{name}.txt: {line!r} has no replacement; write it behind '=>'")
        if not to:
            raise DataError(f"{name}.txt: {line!r} has no sentence; write one below it, as 'text -> result'")
        for key in reversed(names):
            pattern = pattern.replace(key, names[key])
        for one, many in nouns.items() if "<noun>" in pattern else [("", "")]:
            of_noun, template_of_noun = (
                part.replace("<nouns>", many).replace("<noun>", one) for part in (pattern, template)
            )
            if of_noun in found:
                raise DataError(f"{name}.txt: {line!r} stands twice; remove one of the lines")
            replacement = f" {template_of_noun.strip()} "
            found[of_noun] = Replacement(_compiled(of_noun), replacement, text.strip(), result.strip())
    return tuple(found.values())


_compiled = cache(re.compile)
"""Patterns without words of objects are the same for all vocabularies."""


def _any_of(words: Iterable[str]) -> str:
    return f"(?:{'|'.join(words)})"


def read_word_lists(content: str, name: str) -> dict[str, list[str]]:
    """The words of each head of a file's content.

    Raises:
        DataError: a word stands twice below a head in capitals, or below two others; names the file and the word.
    """
    found: dict[str, list[str]] = {}
    heads: dict[tuple[str, str], str] = {}
    for line in _lines(content):
        if not line.startswith(" "):
            head, _, line = line.partition(":")
        for word in line.split():
            other = heads.setdefault((head if head.isupper() else "", word), head)
            if other != head or word in found.get(head, []):
                raise DataError(f"{name}.txt: {word!r} stands under {other!r} and {head!r}; remove one of them")
            found.setdefault(head, []).append(word)
    return found


def _lines(content: str) -> list[str]:
    return [line for line in content.splitlines() if line and not line.startswith("#")]


def _content(name: str) -> str:
    return files("nsdr.language").joinpath(f"{name}.txt").read_text("utf-8")


def pattern_words(name: str) -> set[str]:
    """The words of English in the patterns and replacements of the file `NAME.txt`, without those of examples."""
    found: set[str] = set()
    for line in _lines(_content(name)):
        if not line.startswith(" "):
            line = re.sub(r"<[a-z ]+>|\\.|[a-z](?=\])", " ", line).replace("[", "")  # summari[sz]e
            for variant in (re.sub(r"([a-z])\?", r"\1", line), re.sub(r"[a-z]\?", "", line)):  # colou?r
                found.update(re.findall(r"(?<![A-Za-z?])[a-z]+", variant))
    return found


@cache
def replacements(name: str, vocabulary: Vocabulary = CLEVRER) -> tuple[Replacement, ...]:
    """The replacements of the file `NAME.txt`."""
    return read_replacements(_content(name), name, vocabulary)


def word_lists(name: str) -> dict[str, list[str]]:
    """The word lists of the file `NAME.txt`."""
    return read_word_lists(_content(name), name)


def rewritten(text: str, name: str, vocabulary: Vocabulary = CLEVRER) -> str:
    """A text with the replacements of the file `NAME.txt`."""
    for line in replacements(name, vocabulary):
        changed = line.pattern.sub(line.template, text)
        if changed != text:
            text = " ".join(changed.split())
    return text


def rewritten_words(words: Sequence[str | Slot], name: str) -> list[str | Slot]:
    """Words with the replacements of the file `NAME.txt`; noun phrases go where the replacements put them.

    They are replaced by their forms, so the file has no words of objects.
    """
    slots = [word for word in words if isinstance(word, Slot)]
    found, order = _rewritten_forms(" ".join(word if isinstance(word, str) else word.form for word in words), name)
    numbers = iter(order)
    return [slots[next(numbers)] if _SLOT.fullmatch(word) else word for word in found]


@lru_cache(maxsize=1 << 15)
def _rewritten_forms(text: str, name: str) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """The words of a text of forms after all replacements, and which of its noun phrases each remaining one is."""
    order = list(range(_slots_in(text)))
    for line in replacements(name):
        for match in reversed(list(line.pattern.finditer(text))):
            start, end = match.span()
            kept: list[int] = []
            for group in _GROUP.findall(line.template):
                first, last = match.span(int(group))
                kept += order[_slots_in(text[:first]) : _slots_in(text[:last])] if first >= 0 else []
            order[_slots_in(text[:start]) : _slots_in(text[:end])] = kept
            text = text[:start] + match.expand(line.template) + text[end:]
        text = " ".join(text.split())
    return tuple(text.split()), tuple(order)


def _slots_in(text: str) -> int:
    return len(_SLOT.findall(text))

"""The normal form of a text: one spelling, one word for each meaning, noun phrases found, the question before its clauses.

"When the metallic ball comes into view, how many blocks aren't moving?" becomes "how many cubes be stationary when the metal
sphere enter". The network reads normal forms, and so do the rules that check its programs (`grammar.english`).
"""

import re
import string
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from nsdr.errors import QuestionError
from nsdr.language.english import ENGLISH
from nsdr.language.lexicon import (
    ADJECTIVES,
    CLAUSE_STARTS,
    FORMS,
    NOUNS,
    OTHER_WORDS,
    QUESTION_STARTS,
    SHORT_CORRECTABLE,
)
from nsdr.language.phrases import PHRASES
from nsdr.language.rules import Slot
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["Normal", "normal_form"]

MIN_CORRECTED_LETTERS = 4
"""Shorter words are not corrected, and only to words that are longer or in `SHORT_CORRECTABLE`."""
LONG_LETTERS = 7
"""Misspelt words are corrected to any known word of at least so many letters."""
_TOKEN = re.compile(r"'s\b|[^\W_]+|[,.;:]")
_CONTRACTIONS = tuple(
    (re.compile(pattern), words)
    for pattern, words in (
        (r"[\u2018\u2019`]", "'"),
        (r"\bwon't\b", "will not"),
        (r"\b(?:can't|cannot)\b", "can not"),
        (r"n't\b", " not"),
        (r"'ll\b", " will"),
        (r"'re\b", " are"),
        (r"'ve\b", " have"),
        (r"'d\b", " would"),
        (r"\bi'm\b", "i am"),
        (r"\b(what|where|there|who|it|that|which|how|here|when|why)'s\b", r"\1 is"),
        (r"\bwhats\b", "what is"),
        (r"\bwhich (?:thing|object)s?(?= (?:caused?s?|led|leads|made|makes|triggered)\b)", "which"),
        (r"\bwhich (?:thing|object)s?(?= (?:is|was|are|were) (?:not )?responsible)", "which"),
        (r"\bcollision events?\b", "collisions"),
        (r"\bnext things?\b", "next event"),
        (r"\bof (?:the following|these) (?:things|objects)\b", "of the following"),
        (r"\bthe (first|second|last)(?: one)? (to|that|which)\b", r"the \1 object \2"),
        (r"\btheres\b", "there is"),
        (r"\bgoing to be\b", "going to"),
        (r"\bcolou?red\b", ""),
        (r"\bnothing to do with\b", "no part in"),
        (r"\b(any|some)thing\b|\banyone\b", "any object"),
        (r"\bno ?thing\b", "no object"),
        (r"\ban(?:other one)\b", "another object"),
        (r"\ban\b", "a"),
    )
)
_CATEGORY = {word: name for name, words in ATTRIBUTES.items() for word in words}
_BREAKS = frozenset(",.;:")


@dataclass(frozen=True)
class Normal:
    """A text in normal form.

    Attributes:
        words: words and noun phrases in order.
        corrections: misspelt words with what they were read as.
        left_out: unknown words that were ignored.
    """

    words: tuple[str | Slot, ...]
    corrections: tuple[tuple[str, str], ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The words, separated by spaces; what the network reads."""
        return " ".join(w if isinstance(w, str) else w.text for w in self.words)

    @property
    def forms(self) -> tuple[str, ...]:
        """The words, with the form of each noun phrase ("N", "NS", "O", "OS" or "A") in its place."""
        return tuple(w if isinstance(w, str) else w.form for w in self.words)


def normal_form(text: str, unknown: str = "error") -> Normal:
    """The normal form of a text.

    Args:
        text: English text.
        unknown: what to do with an unknown word: "error", "keep", or "ignore" to leave it out.

    Raises:
        QuestionError: an unknown word that is no misspelling of a known one; names it.
    """
    normal = _normal(text, unknown == "keep")
    if normal.left_out and unknown == "error":
        raise QuestionError(f"unknown word {normal.left_out[0]!r} in {text!r}")
    return normal


@lru_cache(maxsize=1 << 12)
def _normal(text: str, is_kept: bool) -> Normal:
    """The normal form, with unknown words as they are (`is_kept`), or corrected or left out."""
    words, corrections, left_out = _known_words(text, is_kept)
    parts = _in_order(_with_noun_phrases(words))
    slots = [part for part in parts if isinstance(part, Slot)]
    rewritten = _rewritten(" ".join(part if isinstance(part, str) else part.form for part in parts))
    remaining = iter(slots)
    forms = frozenset(("N", "NS", "O", "OS", "A"))
    return Normal(tuple(next(remaining) if word in forms else word for word in rewritten), corrections, left_out)


def _known_words(text: str, is_kept: bool) -> tuple[list[str], tuple[tuple[str, str], ...], tuple[str, ...]]:
    """Normal forms of the words, the corrected words, and those that are left out."""
    text = text.lower()
    for pattern, replacement in _CONTRACTIONS:
        text = pattern.sub(replacement, text)
    words: list[str] = []
    corrections: list[tuple[str, str]] = []
    left_out: list[str] = []
    for word in _TOKEN.findall(text):
        known = word if word in _KNOWN or word in _BREAKS or is_kept else corrected(word)
        if not known:
            left_out.append(word)
            continue
        if known != word:
            corrections.append((word, known))
        words += FORMS.get(known, known).split()
    return words, tuple(corrections), tuple(left_out)


@lru_cache(maxsize=1 << 12)
def corrected(word: str) -> str:
    """The only known word that a misspelt word can be; "" if there is none or several.

    One letter may be wrong, missing, too much, or two neighbours exchanged; the first letter must be right, and all be Latin.
    """
    if len(word) < MIN_CORRECTED_LETTERS or word in OTHER_WORDS or not word.isascii():
        return ""
    near: set[str] = set()
    for i in range(1, len(word) + 1):
        head, tail = word[:i], word[i:]
        near.update(head + letter + tail for letter in string.ascii_lowercase)
        if tail:
            near.add(head + tail[1:])
            near.update(head + letter + tail[1:] for letter in string.ascii_lowercase)
        if len(tail) > 1:
            near.add(head + tail[1] + tail[0] + tail[2:])
    found = sorted(near & _CORRECTABLE, key=lambda candidate: candidate[-1] != word[-1])  # "sphers" is plural
    meanings = {_meaning(candidate) for candidate in found}
    return found[0] if len(meanings) == 1 else ""


def _meaning(word: str) -> object:
    return NOUNS.get(word, ("",))[:1] if word in NOUNS else ADJECTIVES.get(word) or FORMS.get(word, word)


def _with_noun_phrases(words: Sequence[str]) -> list[str | Slot]:
    """Words with noun phrases and attribute words joined; "that be red" and "made of metal" join their noun phrase."""
    parts: list[str | Slot] = []
    attributes: list[str] = []
    for word in words:
        if word in ADJECTIVES:
            attributes.append(ADJECTIVES[word])
            continue
        if word in NOUNS or (word in ("one", "ones") and attributes):
            shape, form = NOUNS.get(word) or ("", "NS" if word == "ones" else "N")
            _append_slot(parts, form, [*attributes, *([shape] if shape else [])])
            attributes = []
            continue
        if attributes and word != ",":
            _append_slot(parts, "A", attributes)
            attributes = []
        if word != "," or not attributes:
            parts.append(word)
    if attributes:
        _append_slot(parts, "A", attributes)
    return _with_postmodifiers(parts)


def _append_slot(parts: list[str | Slot], form: str, words: Sequence[str]) -> None:
    """Append a noun phrase; words that name an attribute twice stay apart, so that no rule fits."""
    if len({_CATEGORY[w] for w in words}) < len(words):
        parts += [Slot("A", (word,)) for word in words]
        return
    ordered = tuple(sorted(words, key=lambda w: list(ATTRIBUTES).index(_CATEGORY[w])))
    bare = {"N": "O", "NS": "OS"}
    parts.append(Slot(form if ordered else bare[form], ordered))


_POSTMODIFIERS = (
    ("that", "be", "made", "of"),
    ("which", "be", "made", "of"),
    ("made", "of"),
    ("made", "out", "of"),
    ("made", "from"),
    ("that", "be"),
    ("which", "be"),
)


def _with_postmodifiers(parts: list[str | Slot]) -> list[str | Slot]:
    i = 0
    while i < len(parts):
        noun = parts[i]
        for words in _POSTMODIFIERS:
            end = i + 1 + len(words)
            attribute = parts[end] if end < len(parts) else ""
            if not isinstance(noun, Slot) or noun.form == "A" or not isinstance(attribute, Slot):
                continue
            if attribute.form == "A" and tuple(parts[i + 1 : end]) == words:
                joined: list[str | Slot] = []
                _append_slot(joined, "NS" if noun.form.endswith("S") else "N", (*noun.words, *attribute.words))
                parts[i : end + 1] = joined
                break
        i += 1
    return parts


def _in_order(parts: list[str | Slot]) -> list[str | Slot]:
    """The question first and a clause in front of it last; without commas and stops."""
    split = _question_start(parts) if parts and parts[0] in CLAUSE_STARTS else 0
    ordered = [*parts[split:], *parts[:split]]
    return [part for part in ordered if part not in _BREAKS]


def _question_start(parts: Sequence[str | Slot]) -> int:
    for i in range(2, len(parts)):
        if parts[i - 1] in _BREAKS and parts[i] in QUESTION_STARTS:
            return i
    for i in range(2, len(parts)):
        if parts[i] in ("how", "what", "which", "why"):
            return i
        follows = parts[i + 1] if i + 1 < len(parts) else ""
        if parts[i] in ("be", "do") and parts[i - 1] != "there" and follows in ("there", "any", "a", "no"):
            return i
    return 0


@lru_cache(maxsize=1 << 15)
def _rewritten(text: str) -> tuple[str, ...]:
    for pattern, replacement in PHRASES:
        changed = pattern.sub(replacement, text)
        if changed != text:
            text = " ".join(changed.split())
    return tuple(text.split())


def _words_of_patterns() -> set[str]:
    found: set[str] = set()
    for pattern, _ in PHRASES:
        found.update(re.findall(r"(?<![\\A-Za-z])[a-z]+", re.sub(r"\\[a-zA-Z]", " ", pattern.pattern)))
    return found


_CENTRAL = frozenset(
    FORMS.keys()
    | {word for form in FORMS.values() for word in form.split()}
    | ADJECTIVES.keys()
    | NOUNS.keys()
    | ENGLISH.words
)
_KNOWN = frozenset({"'s", "one", "ones"} | _CENTRAL | QUESTION_STARTS | CLAUSE_STARTS | _words_of_patterns())
"""All words that a text may have."""
_CORRECTABLE = frozenset(
    {word for word in _CENTRAL if len(word) > MIN_CORRECTED_LETTERS or word in SHORT_CORRECTABLE}
    | {word for word in _KNOWN if len(word) >= LONG_LETTERS}
)
"""Words that misspelt ones are corrected to."""

"""The normal form of a text: one spelling, one word for each meaning, noun phrases found, the question before its clauses.

"When the metallic ball comes into view, how many blocks aren't moving?" becomes "how many cubes be stationary when the metal
sphere enter". The network reads normal forms, and so do the rules (read_english.rules). Spellings, words and phrases are in
spellings.txt, lexicon.txt and phrases.txt.
"""

import re
import string
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

from nsdr.language.slots import Slot, joined, names_twice
from nsdr.language.texts import english
from nsdr.language.words import replacements, rewritten, rewritten_words, word_lists
from nsdr.world.vocabulary import CLEVRER, Vocabulary

MIN_CORRECTED_LETTERS = 4
"""Shorter words are not corrected, and only to words that are longer or among the lexicon's SHORT ones."""
LONG_LETTERS = 7
"""Misspelt words are corrected to any known word of at least so many letters."""
_TOKEN = re.compile(r"'s\b|[^\W_]+|[,.;:]")
_BREAKS = frozenset(",.;:")
_ORDERS = ("first", "second", "last")


_LEXICON, _MEANINGS = word_lists("lexicon"), word_lists("meanings")
QUESTION_STARTS = frozenset(_LEXICON.pop("QUESTION"))
CLAUSE_STARTS = frozenset(_LEXICON.pop("CLAUSE"))
_SHORT = frozenset(_LEXICON.pop("SHORT"))
OTHER_WORDS = frozenset(_LEXICON.pop("OTHER"))
"""Words that are near to known ones and mean something else; they are not corrected."""
FUNCTION_WORDS = frozenset(_MEANINGS.pop("FUNCTION"))
"""Words of normal forms that say nothing by themselves."""
AMBIGUOUS = frozenset(_MEANINGS.pop("AMBIGUOUS"))
"""Words of texts that the phrases rewrite in one of several senses."""
MEANINGS = {word: meaning for meaning, words in _MEANINGS.items() for word in words}
"""Words of normal forms that a program must express, and what they mean."""
FORMS = {word: form for form, words in _LEXICON.items() for word in words}
"""Word -> its normal form."""


@dataclass(frozen=True)
class Normal:
    """A text in normal form.

    Attributes:
        words: words and noun phrases in order.
        corrections: misspelt words with what they were read as.
        left_out: unknown words that were ignored.
        is_hedged: whether hedges ("probably") were left out.
        vocabulary: of the words of objects.
    """

    words: tuple[str | Slot, ...]
    corrections: tuple[tuple[str, str], ...]
    left_out: tuple[str, ...]
    is_hedged: bool
    vocabulary: Vocabulary

    @property
    def text(self) -> str:
        """The words, separated by spaces; what the network reads."""
        return joined(self.words, self.vocabulary)

    @property
    def forms(self) -> tuple[str, ...]:
        """The words, with the form of each noun phrase ("N", "NS", "O", "OS" or "A") in its place."""
        return tuple(w if isinstance(w, str) else w.form for w in self.words)


@lru_cache(maxsize=1 << 12)
def normal_form(text: str, keep_unknown: bool = False, vocabulary: Vocabulary = CLEVRER) -> Normal:
    """The normal form of a text.

    Args:
        text: English text.
        keep_unknown: leave unknown words as they are; they are corrected or left out otherwise.
        vocabulary: of the words of objects.
    """
    spelt = rewritten(re.sub("[\u2018\u2019`]", "'", text.lower()), "spellings", vocabulary)
    unhedged = rewritten(spelt, "hedges")
    words, corrections, left_out = _known_words(unhedged, keep_unknown, vocabulary)
    found = rewritten_words(_in_order(_with_noun_phrases(words, vocabulary)), "phrases")
    return Normal(tuple(found), corrections, left_out, unhedged != spelt, vocabulary)


def _known_words(
    text: str, keep_unknown: bool, vocabulary: Vocabulary
) -> tuple[list[str], tuple[tuple[str, str], ...], tuple[str, ...]]:
    """Normal forms of the words, the corrected words, and those that are left out."""
    all_known = known_words(vocabulary)
    words: list[str] = []
    corrections: list[tuple[str, str]] = []
    left_out: list[str] = []
    for word in _TOKEN.findall(text):
        known = word if word in all_known or word in _BREAKS or keep_unknown else corrected(word, vocabulary)
        if not known:
            left_out.append(word)
            continue
        if known != word:
            corrections.append((word, known))
        words += FORMS.get(known, known).split()
    return words, tuple(corrections), tuple(left_out)


@lru_cache(maxsize=1 << 12)
def corrected(word: str, vocabulary: Vocabulary) -> str:
    """The only known word that a misspelt word can be; "" if there is none or several.

    One letter may be wrong, missing, too much, or two neighbours exchanged; the first letter must be right, and all be Latin.
    """
    if len(word) < MIN_CORRECTED_LETTERS or word in OTHER_WORDS or not word.isascii():
        return ""
    near = one_letter_off(word) & _correctable(vocabulary)
    found = sorted(near, key=lambda other: (other[-1] != word[-1], other in FORMS, other))  # "sphers" is plural
    meanings = {_meaning(candidate, vocabulary) for candidate in found}
    return found[0] if len(meanings) == 1 else ""


def one_letter_off(word: str) -> set[str]:
    """What a word may be misspelt from, by one letter behind the first."""
    near: set[str] = set()
    for i in range(1, len(word) + 1):
        head, tail = word[:i], word[i:]
        near.update(head + letter + tail for letter in string.ascii_lowercase)
        if tail:
            near.add(head + tail[1:])
            near.update(head + letter + tail[1:] for letter in string.ascii_lowercase)
        if len(tail) > 1:
            near.add(head + tail[1] + tail[0] + tail[2:])
    return near


def _meaning(word: str, vocabulary: Vocabulary) -> object:
    if word in vocabulary.nouns:
        return vocabulary.nouns[word][:1]
    return vocabulary.adjectives.get(word) or FORMS.get(word, word)


def _with_noun_phrases(words: Sequence[str], vocabulary: Vocabulary) -> list[str | Slot]:
    """Words, in which noun phrases and attribute words are joined.

    >>> normal_form("How many cubes made of metal enter?").text
    'how many metal cubes enter'
    >>> normal_form("Does the grey ball exit after the metal one?").text  # "one" has the shape of the noun before it
    'do the gray sphere exit after the metal sphere'
    """
    adjectives, nouns = vocabulary.adjectives, vocabulary.nouns
    parts: list[str | Slot] = []
    attributes: list[str] = []
    last_shape = ""
    for word in words:
        if word in adjectives:
            attributes.append(adjectives[word])
            continue
        if word in nouns or (word in ("one", "ones") and attributes):
            has_shape = any(vocabulary.attributes[w] == "shape" for w in attributes)
            one = ("" if has_shape else last_shape, "NS" if word == "ones" else "N")  # "the red cube and the blue one"
            shape, form = nouns.get(word, one)
            last_shape = shape
            _append_slot(parts, form, [*attributes, *([shape] if shape else [])], vocabulary)
            attributes = []
            continue
        if attributes and word != ",":
            _append_slot(parts, "A", attributes, vocabulary)
            attributes = []
        if word != "," or not attributes:
            parts.append(word)
    if attributes:
        _append_slot(parts, "A", attributes, vocabulary)
    return _with_pairs(_with_postmodifiers(parts, vocabulary), vocabulary)


def _with_pairs(parts: list[str | Slot], vocabulary: Vocabulary) -> list[str | Slot]:
    """Words, in which two objects that share a noun have one each.

    >>> normal_form("Do the red and the blue cube collide?").text
    'do the red cube and the blue cube collide'
    >>> normal_form("Do the red and blue cubes collide?").text
    'do the red cube and the blue cube collide'
    """
    for i in range(1, len(parts) - 2):
        end = i + 3 if parts[i + 2] == "the" else i + 2
        first, second = parts[i], parts[end] if end < len(parts) else ""
        if parts[i - 1] != "the" or parts[i + 1] != "and" or not isinstance(first, Slot) or first.form != "A":
            continue
        if isinstance(second, Slot) and (second.form == "NS" or (second.form == "N" and end == i + 3)):
            named = {vocabulary.attributes[w] for w in first.words}
            both = [w for w in second.words if vocabulary.attributes[w] not in named]
            pair = Slot("N", vocabulary.in_order((*first.words, *both))), "and", "the", Slot("N", second.words)
            return [*parts[:i], *pair, *parts[end + 1 :]]
    return parts


def _append_slot(parts: list[str | Slot], form: str, words: Sequence[str], vocabulary: Vocabulary) -> None:
    """Append a noun phrase; words that name an attribute twice stay apart, so that no rule fits."""
    if names_twice(words, vocabulary):
        parts += [Slot("A", (word,)) for word in words]
        return
    parts.append(Slot(form if words else {"N": "O", "NS": "OS"}[form], vocabulary.in_order(words)))


POSTMODIFIERS = {
    ("that", "be", "made", "of"): ("the cube that is made of metal", "the metal cube"),
    ("which", "be", "made", "of"): ("the cube which is made of metal", "the metal cube"),
    ("made", "of"): ("the cube made of metal", "the metal cube"),
    ("made", "out", "of"): ("the cube made out of metal", "the metal cube"),
    ("made", "from"): ("the cube made from metal", "the metal cube"),
    ("that", "be"): ("the cube that is red", "the red cube"),
    ("which", "be"): ("the cube which is red", "the red cube"),
    (): ("is anything red moving", "be any red object moving"),
}
"""Words between a noun and an attribute that belongs to it, each with a text that has them and its normal form."""


def _with_postmodifiers(parts: list[str | Slot], vocabulary: Vocabulary) -> list[str | Slot]:
    """Words, in which attributes behind a noun (`POSTMODIFIERS`) have joined it."""
    i = 0
    while i < len(parts):
        noun = parts[i]
        for words in POSTMODIFIERS:
            end = i + 1 + len(words)
            attribute = parts[end] if end < len(parts) else ""
            if not words and (i == 0 or parts[i - 1] not in ("any", "no")):  # "anything red"
                continue
            if not isinstance(noun, Slot) or noun.form == "A" or not isinstance(attribute, Slot):
                continue
            if attribute.form == "A" and tuple(parts[i + 1 : end]) == words:
                both: list[str | Slot] = []
                form = "NS" if noun.form.endswith("S") else "N"
                _append_slot(both, form, (*noun.words, *attribute.words), vocabulary)
                parts[i : end + 1] = both
                break
        i += 1
    return parts


def _in_order(parts: list[str | Slot]) -> list[str | Slot]:
    """The question first and a clause in front of it last; without commas and stops."""
    parts = _without_front(parts)
    split = _question_start(parts) if parts and parts[0] in CLAUSE_STARTS else 0
    ordered = [*parts[split:], *parts[:split]]
    return [part for part in ordered if part not in _BREAKS]


def _without_front(parts: list[str | Slot]) -> list[str | Slot]:
    """A text with what stands before its first break in the place of "it", "its" or "then", or as a condition.

    >>> normal_form("The cube: what is its color?").text
    "what be the cube 's color"
    >>> normal_form("First thing that hits the cube: what is it made of?").text
    'what be the first object that hit the cube made of'
    >>> normal_form("A sphere is moving. Which color is it?").text
    'what color be the sphere that be moving'
    >>> normal_form("There's a cube that isn't moving; what color is it?").text
    'what color be the cube that be not moving'
    >>> normal_form("The cube enters. How many balls are moving then?").text
    'how many spheres be moving when the cube enter'
    >>> normal_form("The cube enters: how many balls are moving at that moment?").text
    'how many spheres be moving when the cube enter'
    >>> normal_form("We've removed the red cube: what happens?").text
    'what happen if we have removed the red cube'
    """
    end = next((i for i, part in enumerate(parts) if part in _BREAKS), 0)
    front, rest = parts[:end], [part for part in parts[end:] if part not in _BREAKS]
    if front[:2] == ["there", "be"]:
        front = front[2:]
    if not any(isinstance(part, Slot) for part in front) or set(front) & (
        QUESTION_STARTS - {"be", "do", "have", "when"}
    ):
        return parts
    if front[0] in ("we", "you", "i"):
        return [*rest, "if", *front] if {"what", "which"}.intersection(rest) else parts
    if front[0] in ("a", "one", *_ORDERS) or isinstance(front[0], Slot):
        front = ["the", *front[front[0] in ("a", "one") :]]
    if front[0] != "the":
        return parts
    if {"it", "its"}.intersection(rest):
        if front[2:3] == ["be"] and isinstance(front[1], Slot):  # "a sphere is moving"
            front = [*front[:2], "that", *front[2:]]
        forms = {"it": front, "its": [*front, "'s"]}
        return [found for part in rest for found in (forms.get(part, [part]) if isinstance(part, str) else [part])]
    for words in (["then"], *(["at", "that", time] for time in ("time", "point", "moment"))):
        if rest[-len(words) :] == words:
            return [*rest[: -len(words)], "when", *front]
    return parts


def _question_start(parts: Sequence[str | Slot]) -> int:
    """Where the question starts in a text that begins with a clause; 0 if nothing tells.

    >>> normal_form("Had the cube not been there, what would happen?").text
    'what will happen without the cube'
    >>> normal_form("When the video ends how many cubes are moving?").text
    'how many cubes be moving when video end'
    >>> normal_form("When the video ends is any cube moving?").text
    'be any cube moving when video end'
    """
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


def _words_of_patterns() -> set[str]:
    found: set[str] = set()
    for line in replacements("phrases"):
        found.update(re.findall(r"(?<![\\A-Za-z])[a-z]+", re.sub(r"\\[a-zA-Z]", " ", line.pattern.pattern)))
    return found


@cache
def _central_words(vocabulary: Vocabulary) -> frozenset[str]:
    """Known words but function words and those of phrases."""
    of_forms = FORMS.keys() | {word for form in FORMS.values() for word in form.split()}
    return frozenset(of_forms | vocabulary.adjectives.keys() | vocabulary.nouns.keys() | english(vocabulary).words)


@cache
def known_words(vocabulary: Vocabulary) -> frozenset[str]:
    """All words that a text may have."""
    of_english = {"one", "ones"} | FUNCTION_WORDS | QUESTION_STARTS | CLAUSE_STARTS | _words_of_patterns()
    return frozenset(of_english | _central_words(vocabulary))


@cache
def _correctable(vocabulary: Vocabulary) -> frozenset[str]:
    """Words that misspelt ones are corrected to."""
    colors = [word for color in vocabulary.colors for word in (color.word, *color.synonyms)]
    short = {word for word in _SHORT.union(colors, vocabulary.words["shape"]) if len(word) == MIN_CORRECTED_LETTERS}
    central = {word for word in _central_words(vocabulary) if len(word) > MIN_CORRECTED_LETTERS or word in short}
    return frozenset(central | {word for word in known_words(vocabulary) if len(word) >= LONG_LETTERS})

"""Programs of texts by what they mention, whatever the order of their words: weaker than a reading, for texts without one.

"When the red block comes in, there is a green object in motion: what shape is it?" mentions a shape that is asked for, an
object that moves, and a clause of time. The rules (read_contents.rules of `nsdr.language`) say which contents stand for one
program. So every word counts but function words; how they are arranged does not, except in phrases ("how many red cubes").
"""

import re
from collections.abc import Sequence

from nsdr.language.normal import AMBIGUOUS, FUNCTION_WORDS, MEANINGS, normal_form
from nsdr.language.rules import Rules, load_rules
from nsdr.language.slots import Slot
from nsdr.language.words import rewritten_words
from nsdr.question_parser.tokenizer import split_words
from nsdr.world.vocabulary import Vocabulary

SYMBOLS = {"descriptive": "CONTENTS", "multiple_choice": "WHICH"}
"""The symbol of each kind of text; a choice has too few words to tell what it says without their order."""
TIMES = {"when": "TIME", "before": "WHEN", "after": "WHEN"}
"""The symbol of the clauses of time that begin with a word of this meaning."""
ASKED = ("color", "material", "shape", "count")
MEANINGS_IN_ORDER = (
    *(*ASKED, "exist", "not", "happen", "next", "cause", "without"),
    *("first", "second", "last", "moving", "stationary", "enter", "exit", "collision"),
)
"""Meanings of words in the order that the rules have."""
_MALFORMED = re.compile(
    r"\b(\w+) \1\b"
    r"|(?<!how )\bmany\b|\bmany (?!(?:moving |stationary )?(?:NS|OS|collisions?)\b)"
    r"|(?<!^)(?<!what )(?<!the )(?<!its )(?<!'s )\b(?:color|shape)\b"
    r"|\bhappen .*\bhappen\b|\bwill (?!(?:not )?happen\b)|^(?:be|do|have|can)\b.*\bthe (?:moving |stationary )?(?:NS|OS)\b"
    r"|\b(?:not|no) (?!(?:happen|happening|cause)\b)|\b(?:NS|OS) and (?:the )?(?:N|O|NS|OS)\b"
    r"|\bcaused\b|\bwhy\b|(?<!what )(?<!who )(?<!not )(?<!what be the )(?<!who be the )(?<!not the )(?<!not a )\bcause\b"
    r"|\bcause\b.*\b(?:a|any|another) [NO]\b"
    r"|\b(?:[NO]|enter|entering|exit|exiting|collision|hit|hitting)\b.*\bnot cause\b"
    r"|\bwithout (?!(?:the |a )?[NO]\b)"
    r"|\bthe (?:a|be|how|many|of|the|what|when|without)\b"
)
"""Of texts that are no sentences, or that negate something else than what happens."""


def content_readings(text: str, kind: str, vocabulary: Vocabulary) -> list[list[str]]:
    """The programs of a text by its contents, mostly none or one.

    Args:
        text: English text without unknown words.
        kind: "descriptive" or "multiple_choice"; a "choice" has none.
        vocabulary: of the words of objects.
    """
    if kind not in SYMBOLS or AMBIGUOUS.intersection(split_words(text)):
        return []
    normal = normal_form(text, vocabulary=vocabulary)
    words = rewritten_words(normal.words, "contents")
    forms = [word if isinstance(word, str) else word.form for word in words]
    rules = load_rules(vocabulary, "read_english", "read_contents")
    start, end = _clause_of_time(rules, words)
    if _MALFORMED.search(" ".join([*forms[:start], *forms[end:]])):
        return []
    contents = _contents([*words[:start], *words[end:]])
    return rules.read(SYMBOLS[kind], [*contents, *words[start:end]])


def _clause_of_time(rules: Rules, words: Sequence[str | Slot]) -> tuple[int, int]:
    """Where the first clause of time starts, and its longest reading ends; (0, 0) if there is none."""
    for start, word in enumerate(words):
        symbol = TIMES.get(MEANINGS.get(str(word), ""), "")
        for end in range(len(words), start, -1) if symbol else ():
            if rules.read(symbol, words[start:end]):
                return start, end
    return 0, 0


def _contents(words: Sequence[str | Slot]) -> list[str | Slot]:
    """Meanings and noun phrases in the order of the rules, and after them words that mean something else."""
    said = [word for word in words if isinstance(word, str)]
    meanings = {MEANINGS.get(word, word) for word in said if word in MEANINGS or word not in FUNCTION_WORDS}
    meanings |= {"happen"}.intersection(word.replace("happening", "happen") for word in said)
    is_question = {"any", "there"}.intersection(said) or said[:1] in (["be"], ["do"], ["have"], ["can"])
    if is_question and not meanings.intersection((*ASKED, "happen", "cause")):
        meanings.add("exist")
    slots: list[Slot] = []
    for slot in words:
        if isinstance(slot, Slot) and not any(_is_named_by(slot, other, "collision" in meanings) for other in slots):
            slots.append(slot)
    if "without" not in meanings:
        meanings.discard("happen")
    return [
        *(meaning for meaning in MEANINGS_IN_ORDER if meaning in meanings),
        *slots,
        *meanings.difference(MEANINGS_IN_ORDER),
    ]


def _is_named_by(slot: Slot, other: Slot, is_collision: bool) -> bool:
    """Whether a further noun phrase may stand for an object named before; in a collision only "the object" does."""
    return not (slot.words or other.words) if is_collision else set(slot.words) <= set(other.words)

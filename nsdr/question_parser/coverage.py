"""What a text says stands in its program, and the other way round: a check that does not depend on the network.

Refuses characters that no question has, and programs that lose or invent attribute words, ordinals, negations or kinds of
events. It knows single words, not their order.
"""

import unicodedata
from collections.abc import Sequence
from functools import lru_cache

from nsdr.errors import QuestionError
from nsdr.io.limits import check_limit
from nsdr.question_parser.tokenizer import split_words
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["check_coverage", "check_text"]


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


PUNCTUATION = frozenset("'\u2018\u2019\",.;:?!-()/\u201c\u201d\u2026")
"""Characters of a text beside letters, digits and spaces."""
SYNONYMS = {"ball": "sphere", "block": "cube", "box": "cube", "metallic": "metal", "shiny": "metal"}
"""Other words for attribute words."""
ORDINALS = frozenset({"first", "second", "last"})
"""Ordinals; "in the first frame" is none."""
NEGATIONS = frozenset({"not", "no", "never", "nothing", "t"})
"""Words that negate; "t" is the rest of "isn't"."""
REMOVALS = _words("removed remove away without absence absent gone missing")
"""Words that remove an object; without one of them, it takes a negation ("if there were no cube")."""
AT_REST = _words("stationary rest resting still motionless unmoving standing stands stay")
"""Words for objects at rest; without one of them, it takes a negation ("is not moving")."""
_MOTION = _words("moving move moves motion")
_MEETING = _words("collide collides colliding collision collisions hit hits hitting bump bumps bumping")
_COLLISION = _MEETING | _words("crash crashes crashing strikes striking touch touches impact running runs")
_ENTERING = _words("enter enters entering entered entrance")
_ENTRANCE = _ENTERING | _words(
    "appear appears appearing appearance arrive arrives arrival come comes came coming show shows once"
)
_LEAVING = _words("exit exits exiting leaves leaving")
_EXIT = _LEAVING | _words("leave left disappear disappears departure go goes going out")
_CAUSE = _words("responsible cause causes caused why makes reason lead leads contribute contributes brings do")
_NOT_THERE = _words("no not never if had were was suppose imagine did")
LICENSES: dict[str, frozenset[str]] = {
    "filter_collision": _COLLISION,
    "get_col_partner": _COLLISION,
    "filter_in": _ENTRANCE,
    "filter_out": _EXIT,
    "filter_moving": _MOTION,
    "filter_stationary": AT_REST | _MOTION,
    "get_counterfact": REMOVALS | _NOT_THERE,
    "filter_before": frozenset({"before", "until"}),
    "filter_after": frozenset({"after", "once"}),
    "filter_ancestor": _CAUSE,
    "unseen_events": frozenset({"next", "after", "afterwards"}),
    "query_color": frozenset({"color"}),
    "query_material": frozenset({"material", "made"}),
    "query_shape": frozenset({"shape"}),
    "count": frozenset({"many", "number", "count", "often", "times"}),
}
"""Modules of CLEVRER's programs, and the words of which a text must have one."""
EXPRESSED: dict[tuple[str, ...], frozenset[str]] = {
    ("filter_collision", "get_col_partner"): _MEETING,
    ("filter_in",): _ENTERING,
    ("filter_out",): _LEAVING,
    ("filter_stationary",): _words("stationary resting motionless unmoving"),
    ("filter_before",): frozenset({"before"}),
    ("filter_after", "unseen_events"): frozenset({"after"}),
}
"""Modules of which a program must have one, when its text has one of the words."""
_NAMES = frozenset(word for values in ATTRIBUTES.values() for word in values)


def check_text(text: str) -> None:
    """Refuse texts that are no questions or choices.

    Raises:
        QuestionError: a character such as an emoji or a control character; names it.
        DataError: more characters than `Limits.text_characters`.
    """
    check_limit(len(text), "text_characters", "the text")
    for character in text:
        if not (character.isalnum() or character.isspace() or character in PUNCTUATION):
            name = unicodedata.name(character, f"U+{ord(character):04X}").lower()
            raise QuestionError(
                f"{text!r:.80}: has the character {character!r} ({name}); use words and punctuation only"
            )


def check_coverage(text: str, tokens: Sequence[str]) -> None:
    """Refuse a program that loses or invents a part of the text.

    Args:
        text: a question or choice.
        tokens: its program's, as found by the network.

    Raises:
        QuestionError: names the word that the program lacks, or what it has and no word stands for.
    """
    words, program = split_words(text), set(tokens)
    said = {_attribute(word): word for word in words} | {word: word for word in _ordinals(words)}
    said.pop("", None)
    for token in tokens:
        is_named = token in said if token in _NAMES or token in ORDINALS else True
        if not is_named or (token in LICENSES and LICENSES[token].isdisjoint(words)):
            raise _refused(text, tokens, f"no word of the text stands for {token!r}")
    unused = [word for meant, word in said.items() if meant not in program]
    for modules, expressing in EXPRESSED.items():
        if program.isdisjoint(modules):
            unused += sorted(expressing.intersection(words))
    if unused:
        raise _refused(text, tokens, f"the word {unused[0]!r} was not used")
    _check_negations(text, words, tokens)


def _check_negations(text: str, words: Sequence[str], tokens: Sequence[str]) -> None:
    """As many negations as the program has: of choices, of motion, and of an object's presence."""
    expected = ("negate" in tokens) + ("filter_stationary" in tokens and AT_REST.isdisjoint(words))
    expected += "get_counterfact" in tokens and REMOVALS.isdisjoint(words)
    found = [word for word in words if word in NEGATIONS]
    if len(found) != expected:
        what = (
            f"the negation {found[-1]!r} was not used" if len(found) > expected else "it has no negation that it needs"
        )
        raise _refused(text, tokens, what)


@lru_cache(maxsize=1024)
def _attribute(word: str) -> str:
    """The attribute word that a word of a text stands for; "" for none."""
    singular = word.removesuffix("es") if word == "boxes" else word.removesuffix("s")
    for candidate in (word, singular):
        meant = SYNONYMS.get(candidate, candidate)
        if meant in _NAMES:
            return meant
    return ""


def _ordinals(words: Sequence[str]) -> set[str]:
    followed = zip(words, [*words[1:], ""], strict=True)
    return {word for word, following in followed if word in ORDINALS and following != "frame"}


def _refused(text: str, tokens: Sequence[str], why: str) -> QuestionError:
    return QuestionError(f"{text!r} fits no program: {why} (understood: {' '.join(tokens)}); see docs/questions.md")

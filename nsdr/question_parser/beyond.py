"""The programs of questions beyond CLEVRER, by rules alone: the networks have not learnt them."""

from functools import lru_cache

from nsdr.language.extensions import EXTENDED, EXTENSION_PHRASES, EXTENSION_SYMBOLS
from nsdr.language.rules import filled
from nsdr.question_parser.normal import normal_form

__all__ = ["extension_readings"]


@lru_cache(maxsize=1 << 12)
def extension_readings(text: str, kind: str) -> tuple[tuple[str, ...], ...]:
    """The programs of a text that asks for more than CLEVRER's questions do; empty if it is none.

    Words that no rule has, misspelt ones among them, leave no reading.

    Args:
        text: a question.
        kind: "descriptive", "multiple_choice" or "choice"; choices are CLEVRER's own and have none.
    """
    if kind not in EXTENSION_SYMBOLS:
        return ()
    for pattern, word in EXTENSION_PHRASES:
        text = pattern.sub(word, text)
    normal = normal_form(text, "keep")
    found = [filled(program, normal.words) for program in EXTENDED.readings(EXTENSION_SYMBOLS[kind], normal.forms)]
    return tuple(dict.fromkeys(tuple(tokens) for tokens in found if tokens is not None))

"""CLEVRER's question grammar (texts with their programs) and paraphrases of its texts."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.question_parser.grammar.paraphrase import draw_wording, read_paraphrases
    from nsdr.question_parser.grammar.templates import (
        TEXT_KINDS,
        Chooser,
        Grammar,
        Pair,
        Phrases,
        described,
        every,
        sample,
    )

_HOME = {
    "nsdr.question_parser.grammar.paraphrase": ["draw_wording", "read_paraphrases"],
    "nsdr.question_parser.grammar.templates": [
        "TEXT_KINDS",
        "Chooser",
        "Grammar",
        "Pair",
        "Phrases",
        "described",
        "every",
        "sample",
    ],
}

__all__ = [
    "TEXT_KINDS",
    "Chooser",
    "Grammar",
    "Pair",
    "Phrases",
    "described",
    "draw_wording",
    "every",
    "read_paraphrases",
    "sample",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

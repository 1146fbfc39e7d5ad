"""CLEVRER's question grammar (texts with their programs) and paraphrases of its texts."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.question_parser.grammar.paraphrase import paraphrased, read_paraphrases
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
    "nsdr.question_parser.grammar.paraphrase": ["paraphrased", "read_paraphrases"],
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
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "TEXT_KINDS",
    "Chooser",
    "Grammar",
    "Pair",
    "Phrases",
    "described",
    "every",
    "paraphrased",
    "read_paraphrases",
    "sample",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__

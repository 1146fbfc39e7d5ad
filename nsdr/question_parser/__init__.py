"""From questions and choices to programs: tokenizer, networks, constrained decoding and the grammar they are trained on."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.question_parser.model import ParserNetwork, QuestionParserConfig
    from nsdr.question_parser.parser import QuestionParser, build_networks, pad
    from nsdr.question_parser.tokenizer import PROGRAM_TOKENS, Tokenizer

_HOME = {
    "nsdr.question_parser.model": ["ParserNetwork", "QuestionParserConfig"],
    "nsdr.question_parser.parser": ["QuestionParser", "build_networks", "pad"],
    "nsdr.question_parser.tokenizer": ["PROGRAM_TOKENS", "Tokenizer"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "PROGRAM_TOKENS",
    "ParserNetwork",
    "QuestionParser",
    "QuestionParserConfig",
    "Tokenizer",
    "build_networks",
    "pad",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__

"""From questions and choices to programs: tokenizer, networks, constrained decoding and the grammar they are trained on."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.question_parser.endpoint import EndpointParser
    from nsdr.question_parser.model import ParserNetwork, QuestionParserConfig
    from nsdr.question_parser.parser import QuestionParser, build_networks, pad
    from nsdr.question_parser.tokenizer import PROGRAM_TOKENS, Tokenizer

_HOME = {
    "nsdr.question_parser.endpoint": ["EndpointParser"],
    "nsdr.question_parser.model": ["ParserNetwork", "QuestionParserConfig"],
    "nsdr.question_parser.parser": ["QuestionParser", "build_networks", "pad"],
    "nsdr.question_parser.tokenizer": ["PROGRAM_TOKENS", "Tokenizer"],
}

__all__ = [
    "PROGRAM_TOKENS",
    "EndpointParser",
    "ParserNetwork",
    "QuestionParser",
    "QuestionParserConfig",
    "Tokenizer",
    "build_networks",
    "pad",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

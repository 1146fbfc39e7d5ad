from .endpoint import EndpointParser as EndpointParser
from .model import ParserNetwork as ParserNetwork, QuestionParserConfig as QuestionParserConfig
from .parser import QuestionParser as QuestionParser, build_networks as build_networks, pad as pad
from .tokenizer import PROGRAM_TOKENS as PROGRAM_TOKENS, Tokenizer as Tokenizer

VERSION: int

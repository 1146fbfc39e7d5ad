from .base import Parser as Parser
from .language_model import LanguageModelParser as LanguageModelParser
from .loading import load_parser as load_parser
from .model import ParserNetwork as ParserNetwork, QuestionParserConfig as QuestionParserConfig
from .network import build_networks as build_networks, pad as pad
from .tokenizer import Tokenizer as Tokenizer, decoder_tokens as decoder_tokens

VERSION: int

"""The choice of a question parser by name: the grammar, the paper's networks, or a language model on a server."""

from pathlib import Path

from nsdr.errors import DataError
from nsdr.io.checkpoint import HasWeights, find_checkpoint, folder_of_part
from nsdr.question_parser.base import Parser
from nsdr.question_parser.grammar import GrammarParser
from nsdr.question_parser.language_model import LanguageModelParser, is_address
from nsdr.world.vocabulary import CLEVRER, Vocabulary

GRAMMAR, NETWORK = "grammar", "network"


def check_parser(name: str, extensions: bool = False) -> None:
    """Check the choice of a parser before any work.

    Args:
        name, extensions: see `load_parser`.

    Raises:
        DataError: no parser has this name, or it parses no questions beyond CLEVRER.
    """
    if name not in (GRAMMAR, NETWORK) and not is_address(name.partition("#")[0]):
        shown = name.rpartition("@")[2]
        raise DataError(
            f"question_parser (--question-parser) is {shown!r:.200}; expected {GRAMMAR}, {NETWORK}, or a server's address "
            "such as http://localhost:8000/v1, without a password"
        )
    if extensions and name != GRAMMAR:
        raise DataError(f"extensions would do nothing with question_parser {name!r:.200}; only {GRAMMAR} has them")


def load_parser(
    name: str = GRAMMAR,
    checkpoint: str | Path = "default",
    extensions: bool = False,
    device: str = "auto",
    vocabulary: Vocabulary = CLEVRER,
) -> Parser:
    """A question parser by its name.

    Args:
        name: "grammar" (`GrammarParser`), "network" (`QuestionParser`), or the address of an OpenAI-compatible server
            (`LanguageModelParser`), after which `#` and a model's name may follow: "http://localhost:8000/v1#qwen3:8b".
        checkpoint: where the weights of the networks are, as in `find_checkpoint`. If it has none, `default` has them.
        extensions: also parse questions beyond CLEVRER (the grammar only).
        device: where the networks run, as in `PretrainedPart.to`.
        vocabulary: the words of objects.

    Raises:
        DataError: no parser has this name, or it parses no questions beyond CLEVRER, or questions cannot have the vocabulary.
        CheckpointError: weights are missing or corrupt, or were trained on other words.
        EndpointError: the server does not answer.
    """
    check_parser(name, extensions)
    if name == GRAMMAR:
        return GrammarParser(extensions, vocabulary)
    if name == NETWORK:
        from nsdr.question_parser.network import QuestionParser

        folder = folder_of_part(find_checkpoint(checkpoint), "question_parser")
        return QuestionParser.from_checkpoint(folder, vocabulary).to(device)
    address, _, model = name.partition("#")
    return LanguageModelParser(address, model, vocabulary=vocabulary)


def settings_of(parser: Parser) -> tuple[str, bool]:
    """The arguments `name` and `extensions` with which `load_parser` makes this parser again.

    Raises:
        DataError: it is none of those that `load_parser` makes.
    """
    if type(parser) is GrammarParser:
        return GRAMMAR, parser.extensions
    if type(parser) is LanguageModelParser:
        return f"{parser.url}#{parser.model}", False
    if isinstance(parser, HasWeights):  # the networks load torch, which other parsers need not
        from nsdr.question_parser.network import QuestionParser

        if type(parser) is QuestionParser:
            return NETWORK, False
    raise DataError(f"{type(parser).__name__} is no question parser of nsdr, and cannot be stored")

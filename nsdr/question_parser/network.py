"""Programs of texts by the paper's networks (section 4.3), one for each kind of text, with their own probability."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Self, cast

import torch
from torch import nn

from nsdr.errors import CheckpointError, NsdrError, ProgramError, QuestionError
from nsdr.io.checkpoint import PretrainedPart, load_description, load_network, trained_for
from nsdr.io.device import limit_threads
from nsdr.io.worlds import stored_world
from nsdr.language.normal import normal_form
from nsdr.language.texts import TEXT_KINDS
from nsdr.question_parser.base import Parser
from nsdr.question_parser.grammar import REMEDY, another_kind, check_text, unless_confirmed
from nsdr.question_parser.model import ParserNetwork, QuestionParserConfig
from nsdr.question_parser.tokenizer import OTHER, Tokenizer, decoder_tokens, split_words
from nsdr.symbolic.program import Program
from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import CLEVRER_WORLD, World

MIN_PROBABILITY = 0.5
"""Programs with a smaller probability are refused (0-1): such a program is more probable than all others together."""
MAX_BATCH_TEXTS = 512
"""Largest number of texts in one forward pass."""


def pad(rows: Sequence[Sequence[int]]) -> torch.Tensor:
    """Rows of indices -> (B, length of the longest row), padded with zeros on the right."""
    width = max(len(row) for row in rows)
    return torch.tensor([[*row, *[0] * (width - len(row))] for row in rows])


def build_networks(n_words: int, n_tokens: int, config: QuestionParserConfig) -> nn.ModuleDict:
    """The three networks by kind of text, with random weights."""
    return nn.ModuleDict({kind: ParserNetwork(n_words, n_tokens, config) for kind in TEXT_KINDS})


class QuestionParser(PretrainedPart, Parser):
    """Parses texts with the networks alone, on the device of their weights: nothing checks what a program leaves out or adds.

    Args:
        tokenizer: word vocabulary.
        networks: the networks of `build_networks`.
        world: the world whose words they were trained on.
    """

    part = "question_parser"

    def __init__(self, tokenizer: Tokenizer, networks: nn.ModuleDict, world: World = CLEVRER_WORLD) -> None:
        self.tokenizer, self.networks, self.world, self.vocabulary = tokenizer, networks.eval(), world, world.vocabulary

    @classmethod
    def from_checkpoint(cls, folder: str | Path, vocabulary: Vocabulary | None = None, **options: Any) -> Self:
        """The question parser of a checkpoint's folder, on the CPU; `options` are arguments of the constructor.

        Args:
            folder: the folder.
            vocabulary: the words of objects, with their synonyms; None for those of the world that it was trained for.

        Raises:
            CheckpointError: `question_parser.safetensors` or `question_parser.json` is missing or corrupt, or the parser was
                trained with other program tokens, such as other words of objects.
        """
        path, details = Path(folder) / f"{cls.part}.json", load_description(folder, cls.part)
        world = trained_for(folder, cls.part)
        vocabulary = vocabulary or world.vocabulary
        tokens, words, expected = details.get("program_tokens"), details.get("words"), decoder_tokens(vocabulary)
        if not isinstance(tokens, list) or tuple(tokens) != expected:
            other = (
                ", ".join(str(token) for token in tokens if token not in expected) if isinstance(tokens, list) else ""
            )
            raise CheckpointError(
                f"{path}: the question parser was trained with other program tokens{other and f' ({other:.200})'}; give the "
                "weights of this world, or train them (`nsdr train question-parser`)"
            )
        if not isinstance(words, list) or not all(isinstance(w, str) and split_words(w) == [w] for w in words):
            raise CheckpointError(f"{path}: words: expected a list of single words in lower case; restore the file")
        if not words or len(set(words)) < len(words):
            raise CheckpointError(f"{path}: words: expected at least one word, each once; restore the file")
        nouns = (noun for shape in vocabulary.shapes for noun in (shape.word, shape.plurals[shape.word]))
        if missing := [noun for noun in nouns if noun not in words]:
            raise CheckpointError(f"{path}: words: expected those of the world, such as {missing[0]}; train it again")
        tokenizer = Tokenizer(words)
        build = partial(build_networks, len(tokenizer), len(expected))
        return cls(
            tokenizer,
            load_network(folder, cls.part, QuestionParserConfig, build),
            replace(world, vocabulary=vocabulary),
            **options,
        )

    @property
    def network(self) -> nn.Module:
        """The three networks."""
        return self.networks

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        network: Any = self.networks[TEXT_KINDS[0]]
        words = {"words": self.tokenizer.words, "program_tokens": decoder_tokens(self.vocabulary)}
        return network.config, {**words, **stored_world(self.world)}

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """See `Parser`.

        A program with a probability of less than `MIN_PROBABILITY` is an error. One that the rules do not read from the text
        has a note that says it in words.
        """
        found: dict[int, Program | NsdrError] = {}
        readable = []
        for i, text in enumerate(texts):
            try:
                check_text(text, kind)
                unknown = normal_form(text, vocabulary=self.vocabulary).left_out
                if unknown:
                    raise QuestionError(f"unknown word {unknown[0]!r:.40} in {text!r:.200}; {REMEDY}")
                readable.append(i)
            except NsdrError as e:
                found[i] = e
        for i, (tokens, probability) in zip(readable, self.candidates([texts[i] for i in readable], kind), strict=True):
            try:
                program = _program(texts[i], tokens, kind, probability, self.vocabulary)
                found[i] = unless_confirmed(program, texts[i], kind)
            except NsdrError as e:
                found[i] = e
        return [found[i] for i in range(len(texts))]

    @limit_threads(1)
    def candidates(self, texts: Sequence[str], kind: str = "descriptive") -> list[tuple[list[str], float]]:
        """The most probable tokens of many texts with their probability (0-1), whether or not they form a program.

        Words that are not in the vocabulary are left out; a text of such words only is of no kind.
        """
        if not texts:
            return []
        network, known = cast(Any, self.networks[kind]), decoder_tokens(self.vocabulary)
        found: list[tuple[list[str], float]] = []
        for start in range(0, len(texts), MAX_BATCH_TEXTS):
            listed = texts[start : start + MAX_BATCH_TEXTS]
            encoded = [self.tokenizer.known(normal_form(text, vocabulary=self.vocabulary).text) for text in listed]
            words = pad([row or [1] for row in encoded])
            rows, probabilities = network.search(words, kind, self.vocabulary)
            for row, tokens, probability in zip(encoded, rows, probabilities, strict=True):
                found.append(([known[t] for t in tokens], probability) if row else ([OTHER], 1.0))
        return found


def _program(text: str, tokens: list[str], kind: str, probability: float, vocabulary: Vocabulary) -> Program:
    if OTHER in tokens:
        raise another_kind(text, kind)
    try:
        program = Program.parse(tokens, vocabulary)
    except ProgramError as e:
        raise QuestionError(f"{text!r:.200} fits no program ({e}); {REMEDY}") from e
    if probability < MIN_PROBABILITY:
        reason = f"the best one has a probability of {probability:.0%}"
        raise QuestionError(f"{text!r:.200} fits no program ({reason}); {REMEDY}")
    return program

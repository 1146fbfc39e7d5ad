"""Questions and choices -> programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import nn

from nsdr.errors import CheckpointError, ProgramError, QuestionError
from nsdr.io.checkpoint import load_checkpoint
from nsdr.question_parser.grammar.templates import TEXT_KINDS
from nsdr.question_parser.model import ParserNetwork, QuestionParserConfig
from nsdr.question_parser.tokenizer import OTHER, PROGRAM_TOKENS, Tokenizer
from nsdr.symbolic.program import Program

__all__ = ["QuestionParser", "build_networks", "pad"]

MIN_PROBABILITY = 0.9
"""Measured with the default weights: 2,877 real texts have 0.98 or more, sentences without sense 0.8 or less."""
MAX_BATCH_TEXTS = 512
REMEDY = 'word it as CLEVRER\'s questions are, such as "How many cubes enter the scene?"'


def pad(rows: Sequence[Sequence[int]]) -> torch.Tensor:
    """Rows of indices -> (B, longest) with zeros at the ends."""
    width = max(len(row) for row in rows)
    return torch.tensor([[*row, *[0] * (width - len(row))] for row in rows])


def build_networks(n_words: int, config: QuestionParserConfig) -> nn.ModuleDict:
    """The three networks, by kind of text."""
    return nn.ModuleDict({kind: ParserNetwork(n_words, len(PROGRAM_TOKENS), config) for kind in TEXT_KINDS})


class QuestionParser:
    """Parses descriptive questions, multiple-choice questions and choices, each with a network of its own.

    Args:
        tokenizer: word vocabulary.
        networks: as `build_networks` makes them.
        min_probability: programs that are less probable are refused.
        constrained: decode well-typed programs only.
        beam: hypotheses of the search; 1 is greedy.
        unknown: "error", or "ignore" to warn and go on without words that are not known.
    """

    def __init__(
        self,
        tokenizer: Tokenizer,
        networks: nn.ModuleDict,
        min_probability: float = MIN_PROBABILITY,
        constrained: bool = True,
        beam: int = 1,
        unknown: str = "error",
    ) -> None:
        if unknown not in ("error", "ignore"):
            raise QuestionError(f"unknown is {unknown!r}; expected error or ignore")
        if beam < 1:
            raise QuestionError(f"beam is {beam}; expected at least 1")
        self.tokenizer = tokenizer
        self.min_probability = min_probability
        self.constrained, self.beam, self.unknown = constrained, beam, unknown
        self.networks = networks.eval()

    @classmethod
    def from_checkpoint(cls, folder: str | Path, **options: Any) -> "QuestionParser":
        """Load `question_parser.safetensors` and its JSON; `options` are the constructor's.

        Raises:
            CheckpointError: missing, corrupt, or made for other program tokens.
        """
        state, details = load_checkpoint(folder, "question_parser")
        if tuple(details.get("program_tokens", ())) != PROGRAM_TOKENS:
            raise CheckpointError(f"{folder}: the question parser knows other program tokens; train it again")
        tokenizer = Tokenizer(details["words"])
        networks = build_networks(len(tokenizer), QuestionParserConfig(**details["config"]))
        networks.load_state_dict(state)
        return cls(tokenizer, networks, **options)

    def parse(self, text: str, kind: str = "descriptive") -> Program:
        """The program of one text; `parse_batch` for many.

        Args:
            text: a question or choice in CLEVRER's English.
            kind: "descriptive", "multiple_choice" or "choice".

        Raises:
            QuestionError: an empty text, an unknown word, a text of another kind, or one that fits no program.
        """
        return self.parse_batch([text], kind)[0]

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program]:
        """Programs of many texts of one kind; raises as `parse`."""
        found = self.candidates(texts, kind)
        return [self._program(t, tokens, kind, p) for t, (tokens, p) in zip(texts, found, strict=True)]

    def candidates(self, texts: Sequence[str], kind: str = "descriptive") -> list[tuple[list[str], float]]:
        """The most probable tokens of many texts, and their probability (0-1), whether or not they make a program.

        Raises:
            QuestionError: an unknown kind, an empty text or an unknown word.
        """
        if kind not in TEXT_KINDS:
            raise QuestionError(f"kind is {kind!r}; expected one of {', '.join(TEXT_KINDS)}")
        network: Any = self.networks[kind]
        found: list[tuple[list[str], float]] = []
        for start in range(0, len(texts), MAX_BATCH_TEXTS):
            words = pad([self.tokenizer.encode(t, self.unknown) for t in texts[start : start + MAX_BATCH_TEXTS]])
            rows, probabilities = network.search(words, kind if self.constrained else "", self.beam)
            tokens = [[PROGRAM_TOKENS[t] for t in row] for row in rows]
            found += list(zip(tokens, probabilities, strict=True))
        return found

    def _program(self, text: str, tokens: list[str], kind: str, probability: float) -> Program:
        if OTHER in tokens:
            remedy = {
                "descriptive": "give choices with it if it is a multiple-choice question",
                "multiple_choice": "ask it without choices if it is a descriptive question",
                "choice": 'a choice names an object or event, such as "the presence of the red cube"',
            }
            raise QuestionError(f"{text!r} is no {kind.replace('_', '-')} text; {remedy[kind]}, or {REMEDY}")
        try:
            program = Program.parse(tokens)
        except ProgramError as e:
            raise QuestionError(f"{text!r} fits no program ({e}); {REMEDY}") from e
        if probability < self.min_probability:
            raise QuestionError(f"{text!r} fits no program surely (the best one by {probability:.0%}); {REMEDY}")
        return program

"""Train the question parser: `nsdr train question-parser --config configs/question_parser/default.yaml`."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.checkpoint import save_checkpoint
from nsdr.configuration import described, parse_config, resolved
from nsdr.question_parser.grammar import TEXT_KINDS, sample
from nsdr.question_parser.model import QuestionParserConfig
from nsdr.question_parser.parser import build_networks, pad
from nsdr.question_parser.tokenizer import END, OTHER, PAD, PROGRAM_TOKENS, START, Tokenizer
from nsdr.training.loop import LoopConfig, train

__all__ = ["QuestionParserTraining", "main"]

_TOKEN_INDEX = {token: i for i, token in enumerate(PROGRAM_TOKENS)}


@dataclass(frozen=True)
class QuestionParserTraining:
    """Training of the question parser on pairs drawn from the grammar.

    Attributes:
        run_dir: where the run lives; an interrupted one goes on.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        other: share of each batch that is text of another kind, to be told apart.
        evaluation_texts: texts of each kind that are measured (drawn from seeds that training does not use).
        model: the networks.
        loop: the optimisation.
    """

    run_dir: str
    output: str = ""
    other: float = 0.08
    evaluation_texts: int = 1000
    model: QuestionParserConfig = field(default_factory=QuestionParserConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)


class QuestionParserTask:
    """Cross-entropy of the next token, summed over the three networks; share of exact programs."""

    def __init__(self, config: QuestionParserTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.config = config
        vocabulary_rng = random.Random(0)
        texts = [sample(kind, vocabulary_rng)[0] for kind in TEXT_KINDS for _ in range(4000)]
        self.tokenizer = Tokenizer.from_texts(texts)
        self.networks = build_networks(len(self.tokenizer), config.model)
        self.model: nn.Module = self.networks

    def _draw(self, kind: str, size: int, rng: random.Random, other: float) -> list[tuple[str, list[str]]]:
        pairs = []
        for _ in range(size):
            if rng.random() < other:
                wrong = rng.choice([k for k in TEXT_KINDS if k != kind])
                pairs.append((sample(wrong, rng)[0], [OTHER]))
            else:
                pairs.append(sample(kind, rng))
        return pairs

    def batch(self, size: int, rng: np.random.Generator) -> dict[str, tuple[Tensor, Tensor]]:
        """For each kind: words (B, T) and tokens (B, S) with `<start>` and `<end>`."""
        draw = random.Random(int(rng.integers(2**62)))
        batch = {}
        for kind in TEXT_KINDS:
            pairs = self._draw(kind, size, draw, self.config.other)
            words = pad([self.tokenizer.encode(text) for text, _ in pairs])
            tokens = pad([[START, *(_TOKEN_INDEX[t] for t in program), END] for _, program in pairs])
            batch[kind] = (words, tokens)
        return batch

    def losses(self, model: nn.Module, batch: Mapping[str, tuple[Tensor, Tensor]]) -> dict[str, Tensor]:
        device = next(model.parameters()).device
        losses = {}
        for kind, (words, tokens) in batch.items():
            tokens = tokens.to(device)
            logits = self.networks[kind](words.to(device), tokens[:, :-1])
            losses[kind] = F.cross_entropy(logits.flatten(0, 1), tokens[:, 1:].flatten(), ignore_index=PAD)
        return losses

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        rng = random.Random("evaluation")
        device = next(model.parameters()).device
        scores = {}
        for kind in TEXT_KINDS:
            pairs = self._draw(kind, self.config.evaluation_texts, rng, 0.0)
            network: Any = self.networks[kind]
            rows, _ = network.greedy(pad([self.tokenizer.encode(text) for text, _ in pairs]).to(device))
            right = [[PROGRAM_TOKENS[t] for t in row] == program for row, (_, program) in zip(rows, pairs, strict=True)]
            scores[f"{kind}_exact"] = float(np.mean(right))
        return scores


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config = parse_config(QuestionParserTraining, argv, "nsdr train question-parser")
    task = QuestionParserTask(config)
    metrics = train(task, config.loop, config.run_dir, resolved(config))
    output = config.output or f"{config.run_dir}/checkpoint"
    details = {
        "words": task.tokenizer.words,
        "program_tokens": PROGRAM_TOKENS,
        "metrics": metrics,
        "training": described(config),
    }
    save_checkpoint(output, "question_parser", task.networks.state_dict(), config.model, details, half=True)
    return output

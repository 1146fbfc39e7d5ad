"""Train the question parser: `nsdr train question-parser --config configs/question_parser/default.yaml`."""

import random
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.clevrer.questions import iterate_questions
from nsdr.errors import DataError
from nsdr.io.checkpoint import save_checkpoint
from nsdr.io.configuration import described, parse_config, resolved
from nsdr.question_parser.grammar.paraphrase import paraphrased, read_paraphrases
from nsdr.question_parser.grammar.templates import TEXT_KINDS, Pair, sample
from nsdr.question_parser.model import QuestionParserConfig
from nsdr.question_parser.parser import QuestionParser, build_networks, pad
from nsdr.question_parser.tokenizer import END, OTHER, PAD, PROGRAM_TOKENS, START, Tokenizer
from nsdr.training.ablation import parse_sizes, run_ablation
from nsdr.training.loop import LoopConfig, Task, train

__all__ = ["QuestionParserTraining", "main"]

SAMPLES_FOR = {"descriptive": 1, "multiple_choice": 1, "choice": 4}
"""The paper's n, n and 4n."""
_TOKEN_INDEX = {token: i for i, token in enumerate(PROGRAM_TOKENS)}


@dataclass(frozen=True)
class QuestionParserTraining:
    """Training of the question parser on pairs drawn from the grammar, or on a question file.

    Attributes:
        run_dir: where the run lives; an interrupted one goes on.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        questions: question file in CLEVRER's format to learn from; "" draws from the grammar.
        samples: learn from so many programs only: n descriptive, n multiple-choice and 4n choices (paper); 0 for all.
        paraphrase: probability that a training text is reworded.
        other: share of each batch that is text of another kind, to be told apart.
        evaluation_texts: texts of each kind that are measured (drawn from seeds that training does not use).
        ablation: numbers of programs such as "10,100,all": one run for each, and a table and image of what they are worth.
        evaluation_questions: for the ablation, a question file with programs and answers.
        evaluation_scenes: for the ablation, the folder of its scenes' `truth_N.json`.
        model: the networks.
        loop: the optimisation.
    """

    run_dir: str
    output: str = ""
    questions: str = ""
    samples: int = 0
    paraphrase: float = 0.0
    other: float = 0.08
    evaluation_texts: int = 1000
    ablation: str = ""
    evaluation_questions: str = ""
    evaluation_scenes: str = ""
    model: QuestionParserConfig = field(default_factory=QuestionParserConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)


class QuestionParserTask(Task):
    """Cross-entropy of the next token, summed over the three networks; share of exact programs."""

    def __init__(self, config: QuestionParserTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.config = config
        vocabulary_rng = random.Random(0)
        texts = [sample(kind, vocabulary_rng)[0] for kind in TEXT_KINDS for _ in range(4000)]
        if config.paraphrase:
            texts += [paraphrased(text, vocabulary_rng) for text in texts]
        self.tokenizer = Tokenizer.from_texts(texts)
        self.pool = self._pool()
        self.networks = build_networks(len(self.tokenizer), config.model)
        self.model: nn.Module = self.networks

    def _pool(self) -> dict[str, list[Pair]] | None:
        """The pairs to learn from; None for all that the grammar draws."""
        config = self.config
        if not config.questions and not config.samples:
            return None
        rng = random.Random(f"{config.loop.seed} pool")
        if config.questions:
            pool = read_pairs(config.questions)
            for pairs in pool.values():
                rng.shuffle(pairs)
        else:
            pool = {k: [sample(k, rng) for _ in range(SAMPLES_FOR[k] * config.samples)] for k in TEXT_KINDS}
        if config.samples:
            pool = {k: pairs[: SAMPLES_FOR[k] * config.samples] for k, pairs in pool.items()}
        empty = [kind for kind, pairs in pool.items() if not pairs]
        if empty:
            raise DataError(f"{config.questions}: holds no {' and no '.join(empty)} texts with programs")
        return pool

    def _draw(self, kind: str, size: int, rng: random.Random) -> list[Pair]:
        """Training pairs; some are of another kind, some reworded."""
        pairs = []
        for _ in range(size):
            wrong = rng.random() < self.config.other
            of = rng.choice([k for k in TEXT_KINDS if k != kind]) if wrong else kind
            text, program = sample(of, rng) if self.pool is None else rng.choice(self.pool[of])
            if rng.random() < self.config.paraphrase:
                text = paraphrased(text, rng)
            pairs.append((text, [OTHER] if wrong else program))
        return pairs

    def batch(self, size: int, rng: np.random.Generator) -> dict[str, tuple[Tensor, Tensor]]:
        """For each kind: words (B, T) and tokens (B, S) with `<start>` and `<end>`."""
        draw = random.Random(int(rng.integers(2**62)))
        batch = {}
        for kind in TEXT_KINDS:
            pairs = self._draw(kind, size, draw)
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
        parser = QuestionParser(self.tokenizer, self.networks, constrained=True, unknown="ignore")
        scores = {}
        for kind in TEXT_KINDS:
            pairs = [sample(kind, rng) for _ in range(self.config.evaluation_texts)]
            scores[f"{kind}_exact"] = exact_share(parser, pairs, kind)
            reworded = [(p["text"], p["program"].split()) for p in read_paraphrases() if p["kind"] == kind]
            scores[f"{kind}_paraphrase_exact"] = exact_share(parser, reworded, kind)
        return scores


def exact_share(parser: QuestionParser, pairs: Sequence[Pair], kind: str) -> float:
    """Share of texts of a kind whose most probable program is the right one; unknown words are left out silently."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = parser.candidates([text for text, _ in pairs], kind)
    return float(np.mean([tokens == program for (tokens, _), (_, program) in zip(found, pairs, strict=True)]))


def read_pairs(path: str) -> dict[str, list[Pair]]:
    """Distinct texts with programs of a question file, by kind of text."""
    found: dict[str, dict[str, list[str]]] = {kind: {} for kind in TEXT_KINDS}
    for scene in iterate_questions(path):
        for q in scene.questions:
            kind = "multiple_choice" if q.choices else "descriptive"
            for of, text, program in ((kind, q.text, q.program), *(("choice", c.text, c.program) for c in q.choices)):
                if program:
                    found[of][text] = list(program)
    return {kind: list(texts.items()) for kind, texts in found.items()}


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint.

    With `--ablation 10,100,all` one run for each number of programs; returns the table's path.
    """
    config = parse_config(QuestionParserTraining, argv, "nsdr train question-parser")
    if config.ablation:
        return run_ablation(replace(config, ablation=""), parse_sizes(config.ablation), _train)
    return _train(config)


def _train(config: QuestionParserTraining) -> str:
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

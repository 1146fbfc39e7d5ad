"""Train the question parser: `nsdr train question-parser --config default`."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.clevrer.files.questions import read_questions
from nsdr.errors import DataError
from nsdr.io.checkpoint import load_description, start_from
from nsdr.io.worlds import read_world, stored_world, world_beside
from nsdr.language.normal import normal_form
from nsdr.language.reserved import check_vocabulary
from nsdr.language.rules import Pair
from nsdr.language.texts import (
    START_SYMBOLS,
    TEXT_KINDS,
    draw_wording,
    english,
    normal_words,
    read_paraphrases,
    sample,
)
from nsdr.question_parser.model import QuestionParserConfig
from nsdr.question_parser.network import QuestionParser, build_networks, pad
from nsdr.question_parser.tokenizer import END, OTHER, PAD, START, Tokenizer, decoder_tokens
from nsdr.training.loop import LoopConfig, LossTerm, Task, train_part
from nsdr.training.run_folder import parse_training
from nsdr.validation import Count, PathName, PositiveCount, Settings, Share
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import World

SAMPLES_OF_KIND = {"descriptive": 1, "multiple_choice": 1, "choice": 4}
"""Programs of each kind for one of `QuestionParserTraining.samples`: the paper's n, n and 4n."""
MAX_EXAMPLE_SEED = 2**62
"""Upper bound of an example's seed."""
ANOTHER_KIND_SHARE = 0.5
"""Among the texts that the network must reject, the share that are texts of another kind (0-1)."""


@dataclass(frozen=True)
class QuestionParserTraining(Settings):
    """Training of the question parser on pairs drawn from the grammar, or on a question file.

    Attributes:
        run_dir: folder of the run; an interrupted run is resumed.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        questions: question file in CLEVRER's format to train on; "" draws texts from the grammar.
        world: the world whose words the texts have: a file (see `nsdr.read_world`) or the name of one that ships; "" for that
            of the data set that `questions` is of, or CLEVRER's.
        samples: n, to train on n descriptive, n multiple-choice and 4n choice programs only (paper); 0 for all.
        initial: folder of a checkpoint to start from, whose words must be the same; "" starts from random weights.
        paraphrase: probability that a training text is drawn from the rules of other wordings (read_english.rules).
        other: share of each batch whose texts are no texts of the kind, for the network to reject: half of them are texts of
            another kind, half have their words shuffled, or one left out or put in.
        evaluation_texts: number of texts of each kind to evaluate on, drawn from the grammar with a seed of their own.
        model: the networks.
        loop: the optimisation.
    """

    run_dir: PathName
    output: str = ""
    questions: str = ""
    world: str = ""
    samples: Count = 0
    initial: str = ""
    paraphrase: Share = 0.0
    other: Share = 0.08
    evaluation_texts: PositiveCount = 1000
    model: QuestionParserConfig = field(default_factory=QuestionParserConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)


class QuestionParserTask(Task):
    """Cross-entropy of the next program token, for each of the three networks; evaluated by the share of exact programs."""

    def __init__(self, config: QuestionParserTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.config = config
        self.world = read_world(config.world) if config.world else world_beside(config.questions)
        self.vocabulary = self.world.vocabulary
        check_vocabulary(self.vocabulary)
        self.program_tokens = decoder_tokens(self.vocabulary)
        self.token_index = {token: i for i, token in enumerate(self.program_tokens)}
        self.pool = self._pool()
        texts = [text for pairs in (self.pool or {}).values() for text, _ in pairs]
        self.tokenizer = Tokenizer.from_texts([*normal_words(self.vocabulary), *map(self._normal, texts)])
        self.model: nn.Module = build_networks(len(self.tokenizer), len(self.program_tokens), config.model)
        if config.initial:
            if load_description(config.initial, "question_parser")["words"] != list(self.tokenizer.words):
                raise DataError(f"{config.initial}: has other words than this training; leave --initial out")
            start_from(self.model, config.initial, "question_parser")

    def _normal(self, text: str) -> str:
        return normal_form(text, keep_unknown=True, vocabulary=self.vocabulary).text

    def _pool(self) -> dict[str, list[Pair]] | None:
        """The training pairs of each kind; None where each batch is drawn from the grammar anew."""
        config = self.config
        if not config.questions and not config.samples:
            return None
        rng = random.Random(f"{config.loop.seed} pool")
        if config.questions:
            pool = _read_pairs(config.questions, self.world)
            for pairs in pool.values():
                rng.shuffle(pairs)
        else:
            n_of_kind = {k: SAMPLES_OF_KIND[k] * config.samples for k in TEXT_KINDS}
            pool = {k: [sample(k, rng, self.vocabulary) for _ in range(n)] for k, n in n_of_kind.items()}
        if config.samples:
            pool = {k: pairs[: SAMPLES_OF_KIND[k] * config.samples] for k, pairs in pool.items()}
        empty = [kind for kind, pairs in pool.items() if not pairs]
        if empty:
            raise DataError(f"{config.questions}: holds no {' and no '.join(empty)} texts with programs")
        return pool

    def _draw_pair(self, kind: str, rng: random.Random) -> Pair:
        """A text of a kind in normal form with its program, or a text that is not of the kind with the program `OTHER`."""
        if rng.random() >= self.config.other:
            return self._draw_text(kind, rng)
        if rng.random() < ANOTHER_KIND_SHARE:
            text, _ = self._draw_text(rng.choice([k for k in TEXT_KINDS if k != kind]), rng)
        else:
            text = self._spoilt(self._draw_text(kind, rng)[0], rng)
        normal = normal_form(text, keep_unknown=True, vocabulary=self.vocabulary)
        if english(self.vocabulary).readings(START_SYMBOLS[kind], normal.forms):  # it is a text of this kind, too
            return self._draw_text(kind, rng)
        return text, [OTHER]

    def _draw_text(self, kind: str, rng: random.Random) -> Pair:
        if rng.random() < self.config.paraphrase:
            return draw_wording(kind, rng, self.vocabulary)
        text, program = sample(kind, rng, self.vocabulary) if self.pool is None else rng.choice(self.pool[kind])
        return self._normal(text), program

    def _spoilt(self, text: str, rng: random.Random) -> str:
        """A text with its words shuffled, or with one word left out or put in."""
        words = text.split()
        how = rng.randrange(3)
        if how == 0:
            rng.shuffle(words)
        elif how == 1:
            del words[rng.randrange(len(words))]
        else:
            words.insert(rng.randrange(len(words) + 1), rng.choice(normal_words(self.vocabulary)))
        return " ".join(words) or text

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[int]:
        """The seed of each example."""
        return rng.integers(MAX_EXAMPLE_SEED, size=count).tolist()

    def collate(self, examples: Sequence[int]) -> dict[str, tuple[Tensor, Tensor]]:
        """For each kind, words (B, T) and program tokens (B, S) with `<start>` and `<end>`, both int64 and padded."""
        draws = [random.Random(seed) for seed in examples]
        batch = {}
        for kind in TEXT_KINDS:
            pairs = [self._draw_pair(kind, draw) for draw in draws]
            words = pad([self.tokenizer.encode(text) for text, _ in pairs])
            tokens = pad([[START, *(self.token_index[t] for t in program), END] for _, program in pairs])
            batch[kind] = (words, tokens)
        return batch

    def losses(self, model: nn.Module, batch: Mapping[str, tuple[Tensor, Tensor]]) -> dict[str, LossTerm]:
        """For each kind, the cross-entropy of the tokens (B, S) that follow; padding does not count."""
        networks = cast(nn.ModuleDict, model)
        losses = {}
        for kind, (words, tokens) in batch.items():
            logits, following = networks[kind](words, tokens[:, :-1]), tokens[:, 1:]
            total = F.cross_entropy(logits.flatten(0, 1), following.flatten(), ignore_index=PAD, reduction="sum")
            losses[kind] = LossTerm(total, (following != PAD).sum())
        return losses

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """For each kind, the share of exact programs on texts of the grammar, and on CLEVRER's paraphrases."""
        rng = random.Random("evaluation")
        parser = QuestionParser(self.tokenizer, cast(nn.ModuleDict, model), self.world)
        scores = {}
        for kind in TEXT_KINDS:
            pairs = [sample(kind, rng, self.vocabulary) for _ in range(self.config.evaluation_texts)]
            scores[f"{kind}_exact"] = _exact_share(parser, pairs, kind)
            if self.vocabulary != CLEVRER:
                continue
            paraphrases = [(p["text"], p["program"].split()) for p in read_paraphrases() if p["kind"] == kind]
            scores[f"{kind}_paraphrase_exact"] = _exact_share(parser, paraphrases, kind)
        return scores


def _exact_share(parser: QuestionParser, pairs: Sequence[Pair], kind: str) -> float:
    """Share (0-1) of texts of a kind whose most probable program is the true one."""
    found = parser.candidates([text for text, _ in pairs], kind)
    return float(np.mean([tokens == program for (tokens, _), (_, program) in zip(found, pairs, strict=True)]))


def _read_pairs(path: str, world: World) -> dict[str, list[Pair]]:
    """The distinct texts of a question file that have programs of CLEVRER's modules, with their programs, by kind of text."""
    known = frozenset(decoder_tokens(world.vocabulary))
    programs: dict[str, dict[str, list[str]]] = {kind: {} for kind in TEXT_KINDS}
    for q in (q for scene in read_questions(path, world) for q in scene.questions):
        of_question = ("multiple_choice" if q.choices else "descriptive", q.text, q.program)
        for kind, text, program in (of_question, *(("choice", c.text, c.program) for c in q.choices)):
            if program and known.issuperset(program):
                programs[kind][text] = list(program)
    return {kind: list(texts.items()) for kind, texts in programs.items()}


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config = parse_training(QuestionParserTraining, argv, "question-parser")
    task = QuestionParserTask(config)
    details = {"words": task.tokenizer.words, "program_tokens": task.program_tokens, **stored_world(task.world)}
    return train_part("question_parser", task, config, config.model, details)

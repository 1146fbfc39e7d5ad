"""A trained baseline: answers the questions of a file about videos whose features are known."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Self

import torch
from torch import Tensor

from nsdr.baselines.base import BASELINES, Baseline, Sizes
from nsdr.baselines.data import Example, FeatureSource, encoded, feature_sizes, make_batch, video_needs
from nsdr.baselines.vocabulary import Vocabulary
from nsdr.clevrer.files.questions import QUESTION_TYPES, Question, SceneQuestions
from nsdr.errors import CheckpointError, DataError, NsdrError
from nsdr.io.checkpoint import PretrainedPart, load_description, load_network
from nsdr.question_parser.tokenizer import PROGRAM_TOKENS
from nsdr.types import Answer, ChoiceAnswer

__all__ = ["TrainedBaseline", "baseline_sizes", "masked_scores"]

TEXTS_PER_BATCH = 64
"""Most texts of one video that are answered at once; memory is the only thing that depends on it."""


class TrainedBaseline(PretrainedPart):
    """A baseline with its vocabulary.

    Args:
        system: its name in `BASELINES`.
        config: its settings.
        network: the network that was built of them.
        vocabulary: of its training.
        sizes: that it was built with.
    """

    part: ClassVar[str] = "baseline"

    def __init__(self, system: str, config: Any, network: Baseline, vocabulary: Vocabulary, sizes: Sizes) -> None:
        self.system, self.config, self.vocabulary, self.sizes = system, config, vocabulary, sizes
        self._network = network
        self._possible = vocabulary.possible_answers()

    @classmethod
    def from_checkpoint(cls, folder: str | Path, **options: Any) -> Self:
        """The baseline of a checkpoint's folder; there are no options."""
        details = load_description(folder, cls.part)
        where = Path(folder) / f"{cls.part}.json"
        try:
            system = str(details["system"])
            vocabulary = Vocabulary(tuple(map(str, details["words"])), tuple(map(str, details["answers"])))
            given = details["sizes"]
            sizes = Sizes(**{**given, "grid": (int(given["grid"][0]), int(given["grid"][1]))})
            kind = BASELINES[system]
        except (KeyError, TypeError, ValueError, IndexError, DataError) as e:
            raise CheckpointError(f"{where}: not the description of a baseline ({e}); train it again") from e
        found = baseline_sizes(vocabulary, sizes.channels, sizes.grid)
        if sizes != found:
            raise CheckpointError(f"{where}: sizes are {sizes}; its words and answers and this version have {found}")
        network = load_network(folder, cls.part, kind.Config, lambda config: kind(config, sizes))
        config = kind.Config(**{k: tuple(v) if isinstance(v, list) else v for k, v in details["config"].items()})
        return cls(system, config, network, vocabulary, sizes, **options)

    @property
    def network(self) -> Baseline:
        """The network."""
        return self._network

    def with_network(self, network: Baseline) -> Self:
        """The same with other weights, such as averaged ones.

        Args:
            network: of the same settings and sizes.
        """
        return type(self)(self.system, self.config, network, self.vocabulary, self.sizes)

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        return self.config, self.details()

    def details(self) -> dict[str, Any]:
        """What the checkpoint's JSON holds beside the settings: system, words, answers, sizes, number of parameters."""
        return {
            "system": self.system,
            "words": self.vocabulary.words,
            "answers": self.vocabulary.answers,
            "sizes": asdict(self.sizes),
            "parameters": sum(p.numel() for p in self._network.parameters()),
        }

    def check_features(self, features: FeatureSource | None, where: str) -> None:
        """Refuse features that do not fit, that do nothing or that are missing.

        Args:
            features: of the videos to answer about.
            where: their folder, for the message.

        Raises:
            DataError: says what was expected and found.
        """
        wanted = ", ".join(sorted(video_needs(self._network.needs)))
        if features is None and wanted:
            raise DataError(f"{self.system} needs features of the videos ({wanted}); give a folder with them")
        if features is None:
            return
        if not wanted:
            raise DataError(f"features {where} would do nothing: {self.system} does not see the video; leave them out")
        expected, found = (self.sizes.channels, self.sizes.grid), feature_sizes(features, self._network.needs)
        if expected != found:
            raise DataError(
                f"{where}: features have {found[0]} channels and grid {found[1]}, the baseline was trained with "
                f"{expected[0]} and {expected[1]}; make the features with the settings of the training's"
            )

    def answer_questions(
        self,
        scenes: Iterable[SceneQuestions],
        features: FeatureSource | None,
        types: Collection[str] = QUESTION_TYPES,
    ) -> Iterator[tuple[SceneQuestions, dict[int, Answer | NsdrError]]]:
        """Answer questions scene by scene; what `nsdr.evaluation.score.score_answers` takes.

        Args:
            scenes: questions; their programs are read where the network needs programs.
            features: of their videos; None where the network needs none.
            types: question types to answer.

        Yields:
            The scene's questions, and by question id the answer, with probabilities by the softmax, or why it has none.

        Raises:
            DataError: features are missing or do not fit (`check_features`).
        """
        self.check_features(features, "the features")
        for scene in scenes:
            yield scene, self._answered(scene, features, types)

    def _answered(
        self, scene: SceneQuestions, features: FeatureSource | None, types: Collection[str]
    ) -> dict[int, Answer | NsdrError]:
        answers: dict[int, Answer | NsdrError] = {}
        examples: dict[int, list[Example]] = {}
        for question in scene.questions:
            if question.type in types:
                try:
                    with_program = "program" in self._network.needs
                    examples[question.id] = encoded(scene.scene_index, question, self.vocabulary, with_program)
                except NsdrError as e:
                    answers[question.id] = e
        listed = [e for of_question in examples.values() for e in of_question]
        try:
            parts = [listed[i : i + TEXTS_PER_BATCH] for i in range(0, len(listed), TEXTS_PER_BATCH)]
            rows = iter([row for part in parts for row in self.probabilities(part, features)])
        except NsdrError as e:
            return answers | dict.fromkeys(examples, e)
        for question in scene.questions:
            if question.id in examples:
                answers[question.id] = self._answer(question, [next(rows) for _ in examples[question.id]])
        return answers

    def _answer(self, question: Question, probabilities: list[Tensor]) -> Answer:
        """The answer by the probabilities (answers,) of each of its texts."""
        words = [self.vocabulary.answers[int(row.argmax())] for row in probabilities]
        if question.type == "descriptive":
            (row,) = probabilities
            return Answer(question.text, question.program or (), words[0], probability=float(row.max()))
        correct = self.vocabulary.answers.index("correct")
        choices = tuple(
            ChoiceAnswer(choice.text, word, choice.program or (), (), probability=float(row[correct]))
            for choice, word, row in zip(question.choices, words, probabilities, strict=True)
        )
        return Answer(question.text, question.program or (), None, choices=choices)

    @torch.no_grad()
    def probabilities(self, examples: list[Example], features: FeatureSource | None) -> Tensor:
        """Probabilities (B, answers) of every answer to each example, on the CPU; impossible answers have 0.

        Raises:
            DataError: a video has no features; names it.
        """
        self._network.eval()
        batch = make_batch(examples, features, self._network.needs)
        moved = batch._replace(**{name: t.to(self.device) for name, t in batch._asdict().items() if t is not None})
        is_choice = torch.tensor([e.is_choice for e in examples])
        return masked_scores(self._network(moved).float().cpu(), is_choice, self._possible).softmax(1)


def baseline_sizes(vocabulary: Vocabulary, channels: int, grid: tuple[int, int]) -> Sizes:
    """The sizes that a vocabulary and features give.

    Args:
        vocabulary: words and answers.
        channels: of the features; 0 where none are read.
        grid: (h, w) of the feature maps; (0, 0) where none are read.
    """
    return Sizes(vocabulary.size, len(vocabulary.answers), len(PROGRAM_TOKENS), channels, grid)


def masked_scores(scores: Tensor, is_choice: Tensor, possible: Tensor) -> Tensor:
    """Scores (B, answers) with minus infinity for impossible answers.

    Args:
        scores: (B, answers).
        is_choice: (B,) bool, which texts are options.
        possible: (2, answers) bool, as of `Vocabulary.possible_answers`.
    """
    return scores.masked_fill(~possible[is_choice.long()], float("-inf"))

"""Train a baseline: `nsdr train baseline --config small/mac`."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.baselines.base import BASELINES, Baseline, Batch
from nsdr.baselines.data import Example, Vocabulary, make_batch, training_examples
from nsdr.baselines.features.files import KINDS, MANIFEST, FeatureCache
from nsdr.baselines.recoloring import Recoloring
from nsdr.baselines.trained import TrainedBaseline, masked_scores
from nsdr.clevrer.files.questions import PLAIN, QUESTION_TYPES, read_questions
from nsdr.errors import DataError
from nsdr.evaluation.report import Report
from nsdr.evaluation.score import score_answers
from nsdr.io.configuration import config_of
from nsdr.io.fingerprint import fingerprint
from nsdr.io.worlds import world_beside
from nsdr.training.loop import LoopConfig, LossTerm, Task, train_part
from nsdr.training.run_folder import parse_training
from nsdr.validation import Count, PathName, PositiveCount, Settings, expect


@dataclass(frozen=True)
class BaselineTraining(Settings):
    """Training of a baseline on a question file and the features of its videos.

    Attributes:
        run_dir: folder of the run; an interrupted run is resumed.
        system: name of the baseline in `nsdr.baselines.base.BASELINES`.
        questions: question file in CLEVRER's format, with answers, and with programs where the system needs them; its words
            of objects are those of the data set that it is of.
        validation: such a file about other videos, on which the network is evaluated.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        features: folder of a `nsdr.baselines.features.files.FeatureCache`; "" for systems that see no video.
        plain_steps: in the first so many steps only questions about objects alone are drawn (subtype "plain"; `nsdr generate`
            writes them when told to), afterwards only the others; 0 draws both in all steps.
        recolor: whether the colours of each video that is drawn are exchanged with each other, in its features (of words)
            and its texts.
        texts_per_video: most texts of one video in a batch. `loop.batch_size` counts texts: 64 texts with 8 of each video need
            the features of 8 videos.
        model: settings of the system (its `Config`); a setting that is not given has its default.
        loop: the optimisation.
    """

    run_dir: PathName
    system: str
    questions: PathName
    validation: PathName
    output: str = ""
    features: str = ""
    plain_steps: Count = 0
    recolor: bool = False
    texts_per_video: PositiveCount = 8
    model: dict[str, Any] = field(default_factory=dict)
    loop: LoopConfig = field(default_factory=LoopConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        expect(self.system in BASELINES.names(), "system", f"one of {', '.join(BASELINES.names())}", repr(self.system))
        self.model_config()
        below = f"fewer than the {self.loop.steps} steps of the training"
        expect(self.plain_steps < self.loop.steps, "plain_steps", below, self.plain_steps)
        wanted = ", ".join(sorted(BASELINES[self.system].needs & set(KINDS)))
        if wanted and not self.features:
            raise DataError(f"features: {self.system} needs {wanted} of the videos; give the folder of their features")
        if self.recolor and not wanted:
            raise DataError(f"recolor: {self.system} sees no video, it would do nothing; leave it out")
        if self.features and not wanted:
            raise DataError(f"features: {self.system} sees no video, they would do nothing; leave them out")

    def model_config(self) -> Any:
        """The settings of the system.

        Raises:
            DataError: an unknown setting, or a value of another type or out of its range; names it.
        """
        try:
            return config_of(BASELINES[self.system].Config, self.model)
        except DataError as e:
            raise DataError(f"model: {e}") from e

    def data_fingerprint(self) -> str:
        """Of the questions, and of the settings that the features were made with; features of other videos may be added."""
        manifest = [Path(self.features) / MANIFEST] if self.features else []
        return fingerprint(inputs=[Path(self.questions), Path(self.validation), *manifest])


class TrainingBatch(NamedTuple):
    """Examples with their answers.

    Attributes:
        inputs: what the network reads.
        is_choice: (B,) bool, which texts are options.
        answers: (B,) int64 indices of the answers.
    """

    inputs: Batch
    is_choice: Tensor
    answers: Tensor


class BaselineTask(Task):
    """Cross-entropy of the answer among those that are possible; evaluated by the accuracies on other videos."""

    def __init__(self, config: BaselineTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.config = config
        training, self.validation = read_questions(config.questions), read_questions(config.validation)
        kind = BASELINES[config.system]
        vocabulary = Vocabulary.from_questions(training, world_beside(config.questions).vocabulary)
        self.videos = training_examples(training, vocabulary, kind.needs)
        self.first = self.later = self.videos
        if config.plain_steps:
            self.first, self.later = (_some(self.videos, is_plain) for is_plain in (True, False))
            if not (self.first and self.later):
                raise DataError(
                    f"{config.questions}: plain_steps needs questions of subtype {PLAIN!r} and others; give "
                    "`nsdr generate questions` --questions.plain-per-video, or leave plain_steps out"
                )
        self.features = features = FeatureCache(config.features, kind.needs) if config.features else None
        sizes = vocabulary.sizes(features.channels, features.grid) if features else vocabulary.sizes()
        network = kind(config.model_config(), sizes)
        self.model: nn.Module = network
        made = features.manifest["features"] if features else {}
        if config.recolor and "from" not in made:
            raise DataError(
                f"recolor: {config.features} has features of pixels; give those of the truth, or leave it out"
            )
        self.recoloring = Recoloring(vocabulary) if config.recolor else None
        self.trained = TrainedBaseline(config.system, network, vocabulary, made)
        self.possible = vocabulary.possible_answers()

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[Example]:
        """Up to `texts_per_video` texts each of random videos, drawn by their numbers of texts.

        See `plain_steps` and `recolor` of the settings.
        """
        videos = self.first if step < self.config.plain_steps else self.later
        sizes = np.array([len(texts) for texts in videos])
        drawn: list[Example] = []
        while len(drawn) < count:
            texts = videos[rng.choice(len(videos), p=sizes / sizes.sum())]
            some = [texts[i] for i in rng.permutation(len(texts))[: self.config.texts_per_video]]
            if self.recoloring:
                colors = self.recoloring.draw(rng)
                some = [self.recoloring.text(example, colors) for example in some]
            drawn += some
        return drawn[:count]

    def collate(self, examples: Sequence[Example]) -> TrainingBatch:
        """The batch of these texts."""
        return TrainingBatch(
            make_batch(examples, self.features, self.trained.network.needs, self.trained.vocabulary.objects),
            torch.tensor([e.is_choice for e in examples]),
            torch.tensor([e.answer for e in examples]),
        )

    def losses(self, model: nn.Module, batch: TrainingBatch) -> dict[str, LossTerm]:
        """The cross-entropy of the answers."""
        scores = masked_scores(model(batch.inputs), batch.is_choice, self.possible.to(batch.is_choice.device))
        total = F.cross_entropy(scores.float(), batch.answers, reduction="sum")
        return {"answer": LossTerm(total, len(batch.answers))}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Accuracies on the validation videos by question type, for options also per option; programs are the file's."""
        of = self.trained
        baseline = TrainedBaseline(of.system, cast(Baseline, model), of.vocabulary, of.features)
        return accuracies(score_answers(baseline.answer_questions(self.validation, self.features)))


def _some(videos: Sequence[Sequence[Example]], is_plain: bool) -> list[list[Example]]:
    """The texts that are plain, or those that are not, of the videos that have some."""
    kept = ([text for text in texts if text.is_plain == is_plain] for texts in videos)
    return [texts for texts in kept if texts]


def accuracies(report: Report) -> dict[str, float]:
    """The accuracies (0-1) of a report by name, also by subtype, without question types that do not occur."""
    descriptive = report["descriptive"]
    found = {"descriptive": descriptive["accuracy"]}
    found |= {f"descriptive_{name}": row["accuracy"] for name, row in descriptive["subtypes"].items() if name != "None"}
    for kind in QUESTION_TYPES[1:]:
        found |= {f"{kind}_{name}": report[kind][name] for name in ("per_option", "per_question")}
    return {name: value for name, value in found.items() if value is not None}


def train_baseline(config: BaselineTraining) -> str:
    """Run one training; returns the folder of the finished checkpoint.

    Raises:
        DataError: unreadable questions or features, or the run was started with other ones.
    """
    task = BaselineTask(config)
    counts = {
        "videos": len(task.videos),
        "texts": sum(map(len, task.videos)),
        "validation_videos": len(task.validation),
    }
    inputs = {"data": config.data_fingerprint()}
    return train_part("baseline", task, config, config.model_config(), {**task.trained.details(), **counts}, inputs)


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    return train_baseline(parse_training(BaselineTraining, argv, "baseline"))

"""Scores of trained baselines by the same harness as those of NS-DR."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from msgspec.structs import replace

from nsdr.baselines.features.files import FeatureCache
from nsdr.baselines.recording import keep_recording
from nsdr.baselines.trained import TrainedBaseline
from nsdr.clevrer.files.questions import SceneQuestions
from nsdr.errors import DataError, NsdrError
from nsdr.evaluation.runner import (
    EvaluationConfig,
    evaluation_fingerprint,
    parse_all,
    parser_of,
    selected_questions,
    true_scene_of,
)
from nsdr.evaluation.score import Parse, score_answers
from nsdr.evaluation.sources import SOURCES
from nsdr.io.checkpoint import find_checkpoint, load_description
from nsdr.io.fingerprint import fingerprint
from nsdr.symbolic import Executor
from nsdr.types import Answer

__all__ = ["USED", "BaselineRow", "Trainer", "evaluate_baseline", "training_text"]

PROGRAMS = ("programs", "parser", "parser_model", "checkpoint")
"""Settings of `EvaluationConfig` that only baselines use which read programs."""
USED = ("questions", "root", "split", "types", "exclude", "every", "limit", "truth_source", "truth", *PROGRAMS)
"""Settings of `EvaluationConfig` that trained baselines use. The true scenes serve to tag counterfactual options."""
TRAINING = ("system", "parameters", "videos", "texts")
"""What a results file keeps of a checkpoint's description."""


class Trainer(Protocol):
    """Trains what the YAML files of `nsdr train baseline` ask for."""

    def fingerprint(self, file: str) -> str:
        """Of the training: its settings, questions and features."""

    def features(self, file: str) -> str:
        """Folder of the features of the training; "" for a system that sees no video."""

    def train(self, file: str, device: str) -> str:
        """Train, or go on, or find that it is done; returns the folder of the checkpoint."""

    def time(self, file: str) -> Mapping[str, float]:
        """`seconds` and `cpu_seconds` that the training took."""


@dataclass(frozen=True)
class BaselineRow:
    """A trained baseline as a row of an experiment.

    Attributes:
        train: YAML file of `nsdr train baseline`, whose training is run first; "" with `trained`.
        trained: checkpoint of a baseline; "" with `train`.
        features: folder of the features of the videos to answer about; "" for that of the training, which only `train` knows.
    """

    train: str = ""
    trained: str = ""
    features: str = ""

    def __post_init__(self) -> None:
        if bool(self.train) == bool(self.trained):
            raise DataError("give train (a YAML file) or trained (a checkpoint), and not both")

    def features_folder(self, trainer: Trainer | None) -> str:
        """Folder of the features of the videos to answer about; "" for none."""
        return self.features or (_needed(trainer).features(self.train) if self.train else "")

    def fingerprint(self, evaluation: EvaluationConfig, trainer: Trainer | None) -> str:
        """Of everything that the row's numbers depend on.

        Raises:
            DataError: the questions, the features, or what a training needs is not there.
        """
        folder = self.features_folder(trainer)
        config = {
            "evaluation": evaluation_fingerprint(evaluation),
            "training": _needed(trainer).fingerprint(self.train) if self.train else "",
            "features": FeatureCache(folder).fingerprint if folder else "",
        }
        return fingerprint(config=config, weights=[find_checkpoint(self.trained)] if self.trained else [])


def _needed(trainer: Trainer | None) -> Trainer:
    if trainer is None:
        raise DataError("a row with train needs something that trains; run it by `nsdr experiment`")
    return trainer


def evaluate_baseline(
    row: BaselineRow, config: EvaluationConfig, own: Sequence[str], device: str, trainer: Trainer | None
) -> dict[str, Any]:
    """Train a baseline where its row says so, answer the questions and score the answers.

    Args:
        row: which baseline.
        config: which questions; of its settings those in `USED` have an effect.
        own: settings that the row itself gives, which must have an effect.
        device: where the networks run.
        trainer: trains; None where the row has a checkpoint.

    Returns:
        The report of `score_answers`, and under `training` what is known of the training.

    Raises:
        DataError: unreadable questions or features, or settings that have no effect.
        CheckpointError: missing or damaged weights.
    """
    folder = find_checkpoint(_needed(trainer).train(row.train, device) if row.train else row.trained)
    baseline = TrainedBaseline.from_pretrained(folder, device)
    needs = baseline.network.needs
    unused = sorted(set(PROGRAMS) & set(own))
    if unused and "program" not in needs:
        raise DataError(f"{', '.join(unused)} would do nothing: {baseline.system} reads no programs; leave them out")
    where = row.features_folder(trainer)
    features = FeatureCache(where, needs) if where else None
    baseline.check_features(features)
    scenes, _ = selected_questions(config)
    parsed, failed = scenes, dict[int, dict[int, NsdrError]]()
    if "program" in needs and (parser := parser_of(config)) is not None:
        parsed, failed = _with_programs(scenes, parse_all(parser, scenes, config.types), config.types)

    def answered() -> Iterator[tuple[SceneQuestions, Mapping[int, Answer | NsdrError]]]:
        for scene, (_, answers) in zip(scenes, baseline.answer_questions(parsed, features, config.types), strict=True):
            yield scene, answers | failed.get(scene.scene_index, {})

    recordings = None
    if config.truth_source:
        source = SOURCES[config.truth_source](Path(config.truth), {s.scene_index for s in scenes})
        recordings = {s.scene_index: Executor(keep_recording(true_scene_of(source, s))) for s in scenes}
    report = score_answers(answered(), recordings)
    command = f"nsdr train baseline --config {row.train}" if row.train else f"checkpoint {row.trained}"
    time = _needed(trainer).time(row.train) if row.train else {}
    return report | {"training": {**_training(folder), "command": command, **time}}


def _with_programs(
    scenes: Sequence[SceneQuestions], parse: Parse, types: Sequence[str]
) -> tuple[list[SceneQuestions], dict[int, dict[int, NsdrError]]]:
    """The questions with parsed programs, and by scene and question why one has none."""
    result, failed = [], dict[int, dict[int, NsdrError]]()
    for scene in scenes:
        questions = []
        for q in (q for q in scene.questions if q.type in types):
            try:
                program = parse(q.text, "multiple_choice" if q.choices else "descriptive").tokens
                choices = tuple(replace(c, program=parse(c.text, "choice").tokens) for c in q.choices)
                questions.append(replace(q, program=program, choices=choices))
            except NsdrError as e:
                failed.setdefault(scene.scene_index, {})[q.id] = e
        result.append(replace(scene, questions=tuple(questions)))
    return result, failed


def _training(folder: Path) -> dict[str, Any]:
    """What a checkpoint says of its training."""
    details = load_description(folder, TrainedBaseline.part)
    known: dict[str, Any] = {name: details[name] for name in TRAINING if name in details}
    training = details.get("training")
    if isinstance(training, dict):
        loop = training["loop"]
        known["seed"] = loop["seed"]
        if "texts" in known:
            known["passes"] = loop["steps"] * loop["batch_size"] / known["texts"]
    return known


def training_text(training: Mapping[str, Any]) -> str:
    """One line about a training, as `evaluate_baseline` reports it."""
    parts = [f"`{training['command']}`", f"{training['parameters']:,} parameters"]
    if "seed" in training:
        parts.append(f"seed {training['seed']}")
    if "texts" in training:
        seen = f" seen {training['passes']:.1f} times" if "passes" in training else ""
        parts.append(f"{training['texts']:,} texts about {training['videos']:,} videos{seen}")
    if "seconds" in training:
        parts.append(f"trained in {training['seconds']:.0f} s ({training['cpu_seconds']:.0f} s of CPU time)")
    return ", ".join(parts)

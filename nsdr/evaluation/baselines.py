"""Scores of trained baselines by the same harness as those of NS-DR."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from nsdr.baselines.features.files import FeatureCache
from nsdr.baselines.trained import TrainedBaseline
from nsdr.clevrer.files.questions import SceneQuestions
from nsdr.errors import DataError, NsdrError
from nsdr.evaluation.report import Report
from nsdr.evaluation.runner import parse_all, parser_of
from nsdr.evaluation.score import Parse, score_answers
from nsdr.evaluation.settings import EvaluationConfig, evaluation_fingerprint, known_world_of_data, selected_questions
from nsdr.io.checkpoint import find_checkpoint, load_description
from nsdr.io.fingerprint import fingerprint
from nsdr.types import Answer

PROGRAMS = ("programs", "question_parser", "checkpoint")
"""Settings of `EvaluationConfig` that only baselines use which read programs."""
USED = ("questions", "root", "split", "types", "every", "limit", "tags_from", *PROGRAMS)
"""Settings of `EvaluationConfig` that trained baselines use."""
TRAINING = ("system", "parameters", "videos", "texts")
"""What a results file keeps of a checkpoint's description."""
SECONDS_PER_MINUTE = 60


def evaluate_baseline(
    trained: str, features: str, config: EvaluationConfig, own: Sequence[str], device: str
) -> tuple[Report, dict[str, Any]]:
    """Answer the questions by a trained baseline and score the answers.

    Args:
        trained: its checkpoint.
        features: folder of the features of the videos; "" for a system that sees no video.
        config: which questions; of its settings those in `USED` have an effect.
        own: settings that are given for this baseline, which must have an effect.
        device: where the networks run.

    Returns:
        The report, and what is known of the training.

    Raises:
        DataError: unreadable questions or features, questions in other words than the baseline's, or settings that have no
            effect.
        CheckpointError: missing or damaged weights.
    """
    folder = find_checkpoint(trained)
    baseline = TrainedBaseline.from_pretrained(folder, device)
    of_data, ours = known_world_of_data(config), baseline.vocabulary.objects
    if of_data is not None and of_data.vocabulary.words != ours.words:
        example = f"{of_data.vocabulary.example}, and {trained} learnt those of another, such as {ours.example}"
        raise DataError(
            f"{config.root or config.questions}: is in the words of the world {of_data.name}, such as {example}; give a "
            "baseline that was trained on questions of this world"
        )
    needs = baseline.network.needs
    unused = sorted(set(PROGRAMS) & set(own))
    if unused and "program" not in needs:
        raise DataError(f"{', '.join(unused)} would do nothing: {baseline.system} reads no programs; leave them out")
    scenes, _ = selected_questions(config)
    known = FeatureCache(features, needs) if features else None
    baseline.check_features(known)
    parsed, failed = scenes, dict[int, dict[int, NsdrError]]()
    if "program" in needs and (parser := parser_of(config)) is not None:
        parsed, failed = _with_programs(scenes, parse_all(parser, scenes, config.types), config.types)

    def answered() -> Iterator[tuple[SceneQuestions, Mapping[int, Answer | NsdrError]]]:
        for scene, (_, answers) in zip(scenes, baseline.answer_questions(parsed, known, config.types), strict=True):
            yield scene, answers | failed.get(scene.scene_index, {})

    return score_answers(answered()), {**_training(folder), "checkpoint": trained}


def baseline_fingerprint(trained: str, features: str, config: EvaluationConfig) -> str:
    """Of everything that a baseline's numbers depend on.

    Raises:
        DataError: the questions or the features are not there.
        CheckpointError: there are no such weights.
    """
    settings = {
        "evaluation": evaluation_fingerprint(config),
        "features": FeatureCache(features).fingerprint if features else "",
    }
    return fingerprint(config=settings, weights=[find_checkpoint(trained)])


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
    if "cpu_seconds" in details.get("metrics", {}):
        known["cpu_seconds"] = details["metrics"]["cpu_seconds"]
    return known


def training_text(training: Mapping[str, Any]) -> str:
    """One line about a training, as `evaluate_baseline` reports it."""
    parts = [f"`{training['checkpoint']}`", f"{training['parameters']:,} parameters"]
    if "seed" in training:
        parts.append(f"seed {training['seed']}")
    if "texts" in training:
        seen = f" seen {training['passes']:.1f} times" if "passes" in training else ""
        parts.append(f"{training['texts']:,} texts about {training['videos']:,} videos{seen}")
    if "cpu_seconds" in training:
        minutes = round(training["cpu_seconds"] / SECONDS_PER_MINUTE)
        parts.append(f"{minutes} minute{'s' if minutes != 1 else ''} of CPU time")
    return ", ".join(parts)

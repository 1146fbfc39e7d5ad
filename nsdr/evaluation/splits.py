"""Whole splits of CLEVRER: pixels or proposals -> answers over thousands of videos, resumable at any kill.

Scenes are kept on disk by the content of their input and the configuration that made them, so that a second run only does what
is missing, and every run gives the same report byte for byte.
"""

import hashlib
import json
import logging
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

import nsdr
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.questions import QUESTION_TYPES, SceneQuestions
from nsdr.dynamics.registry import backend_settings, checkpoint_folders
from nsdr.errors import DataError, NsdrError
from nsdr.evaluation.score import Parse, evaluate
from nsdr.io import storage
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.files import write_json
from nsdr.io.tasks import run_tasks
from nsdr.symbolic import Executor
from nsdr.types import Scene

__all__ = ["SplitEvaluation", "evaluate_split"]

log = logging.getLogger(__name__)
SOURCES = ("videos", "proposals")


@dataclass(frozen=True)
class SplitEvaluation:
    """What is evaluated, and how.

    Attributes:
        root: folder in the official layout (see `CLEVRER`).
        split: "train", "validation" or "test".
        source: "videos", or the split's mask "proposals".
        cache: folder for scenes.
        limit: first so many scenes of the question file; 0 for all.
        programs: "parsed" or "gold".
        types: question types to answer.
        checkpoint: weights.
        dynamics: backend of the dynamics predictor, or its YAML file.
        stride: of the frame parser.
        engine: "processes" or "ray".
        workers: processes, 0 for one a CPU core.
    """

    root: str
    split: str
    source: str = "videos"
    cache: str = "runs/scenes"
    limit: int = 0
    programs: str = "parsed"
    types: Sequence[str] = QUESTION_TYPES
    checkpoint: str = "default"
    dynamics: str = "physics"
    stride: int = 1
    engine: str = "processes"
    workers: int = 0


@dataclass(frozen=True)
class _Recipe:
    """What every worker needs to make a scene."""

    root: str
    split: str
    source: str
    checkpoint: str
    dynamics: str
    stride: int


def evaluate_split(config: SplitEvaluation) -> dict[str, Any]:
    """Answer the questions of a split; a video that fails is recorded, its questions count as wrong.

    Returns:
        The report of `nsdr.evaluation.score.evaluate`.

    Raises:
        DataError: no such folder, split or question file, or an unknown source.
    """
    if config.source not in SOURCES:
        raise DataError(f"a split is evaluated from {' or '.join(SOURCES)}, not from {config.source}")
    split = CLEVRER(config.root).split(config.split)
    questions = list(split.questions())[: config.limit or None]
    recipe = _Recipe(config.root, config.split, config.source, config.checkpoint, config.dynamics, config.stride)
    folder = Path(config.cache) / _configuration_digest(recipe)
    jobs, failed = {}, {}
    for scene in tqdm(questions, desc="reading", unit="video"):
        try:
            content = hashlib.sha256(_content(recipe, scene.scene_index)).hexdigest()[:16]
            jobs[scene.scene_index] = folder / f"scene_{scene.scene_index:05d}_{content}.json"
        except NsdrError as e:
            failed[scene.scene_index] = str(e)
    missing = [(index, path) for index, path in jobs.items() if not path.exists()]
    outcomes = run_tasks(partial(_perceive, recipe), missing, config.engine, config.workers)
    progress = tqdm(outcomes, desc="videos", unit="video", total=len(jobs), initial=len(jobs) - len(missing))
    failed |= {outcome.item[0]: outcome.error for outcome in progress if outcome.error}
    if failed:
        write_json(folder / "failures.json", {str(k): failed[k] for k in sorted(failed)}, indent=1)
        log.warning("%d videos failed; see %s", len(failed), folder / "failures.json")

    def scenes() -> Iterator[tuple[SceneQuestions, Executor | NsdrError]]:
        for scene in questions:
            if scene.scene_index in failed:
                yield scene, DataError(failed[scene.scene_index])
            else:
                yield scene, Executor(storage.load(Scene, jobs[scene.scene_index]))

    return evaluate(scenes(), _parser(config), config.types)


def _parser(config: SplitEvaluation) -> Parse | None:
    if config.programs == "gold":
        return None
    from nsdr.question_parser.parser import QuestionParser

    return QuestionParser.from_checkpoint(find_checkpoint(config.checkpoint)).parse


def _configuration_digest(recipe: _Recipe) -> str:
    """Of everything but the input that a scene depends on: version, weights, backend and stride."""
    digest = hashlib.sha256(f"{nsdr.__version__} {recipe.source} {recipe.stride}".encode())
    settings = backend_settings(recipe.dynamics)
    digest.update(json.dumps(asdict(settings), sort_keys=True).encode())
    for folder in checkpoint_folders(find_checkpoint(recipe.checkpoint), settings):
        for part in ("frame_parser", "dynamics"):
            for path in (folder / f"{part}.json", folder / f"{part}.safetensors"):
                digest.update(path.read_bytes() if path.exists() else b"")
    return digest.hexdigest()[:16]


def _content(recipe: _Recipe, index: int) -> bytes:
    split = _split(recipe.root, recipe.split)
    return split.video(index).read_bytes() if recipe.source == "videos" else split.raw_proposals(index)


def _perceive(recipe: _Recipe, job: tuple[int, Path]) -> None:
    index, path = job
    split, pipeline = _split(recipe.root, recipe.split), _pipeline(recipe)
    if recipe.source == "videos":
        perception = pipeline.perceive(split.video(index))
    else:
        perception = pipeline.perceive(proposals=split.proposals(index))
    storage.save(perception.scene, path)


@lru_cache(maxsize=1)
def _split(root: str, name: str) -> Any:
    return CLEVRER(root).split(name)


@lru_cache(maxsize=1)
def _pipeline(recipe: _Recipe) -> Any:
    from nsdr.pipeline import Pipeline

    pipeline = Pipeline.from_pretrained(recipe.checkpoint, recipe.dynamics)
    pipeline.frame_parser.stride = recipe.stride
    return pipeline

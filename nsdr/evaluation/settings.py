"""What is evaluated, and how: the settings, the questions they select, and what a report depends on."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from nsdr import question_parser, symbolic
from nsdr.baselines.recording import tag_options
from nsdr.clevrer.dataset import CLEVRER, Split, file_name
from nsdr.clevrer.files.questions import QUESTION_TYPES, SceneQuestions, read_questions
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.errors import DataError
from nsdr.evaluation.sources import SOURCES, Data
from nsdr.io.files import find_files
from nsdr.io.fingerprint import fingerprint
from nsdr.io.tasks import ENGINES
from nsdr.io.worlds import known_world_beside
from nsdr.pipeline_config import OF_QUESTIONS, PipelineConfig, pipeline_settings
from nsdr.validation import Count, PositiveCount, Settings, expect, one_of
from nsdr.world.world import CLEVRER_WORLD, World

VERSION = 3
"""Of reports: raised when they change."""
COUNTED_OTHERWISE = {
    *("questions", "data", "videos", "truth", "tags_from", "root", "available", "cache", "engine", "workers", "device"),
    *("checkpoint", "config", "set", "dynamics", "question_parser"),
}
"""Settings that count for a fingerprint by what they name, or change no result."""

FILES_OF = {"videos": "videos", "proposals": "proposals", "tracks": "annotations", "annotations": "annotations"}
"""The kind of a data set's files that scenes of each source are made from."""


@dataclass(frozen=True)
class EvaluationConfig(Settings):
    """What is evaluated, and how.

    Attributes:
        questions: question file; "" with `root`.
        data: folder or file that `source` reads; "" with `root`.
        root: folder of a data set in CLEVRER's official layout, in place of `questions` and `data`.
        split: which part of `root`.
        available: whether only the videos of `root` that are there count; if not, all must be there.
        source: what scenes are made from, such as "videos", "proposals", "annotations" or "scenes"; a wrong word lists all.
        videos: folder of the videos that the proposals of `data` are of, for a dynamics backend that reads images.
        programs: "parsed", or "gold" for those of the question file.
        question_parser: "grammar", "network", or a language model's address; "" for that of `config` (grammar).
        types: question types to answer.
        every: answer every n-th scene of those with such questions.
        limit: answer the first n of these scenes; 0 for all.
        checkpoint: weights.
        dynamics: a backend's name, or its YAML file; "" for that of `config` (physics).
        config: YAML file with settings of a pipeline, or "paper" for the paper's system; "" for the defaults.
        set: single settings, "key=value" each, such as "tracker.score=0.8".
        semantics: "paper", or "official" for the released executor's, which needs predictions.
        collisions: with the official semantics "predicted", or "velocity" (NE).
        counterfactuals: "simulated", or "recording" for `nsdr.baselines.keep_recording`.
        data_set_rules: whether rules of CLEVRER's questions count, as in `nsdr.Executor`; with the paper's semantics.
        truth_source: source of scenes whose observed collisions replace the detected ones; "" for none.
        truth: folder or file that `truth_source` reads.
        tags_from: file or folder of true scenes (annotations, truth files or compact ground truth) that tell which
            counterfactual options are observational and which inferential; "" keeps the tags of the question file.
        cache: folder that keeps scenes for the next run.
        engine: "processes" or "ray".
        workers: number of processes; 0 is one per CPU core, and on CUDA at most as many as the GPU's memory is enough for.
        device: where the networks of every process run, such as "cuda:1"; "auto" takes a GPU where there is one.
    """

    questions: str = ""
    data: str = ""
    root: str = ""
    split: Literal["train", "validation", "test"] = "validation"
    available: bool = False
    source: str = "videos"
    videos: str = ""
    programs: Literal["parsed", "gold"] = "parsed"
    question_parser: str = ""
    types: Sequence[str] = QUESTION_TYPES
    every: PositiveCount = 1
    limit: Count = 0
    checkpoint: str = "default"
    dynamics: str = ""
    config: str = ""
    set: Sequence[str] = ()
    semantics: Literal["paper", "official"] = "paper"
    collisions: Literal["predicted", "velocity"] = "predicted"
    counterfactuals: Literal["simulated", "recording"] = "simulated"
    data_set_rules: bool = True
    truth_source: str = ""
    truth: str = ""
    tags_from: str = ""
    cache: str = "runs/scenes"
    engine: Annotated[str, one_of(ENGINES)] = "processes"
    workers: Count = 0
    device: str = "auto"

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = sorted(set(self.types) - set(QUESTION_TYPES)) if self.types else ["nothing"]
        if unknown:
            raise DataError(f"types: unknown question type {unknown[0]!r}; expected {', '.join(QUESTION_TYPES)}")
        sources = SOURCES.names()
        expect(self.source in sources, "source", f"one of {', '.join(sources)}", self.source)
        expect(self.truth_source in ("", *sources), "truth_source", f"one of {', '.join(sources)}", self.truth_source)
        if self.question_parser and self.programs == "gold":
            raise DataError("question_parser would do nothing with programs gold; leave one out")
        if (bool(self.questions), bool(self.data)) != (not self.root, not self.root):
            raise DataError("give --questions and --data, or --root for a whole split")
        if self.semantics == "official" and self.source != "predictions":
            raise DataError(
                f"the official semantics runs on predictions, not on {self.source}; use --source predictions"
            )
        if self.semantics == "official" and self.counterfactuals != "simulated":
            raise DataError("counterfactuals: recording needs --semantics paper")
        if self.semantics == "paper" and self.collisions != "predicted":
            raise DataError("collisions: velocity needs --semantics official; for NE of a backend use its YAML file")
        if self.videos and (self.source != "proposals" or self.root):
            raise DataError("videos goes with --source proposals and --data; leave it out")
        if bool(self.truth_source) != bool(self.truth):
            raise DataError("truth_source and truth go together; give both or none")
        if self.split != "validation" and not self.root:
            raise DataError(f"split {self.split} is of --root and does nothing without it")
        if self.available and not self.root:
            raise DataError("available is of --root and does nothing without it")
        if self.semantics == "official" and self.root:
            raise DataError("source predictions cannot be read from a split of --root; give --questions and --data")

    @property
    def world(self) -> World:
        """The world of the questions: that of the data; or else CLEVRER's with `root`, and without it the pipeline's."""
        if known := known_world_of_data(self):
            return known
        return CLEVRER_WORLD if self.root else self.pipeline().world

    def pipeline(self) -> PipelineConfig:
        """The resolved settings of the pipeline."""
        chosen = [f"question_parser={self.question_parser}"] if self.question_parser else []
        return pipeline_settings(self.config, self.dynamics, [*self.set, *chosen], self.checkpoint)


def known_world_of_data(config: EvaluationConfig) -> World | None:
    """The world that the data set says, or what is beside the questions or beside `data`; None where nothing says it."""
    if config.root:
        return known_world_beside(Path(config.root) / "manifest.json")
    return known_world_beside(config.questions) or known_world_beside(config.data)


def evaluation_fingerprint(config: EvaluationConfig) -> str:
    """Of everything a report depends on; folders count by the names, sizes and times of their files."""
    inputs: list[Any] = []
    for name in (config.questions, config.data, config.videos, config.truth, config.tags_from, config.root):
        path = Path(name)
        if name and path.is_dir():
            files = find_files(path, "*")
            inputs.append(repr([(str(p), p.stat().st_size, p.stat().st_mtime_ns) for p in files]).encode())
        elif name:
            inputs.append(path)
    values = {name: value for name, value in asdict(config).items() if name not in COUNTED_OTHERWISE}
    versions = [VERSION, question_parser.VERSION, symbolic.VERSION]
    settings = config.pipeline()
    parser = [getattr(settings, name) for name in OF_QUESTIONS]
    return fingerprint(inputs=inputs, config=[values, versions, parser, settings.fingerprint(config.checkpoint)])


def selected_questions(config: EvaluationConfig) -> tuple[list[SceneQuestions], Data]:
    """The questions that are answered, and what scenes are made from.

    Raises:
        DataError: unreadable questions; or some of the files of `root` are missing (says how many, and where they were looked
            for), and `available` is False.
    """
    data: Data
    if config.root:
        split = CLEVRER(config.root).split(config.split)
        listed, data = list(split.questions()), split
    else:
        listed, data = read_questions(config.questions, config.world), Path(config.data)
    listed = [s for s in listed if any(q.type in config.types for q in s.questions)]
    if isinstance(data, Split) and config.available:
        listed = [s for s in listed if _is_there(config, data, s)]
        if not listed:
            raise DataError(_partial(config, data, 0, len(data.indices), data.indices[0]))
    listed = listed[:: config.every][: config.limit or None]
    if isinstance(data, Split) and not config.available:
        missing = [s.scene_index for s in listed if not _is_there(config, data, s)]
        if missing:
            raise DataError(_partial(config, data, len(listed) - len(missing), len(listed), missing[0]))
    return _tagged(listed, config) if config.tags_from else listed, data


def _is_there(config: EvaluationConfig, split: Split, s: SceneQuestions) -> bool:
    """Whether a split has the file that the scene of questions is made from."""
    return config.source not in FILES_OF or split.find(FILES_OF[config.source], s.scene_index) is not None


def _partial(config: EvaluationConfig, split: Split, there: int, wanted: int, missing: int) -> str:
    """What is said of a split with some or none of the files, of which that of the scene `missing` is missing."""
    kind = FILES_OF[config.source]
    remedy = "; --available scores those" if there else ""
    said = f"{split.root}: {there or 'none'} of {wanted} {kind} are here{remedy}: {split.files.expected(kind)}"
    return f"{said}; {file_name(kind, missing)} is missing"


def _tagged(questions: Sequence[SceneQuestions], config: EvaluationConfig) -> list[SceneQuestions]:
    """The questions with the tags that the true scenes of `tags_from` give them."""
    if "counterfactual" not in config.types:
        return list(questions)
    wanted = {s.scene_index for s in questions if any(q.type == "counterfactual" for q in s.questions)}
    scenes = {index: scene for index, _, scene in iterate_scenes(config.tags_from) if index in wanted}
    where = f"{config.questions or config.root} with tags_from {config.tags_from}"
    if missing := wanted - scenes.keys():
        raise DataError(
            f"{where}, which lacks {len(missing)} scenes with counterfactual questions, such as {min(missing)}"
        )
    try:
        return [tag_options(s, scenes[s.scene_index]) if s.scene_index in scenes else s for s in questions]
    except DataError as e:
        raise DataError(f"{where}: {e}") from e

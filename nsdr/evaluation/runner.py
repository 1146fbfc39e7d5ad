"""Evaluation of question files and whole splits: parallel, and resumable at any kill.

Scenes are kept on disk under their fingerprint, so that a second run only makes what is missing, and every run gives the same
report byte for byte. Evaluations may share the folder: one that needs scenes of the same settings waits for another that makes
them, and what was made is never replaced by a scene of other inputs.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from tqdm import tqdm

from nsdr import question_parser, symbolic
from nsdr.baselines.recording import keep_recording, tag_options
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.files.questions import QUESTION_TYPES, SceneQuestions, read_questions
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.clevrer.layout import FolderFiles
from nsdr.dynamics.registry import READ_NO_IMAGES
from nsdr.errors import DataError, NsdrError
from nsdr.evaluation.batch import worker_pipeline
from nsdr.evaluation.score import Parse, evaluate
from nsdr.evaluation.sources import SOURCES, Data, PerceptionInput, SceneSource, prediction_file
from nsdr.io import storage
from nsdr.io.device import resolve_device
from nsdr.io.files import find_files
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, read_output, run_jobs
from nsdr.io.tasks import ENGINES
from nsdr.pipeline_config import OF_QUESTIONS, PipelineConfig, idle_without_video, pipeline_settings
from nsdr.question_parser.base import Parser
from nsdr.question_parser.loading import NETWORK, load_parser
from nsdr.symbolic import Executor, OfficialExecutor, Program
from nsdr.types import Scene
from nsdr.validation import Count, PositiveCount, Settings, expect, one_of

VERSION = 3
"""Of reports: raised when they change."""
SceneJob = Job[tuple[PerceptionInput, Scene | None]]
"""Makes a scene of the pipeline's input, in which the observed collisions of a true scene may replace the detected ones."""
COUNTED_OTHERWISE = {
    *("questions", "data", "videos", "truth", "tags_from", "root", "cache", "engine", "workers", "device"),
    *("checkpoint", "config", "set", "dynamics", "question_parser"),
}
"""Settings that count for a fingerprint by what they name, or change no result."""


@dataclass(frozen=True)
class EvaluationConfig(Settings):
    """What is evaluated, and how.

    Attributes:
        questions: question file; "" with `root`.
        data: folder or file that `source` reads; "" with `root`.
        root: data set in the official layout (see `nsdr.clevrer.CLEVRER`), in place of `questions` and `data`.
        split: "train", "validation" or "test" of `root`.
        source: what scenes are made from, a name in `nsdr.evaluation.SOURCES`.
        videos: folder of the videos that the proposals of `data` are of, for a dynamics backend that reads images.
        programs: "parsed", or "gold" for those of the question file.
        question_parser: what parses, as in `nsdr.PipelineConfig`; "" for that of `config` (grammar).
        types: question types to answer.
        every: answer every n-th scene of those with such questions.
        limit: answer the first n of these scenes; 0 for all.
        checkpoint: weights.
        dynamics: a backend's name, or its YAML file; "" for that of `config` (physics).
        config: YAML file of a `nsdr.PipelineConfig`, or "paper" for the paper's system; "" for the defaults.
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
        workers: number of processes; 0 is one per CPU core.
        device: where the networks of every process run, as in `Pipeline.from_pretrained`.
    """

    questions: str = ""
    data: str = ""
    root: str = ""
    split: Literal["train", "validation", "test"] = "validation"
    source: str = "proposals"
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
        if self.semantics == "official" and self.root:
            raise DataError("source predictions cannot be read from a split of --root; give --questions and --data")

    def pipeline(self) -> PipelineConfig:
        """The resolved settings of the pipeline."""
        chosen = [f"question_parser={self.question_parser}"] if self.question_parser else []
        return pipeline_settings(self.config, self.dynamics, [*self.set, *chosen])


def run_evaluation(config: EvaluationConfig) -> dict[str, Any]:
    """Answer and score the questions; a scene that fails is recorded, and its questions count as wrong.

    A scene of the cache that cannot be read any more is made again.

    Returns:
        The report of `nsdr.evaluation.evaluate`.

    Raises:
        DataError: unreadable questions or data, or values that do not go together.
        EndpointError: the server of the question parser is not there; or it fails, after the scenes were kept.
        MachineError: a full disk, a lost worker or the like, which is no fault of a scene.
    """
    parser = parser_of(config)  # a server that is not there is found before the work
    settings = config.pipeline()
    device = str(resolve_device(config.device))
    questions, data = selected_questions(config)
    made: Iterable[tuple[SceneQuestions, Executor | OfficialExecutor | NsdrError]]
    if config.semantics == "official":
        _check_no_pipeline_options(config)
        predictions = FolderFiles(Path(config.data))
        made = (
            (s, _official(config, predictions, s.scene_index)) for s in tqdm(questions, desc="scenes", unit="scene")
        )
    else:
        scenes = _scenes(config, settings, device, questions, data)
        made = ((s, _executor(scenes[s.scene_index], config)) for s in questions)
    parse = parse_all(parser, questions, config.types) if parser else None
    return evaluate(made, parse, config.types)


def _scenes(
    config: EvaluationConfig,
    settings: PipelineConfig,
    device: str,
    questions: Sequence[SceneQuestions],
    data: Data,
) -> Mapping[int, Scene | Callable[[], Scene] | NsdrError]:
    """By scene index a scene, a function that reads it from the cache, or why there is none."""
    if config.videos and settings.dynamics.backend in READ_NO_IMAGES:
        raise DataError(
            f"videos would do nothing: dynamics {settings.dynamics.backend!r} reads no images; leave it out"
        )
    wanted = {s.scene_index for s in questions}
    source = SOURCES[config.source](data, wanted)
    video_of = SOURCES["videos"](Path(config.videos), wanted) if config.videos else None
    true_source = SOURCES[config.truth_source](Path(config.truth), wanted) if config.truth_source else None
    scenes: dict[int, Scene | Callable[[], Scene] | NsdrError] = {}
    jobs: list[SceneJob] = []
    common = ""
    for s in tqdm(questions, desc="reading", unit="scene"):
        try:
            found = source(s)
            true_scene = None if true_source is None else true_scene_of(true_source, s)
            if isinstance(found, Scene):
                scenes[s.scene_index] = found
                continue
            if not isinstance(found, Mapping):
                expected = "an nsdr.Scene, or arguments of Pipeline.perceive"
                raise DataError(f"source {config.source} returned a {type(found).__name__}; expected {expected}")
            if video_of is not None:
                found = {**found, **cast(PerceptionInput, video_of(s))}
            common = common or settings.fingerprint(config.checkpoint, config.source, config.truth_source)
            jobs.append(_job(config, common, s.scene_index, found, true_scene))
        except NsdrError as e:
            scenes[s.scene_index] = e
    if any(isinstance(s, Scene) for s in scenes.values()):
        _check_no_pipeline_options(config)
    if jobs:
        function, read = partial(_perceive, config.checkpoint, settings, device), partial(storage.load, Scene)
        folder = jobs[0].output.parent
        summary = run_jobs(function, jobs, folder, config.engine, config.workers, "scene", wait=True)
        scenes |= {int(job.name): partial(read_output, job, read, function) for job in jobs}
        scenes |= {int(name): DataError(message) for name, message in summary.failed.items()}
    return scenes


def parser_of(config: EvaluationConfig) -> Parser | None:
    """The parser of the settings; None where the programs are those of the question file.

    Raises:
        CheckpointError: missing or corrupt weights.
        EndpointError: the server of the question parser is not there.
    """
    settings = config.pipeline()
    if config.programs == "gold":
        return None
    return load_parser(settings.question_parser, config.checkpoint, settings.extensions, config.device)


def parse_all(parser: Parser, questions: Iterable[SceneQuestions], types: Sequence[str]) -> Parse:
    """Programs of the texts of questions of these types: every distinct text is parsed once, in batches.

    Raises:
        EndpointError: the server of the parser fails.
    """
    texts: dict[str, dict[str, None]] = {"descriptive": {}, "multiple_choice": {}, "choice": {}}
    for question in (q for s in questions for q in s.questions if q.type in types):
        texts["descriptive" if question.type == "descriptive" else "multiple_choice"][question.text] = None
        texts["choice"].update(dict.fromkeys(c.text for c in question.choices))
    known: dict[tuple[str, str], Program | NsdrError] = {}
    for kind, listed in texts.items():
        programs = parser.parse_batch(list(listed), kind)
        known |= {(text, kind): program for text, program in zip(listed, programs, strict=True)}

    def parse(text: str, kind: str) -> Program:
        program = known[text, kind]
        if isinstance(program, NsdrError):
            raise program
        return program

    return parse


def _check_no_pipeline_options(config: EvaluationConfig) -> None:
    """Sources that give scenes leave nothing to do for a pipeline and its options."""
    given = [f"--{name}" for name in ("dynamics", "truth_source") if getattr(config, name)]
    given += idle_without_video(config.config, config.set)
    if config.checkpoint != "default" and (config.programs == "gold" or config.pipeline().question_parser != NETWORK):
        given.append("--checkpoint")
    if given:
        raise DataError(f"source {config.source} needs no pipeline: {', '.join(given)} would do nothing; leave it out")


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
    """The questions that are answered, and what scenes are made from."""
    data: Data
    if config.root:
        split = CLEVRER(config.root).split(config.split)
        listed, data = list(split.questions()), split
    else:
        listed, data = read_questions(config.questions), Path(config.data)
    listed = [s for s in listed if any(q.type in config.types for q in s.questions)]
    listed = listed[:: config.every][: config.limit or None]
    return _tagged(listed, config) if config.tags_from else listed, data


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


def _job(
    config: EvaluationConfig, common: str, index: int, given: PerceptionInput, true_scene: Scene | None
) -> SceneJob:
    inputs = [Path(v) if isinstance(v, str) else v for v in given.values()]
    value = fingerprint(inputs=[*inputs, common.encode(), *([] if true_scene is None else [true_scene])])
    output = Path(config.cache) / f"{config.source}-{common}" / f"scene_{index:05d}_{value}.json"
    return Job(str(index), (given, true_scene), output, value)


def _perceive(
    checkpoint: str, settings: PipelineConfig, device: str, item: tuple[PerceptionInput, Scene | None], output: Path
) -> None:
    given, true_scene = item
    perception = worker_pipeline(checkpoint, settings, device).perceive(**given, true_scene=true_scene)
    storage.save(replace(perception.scene, physics=None), output)  # which CLEVRER's questions do not ask for


def true_scene_of(source: SceneSource, s: SceneQuestions) -> Scene:
    """The scene of a source that gives scenes.

    Raises:
        DataError: it gives something else.
    """
    scene = source(s)
    if not isinstance(scene, Scene):
        raise DataError("the source of true scenes must give scenes: annotations, ground-truth, truth or scenes")
    return scene


def _executor(scene: Scene | Callable[[], Scene] | NsdrError, config: EvaluationConfig) -> Executor | NsdrError:
    try:
        known = scene() if callable(scene) else scene
    except DataError as e:
        return e
    if isinstance(known, NsdrError):
        return known
    asked = keep_recording(known) if config.counterfactuals == "recording" else known
    return Executor(asked, data_set_rules=config.data_set_rules)


def _official(config: EvaluationConfig, predictions: FolderFiles, scene_index: int) -> OfficialExecutor | NsdrError:
    try:
        return OfficialExecutor(prediction_file(predictions, scene_index), config.collisions)
    except NsdrError as e:
        return e

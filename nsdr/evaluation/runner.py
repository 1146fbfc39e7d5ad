"""Evaluation of question files and whole splits: parallel, and resumable at any kill.

Scenes are kept on disk under their fingerprint, so that a second run only makes what is missing, and every run gives the same
report byte for byte. Evaluations may share the folder: one that needs scenes of the same settings waits for another that makes
them, and what was made is never replaced by a scene of other inputs.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, cast

from tqdm import tqdm

from nsdr.baselines.recording import keep_recording
from nsdr.clevrer.files.questions import SceneQuestions
from nsdr.clevrer.layout import FolderFiles
from nsdr.dynamics.registry import READ_NO_IMAGES
from nsdr.errors import CheckpointError, DataError, NsdrError
from nsdr.evaluation.batch import worker_pipeline
from nsdr.evaluation.report import Report
from nsdr.evaluation.score import Parse, score_scenes
from nsdr.evaluation.settings import EvaluationConfig, known_world_of_data, selected_questions
from nsdr.evaluation.sources import SOURCES, Data, PerceptionInput, SceneSource, prediction_file
from nsdr.io import storage
from nsdr.io.device import resolve_device, workers_on
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, read_output, run_jobs
from nsdr.io.worlds import check_world_of_data
from nsdr.pipeline import Pipeline
from nsdr.pipeline_config import PipelineConfig, idle_without_video
from nsdr.question_parser.base import Parser, parse_texts
from nsdr.question_parser.grammar import GrammarParser
from nsdr.question_parser.loading import NETWORK, load_parser
from nsdr.symbolic import Executor, OfficialExecutor, Program
from nsdr.types import Scene
from nsdr.world.vocabulary import indefinite

SceneInput = tuple[PerceptionInput, Scene | None]
"""What a pipeline perceives, and a true scene whose observed collisions replace the detected ones."""
MadeScene = Scene | Callable[[], Scene] | NsdrError
"""A scene, a function that makes or reads it, or why there is none."""
Perceived = Callable[[EvaluationConfig, Mapping[int, SceneInput]], dict[int, MadeScene]]
"""(settings, inputs by scene index) -> scenes."""
PERCEIVED = ("videos", "proposals", "tracks")
"""Sources from which a pipeline makes scenes. The world of those of other packages is not checked."""
OF_PIPELINES = ("checkpoint", "dynamics", "config", "set", "question_parser")
"""Settings of `EvaluationConfig` in whose place `evaluate` takes a pipeline."""


def evaluate(
    pipeline: Pipeline,
    questions: str | Path,
    split: Literal["train", "validation", "test"] = "validation",
    limit: int = 0,
    **settings: Any,
) -> Report:
    """Answer and score the questions of a data set, or of a question file, by a pipeline.

    Texts are parsed by the pipeline's question parser (`programs="gold"` takes the programs of the data set). Its other parts
    perceive the videos in several processes, and scenes are kept in `cache`, so that an interrupted evaluation goes on. A
    pipeline with a frame parser or a dynamics backend of your own perceives in this process, and its scenes are not kept.

        >>> print(nsdr.evaluate(nsdr.Pipeline.from_pretrained(), "data/clevrer", limit=100))

    Args:
        pipeline: any parts.
        questions: folder of a data set in the official layout (see `nsdr.CLEVRER`); or a question file, beside which `data`
            names the folder or file that scenes are made from.
        split: split of the data set.
        limit: answer questions about the first n videos; 0 for all.
        settings: others of `EvaluationConfig`, such as `source="proposals"` to start from mask proposals, `data="videos/"`,
            `types=["counterfactual"]`, `cache="runs/scenes"` or `workers=1`.

    Raises:
        DataError: unreadable questions or data, values that do not go together, or data of another world than the pipeline's.
        EndpointError: the server of the question parser fails.
        MachineError: a full disk, a lost worker or the like.
    """
    if given := [name for name in OF_PIPELINES if name in settings]:
        raise DataError(f"{', '.join(given)}: the pipeline that is given has its own; leave it out")
    path = str(questions)
    if not Path(path).exists():
        raise DataError(f"{path}: no such file or folder; expected a data set's folder, or a question file with data=…")
    if not (Path(path).is_dir() or settings.get("data")):
        raise DataError(f"{path} is a question file; data=… names the folder or file that scenes are made from")
    where: dict[str, Any] = {"root": path} if Path(path).is_dir() else {"questions": path}
    config = EvaluationConfig(**where, split=split, limit=limit, **settings)
    _check_world(config, pipeline, "the pipeline")
    parser = None if config.programs == "gold" else pipeline.question_parser
    perceives = _without_questions(pipeline)
    try:
        stored = perceives.settings
    except DataError:  # a part of the user's own, which other processes could not load
        return _evaluate(config, parser, lambda *about: _perceived_here(perceives, *about))
    with TemporaryDirectory(prefix="nsdr") as folder:
        perceives.save_pretrained(folder)
        config = replace(config, checkpoint=folder, device=str(pipeline.frame_parser.device))
        return _evaluate(config, parser, partial(_perceived_by_jobs, stored))


def _without_questions(pipeline: Pipeline) -> Pipeline:
    """A pipeline that perceives alike."""
    p = pipeline
    return Pipeline(
        p.frame_parser, p.dynamics, GrammarParser(vocabulary=p.world.vocabulary), p.tracker, p.video, p.world
    )


def run_evaluation(config: EvaluationConfig) -> Report:
    """Answer and score questions by the pipeline that settings describe, as `nsdr evaluate` does.

    A scene that fails is recorded, and its questions count as wrong. A scene of the cache that cannot be read any more is made
    again.

    Raises:
        DataError: unreadable questions or data, values that do not go together, or data of another world than the weights'.
        EndpointError: the server of the question parser is not there; or it fails, after the scenes were kept.
        MachineError: a full disk, a lost worker or the like, which is no fault of a scene.
    """
    settings = config.pipeline()
    resolve_device(config.device)
    _check_world(config, settings, config.checkpoint)
    if config.videos and settings.dynamics.backend in READ_NO_IMAGES:
        backend = settings.dynamics.backend
        raise DataError(f"videos would do nothing: dynamics {backend!r} reads no images; leave it out")
    parser = parser_of(config)  # a server that is not there is found before the work
    return _evaluate(config, parser, partial(_perceived_by_jobs, settings))


def _check_world(config: EvaluationConfig, pipeline: Pipeline | PipelineConfig, weights: str) -> None:
    """Raise `DataError` if a pipeline that perceives could perceive no scene, because it is for another world than the data's.

    Tracks are explained in their own world, and videos that need not look as expected may be of another one; but questions are
    in the words of their world. Where nothing says a world, it is taken to be the pipeline's.
    """
    theirs, ours = known_world_of_data(config), pipeline.world
    if theirs is None or config.source not in PERCEIVED:
        return
    any_world = config.source == "tracks" or (config.source == "videos" and pipeline.video.check != "refuse")
    if not any_world or theirs.vocabulary.words != ours.vocabulary.words:
        check_world_of_data(config.root or config.questions, theirs, weights, ours)


def _evaluate(config: EvaluationConfig, parser: Parser | None, perceived: Perceived) -> Report:
    questions, data = selected_questions(config)
    made: Iterable[tuple[SceneQuestions, Executor | OfficialExecutor | NsdrError]]
    if config.semantics == "official":
        _check_no_pipeline_options(config)
        predictions = FolderFiles(Path(config.data))
        made = (
            (s, _official(config, predictions, s.scene_index)) for s in tqdm(questions, desc="scenes", unit="scene")
        )
    else:
        scenes = _scenes(config, perceived, questions, data)
        made = ((s, _executor(scenes[s.scene_index], config)) for s in questions)
    return score_scenes(made, parse_all(parser, questions, config.types) if parser else None, config.types)


def _scenes(
    config: EvaluationConfig, perceived: Perceived, questions: Sequence[SceneQuestions], data: Data
) -> dict[int, MadeScene]:
    """The scene of each index."""
    wanted = {s.scene_index for s in questions}
    source = SOURCES[config.source](data, wanted)
    video_of = SOURCES["videos"](Path(config.videos), wanted) if config.videos else None
    true_source = SOURCES[config.truth_source](Path(config.truth), wanted) if config.truth_source else None
    scenes: dict[int, MadeScene] = {}
    inputs: dict[int, SceneInput] = {}
    for s in tqdm(questions, desc="reading", unit="scene"):
        try:
            found = source(s)
            true_scene = None if true_source is None else true_scene_of(true_source, s)
            if isinstance(found, Scene):
                scenes[s.scene_index] = found
                continue
            if not isinstance(found, Mapping):
                expected = "an nsdr.Scene, or arguments of Pipeline.perceive"
                raise DataError(
                    f"source {config.source} returned {indefinite(type(found).__name__)}; expected {expected}"
                )
            if video_of is not None:
                found = {**found, **cast(PerceptionInput, video_of(s))}
            inputs[s.scene_index] = found, true_scene
        except NsdrError as e:
            scenes[s.scene_index] = e
    if any(isinstance(s, Scene) for s in scenes.values()):
        _check_no_pipeline_options(config)
    return {**scenes, **(perceived(config, inputs) if inputs else {})}


def _perceived_here(
    pipeline: Pipeline, config: EvaluationConfig, inputs: Mapping[int, SceneInput]
) -> dict[int, MadeScene]:
    """Scenes that a pipeline makes in this process when they are asked for."""
    bar = tqdm(total=len(inputs), desc="scenes", unit="scene")

    def scene(given: PerceptionInput, true_scene: Scene | None) -> Scene:
        bar.update()
        return pipeline.perceive(**given, true_scene=true_scene).scene

    return {index: partial(scene, *about) for index, about in inputs.items()}


def _perceived_by_jobs(
    settings: PipelineConfig, config: EvaluationConfig, inputs: Mapping[int, SceneInput]
) -> dict[int, MadeScene]:
    """Scenes that processes with the pipeline of the settings make and keep."""
    common = settings.fingerprint(config.checkpoint, config.source, config.truth_source)
    jobs = [_job(config, common, index, *about) for index, about in inputs.items()]
    device = resolve_device(config.device)
    function = partial(_perceive, config.checkpoint, settings, str(device))
    folder, read = jobs[0].output.parent, partial(storage.load, kind=Scene)
    summary = run_jobs(function, jobs, folder, config.engine, workers_on(device, config.workers), "scene", wait=True)
    scenes: dict[int, MadeScene] = {int(job.name): partial(read_output, job, read, function) for job in jobs}
    return scenes | {int(name): DataError(message) for name, message in summary.failed.items()}


def parser_of(config: EvaluationConfig) -> Parser | None:
    """The parser of the settings; None where the programs are those of the question file.

    Raises:
        CheckpointError: missing or corrupt weights.
        EndpointError: the server of the question parser is not there.
    """
    settings = config.pipeline()
    if config.programs == "gold":
        return None
    vocabulary = config.world.vocabulary
    return load_parser(settings.question_parser, config.checkpoint, settings.extensions, config.device, vocabulary)


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
        programs = parse_texts(parser, list(listed), kind)
        known |= {(text, kind): program for text, program in zip(listed, programs, strict=True)}

    def parse(text: str, kind: str) -> Program:
        program = known[text, kind]
        if isinstance(program, NsdrError):
            raise program
        return program

    return parse


def _check_no_pipeline_options(config: EvaluationConfig) -> None:
    """Sources that give scenes leave nothing to do for a pipeline and its options."""
    given = [f"--{name.replace('_', '-')}" for name in ("dynamics", "truth_source") if getattr(config, name)]
    given += idle_without_video(config.config, config.set)
    if config.checkpoint != "default" and (config.programs == "gold" or config.pipeline().question_parser != NETWORK):
        given.append("--checkpoint")
    if given:
        raise DataError(f"source {config.source} needs no pipeline: {', '.join(given)} would do nothing; leave it out")


def _job(
    config: EvaluationConfig, common: str, index: int, given: PerceptionInput, true_scene: Scene | None
) -> Job[SceneInput]:
    inputs = [Path(v) if isinstance(v, str) else v for v in given.values()]
    value = fingerprint(inputs=[*inputs, common.encode(), *([] if true_scene is None else [true_scene])])
    output = Path(config.cache) / f"{config.source}-{common}" / f"scene_{index:05d}_{value}.json"
    return Job(str(index), (given, true_scene), output, value)


def _perceive(checkpoint: str, settings: PipelineConfig, device: str, item: SceneInput, output: Path) -> None:
    given, true_scene = item
    perception = worker_pipeline(checkpoint, settings, device).perceive(**given, true_scene=true_scene)
    storage.save(output, replace(perception.scene, physics=None))  # which CLEVRER's questions do not ask for


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
    except CheckpointError:  # other scenes would fail, too
        raise
    except NsdrError as e:
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

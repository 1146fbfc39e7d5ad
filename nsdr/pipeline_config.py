"""Settings of all parts of the pipeline, the parts that they describe, and what makes kept results of perception stale."""

import json
import sys
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

from msgspec import Meta

from nsdr.dynamics import registry
from nsdr.dynamics.base import Dynamics
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.dynamics.registry import BACKENDS, BackendConfig, backend_settings, load_backend, weights_folder
from nsdr.errors import CheckpointError, DataError
from nsdr.frame_parser.check.video import VideoConfig
from nsdr.io.checkpoint import (
    PIPELINE,
    PretrainedPart,
    find_checkpoint,
    folder_of_part,
    has_part,
    is_default,
    load_description,
    world_of_checkpoint,
)
from nsdr.io.configuration import option, parse_config
from nsdr.io.device import PRECISIONS, resolve_device, without_compiler
from nsdr.io.fingerprint import fingerprint
from nsdr.io.reading import read_yaml
from nsdr.io.shipped import find_config
from nsdr.question_parser import loading
from nsdr.question_parser.base import Parser
from nsdr.question_parser.loading import GRAMMAR, NETWORK, check_parser, load_parser
from nsdr.tracking.tracker import TrackerConfig
from nsdr.validation import MAX_SIZE, PositiveCount, Settings, one_of
from nsdr.world.world import CLEVRER_WORLD, World

if TYPE_CHECKING:  # it loads torch, and settings are checked without it
    from nsdr.frame_parser.parser import FrameParser

OF_QUESTIONS = ("question_parser", "extensions")
"""Settings of `PipelineConfig` that only questions depend on, and perception does not."""


@dataclass(frozen=True)
class PipelineConfig(Settings):
    """Thresholds and settings of all parts (`configs/pipeline/default.yaml`).

    Attributes:
        stride: the frame parser processes every n-th frame; the tracker bridges the others.
        batch_size: frames per forward pass of the frame parser.
        precision: number format of the frame parser's convolutions: "float32", "bfloat16", or "auto" for bfloat16 where a CPU
            multiplies matrices of it (AMX), else float32.
        video: what is expected of videos, and how many frames of them are processed.
        world: what the videos are of; the weights of all parts have to be of a world that differs only in what they may.
        tracker: thresholds of the tracker.
        dynamics: the dynamics backend and its settings.
        question_parser: "grammar", "network" (the paper's), or the address of a server with a language model, such as
            "http://localhost:8000/v1#MODEL"; see `nsdr.question_parser.load_parser`.
        extensions: whether the grammar also parses questions beyond CLEVRER: speeds, directions, masses, changed objects.
    """

    stride: PositiveCount = 1
    batch_size: Annotated[int, Meta(ge=1, le=MAX_SIZE)] = 8
    precision: Annotated[str, one_of(PRECISIONS)] = "auto"
    video: VideoConfig = field(default_factory=VideoConfig)
    world: World = field(default_factory=World)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    dynamics: BackendConfig = field(default_factory=BackendConfig)
    question_parser: str = GRAMMAR
    extensions: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_parser(self.question_parser, self.extensions)

    def fingerprint(self, checkpoint: str | Path, *made: str) -> str:
        """Of everything that perception depends on but its input: these settings, weights, and versions of the stages.

        A plug-in's module may have a `VERSION`, too.

        Args:
            checkpoint: where the weights are.
            made: what is made, and from what.
        """
        from nsdr import dynamics, frame_parser, tracking
        from nsdr.dynamics import physics, propnet

        backend = physics if self.dynamics.backend == "physics" else propnet
        versions = {stage.__name__: stage.VERSION for stage in (frame_parser, tracking, dynamics, backend)}
        plugin = sys.modules[BACKENDS[self.dynamics.backend].__module__]
        versions[plugin.__name__] = getattr(plugin, "VERSION", 0)
        folder = find_checkpoint(checkpoint)
        parser = folder_of_part(folder, "frame_parser")
        weights = [*(parser / f"frame_parser.{ending}" for ending in ("json", "safetensors"))]
        weights.append(weights_folder(folder, self.dynamics))
        background = [Path(self.video.background)] if self.video.background else []
        settings = {name: value for name, value in asdict(self).items() if name not in OF_QUESTIONS}
        return fingerprint(inputs=background, config=[*made, settings, versions], weights=weights)


def pipeline_settings(
    file: str | Path = "",
    dynamics: str | Path = "",
    overrides: Sequence[str] = (),
    checkpoint: str | Path = "default",
) -> PipelineConfig:
    """Settings from a YAML file, a dynamics backend and single overrides, the later ones winning.

    Args:
        file: YAML file of a `PipelineConfig`, or the name of one that ships, such as "paper"; "" for those that were saved with
            the checkpoint, or the defaults.
        dynamics: a backend's name, or a YAML file of a `BackendConfig`; "" for that of `file`.
        overrides: "key=value" each, such as "tracker.score=0.8" or "dynamics.physics.runs=10".
        checkpoint: where the weights are, as in `find_checkpoint`.

    Raises:
        CheckpointError: there is no such checkpoint.
        DataError: an unknown key or value; names it.
    """
    argv = ["--config", str(find_config(file, "pipeline"))] if file else _saved_with(checkpoint)
    if dynamics:
        is_file = str(dynamics).endswith((".yaml", ".yml"))
        if is_file:
            read_yaml(dynamics)  # whose errors say what is wrong with a file
        argv += ["--dynamics" if is_file else "--dynamics.backend", str(dynamics)]
    known = [f.name for f in fields(PipelineConfig)]
    for key, times in Counter(override.partition("=")[0] for override in overrides).items():
        if times > 1:
            raise DataError(f"--set {key} is given {times} times, of which one alone would count; give it once")
    for override in overrides:
        key, separator, value = override.partition("=")
        if not separator:
            raise DataError(f"--set {override}: expected key=value, such as tracker.score=0.8")
        if key.split(".")[0] not in known:
            raise DataError(f"--set {override}: expected a setting of {', '.join(known)}")
        argv += [option(key), value]
    try:
        config = parse_config(PipelineConfig, argv, "nsdr")
    except DataError as e:  # which names the option that stands for the setting here
        wrong, colon, message = str(e).partition(":")
        keys = [key for key in (override.partition("=")[0] for override in overrides) if option(key) == wrong]
        if not keys:
            raise
        raise DataError(f"--set {keys[0]}{colon}{message}") from e
    backend_settings(config.dynamics)
    return config


def _saved_with(checkpoint: str | Path) -> list[str]:
    """The settings that a pipeline was saved with, or those which use the parts that alone were trained; as arguments."""
    if str(checkpoint) == "default":
        return []
    folder = find_checkpoint(checkpoint)
    if (folder / PIPELINE).is_file():
        return ["--config", str(folder / PIPELINE)]
    argv = ["--world", json.dumps(asdict(world))] if (world := world_of_checkpoint(folder)) != CLEVRER_WORLD else []
    if has_part(folder, "dynamics") and not has_part(folder, "collisions"):
        argv += ["--dynamics.backend", str(load_description(folder, "dynamics").get("network", "propnet"))]
    if has_part(folder, "question_parser") and not has_part(folder, "frame_parser"):
        argv += [option("question_parser"), NETWORK]
    return argv


def check_weights(part: object, world: World) -> None:
    """Raise `DataError` if a part has weights that were trained for a world which differs in what they depend on."""
    for one in (part, getattr(part, "backend", None), getattr(part, "detector", None)):
        if isinstance(one, PretrainedPart):
            one.check_world(world)


class NoWeights:
    """Takes the place of a frame parser or a detector of collisions for which there are no weights of the world.

    A pipeline with it still takes what needs no such weights: masks or tracks, and true collisions.

    Args:
        reason: why there are none.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        """Raise `CheckpointError` with the reason."""
        raise CheckpointError(self.reason)

    parse = collision_candidates = _refuse


def load_parts(path_or_id: str | Path, config: PipelineConfig, device: str) -> tuple["FrameParser", Dynamics, Parser]:
    """Load the frame parser, the dynamics backend and the question parser of a checkpoint.

    Args:
        path_or_id: where the checkpoint is. A warning says which parts it lacks, and shipped ones are used for them. Where the
            shipped frame parser or detector of collisions is of another world, `NoWeights` takes its place.
        config: settings of the parts.
        device: where the networks of the question parser run.

    Raises:
        CheckpointError: missing or corrupt; says what and how to get it.
        DataError: an unknown device, or weights of another world that the checkpoint has; says what differs.
        EndpointError: the server of the question parser does not answer.
    """
    folder = find_checkpoint(path_or_id)
    resolve_device(device)
    question_parser = load_parser(config.question_parser, folder, config.extensions, device, config.world.vocabulary)
    with without_compiler():
        from nsdr.frame_parser.parser import FrameParser
    taken = {
        "frame_parser": folder_of_part(folder, "frame_parser"),
        "dynamics": weights_folder(folder, config.dynamics),
    }
    if config.question_parser == NETWORK:
        taken["question_parser"] = folder_of_part(folder, "question_parser")
    options = {
        "batch_size": config.batch_size,
        "stride": config.stride,
        "precision": config.precision,
        "world": config.world,
    }
    frame_parser: Any
    try:
        frame_parser = FrameParser.from_checkpoint(taken["frame_parser"], **options)
    except DataError as e:
        if not is_default(taken["frame_parser"]) or config.world == CLEVRER_WORLD:
            raise
        taken["frame_parser"] = folder
        frame_parser = NoWeights(f"videos need a frame parser, and {path_or_id} has none for this world: {e}")
    backend = load_backend(config.dynamics, folder)
    try:
        check_weights(backend, config.world)
    except DataError as e:
        if not (isinstance(backend, PhysicsPredictor) and is_default(taken["dynamics"])):
            raise
        taken["dynamics"] = folder
        needs = "collisions need a detector where no true_scene is given"
        backend.detector = NoWeights(f"{needs}, and {path_or_id} has none for this world: {e}")
    lacking = [] if is_default(folder) else [part for part, found in taken.items() if found != folder]
    if lacking:
        warnings.warn(f"{folder} has no {', '.join(lacking)}; the shipped ones are used", stacklevel=3)
    return frame_parser, backend, question_parser


def settings_of(
    frame_parser: "FrameParser",
    dynamics: Dynamics,
    question_parser: Parser,
    tracker: TrackerConfig,
    video: VideoConfig,
    world: World,
) -> PipelineConfig:
    """The settings with which `load_parts` loads these parts again, if their weights are in the checkpoint.

    Raises:
        DataError: a part of the user's own, which is not named by settings; names it.
    """
    from nsdr.frame_parser.parser import FrameParser

    if type(frame_parser) is not FrameParser:
        raise DataError(f"{type(frame_parser).__name__} is no nsdr.FrameParser, and cannot be stored")
    name, extensions = loading.settings_of(question_parser)
    return PipelineConfig(
        stride=frame_parser.stride,
        batch_size=frame_parser.batch_size,
        precision=frame_parser.precision,
        video=video,
        world=world,
        tracker=tracker,
        dynamics=registry.settings_of(dynamics),
        question_parser=name,
        extensions=extensions,
    )


def idle_without_video(file: str | Path, overrides: Sequence[str]) -> list[str]:
    """Those of the options `--config` and `--set` that do nothing for a scene that is already made.

    Only the settings of the question parser do something for it.
    """
    default, settings = PipelineConfig(), pipeline_settings(file)
    is_idle = all(getattr(settings, name) == getattr(default, name) for name in OF_QUESTIONS)
    others = [override for override in overrides if override.partition("=")[0] not in OF_QUESTIONS]
    return [*([f"--config {file}"] if file and is_idle else []), *(f"--set {override}" for override in others)]

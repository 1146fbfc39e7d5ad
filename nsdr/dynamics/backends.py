"""The dynamics backends by name, and their settings in one dataclass (`configs/dynamics/physics.yaml`)."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from nsdr.checkpoint import find_checkpoint
from nsdr.configuration import parse_config
from nsdr.dynamics.physics import PhysicsConfig, PhysicsPredictor
from nsdr.dynamics.predictor import DynamicsPredictor
from nsdr.dynamics.velocity import MotionBackend, VelocityConfig, VelocityEvents
from nsdr.errors import DataError
from nsdr.types import DynamicsPrediction, VideoTracks

__all__ = ["BACKENDS", "Backend", "BackendConfig", "backend_settings", "checkpoint_folders", "load_backend"]

PAPER_CHECKPOINT = "dynamics_paper"


class Backend(Protocol):
    """What a pipeline needs of a dynamics predictor: this one method."""

    def predict(self, tracks: VideoTracks) -> DynamicsPrediction:
        """Motion and collisions: observed, after the video, and with each object removed."""


@dataclass(frozen=True)
class BackendConfig:
    """Which dynamics predictor, and how it works.

    Attributes:
        backend: "physics" (a simulator fitted to the tracks), "state" (PropNet on ground-plane states) or "paper" (PropNet on
            patches).
        shortcut: with an object removed, what that cannot influence keeps its observed motion (not for "paper").
        horizon_frame: last frame that is predicted.
        collisions: "predicted", or "velocity" for collisions from changes of velocity alone (NE).
        physics: of the physics backend.
        velocity: rule for collisions from changes of velocity.
    """

    backend: str = "physics"
    shortcut: bool = True
    horizon_frame: int = 179
    collisions: str = "predicted"
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    velocity: VelocityConfig = field(default_factory=VelocityConfig)


def _physics(folder: Path, c: BackendConfig) -> MotionBackend:
    settings = replace(c.physics, shortcut=c.shortcut, horizon_frame=c.horizon_frame)
    return PhysicsPredictor(DynamicsPredictor.from_checkpoint(folder), settings)


def _state(folder: Path, c: BackendConfig) -> MotionBackend:
    return DynamicsPredictor.from_checkpoint(folder, c.shortcut, c.horizon_frame)


def _paper(folder: Path, c: BackendConfig) -> MotionBackend:
    from nsdr.dynamics.paper import PaperPredictor

    return PaperPredictor.from_checkpoint(find_checkpoint(PAPER_CHECKPOINT), c.horizon_frame)


BACKENDS: dict[str, Callable[[Path, BackendConfig], MotionBackend]] = {
    "physics": _physics,
    "state": _state,
    "paper": _paper,
}


def load_backend(folder: Path, settings: str | Path | BackendConfig = "physics") -> Backend:
    """A dynamics predictor with its weights.

    Args:
        folder: the checkpoint with `dynamics.safetensors`; "paper" has one of its own, `checkpoints/dynamics_paper`.
        settings: a backend's name, a YAML file of a `BackendConfig`, or one.

    Raises:
        DataError: an unknown backend or kind of collisions.
        CheckpointError: weights are missing or corrupt.
    """
    config = backend_settings(settings)
    backend = BACKENDS[config.backend](folder, config)
    return VelocityEvents(backend, config.velocity) if config.collisions == "velocity" else backend


def backend_settings(settings: str | Path | BackendConfig) -> BackendConfig:
    """Settings from a backend's name or a YAML file, checked; raises `DataError` as `load_backend`."""
    if isinstance(settings, BackendConfig):
        config = settings
    elif str(settings).endswith((".yaml", ".yml")):
        config = parse_config(BackendConfig, ["--config", str(settings)], "nsdr")
    else:
        config = BackendConfig(str(settings))
    if config.backend not in BACKENDS:
        raise DataError(f"dynamics {config.backend!r}: expected {', '.join(BACKENDS)} or a YAML file")
    if config.collisions not in ("predicted", "velocity"):
        raise DataError(f"collisions is {config.collisions!r}; expected predicted or velocity")
    return config


def checkpoint_folders(folder: Path, config: BackendConfig) -> list[Path]:
    """Folders whose weights a pipeline with this backend uses."""
    return [folder, find_checkpoint(PAPER_CHECKPOINT)] if config.backend == "paper" else [folder]

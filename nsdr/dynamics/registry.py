"""The dynamics backends by name, and their settings in one dataclass (`configs/dynamics/physics.yaml`)."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from nsdr.dynamics.base import Dynamics
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.dynamics.velocity_events import VelocityEvents
from nsdr.errors import CheckpointError, DataError
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.configuration import parse_config
from nsdr.io.registry import Registry
from nsdr.validation import Settings, one_of

PATCH_CHECKPOINTS = {"paper": "dynamics_paper", "paper_images": "dynamics_paper_images"}
"""Backends whose network sees patches, and the shipped checkpoint of each beside `default`."""
READ_NO_IMAGES = ("physics", "state", "paper")
"""Backends that see the tracks alone."""


@dataclass(frozen=True)
class BackendConfig(Settings):
    """Which dynamics backend, and how it works.

    Attributes:
        backend: a name in `BACKENDS`: "physics" (a simulator fitted to the tracks), "state" (PropNet on ground-plane states),
            "paper" (PropNet on patches), "paper_images" (PropNet on patches of images; videos only), or one of another package.
        weights: folder of the trained network, for "paper" and "paper_images"; "" for the checkpoint's, or the shipped ones.
        collisions: "predicted", or "velocity" for those that changes of velocity alone show (NE).
        physics: of the physics backend.
    """

    backend: str = "physics"
    weights: str = ""
    collisions: Annotated[str, one_of(("predicted", "velocity"))] = "predicted"
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)


BackendFactory = Callable[[Path, BackendConfig], Dynamics]
"""(checkpoint folder, settings) -> the backend with its weights."""
BACKENDS: Registry[BackendFactory] = Registry(
    "dynamics backend (or YAML file)",
    "nsdr.dynamics",
    {
        "physics": "nsdr.dynamics.registry:_physics",
        "state": "nsdr.dynamics.registry:_state",
        "paper": "nsdr.dynamics.registry:_patches",
        "paper_images": "nsdr.dynamics.registry:_patches",
    },
)
"""Dynamics backends by name; other packages add theirs by entry points of the group `nsdr.dynamics`."""


def _physics(folder: Path, config: BackendConfig) -> Dynamics:
    from nsdr.dynamics.collisions.network import TrackCollisionDetector

    if (folder / "dynamics.safetensors").exists() and not (folder / "collisions.safetensors").exists():
        remedy = 'give the backend that was saved, such as --dynamics state (in Python, dynamics="state")'
        raise CheckpointError(f"{folder}: has no collisions.safetensors, which dynamics 'physics' needs; {remedy}")
    detector = TrackCollisionDetector.from_checkpoint(folder)
    return PhysicsPredictor(detector, config.physics)


def _state(folder: Path, config: BackendConfig) -> Dynamics:
    from nsdr.dynamics.propnet.state_predictor import StatePredictor

    return StatePredictor.from_checkpoint(folder)


def _patches(folder: Path, config: BackendConfig) -> Dynamics:
    from nsdr.dynamics.propnet.patch_predictor import ImagePredictor, PatchPredictor

    predictor = PatchPredictor if config.backend == "paper" else ImagePredictor
    return predictor.from_checkpoint(_patch_folder(folder, config))


def _patch_folder(folder: Path, config: BackendConfig) -> Path:
    """Where the weights of a network on patches are: of `config`, else of the checkpoint.

    The shipped checkpoint of the backend stands for `default`.
    """
    if config.weights:
        return find_checkpoint(config.weights)
    return find_checkpoint(PATCH_CHECKPOINTS[config.backend]) if _is_default(folder) else folder


def _is_default(folder: Path) -> bool:
    """Whether a folder is the checkpoint `default`, which need not be there."""
    try:
        return folder.resolve() == find_checkpoint().resolve()
    except CheckpointError:
        return False


def load_backend(folder: Path, settings: str | Path | BackendConfig = "physics") -> Dynamics:
    """A dynamics backend with its weights.

    Args:
        folder: the checkpoint with `dynamics.safetensors`; for "paper" and "paper_images" and the folder of `default`, the
            shipped `dynamics_paper` and `dynamics_paper_images` are read instead.
        settings: a backend's name, a YAML file of a `BackendConfig`, or one.

    Raises:
        DataError: an unknown backend, or settings that would do nothing.
        CheckpointError: weights are missing or corrupt, or of another backend's network.
    """
    config = backend_settings(settings)
    backend = BACKENDS[config.backend](folder, config)
    return VelocityEvents(backend) if config.collisions == "velocity" else backend


def backend_settings(settings: str | Path | BackendConfig) -> BackendConfig:
    """Settings from a backend's name or a YAML file, checked; raises `DataError` as `load_backend`."""
    if isinstance(settings, BackendConfig):
        config = settings
    elif str(settings).endswith((".yaml", ".yml")):
        config = parse_config(BackendConfig, ["--config", str(settings)], "nsdr")
    else:
        config = BackendConfig(str(settings))
    BACKENDS.check(config.backend)
    if config.weights and config.backend not in PATCH_CHECKPOINTS:
        raise DataError(f"weights: does nothing with dynamics {config.backend!r}; name the folder by --checkpoint")
    if config.backend in ("state", *PATCH_CHECKPOINTS) and config.physics != PhysicsConfig():
        raise DataError(f"settings of physics do nothing with dynamics {config.backend!r}; leave them out")
    return config


def checkpoint_folders(folder: Path, config: BackendConfig) -> list[Path]:
    """Folders whose weights a pipeline with this backend uses."""
    patches = [_patch_folder(folder, config)] if config.backend in PATCH_CHECKPOINTS else []
    return [*dict.fromkeys([folder, *patches])]

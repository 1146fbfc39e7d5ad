"""The dynamics backends by name, and the dataclass of their settings (`configs/dynamics/physics.yaml`)."""

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

PATCH_CHECKPOINTS = {"propnet_patches": "propnet_patches", "propnet_images": "propnet_images"}
"""Name of the shipped checkpoint of each backend with a network on patches; these weights are not part of `default`."""
READ_NO_IMAGES = ("physics", "propnet", "propnet_patches")
"""Names of the backends that read only tracks."""


@dataclass(frozen=True)
class BackendConfig(Settings):
    """Choice of a dynamics backend, and its settings.

    Attributes:
        backend: a name in `BACKENDS`: "physics" (a simulator fitted to the tracks), "propnet" (PropNet on ground-plane states),
            "propnet_patches" (PropNet on patches of masks), "propnet_images" (PropNet on patches of images and masks; needs
            videos), or a backend of another package.
        weights: folder of the trained network, for "propnet_patches" and "propnet_images"; "" for the network of the
            checkpoint, or the shipped one if the checkpoint is `default`.
        collisions: "predicted" for collisions that the backend predicts, "velocity" for collisions detected from changes of
            velocity alone (the paper's variant "no events", NE).
        physics: settings of the physics backend.
    """

    backend: str = "physics"
    weights: str = ""
    collisions: Annotated[str, one_of(("predicted", "velocity"))] = "predicted"
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)


BackendFactory = Callable[[Path, BackendConfig], Dynamics]
"""A function (checkpoint folder, settings) -> backend with its weights."""
BACKENDS: Registry[BackendFactory] = Registry(
    "dynamics backend (or YAML file)",
    "nsdr.dynamics",
    {
        "physics": "nsdr.dynamics.registry:_physics",
        "propnet": "nsdr.dynamics.registry:_state",
        "propnet_patches": "nsdr.dynamics.registry:_patches",
        "propnet_images": "nsdr.dynamics.registry:_patches",
    },
)
"""Dynamics backends by name; other packages add theirs by entry points of the group `nsdr.dynamics`."""


def _physics(folder: Path, config: BackendConfig) -> Dynamics:
    """Load the physics backend."""
    from nsdr.dynamics.collisions.network import TrackCollisionDetector

    if (folder / "dynamics.safetensors").exists() and not (folder / "collisions.safetensors").exists():
        remedy = 'give the backend that was saved, such as --dynamics propnet (in Python, dynamics="propnet")'
        raise CheckpointError(f"{folder}: has no collisions.safetensors, which dynamics 'physics' needs; {remedy}")
    detector = TrackCollisionDetector.from_checkpoint(folder)
    return PhysicsPredictor(detector, config.physics)


def _state(folder: Path, config: BackendConfig) -> Dynamics:
    """Load PropNet on ground-plane states."""
    from nsdr.dynamics.propnet.state_predictor import PropNetPredictor

    return PropNetPredictor.from_checkpoint(folder)


def _patches(folder: Path, config: BackendConfig) -> Dynamics:
    """Load PropNet on patches of masks, or of images and masks."""
    from nsdr.dynamics.propnet.patch_predictor import ImagePropNetPredictor, PatchPropNetPredictor

    predictor = PatchPropNetPredictor if config.backend == "propnet_patches" else ImagePropNetPredictor
    return predictor.from_checkpoint(_patch_folder(folder, config))


def _patch_folder(folder: Path, config: BackendConfig) -> Path:
    """The folder with the weights of a network on patches.

    It is `config.weights` if given; otherwise the checkpoint folder, or the backend's shipped checkpoint in place of `default`.
    """
    if config.weights:
        return find_checkpoint(config.weights)
    return find_checkpoint(PATCH_CHECKPOINTS[config.backend]) if _is_default(folder) else folder


def _is_default(folder: Path) -> bool:
    """Whether a folder is the checkpoint `default`; False if `default` is not installed."""
    try:
        return folder.resolve() == find_checkpoint().resolve()
    except CheckpointError:
        return False


def load_backend(folder: Path, settings: str | Path | BackendConfig = "physics") -> Dynamics:
    """Load a dynamics backend with its weights.

    Args:
        folder: folder of the checkpoint. For "propnet_patches" and "propnet_images", the shipped weights of these
            names are read in place of `default`.
        settings: name of a backend, YAML file of a `BackendConfig`, or a `BackendConfig`.

    Raises:
        DataError: the backend is unknown, or a setting would have no effect.
        CheckpointError: weights are missing or corrupt, or belong to the network of another backend.
    """
    config = backend_settings(settings)
    backend = BACKENDS[config.backend](folder, config)
    return VelocityEvents(backend) if config.collisions == "velocity" else backend


def backend_settings(settings: str | Path | BackendConfig) -> BackendConfig:
    """Make and check settings.

    Args:
        settings: name of a backend, YAML file of a `BackendConfig`, or a `BackendConfig`.

    Raises:
        DataError: the backend is unknown, or a setting would have no effect.
    """
    if isinstance(settings, BackendConfig):
        config = settings
    elif str(settings).endswith((".yaml", ".yml")):
        config = parse_config(BackendConfig, ["--config", str(settings)], "nsdr")
    else:
        config = BackendConfig(str(settings))
    BACKENDS.check(config.backend)
    if config.weights and config.backend not in PATCH_CHECKPOINTS:
        raise DataError(f"weights would do nothing with dynamics {config.backend!r}; name the folder by --checkpoint")
    if config.backend in ("propnet", *PATCH_CHECKPOINTS) and config.physics != PhysicsConfig():
        raise DataError(f"settings of physics would do nothing with dynamics {config.backend!r}; leave them out")
    return config


def checkpoint_folders(folder: Path, config: BackendConfig) -> list[Path]:
    """Folders from which a pipeline with this backend reads weights."""
    patches = [_patch_folder(folder, config)] if config.backend in PATCH_CHECKPOINTS else []
    return [*dict.fromkeys([folder, *patches])]

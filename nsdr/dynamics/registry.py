"""The dynamics backends by name, and the dataclass of their settings (`configs/dynamics/physics.yaml`)."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from nsdr.dynamics.base import Dynamics
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.dynamics.velocity_events import VelocityEvents
from nsdr.errors import DataError
from nsdr.io.checkpoint import find_checkpoint, folder_of_part, is_default
from nsdr.io.configuration import parse_config
from nsdr.io.registry import Registry
from nsdr.validation import Settings, one_of

ON_PATCHES = ("propnet_patches", "propnet_images")
"""Names of the backends with a network on patches, which are also those of their shipped checkpoints: `default` has no such
weights."""
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
        "propnet": "nsdr.dynamics.registry:_propnet",
        "propnet_patches": "nsdr.dynamics.registry:_on_patches",
        "propnet_images": "nsdr.dynamics.registry:_on_patches",
    },
)
"""Dynamics backends by name; other packages add theirs by entry points of the group `nsdr.dynamics`."""


def _physics(folder: Path, config: BackendConfig) -> Dynamics:
    """Load the physics backend."""
    return PhysicsPredictor.from_checkpoint(weights_folder(folder, config), config=config.physics)


def _propnet(folder: Path, config: BackendConfig) -> Dynamics:
    """Load PropNet on ground-plane states."""
    from nsdr.dynamics.propnet.state_predictor import PropNetPredictor

    return PropNetPredictor.from_checkpoint(weights_folder(folder, config))


def _on_patches(folder: Path, config: BackendConfig) -> Dynamics:
    """Load PropNet on patches of masks, or of images and masks."""
    from nsdr.dynamics.propnet.patch_predictor import ImagePropNetPredictor, PatchPropNetPredictor

    predictor = PatchPropNetPredictor if config.backend == "propnet_patches" else ImagePropNetPredictor
    return predictor.from_checkpoint(weights_folder(folder, config))


def weights_folder(folder: Path, config: BackendConfig) -> Path:
    """The folder from which a backend takes its weights.

    It is `config.weights` if given; otherwise the checkpoint's folder, or that of a shipped checkpoint if the checkpoint has no
    such weights.
    """
    if config.weights:
        return find_checkpoint(config.weights)
    if config.backend in ON_PATCHES:
        has_own = not is_default(folder)
        return folder_of_part(folder, "dynamics", config.backend) if has_own else find_checkpoint(config.backend)
    if config.backend == "propnet":
        return folder_of_part(folder, "dynamics")
    return folder_of_part(folder, "collisions") if config.backend == "physics" else folder


def load_backend(settings: str | Path | BackendConfig = "physics", checkpoint: str | Path = "default") -> Dynamics:
    """Load a dynamics backend with its weights.

    Args:
        settings: name of a backend, YAML file of a `BackendConfig`, or a `BackendConfig`.
        checkpoint: where the weights are (see `nsdr.io.checkpoint.find_checkpoint`). A shipped checkpoint has those that it
            lacks.

    Raises:
        DataError: the backend is unknown, or a setting would have no effect.
        CheckpointError: weights are missing or corrupt, or belong to the network of another backend.
    """
    config = backend_settings(settings)
    backend = BACKENDS[config.backend](find_checkpoint(config.weights or checkpoint), config)
    return VelocityEvents(backend) if config.collisions == "velocity" else backend


def settings_of(backend: Dynamics) -> BackendConfig:
    """The settings with which `load_backend` makes this backend again, if its weights are in the checkpoint.

    Raises:
        DataError: the class of the backend has no `name` of its own under which a backend is installed, or the physics backend
            has a detector of the user's own.
    """
    if isinstance(backend, VelocityEvents):
        return replace(settings_of(backend.backend), collisions="velocity")
    name = vars(type(backend)).get("name", "")  # not that of a base class, whose motion may differ
    if name not in BACKENDS.names():
        kind = type(backend).__name__
        raise DataError(
            f"{kind} has no `name` of an installed backend ({', '.join(BACKENDS.names())}); see 'Replace a part' in the "
            "documentation"
        )
    if not isinstance(backend, PhysicsPredictor):
        return BackendConfig(name)
    from nsdr.dynamics.collisions.network import TrackCollisionDetector

    if type(backend.detector) is not TrackCollisionDetector:
        raise DataError(f"{type(backend.detector).__name__} is no collision detector of nsdr, and cannot be stored")
    return BackendConfig(name, physics=backend.config)


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
    if config.weights and config.backend not in ON_PATCHES:
        raise DataError(f"weights would do nothing with dynamics {config.backend!r}; name the folder by --checkpoint")
    if config.backend in ("propnet", *ON_PATCHES) and config.physics != PhysicsConfig():
        raise DataError(f"settings of physics would do nothing with dynamics {config.backend!r}; leave them out")
    return config

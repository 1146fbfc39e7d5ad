"""Tracks to rollouts: motion and collisions, observed, future and counterfactual; the backends and their registry."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.dynamics.base import DynamicsBackend
    from nsdr.dynamics.physics import PhysicsConfig, PhysicsPredictor
    from nsdr.dynamics.propnet import PatchModel, PatchPredictor, StateModel, StatePredictor
    from nsdr.dynamics.registry import BACKENDS, BackendConfig, load_backend
    from nsdr.dynamics.scene import scene_from_prediction
    from nsdr.dynamics.velocity_events import VelocityConfig, VelocityEvents

_HOME = {
    "base": ["DynamicsBackend"],
    "physics": ["PhysicsConfig", "PhysicsPredictor"],
    "propnet": ["PatchModel", "PatchPredictor", "StateModel", "StatePredictor"],
    "registry": ["BACKENDS", "BackendConfig", "load_backend"],
    "scene": ["scene_from_prediction"],
    "velocity_events": ["VelocityConfig", "VelocityEvents"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "BACKENDS",
    "BackendConfig",
    "DynamicsBackend",
    "PatchModel",
    "PatchPredictor",
    "PhysicsConfig",
    "PhysicsPredictor",
    "StateModel",
    "StatePredictor",
    "VelocityConfig",
    "VelocityEvents",
    "load_backend",
    "scene_from_prediction",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr.dynamics' has no attribute {name!r}")
    return getattr(import_module(f"nsdr.dynamics.{_MODULE_OF[name]}"), name)

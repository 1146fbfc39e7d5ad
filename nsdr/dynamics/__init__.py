"""Tracks to rollouts: motion and collisions, observed, future and counterfactual; the backends and their registry."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.dynamics.base import DynamicsBackend
    from nsdr.dynamics.collisions import CollisionNetwork, TrackCollisionDetector
    from nsdr.dynamics.physics import PhysicsConfig, PhysicsPredictor
    from nsdr.dynamics.propnet import PatchModel, PatchPredictor, StateModel, StatePredictor
    from nsdr.dynamics.registry import BACKENDS, BackendConfig, load_backend
    from nsdr.dynamics.scene import scene_from_prediction
    from nsdr.dynamics.velocity_events import VelocityConfig, VelocityEvents

_HOME = {
    "nsdr.dynamics.base": ["DynamicsBackend"],
    "nsdr.dynamics.collisions": ["CollisionNetwork", "TrackCollisionDetector"],
    "nsdr.dynamics.physics": ["PhysicsConfig", "PhysicsPredictor"],
    "nsdr.dynamics.propnet": ["PatchModel", "PatchPredictor", "StateModel", "StatePredictor"],
    "nsdr.dynamics.registry": ["BACKENDS", "BackendConfig", "load_backend"],
    "nsdr.dynamics.scene": ["scene_from_prediction"],
    "nsdr.dynamics.velocity_events": ["VelocityConfig", "VelocityEvents"],
}

__all__ = [
    "BACKENDS",
    "BackendConfig",
    "CollisionNetwork",
    "DynamicsBackend",
    "PatchModel",
    "PatchPredictor",
    "PhysicsConfig",
    "PhysicsPredictor",
    "StateModel",
    "StatePredictor",
    "TrackCollisionDetector",
    "VelocityConfig",
    "VelocityEvents",
    "load_backend",
    "scene_from_prediction",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

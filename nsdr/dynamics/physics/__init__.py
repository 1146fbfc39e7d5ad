"""The physics backend: a planar simulator, its fit to tracks, and the search for the collisions that explain them."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.dynamics.physics.collision_search import CollisionSearchConfig, search_collisions
    from nsdr.dynamics.physics.predictor import CollisionDetector, PhysicsConfig, PhysicsPredictor
    from nsdr.dynamics.physics.simulator import BodyStates, PrescribedMotion, SimulatedMotion, simulate
    from nsdr.dynamics.physics.trajectory_fit import TrajectoryFit, TrajectoryFitConfig, fit_trajectories

_HOME = {
    "collision_search": ["CollisionSearchConfig", "search_collisions"],
    "predictor": ["CollisionDetector", "PhysicsConfig", "PhysicsPredictor"],
    "simulator": ["BodyStates", "PrescribedMotion", "SimulatedMotion", "simulate"],
    "trajectory_fit": ["TrajectoryFit", "TrajectoryFitConfig", "fit_trajectories"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "BodyStates",
    "CollisionDetector",
    "CollisionSearchConfig",
    "PhysicsConfig",
    "PhysicsPredictor",
    "PrescribedMotion",
    "SimulatedMotion",
    "TrajectoryFit",
    "TrajectoryFitConfig",
    "fit_trajectories",
    "search_collisions",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr.dynamics.physics' has no attribute {name!r}")
    return getattr(import_module(f"nsdr.dynamics.physics.{_MODULE_OF[name]}"), name)

"""The physics backend: a planar simulator, its fit to tracks, and the search for the collisions that explain them."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.dynamics.physics.collision_search import CollisionSearchConfig, search_collisions
    from nsdr.dynamics.physics.predictor import CollisionDetector, PhysicsConfig, PhysicsPredictor
    from nsdr.dynamics.physics.simulator import BodyStates, PrescribedMotion, SimulatedMotion, simulate
    from nsdr.dynamics.physics.trajectory_fit import TrajectoryFit, TrajectoryFitConfig, fit_trajectories

_HOME = {
    "nsdr.dynamics.physics.collision_search": ["CollisionSearchConfig", "search_collisions"],
    "nsdr.dynamics.physics.predictor": ["CollisionDetector", "PhysicsConfig", "PhysicsPredictor"],
    "nsdr.dynamics.physics.simulator": ["BodyStates", "PrescribedMotion", "SimulatedMotion", "simulate"],
    "nsdr.dynamics.physics.trajectory_fit": ["TrajectoryFit", "TrajectoryFitConfig", "fit_trajectories"],
}

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

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

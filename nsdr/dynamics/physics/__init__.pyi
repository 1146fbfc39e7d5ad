from .collision_search import CollisionSearchConfig as CollisionSearchConfig, search_collisions as search_collisions
from .predictor import (
    CollisionDetector as CollisionDetector,
    PhysicsConfig as PhysicsConfig,
    PhysicsPredictor as PhysicsPredictor,
)
from .simulator import (
    BodyStates as BodyStates,
    PrescribedMotion as PrescribedMotion,
    SimulatedMotion as SimulatedMotion,
    simulate as simulate,
)
from .trajectory_fit import (
    TrajectoryFit as TrajectoryFit,
    TrajectoryFitConfig as TrajectoryFitConfig,
    fit_trajectories as fit_trajectories,
)

VERSION: int

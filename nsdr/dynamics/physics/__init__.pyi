from .collision_search import search_collisions as search_collisions
from .config import PhysicsConfig as PhysicsConfig
from .predictor import (
    CollisionDetector as CollisionDetector,
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
    fit_trajectories as fit_trajectories,
)

VERSION: int

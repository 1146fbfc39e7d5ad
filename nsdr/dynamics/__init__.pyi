from .base import DynamicsBackend as DynamicsBackend
from .collisions import CollisionNetwork as CollisionNetwork, TrackCollisionDetector as TrackCollisionDetector
from .physics import PhysicsConfig as PhysicsConfig, PhysicsPredictor as PhysicsPredictor
from .propnet import (
    PatchModel as PatchModel,
    PatchPredictor as PatchPredictor,
    StateModel as StateModel,
    StatePredictor as StatePredictor,
)
from .registry import BACKENDS as BACKENDS, BackendConfig as BackendConfig, load_backend as load_backend
from .scene import scene_from_prediction as scene_from_prediction
from .velocity_events import VelocityEvents as VelocityEvents

VERSION: int

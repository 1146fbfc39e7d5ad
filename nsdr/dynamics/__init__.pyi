from .base import Dynamics as Dynamics, Explanation as Explanation, StoredExplanation as StoredExplanation
from .collisions.network import CollisionNetwork as CollisionNetwork, TrackCollisionDetector as TrackCollisionDetector
from .motion_states import MotionStates as MotionStates, states_from_tracks as states_from_tracks
from .physics.config import PhysicsConfig as PhysicsConfig
from .physics.predictor import PhysicsPredictor as PhysicsPredictor
from .propnet.patch_model import PatchPropNet as PatchPropNet
from .propnet.patch_predictor import PatchPropNetPredictor as PatchPropNetPredictor
from .propnet.state_model import PropNet as PropNet
from .propnet.state_predictor import PropNetPredictor as PropNetPredictor
from .registry import BACKENDS as BACKENDS, BackendConfig as BackendConfig, load_backend as load_backend
from .scene import scene_from_prediction as scene_from_prediction
from .simulation import simulate as simulate
from .velocity_events import VelocityEvents as VelocityEvents

VERSION: int

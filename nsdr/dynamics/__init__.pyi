from .base import StoredExplanation as StoredExplanation
from .collisions.network import CollisionNetwork as CollisionNetwork, TrackCollisionDetector as TrackCollisionDetector
from .motion_states import MotionStates as MotionStates, states_from_tracks as states_from_tracks
from .physics.config import PhysicsConfig as PhysicsConfig
from .propnet.patch_model import PatchPropNet as PatchPropNet
from .propnet.state_model import PropNet as PropNet
from .registry import BACKENDS as BACKENDS, BackendConfig as BackendConfig
from .scene import scene_from_prediction as scene_from_prediction
from .simulation import simulate as simulate
from .velocity_events import VelocityEvents as VelocityEvents

VERSION: int

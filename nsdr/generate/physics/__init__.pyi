from .bullet import (
    Body as Body,
    BulletConfig as BulletConfig,
    BulletMotion as BulletMotion,
    Contact as Contact,
    Simulator as Simulator,
)
from .scene import SimulatedScene as SimulatedScene, simulate_scene as simulate_scene
from .scene_config import SceneConfig as SceneConfig

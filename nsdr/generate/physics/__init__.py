"""Simulation of CLEVRER scenes in Bullet, and resimulation of released annotations."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.generate.physics.bullet import Body, BulletConfig, BulletMotion, Contact, Simulator
    from nsdr.generate.physics.resimulate import Resimulation
    from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
    from nsdr.generate.physics.scene_config import SceneConfig

_HOME = {
    "nsdr.generate.physics.bullet": ["Body", "BulletConfig", "BulletMotion", "Contact", "Simulator"],
    "nsdr.generate.physics.resimulate": ["Resimulation"],
    "nsdr.generate.physics.scene": ["SimulatedScene", "simulate_scene"],
    "nsdr.generate.physics.scene_config": ["SceneConfig"],
}

__all__ = [
    "Body",
    "BulletConfig",
    "BulletMotion",
    "Contact",
    "Resimulation",
    "SceneConfig",
    "SimulatedScene",
    "Simulator",
    "simulate_scene",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

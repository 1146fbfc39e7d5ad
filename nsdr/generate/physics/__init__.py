"""Simulation of CLEVRER scenes in Bullet, and resimulation of released annotations."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

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


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr.generate.physics' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__

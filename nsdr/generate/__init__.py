"""Generation of data sets in CLEVRER's layout: simulated scenes, rendered videos, and questions with answers."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.generate.dataset import DatasetConfig, generate_dataset
    from nsdr.generate.physics.bullet import BulletConfig, Simulator
    from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
    from nsdr.generate.physics.scene_config import SceneConfig
    from nsdr.generate.questions.selection import QuestionConfig, generate_questions
    from nsdr.generate.render.preview import render_preview
    from nsdr.generate.render.view import RenderConfig, View

_HOME = {
    "nsdr.generate.dataset": ["DatasetConfig", "generate_dataset"],
    "nsdr.generate.physics.bullet": ["BulletConfig", "Simulator"],
    "nsdr.generate.physics.scene": ["SimulatedScene", "simulate_scene"],
    "nsdr.generate.physics.scene_config": ["SceneConfig"],
    "nsdr.generate.questions.selection": ["QuestionConfig", "generate_questions"],
    "nsdr.generate.render.preview": ["render_preview"],
    "nsdr.generate.render.view": ["RenderConfig", "View"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "BulletConfig",
    "DatasetConfig",
    "QuestionConfig",
    "RenderConfig",
    "SceneConfig",
    "SimulatedScene",
    "Simulator",
    "View",
    "generate_dataset",
    "generate_questions",
    "render_preview",
    "simulate_scene",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr.generate' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__

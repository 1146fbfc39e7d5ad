"""Generation of data sets in CLEVRER's layout: simulated scenes, rendered videos, and questions with answers."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

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

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

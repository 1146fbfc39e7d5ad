from .dataset import DatasetConfig as DatasetConfig
from .physics.bullet import BulletConfig as BulletConfig, Simulator as Simulator
from .physics.scene import SimulatedScene as SimulatedScene, simulate_scene as simulate_scene
from .physics.scene_config import SceneConfig as SceneConfig
from .questions.selection import QuestionConfig as QuestionConfig, generate_questions as generate_questions
from .render.preview import render_preview as render_preview
from .render.view import RenderConfig as RenderConfig, View as View

VERSION: int

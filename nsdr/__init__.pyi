from .claims.narration import narrate as narrate
from .claims.verification import verify as verify
from .clevrer.dataset import CLEVRER as CLEVRER
from .datasets import VideoDataset as VideoDataset
from .dynamics.base import Dynamics as Dynamics, Explanation as Explanation
from .dynamics.physics.predictor import PhysicsPredictor as PhysicsPredictor
from .dynamics.propnet.patch_predictor import (
    ImagePropNetPredictor as ImagePropNetPredictor,
    PatchPropNetPredictor as PatchPropNetPredictor,
)
from .dynamics.propnet.state_predictor import PropNetPredictor as PropNetPredictor
from .dynamics.registry import load_backend as load_backend
from .errors import (
    CheckpointError as CheckpointError,
    DataError as DataError,
    ExecutionError as ExecutionError,
    NsdrError as NsdrError,
    ProgramError as ProgramError,
    QuestionError as QuestionError,
    VideoError as VideoError,
)
from .evaluation.report import Report as Report
from .evaluation.runner import evaluate as evaluate
from .frame_parser.dataset import FrameDataset as FrameDataset
from .frame_parser.parser import FrameParser as FrameParser
from .generate.dataset import generate_dataset as generate_dataset
from .io.storage import load as load, save as save
from .io.video import read_video as read_video, write_video as write_video
from .io.worlds import read_world as read_world
from .perception import Perception as Perception
from .pipeline import Pipeline as Pipeline, judge as judge
from .pipeline_config import PipelineConfig as PipelineConfig
from .question_parser.grammar import GrammarParser as GrammarParser
from .question_parser.network import QuestionParser as QuestionParser
from .symbolic import Executor as Executor, OfficialExecutor as OfficialExecutor, Program as Program
from .tracking.masks import tracks_from_masks as tracks_from_masks
from .tracking.tracker import track as track
from .types import (
    Add as Add,
    Answer as Answer,
    Camera as Camera,
    Event as Event,
    Freeze as Freeze,
    Judgement as Judgement,
    Move as Move,
    Remove as Remove,
    Rollout as Rollout,
    Scene as Scene,
    SceneObject as SceneObject,
    SetMass as SetMass,
    SetVelocity as SetVelocity,
    Simulation as Simulation,
    Track as Track,
    VideoProposals as VideoProposals,
    VideoTracks as VideoTracks,
)
from .world.world import World as World

__version__: str

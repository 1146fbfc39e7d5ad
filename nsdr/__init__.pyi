from .claims import (
    Claim as Claim,
    Verification as Verification,
    narrate as narrate,
    verify as verify,
)
from .clevrer.dataset import CLEVRER as CLEVRER
from .dynamics.base import Dynamics as Dynamics, Explanation as Explanation
from .dynamics.motion_states import MotionStates as MotionStates, states_from_tracks as states_from_tracks
from .dynamics.physics.predictor import PhysicsPredictor as PhysicsPredictor
from .dynamics.propnet.patch_model import PatchPropNet as PatchPropNet
from .dynamics.propnet.patch_predictor import PatchPropNetPredictor as PatchPropNetPredictor
from .dynamics.propnet.state_model import PropNet as PropNet
from .dynamics.propnet.state_predictor import PropNetPredictor as PropNetPredictor
from .dynamics.registry import BackendConfig as BackendConfig, load_backend as load_backend
from .errors import (
    CheckpointError as CheckpointError,
    DataError as DataError,
    ExecutionError as ExecutionError,
    MachineError as MachineError,
    NsdrError as NsdrError,
    ProgramError as ProgramError,
    QuestionError as QuestionError,
    VideoError as VideoError,
)
from .evaluation.report import Report as Report
from .evaluation.runner import evaluate as evaluate
from .frame_parser.check.video import VideoConfig as VideoConfig
from .frame_parser.dataset import FrameDataset as FrameDataset
from .frame_parser.model import build_frame_parser as build_frame_parser
from .frame_parser.parser import FrameParser as FrameParser
from .io.storage import load as load, save as save
from .pipeline import (
    Perception as Perception,
    Pipeline as Pipeline,
    PipelineConfig as PipelineConfig,
    judge as judge,
)
from .question_parser.grammar import GrammarParser as GrammarParser
from .question_parser.model import ParserNetwork as ParserNetwork
from .question_parser.network import QuestionParser as QuestionParser
from .symbolic import (
    Executor as Executor,
    Program as Program,
    format_trace as format_trace,
    format_tree as format_tree,
)
from .tracking.tracker import TrackerConfig as TrackerConfig, track as track
from .types import (
    Add as Add,
    Answer as Answer,
    Camera as Camera,
    ChoiceAnswer as ChoiceAnswer,
    DynamicsPrediction as DynamicsPrediction,
    Event as Event,
    EventChange as EventChange,
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
    TraceStep as TraceStep,
    Track as Track,
    UncertainEvent as UncertainEvent,
    VideoProposals as VideoProposals,
    VideoTracks as VideoTracks,
    Violation as Violation,
)

__version__: str

"""NS-DR: answers questions about videos of colliding objects (CLEVRER, ICLR 2020) over a symbolic scene.

video -> frame parser -> proposals -> tracker -> tracks -> dynamics backend -> scene
question -> question parser -> program;  program + scene -> executor -> answer with its trace

    >>> import nsdr
    >>> pipeline = nsdr.Pipeline.from_pretrained()
    >>> pipeline.answer("video.mp4", "How many collisions happen?").answer

Names load their modules when first used, so `import nsdr` is quick. Import it before torch: it lets torch's idle threads
sleep, which must be set before torch loads (see `nsdr.io.threads`).
"""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports
from nsdr.io.threads import wait_passively

__version__ = "0.2.0"

wait_passively()

if TYPE_CHECKING:
    from nsdr.clevrer.dataset import CLEVRER
    from nsdr.dynamics.physics.predictor import PhysicsPredictor
    from nsdr.dynamics.propnet.patch_model import PatchModel
    from nsdr.dynamics.propnet.patch_predictor import PatchPredictor
    from nsdr.dynamics.propnet.state_model import StateModel
    from nsdr.dynamics.propnet.state_predictor import StatePredictor
    from nsdr.dynamics.registry import BackendConfig, load_backend
    from nsdr.errors import (
        CheckpointError,
        DataError,
        ExecutionError,
        NsdrError,
        ProgramError,
        QuestionError,
        VideoError,
    )
    from nsdr.evaluation.runner import EvaluationConfig, run_evaluation
    from nsdr.evaluation.score import evaluate
    from nsdr.frame_parser.dataset import FrameDataset
    from nsdr.frame_parser.model import build_frame_parser
    from nsdr.frame_parser.parser import FrameParser
    from nsdr.frame_parser.video_check import VideoConfig
    from nsdr.io.storage import load, save
    from nsdr.pipeline import Perception, Pipeline, PipelineConfig
    from nsdr.question_parser.model import ParserNetwork
    from nsdr.question_parser.parser import QuestionParser
    from nsdr.symbolic import Executor, Program, explain, format_trace, format_tree
    from nsdr.symbolic.minimal_pairs import MinimalPair, minimal_pairs
    from nsdr.symbolic.narration import narrate
    from nsdr.symbolic.verify import Claim, Verification, verify
    from nsdr.tracking.tracker import TrackerConfig, track
    from nsdr.types import (
        Add,
        Answer,
        ChoiceAnswer,
        Doubt,
        DynamicsPrediction,
        Event,
        EventChange,
        Freeze,
        Move,
        Remove,
        Rollout,
        Scene,
        SceneObject,
        SetMass,
        SetVelocity,
        Simulation,
        TraceStep,
        Track,
        VideoProposals,
        VideoTracks,
    )

_HOME = {
    "nsdr.clevrer.dataset": ["CLEVRER"],
    "nsdr.dynamics.physics.predictor": ["PhysicsPredictor"],
    "nsdr.dynamics.propnet.patch_model": ["PatchModel"],
    "nsdr.dynamics.propnet.patch_predictor": ["PatchPredictor"],
    "nsdr.dynamics.propnet.state_model": ["StateModel"],
    "nsdr.dynamics.propnet.state_predictor": ["StatePredictor"],
    "nsdr.dynamics.registry": ["BackendConfig", "load_backend"],
    "nsdr.errors": [
        "CheckpointError",
        "DataError",
        "ExecutionError",
        "NsdrError",
        "ProgramError",
        "QuestionError",
        "VideoError",
    ],
    "nsdr.evaluation.runner": ["EvaluationConfig", "run_evaluation"],
    "nsdr.evaluation.score": ["evaluate"],
    "nsdr.frame_parser.dataset": ["FrameDataset"],
    "nsdr.frame_parser.model": ["build_frame_parser"],
    "nsdr.frame_parser.parser": ["FrameParser"],
    "nsdr.io.storage": ["load", "save"],
    "nsdr.frame_parser.video_check": ["VideoConfig"],
    "nsdr.pipeline": ["Perception", "Pipeline", "PipelineConfig"],
    "nsdr.question_parser.model": ["ParserNetwork"],
    "nsdr.question_parser.parser": ["QuestionParser"],
    "nsdr.symbolic": ["Executor", "Program", "explain", "format_trace", "format_tree"],
    "nsdr.symbolic.minimal_pairs": ["MinimalPair", "minimal_pairs"],
    "nsdr.symbolic.narration": ["narrate"],
    "nsdr.symbolic.verify": ["Claim", "Verification", "verify"],
    "nsdr.tracking.tracker": ["TrackerConfig", "track"],
    "nsdr.types": [
        "Add",
        "Answer",
        "ChoiceAnswer",
        "Doubt",
        "DynamicsPrediction",
        "Event",
        "EventChange",
        "Freeze",
        "Move",
        "Remove",
        "Rollout",
        "Scene",
        "SceneObject",
        "SetMass",
        "SetVelocity",
        "Simulation",
        "TraceStep",
        "Track",
        "VideoProposals",
        "VideoTracks",
    ],
}

__all__ = [
    "CLEVRER",
    "Add",
    "Answer",
    "BackendConfig",
    "CheckpointError",
    "ChoiceAnswer",
    "Claim",
    "DataError",
    "Doubt",
    "DynamicsPrediction",
    "EvaluationConfig",
    "Event",
    "EventChange",
    "ExecutionError",
    "Executor",
    "FrameDataset",
    "FrameParser",
    "Freeze",
    "MinimalPair",
    "Move",
    "NsdrError",
    "ParserNetwork",
    "PatchModel",
    "PatchPredictor",
    "Perception",
    "PhysicsPredictor",
    "Pipeline",
    "PipelineConfig",
    "Program",
    "ProgramError",
    "QuestionError",
    "QuestionParser",
    "Remove",
    "Rollout",
    "Scene",
    "SceneObject",
    "SetMass",
    "SetVelocity",
    "Simulation",
    "StateModel",
    "StatePredictor",
    "TraceStep",
    "Track",
    "TrackerConfig",
    "Verification",
    "VideoConfig",
    "VideoError",
    "VideoProposals",
    "VideoTracks",
    "__version__",
    "build_frame_parser",
    "evaluate",
    "explain",
    "format_trace",
    "format_tree",
    "load",
    "load_backend",
    "minimal_pairs",
    "narrate",
    "run_evaluation",
    "save",
    "track",
    "verify",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

"""NS-DR: answers questions about videos of colliding objects (CLEVRER, ICLR 2020) over a symbolic scene.

video -> frame parser -> proposals -> tracker -> tracks -> dynamics predictor -> scene
question -> question parser -> program;  program + scene -> executor -> answer with its trace

    >>> import nsdr
    >>> pipeline = nsdr.Pipeline.from_pretrained()
    >>> pipeline.answer("video.mp4", "How many collisions happen?").answer

Names load their modules when first used, so `import nsdr` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from nsdr.dynamics.propnet.state_predictor import StatePredictor
    from nsdr.errors import (
        CheckpointError,
        DataError,
        ExecutionError,
        NsdrError,
        ProgramError,
        QuestionError,
        VideoError,
    )
    from nsdr.frame_parser.parser import FrameParser
    from nsdr.io.storage import load, save
    from nsdr.pipeline import Perception, Pipeline
    from nsdr.question_parser.parser import QuestionParser
    from nsdr.symbolic import Executor, Program, format_trace, format_tree
    from nsdr.symbolic.traces import explain
    from nsdr.tracking.tracker import track
    from nsdr.types import (
        Answer,
        DynamicsPrediction,
        Event,
        Rollout,
        Scene,
        SceneObject,
        Track,
        VideoProposals,
        VideoTracks,
    )

_HOME = {
    "nsdr.dynamics.propnet.state_predictor": ["StatePredictor"],
    "nsdr.errors": [
        "CheckpointError",
        "DataError",
        "ExecutionError",
        "NsdrError",
        "ProgramError",
        "QuestionError",
        "VideoError",
    ],
    "nsdr.frame_parser.parser": ["FrameParser"],
    "nsdr.tracking.tracker": ["track"],
    "nsdr.pipeline": ["Perception", "Pipeline"],
    "nsdr.question_parser.parser": ["QuestionParser"],
    "nsdr.io.storage": ["load", "save"],
    "nsdr.symbolic": ["Executor", "Program", "explain", "format_trace", "format_tree"],
    "nsdr.types": [
        "Answer",
        "DynamicsPrediction",
        "Event",
        "Rollout",
        "Scene",
        "SceneObject",
        "Track",
        "VideoProposals",
        "VideoTracks",
    ],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Answer",
    "CheckpointError",
    "DataError",
    "DynamicsPrediction",
    "Event",
    "ExecutionError",
    "Executor",
    "FrameParser",
    "NsdrError",
    "Perception",
    "Pipeline",
    "Program",
    "ProgramError",
    "QuestionError",
    "QuestionParser",
    "Rollout",
    "Scene",
    "SceneObject",
    "StatePredictor",
    "Track",
    "VideoError",
    "VideoProposals",
    "VideoTracks",
    "__version__",
    "explain",
    "format_trace",
    "format_tree",
    "load",
    "save",
    "track",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__

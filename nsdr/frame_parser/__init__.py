"""From frames to proposals: the Mask R-CNN with attribute heads, its data set, its metrics and its use on videos."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.frame_parser.dataset import AugmentConfig, FrameDataset, augment, collate, image_tensor
    from nsdr.frame_parser.metrics import average_precision, detection_scores
    from nsdr.frame_parser.model import FrameParserConfig, FrameParserNetwork, build_frame_parser
    from nsdr.frame_parser.parser import FrameParser
    from nsdr.frame_parser.training_frames import frame_records, write_frames

_HOME = {
    "nsdr.frame_parser.dataset": ["AugmentConfig", "FrameDataset", "augment", "collate", "image_tensor"],
    "nsdr.frame_parser.metrics": ["average_precision", "detection_scores"],
    "nsdr.frame_parser.model": ["FrameParserConfig", "FrameParserNetwork", "build_frame_parser"],
    "nsdr.frame_parser.parser": ["FrameParser"],
    "nsdr.frame_parser.training_frames": ["frame_records", "write_frames"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "AugmentConfig",
    "FrameDataset",
    "FrameParser",
    "FrameParserConfig",
    "FrameParserNetwork",
    "augment",
    "average_precision",
    "build_frame_parser",
    "collate",
    "detection_scores",
    "frame_records",
    "image_tensor",
    "write_frames",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__

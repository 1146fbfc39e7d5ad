"""From frames to proposals: the Mask R-CNN with attribute heads, its data set, its metrics and its use on videos."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.frame_parser.dataset import AugmentConfig, FrameDataset, augment, collate, image_tensor
    from nsdr.frame_parser.metrics import average_precision, detection_scores
    from nsdr.frame_parser.model import FrameParserConfig, FrameParserNetwork, build_frame_parser
    from nsdr.frame_parser.parser import FrameParser
    from nsdr.frame_parser.training_frames import frame_records, write_frames
    from nsdr.frame_parser.video_check import VideoCheck, VideoConfig, check_video, clip_frames

_HOME = {
    "nsdr.frame_parser.dataset": ["AugmentConfig", "FrameDataset", "augment", "collate", "image_tensor"],
    "nsdr.frame_parser.metrics": ["average_precision", "detection_scores"],
    "nsdr.frame_parser.model": ["FrameParserConfig", "FrameParserNetwork", "build_frame_parser"],
    "nsdr.frame_parser.parser": ["FrameParser"],
    "nsdr.frame_parser.training_frames": ["frame_records", "write_frames"],
    "nsdr.frame_parser.video_check": ["VideoCheck", "VideoConfig", "check_video", "clip_frames"],
}

__all__ = [
    "AugmentConfig",
    "FrameDataset",
    "FrameParser",
    "FrameParserConfig",
    "FrameParserNetwork",
    "VideoCheck",
    "VideoConfig",
    "augment",
    "average_precision",
    "build_frame_parser",
    "check_video",
    "clip_frames",
    "collate",
    "detection_scores",
    "frame_records",
    "image_tensor",
    "write_frames",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)

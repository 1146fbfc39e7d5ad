from .check.video import (
    VideoCheck as VideoCheck,
    VideoConfig as VideoConfig,
    check_video as check_video,
    clip_frames as clip_frames,
)
from .dataset import (
    AugmentConfig as AugmentConfig,
    augment as augment,
    collate as collate,
    image_tensor as image_tensor,
)
from .metrics import average_precision as average_precision, detection_scores as detection_scores
from .model import (
    FrameParserConfig as FrameParserConfig,
    FrameParserNetwork as FrameParserNetwork,
    build_frame_parser as build_frame_parser,
)
from .training_frames import write_frames as write_frames

VERSION: int

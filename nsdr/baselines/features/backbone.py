"""The networks that the features of frames come from: torchvision's ResNets (paper), or the frame parser's own backbone."""

import urllib.error
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torchvision import models

from nsdr.errors import CheckpointError, machine_error
from nsdr.frame_parser.parser import Detector

FRAME_PARSER = "frame_parser"
"""Name of the frame parser's own backbone."""
CHANNELS = {"resnet18": (256, 512), "resnet50": (1024, 2048)}
"""Channels of torchvision's networks after their third stage, which gives the maps, and after their last stage."""
STRIDE = 16
"""Stride of the third stage, and of the coarsest level of the frame parser's pyramid (pixels)."""
PYRAMID_LEVELS = ("0", "1", "2")
"""The levels of the pyramid that are used: strides of 4, 8 and 16 px."""
IMAGE_MEAN, IMAGE_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of the RGB channels with which torchvision's weights were trained (0-1)."""


class FeatureMaps(NamedTuple):
    """Feature maps of F frames, float32.

    Attributes:
        levels: (F, C, h, w) maps of each level.
        last: (F, C, h, w) maps of the last stage, whose means are the pooled features; None if these are means of the levels.
    """

    levels: list[Tensor]
    last: Tensor | None


class ResnetBackbone:
    """Maps of the last two stages of a ResNet trained on ImageNet.

    Args:
        name: one of `CHANNELS`. torchvision's weights are downloaded when first used.
        size: height and width to which frames are scaled (pixels).
        precision: number format of the network.
        device: where it runs.

    Raises:
        CheckpointError: the weights cannot be downloaded.
    """

    def __init__(self, name: str, size: tuple[int, int], precision: torch.dtype, device: torch.device) -> None:
        try:
            resnet: Any = models.get_model(name, weights="IMAGENET1K_V1")
        except (urllib.error.URLError, OSError, RuntimeError) as e:
            if failure := machine_error(e, f"weights of {name}"):
                raise failure from e
            remedy = f"connect to the network, or set backbone to {FRAME_PARSER}"
            raise CheckpointError(f"weights of {name} cannot be downloaded ({e}); {remedy}") from e
        resnet = resnet.eval().to(device, memory_format=torch.channels_last)
        self._start = nn.Sequential(
            resnet.conv1, resnet.bn1, resnet.relu, resnet.maxpool, resnet.layer1, resnet.layer2, resnet.layer3
        )
        self._end, self._size, self._precision, self._device = resnet.layer4, size, precision, device

    def __call__(self, frames: Sequence[NDArray[np.uint8]]) -> FeatureMaps:
        """RGB frames (H, W, 3) -> maps (F, C, H/16, W/16), and last maps of half that size; sizes are rounded up."""
        images = image_batch(frames, self._size).to(self._device)
        mixed = self._precision != torch.float32  # some devices have no autocast, even to be disabled
        with torch.autocast(self._device.type, self._precision) if mixed else nullcontext():
            third = self._start(images)
            last = self._end(third)
        return FeatureMaps([third.float()], last.float())


class FrameParserBackbone:
    """Maps of the frame parser's backbone, a feature pyramid that was trained to find objects and their attributes.

    Differs from the paper: its ResNet was trained on ImageNet.

    Args:
        detector: the frame parser's detector.
    """

    def __init__(self, detector: Detector) -> None:
        self._detector = detector

    def __call__(self, frames: Sequence[NDArray[np.uint8]]) -> FeatureMaps:
        """Frames (320, 480, 3), RGB -> maps of strides 4, 8 and 16 px."""
        levels = self._detector.backbone(self._detector.normalized(frames))
        return FeatureMaps([levels[name].float() for name in PYRAMID_LEVELS], None)


def image_batch(frames: Sequence[NDArray[np.uint8]], size: tuple[int, int]) -> Tensor:
    """A ResNet's input (B, 3, height, width) of RGB frames (H, W, 3), scaled to `size` (height, width; pixels)."""
    height, width = size
    scaled = [
        frame if frame.shape[:2] == size else cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)
        for frame in frames
    ]
    pixels = torch.from_numpy(np.stack(scaled)).permute(0, 3, 1, 2).float().div_(255)  # channels last in memory
    return pixels.sub_(torch.tensor(IMAGE_MEAN)[:, None, None]).div_(torch.tensor(IMAGE_STD)[:, None, None])

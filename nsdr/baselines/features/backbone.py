"""The ResNet of the frames' features: torchvision's weights, or those of `nsdr train backbone`."""

import urllib.error
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torchvision import models

from nsdr.errors import CheckpointError
from nsdr.io.checkpoint import find_checkpoint, load_network
from nsdr.validation import Settings, one_of
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = [
    "CHANNELS",
    "IMAGENET",
    "MAX_COUNT",
    "STRIDE",
    "Backbone",
    "BackboneConfig",
    "FrameClassifier",
    "FrameScores",
    "image_batch",
    "load_backbone",
]

IMAGENET = "imagenet"
"""Stands for torchvision's weights, in place of a checkpoint."""
CHANNELS = {"resnet18": (256, 512), "resnet50": (1024, 2048)}
"""Channels of torchvision's networks after their third stage, which gives the maps, and after their last one."""
STRIDE = 16
"""Stride of the third stage (pixels)."""
IMAGE_MEAN, IMAGE_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of the RGB channels with which torchvision's weights were trained (0-1)."""
MAX_COUNT = 10
"""Frames with more objects count as frames with so many."""


@dataclass(frozen=True)
class BackboneConfig(Settings):
    """Architecture of the backbone.

    Attributes:
        name: torchvision's "resnet18" or "resnet50" (paper).
    """

    name: Annotated[str, one_of(CHANNELS)] = "resnet18"


class Backbone(nn.Module):
    """A ResNet that gives the maps of its last two stages.

    Args:
        resnet: torchvision's network.
    """

    def __init__(self, resnet: nn.Module) -> None:
        super().__init__()
        resnet.fc = nn.Identity()
        self.resnet = resnet

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Images (B, 3, H, W) of `image_batch` -> maps (B, C, H/16, W/16) and (B, C, H/32, W/32), sizes rounded up."""
        net = self.resnet
        x = net.layer1(net.maxpool(net.relu(net.bn1(net.conv1(images)))))  # type: ignore[operator]
        third = net.layer3(net.layer2(x))  # type: ignore[operator]
        return third, net.layer4(third)  # type: ignore[operator]


class FrameScores(NamedTuple):
    """What is said of B frames, before sigmoid and softmax.

    Attributes:
        centre: (B, h, w), that an object's centre is in the cell.
        attributes: by attribute, (B, words, h, w) for the object whose centre is in the cell.
        present: (B, all words of all attributes), that an object with the word is seen.
        number: (B, `MAX_COUNT` + 1), number of objects seen.
    """

    centre: Tensor
    attributes: dict[str, Tensor]
    present: Tensor
    number: Tensor


class FrameClassifier(nn.Module):
    """A backbone with heads that say what a frame shows: what it is trained with.

    Differs from the paper: nothing there corresponds to it; its ResNet-50 was trained on ImageNet.
    """

    def __init__(self, config: BackboneConfig) -> None:
        super().__init__()
        self.config = config
        self.backbone = Backbone(models.get_model(config.name, weights=None))
        (third, last), words = CHANNELS[config.name], sum(map(len, ATTRIBUTES.values()))
        self.cells = nn.Conv2d(third, 1 + words, 1)
        self.frame = nn.Linear(last, words + MAX_COUNT + 1)

    def forward(self, images: Tensor) -> FrameScores:
        """Normalised images (B, 3, H, W) -> scores."""
        third, last = self.backbone(images)
        sizes = [len(words) for words in ATTRIBUTES.values()]
        centre, *attributes = self.cells(third).float().split([1, *sizes], 1)
        present, number = self.frame(last.mean((2, 3))).float().split([sum(sizes), MAX_COUNT + 1], 1)
        return FrameScores(centre[:, 0], dict(zip(ATTRIBUTES, attributes, strict=True)), present, number)


def load_backbone(name: str, weights: str) -> Backbone:
    """A backbone with trained weights.

    Args:
        name: one of `CHANNELS`.
        weights: `IMAGENET`, or a checkpoint of `nsdr train backbone` as of `nsdr.io.checkpoint.find_checkpoint`.

    Raises:
        CheckpointError: the weights cannot be loaded, or are of another network.
    """
    if weights != IMAGENET:
        trained = load_network(find_checkpoint(weights), "backbone", BackboneConfig, FrameClassifier)
        found = trained.config.name
        if found != name:
            raise CheckpointError(f"{weights}: expected a {name}, got a {found}; change the backbone or the weights")
        return trained.backbone
    try:
        return Backbone(models.get_model(name, weights="IMAGENET1K_V1"))
    except (urllib.error.URLError, OSError, RuntimeError) as e:
        remedy = "connect to the network, or give a checkpoint of `nsdr train backbone` as weights"
        raise CheckpointError(f"weights {IMAGENET} of {name} cannot be downloaded ({e}); {remedy}") from e


def image_batch(frames: Sequence[NDArray[np.uint8]], size: tuple[int, int]) -> Tensor:
    """The backbone's input (B, 3, height, width) of RGB frames (H, W, 3), scaled to `size` (height, width; pixels)."""
    height, width = size
    scaled = [
        frame if frame.shape[:2] == size else cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)
        for frame in frames
    ]
    pixels = torch.from_numpy(np.stack(scaled)).permute(0, 3, 1, 2).float().div_(255)  # channels last in memory
    return pixels.sub_(torch.tensor(IMAGE_MEAN)[:, None, None]).div_(torch.tensor(IMAGE_STD)[:, None, None])

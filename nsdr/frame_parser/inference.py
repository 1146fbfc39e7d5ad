"""The frame parser's network prepared for detection: fused convolutions, lower precision, few proposals."""

from collections.abc import Sequence
from copy import deepcopy
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval
from torchvision.models.detection.image_list import ImageList

from nsdr.frame_parser.model import ROI_LEVELS

__all__ = ["Detector"]

MIN_OBJECTNESS = 0.05
"""Regions that are objects with a lower probability are not proposed (0-1). Not in training, where they are the negatives.
`python benchmarks/frame_parser.py --objectness FRAMES` prints how many detections in training frames come from lower ones."""


class Detector:
    """Detections of a trained network of `build_frame_parser`, the same as the network's own within rounding.

    The first stage is a copy, with batch normalisation in the convolutions' weights; boxes, classes and masks are computed in
    float32 by the network's own second stage.

    Args:
        model: the network, in evaluation mode; on the device to use.
        precision: number format of the copy.
        min_objectness: regions that are objects with a lower probability are not proposed (0-1).
    """

    def __init__(self, model: Any, precision: torch.dtype, min_objectness: float = MIN_OBJECTNESS) -> None:
        self.precision, self.roi_heads = precision, model.roi_heads
        self.backbone = _fused(deepcopy(model.backbone))
        self.rpn = _fused(deepcopy(model.rpn))
        for part in (self.backbone, self.rpn.head):
            part.to(precision).to(memory_format=torch.channels_last)
        self.rpn.score_thresh = min_objectness
        self.device = next(model.parameters()).device
        mean, std = (
            torch.tensor(v, device=self.device) for v in (model.transform.image_mean, model.transform.image_std)
        )
        self.scale, self.offset = 1 / (255 * std), mean / std

    def __call__(self, frames: Sequence[NDArray[np.uint8]]) -> list[dict[str, Tensor]]:
        """Detections in RGB frames (H, W, 3) of one size, as `AttributeRoIHeads` describes them; on the CPU."""
        images = self._normalized(frames)
        sizes = [frame.shape[:2] for frame in frames]
        levels = self.backbone(images)
        proposals, _ = self.rpn(ImageList(images, sizes), levels)
        # RoIAlign wants contiguous features; conversion and copy in one step take a quarter of the time of two.
        pooled = {k: levels[k].to(torch.float32, memory_format=torch.contiguous_format) for k in ROI_LEVELS}
        detections = self.roi_heads(pooled, proposals, sizes)[0]
        return [{name: value.cpu() for name, value in found.items()} for found in detections]

    def _normalized(self, frames: Sequence[NDArray[np.uint8]]) -> Tensor:
        """The network's input (B, 3, H, W), channels last."""
        pixels = torch.from_numpy(np.stack(frames)).to(self.device)
        # Whole rows at a time: arithmetic along an axis of three channels takes three times as long.
        width = pixels.shape[2]
        rows = pixels.float().flatten(2).mul_(self.scale.repeat(width)).sub_(self.offset.repeat(width))
        return rows.to(self.precision).view(pixels.shape).permute(0, 3, 1, 2)


def _fused(module: Any) -> Any:
    """The module with each convolution and the batch normalisation that follows it as one convolution."""
    names = list(module._modules)
    for name, following in pairwise(names):
        conv, norm = module._modules[name], module._modules[following]
        if isinstance(conv, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            module._modules[name], module._modules[following] = fuse_conv_bn_eval(conv, norm), nn.Identity()
    for child in module.children():
        _fused(child)
    return module

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
from torchvision.ops import boxes as box_ops

from nsdr.frame_parser.model import ROI_LEVELS

__all__ = ["Detector"]

MIN_OBJECTNESS = 0.05
"""Regions that are objects with a lower probability are not proposed (0-1). Not in training, where they are the negatives.
`python benchmarks/frame_parser.py --objectness FRAMES` prints how many detections in training frames come from lower ones."""


class Detector:
    """Detections of a trained network of `build_frame_parser`, the same as the network's own within rounding.

    Its backbone and the head of the region proposals are copies, with batch normalisation in the convolutions' weights; boxes,
    classes and masks are computed in float32 by the network's own second stage.

    Args:
        model: the network, in evaluation mode; on the device to use.
        precision: number format of the copies.
        min_objectness: regions that are objects with a lower probability are not proposed (0-1).
    """

    def __init__(self, model: Any, precision: torch.dtype, min_objectness: float = MIN_OBJECTNESS) -> None:
        self.model, self.precision, self.min_objectness = model, precision, min_objectness
        self.backbone, self.rpn_head = (
            _fused(deepcopy(part)).to(precision).to(memory_format=torch.channels_last)
            for part in (model.backbone, model.rpn.head)
        )
        self.device = next(model.parameters()).device
        mean, std = (
            torch.tensor(v, device=self.device) for v in (model.transform.image_mean, model.transform.image_std)
        )
        self.scale, self.offset = 1 / (255 * std), mean / std

    def __call__(self, frames: Sequence[NDArray[np.uint8]]) -> list[dict[str, Tensor]]:
        """Detections in RGB frames (H, W, 3) of one size, as `AttributeRoIHeads` describes them; on the CPU."""
        height, width = frames[0].shape[:2]
        levels = self.backbone(self._normalized(frames))
        sizes = [(height, width)] * len(frames)
        proposals = self._proposals(levels, (height, width))
        # RoIAlign wants contiguous features; conversion and copy in one step take a quarter of the time of two.
        pooled = {k: levels[k].to(torch.float32, memory_format=torch.contiguous_format) for k in ROI_LEVELS}
        detections = self.model.roi_heads(pooled, proposals, sizes)[0]
        return [{name: value.cpu() for name, value in found.items()} for found in detections]

    def _normalized(self, frames: Sequence[NDArray[np.uint8]]) -> Tensor:
        """The network's input (B, 3, H, W), channels last."""
        pixels = torch.from_numpy(np.stack(frames))
        if self.device.type == "cuda":
            pixels = pixels.pin_memory()
        pixels = pixels.to(self.device, non_blocking=True)
        # Whole rows at a time: arithmetic along an axis of three channels takes three times as long.
        rows = pixels.float().flatten(2)
        width = pixels.shape[2]
        rows = rows.mul_(self.scale.repeat(width)).sub_(self.offset.repeat(width))
        return rows.to(self.precision).view(pixels.shape).permute(0, 3, 1, 2)

    def _proposals(self, levels: dict[str, Tensor], size: tuple[int, int]) -> list[Tensor]:
        """Proposed boxes (N, 4) of each image; as torchvision's `RegionProposalNetwork`, which decodes all anchors."""
        rpn = self.model.rpn
        all_logits, all_deltas = self.rpn_head(list(levels.values()))
        anchors = rpn.anchor_generator(
            ImageList(torch.empty(1, 3, *size, device=self.device), [size]),
            [level[:1].float() for level in levels.values()],
        )[0].split([logits[0].numel() for logits in all_logits])
        boxes, scores, groups = [], [], []
        for k, (logits, deltas) in enumerate(zip(all_logits, all_deltas, strict=True)):
            n = len(logits)
            flat = logits.permute(0, 2, 3, 1).flatten(1).float()
            best, index = flat.topk(min(rpn.pre_nms_top_n(), flat.shape[1]))
            deltas = deltas.unflatten(1, (-1, 4)).permute(0, 3, 4, 1, 2).reshape(n, -1, 4)
            chosen = deltas.gather(1, index[:, :, None].expand(-1, -1, 4)).float()
            boxes.append(rpn.box_coder.decode(chosen.flatten(0, 1), [anchors[k][index].flatten(0, 1)]).view(n, -1, 4))
            scores.append(best.sigmoid())
            groups.append(torch.arange(n, device=self.device)[:, None].expand_as(index) * len(levels) + k)
        return self._kept(torch.cat(boxes, 1), torch.cat(scores, 1), torch.cat(groups, 1), size)

    def _kept(self, boxes: Tensor, scores: Tensor, groups: Tensor, size: tuple[int, int]) -> list[Tensor]:
        """Proposals of each image after non-maximum suppression within each group (image and level), best first.

        Args:
            boxes: (B, N, 4) xyxy in pixels.
            scores: (B, N) probabilities of being an object.
            groups: (B, N) index of image and level.
            size: height and width of the images (pixels).
        """
        rpn = self.model.rpn
        n_images, image = len(boxes), torch.arange(len(boxes), device=self.device)[:, None].expand_as(scores)
        boxes = box_ops.clip_boxes_to_image(boxes, size).flatten(0, 1)
        large = (boxes[:, 2:] - boxes[:, :2] >= rpn.min_size).all(1)
        kept = torch.where(large & (scores.flatten() >= self.min_objectness))[0]
        boxes, scores, groups, image = (
            boxes[kept],
            scores.flatten()[kept],
            groups.flatten()[kept],
            image.flatten()[kept],
        )
        kept = box_ops.batched_nms(boxes, scores, groups, rpn.nms_thresh)
        return [boxes[kept[image[kept] == i][: rpn.post_nms_top_n()]] for i in range(n_images)]


def _fused(module: nn.Module) -> nn.Module:
    """The module with each convolution and the batch normalisation that follows it as one convolution."""
    names = list(module._modules)
    for name, following in pairwise(names):
        conv, norm = module._modules[name], module._modules[following]
        if isinstance(conv, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            module._modules[name], module._modules[following] = fuse_conv_bn_eval(conv, norm), nn.Identity()
    for child in module.children():
        _fused(child)
    return module

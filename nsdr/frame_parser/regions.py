"""Regions of all images of a batch at once: the first stage that proposes them, and what both stages do with them.

torchvision goes from image to image. On a GPU, starting the work for each image and waiting for it then takes most of the time.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torchvision.models.detection.image_list import ImageList
from torchvision.models.detection.rpn import RegionProposalNetwork
from torchvision.ops import MultiScaleRoIAlign, boxes as box_ops, nms, roi_align

ROI_LEVELS = ["0", "1"]
"""Pyramid levels that the second stage pools from: CLEVRER's objects are 25-110 px wide."""
ROI_STRIDES_PX = (4, 8)
"""Strides of these levels (pixels)."""
ROI_COARSE_PX = 128
"""Regions whose area has at least this side are pooled from the coarse level, smaller ones from the fine level (pixels)."""
ROI_SAMPLES = 2
"""Samples per pooled cell along each axis (`sampling_ratio` of RoIAlign)."""
GROUP_SPACING_PX = 1024
"""Distance by which groups of boxes are moved apart before non-maximum suppression, more than the side of an image (pixels)."""


def images_of(boxes: Sequence[Tensor]) -> Tensor:
    """The index (N,) of each region's image, from the boxes (N_i, 4) of the images."""
    counts = torch.tensor([len(of_image) for of_image in boxes])
    return torch.repeat_interleave(counts).to(boxes[0].device)


def by_image(values: Tensor, image: Tensor, n_images: int) -> tuple[Tensor, ...]:
    """The values (N, …) of each of `n_images` images, from the ascending index (N,) of each value's image."""
    return values.split(torch.bincount(image, minlength=n_images).tolist())


def clipped(boxes: Tensor, image: Tensor, image_sizes: Sequence[tuple[int, int]]) -> Tensor:
    """The boxes (N, 4) xyxy cut off at the borders of their images, whose index is (N,) and whose sizes are (height, width)."""
    borders = torch.tensor([(width, height, width, height) for height, width in image_sizes], device=boxes.device)
    return boxes.clamp(min=0).minimum(borders[image].to(boxes.dtype))


def has_sides(boxes: Tensor, least_px: float) -> Tensor:
    """Whether (N,) both sides of the boxes (N, 4) xyxy are at least that long (pixels)."""
    return (boxes[:, 2:] - boxes[:, :2] >= least_px).all(1)


def best_of_images(
    boxes: Tensor, scores: Tensor, image: Tensor, group: Tensor, n_groups: int, iou: float, most: int
) -> Tensor:
    """Indices (M,) of the regions that non-maximum suppression leaves, at most `most` of an image.

    Args:
        boxes: (N, 4) float32 xyxy (pixels), the regions of all images.
        scores: (N,) float32.
        image: (N,) int64 index of each region's image.
        group: (N,) int64 from 0 to `n_groups` - 1; regions of different groups, such as those of different images, do not
            suppress each other.
        iou: of two regions with a larger intersection over union, the one with the lower score is dropped (0-1).
        most: largest number of regions of an image.

    Returns:
        The indices in the order of the images, and by falling score within each.
    """
    # The groups lie in a square: coordinates far from the origin are less exact.
    side = math.isqrt(n_groups) + 1
    cell = torch.stack([group % side, group // side] * 2, 1)
    kept = nms(boxes + cell * GROUP_SPACING_PX, scores, iou)
    of_image, order = image[kept].sort(stable=True)
    rank = torch.arange(len(kept), device=kept.device) - torch.searchsorted(of_image, of_image)
    return kept[order[rank < most]]


class ProposalNetwork(RegionProposalNetwork):
    """torchvision's first stage, whose proposals at inference are made for all images of a batch at once.

    Only the boxes of the best regions of each level are computed. In training, torchvision's own code runs.
    """

    def forward(self, images, features, targets=None):  # type: ignore[no-untyped-def]
        if self.training:
            return super().forward(images, features, targets)
        levels = list(features.values())
        n_images = len(levels[0])
        # Anchors are the same in all images.
        anchors = self.anchor_generator(ImageList(images.tensors[:1], images.image_sizes[:1]), levels)[0]
        chosen, start = [], 0
        for level, (objectness, deltas) in enumerate(zip(*self.head(levels), strict=True)):
            scores = objectness.permute(0, 2, 3, 1).flatten(1)
            codes = deltas.permute(0, 2, 3, 1).reshape(n_images, -1, 4)
            best, place = scores.topk(min(self.pre_nms_top_n(), scores.shape[1]), 1)
            codes = codes.gather(1, place[..., None].expand(-1, -1, 4))
            chosen.append((best, codes, anchors[start + place], torch.full_like(place, level)))
            start += scores.shape[1]
        logits, codes, corners, level_index = (torch.cat(values, 1) for values in zip(*chosen, strict=True))
        image_index = torch.arange(n_images, device=logits.device)[:, None].expand_as(logits)
        scores, image = logits.sigmoid().flatten(), image_index.flatten()
        group = (image_index * len(levels) + level_index).flatten()
        boxes = self.box_coder.decode_single(codes.flatten(0, 1), corners.flatten(0, 1))
        boxes = clipped(boxes, image, images.image_sizes)
        kept = torch.where((scores >= self.score_thresh) & has_sides(boxes, self.min_size))[0]
        boxes, scores, image = boxes[kept], scores[kept], image[kept]
        best = best_of_images(
            boxes, scores, image, group[kept], n_images * len(levels), self.nms_thresh, self.post_nms_top_n()
        )
        return list(by_image(boxes[best], image[best], n_images)), {}


class RegionPool(MultiScaleRoIAlign):
    """torchvision's pooling from the pyramid level that fits a region's size, for the regions of all images at once.

    Args:
        cells: side of the pooled features.
    """

    def __init__(self, cells: int) -> None:
        super().__init__(ROI_LEVELS, cells, ROI_SAMPLES)

    def forward(self, x, boxes, image_shapes):  # type: ignore[no-untyped-def]
        """Features by level (B, C, H, W) and boxes (N_i, 4) xyxy by image -> pooled features (N, C, cells, cells)."""
        corners = torch.cat(list(boxes))
        regions = torch.cat([images_of(boxes)[:, None].to(corners.dtype), corners], 1)
        level = (box_ops.box_area(corners) >= ROI_COARSE_PX**2).long()
        first = x[ROI_LEVELS[0]]
        pooled = first.new_zeros(len(regions), first.shape[1], *self.output_size)
        for i, (name, stride) in enumerate(zip(ROI_LEVELS, ROI_STRIDES_PX, strict=True)):
            here = torch.where(level == i)[0]
            pooled[here] = roi_align(x[name], regions[here], self.output_size, 1 / stride, ROI_SAMPLES).to(pooled.dtype)
        return pooled

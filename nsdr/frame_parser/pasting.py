"""Masks in boxes as runs of image pixels, for all objects of a batch at once."""

import torch
from torch import Tensor
from torch.nn import functional as F

from nsdr.frame_parser.roi_heads import MASK_THRESHOLD


def mask_changes(masks: Tensor, boxes: Tensor, size: tuple[int, int]) -> Tensor:
    """Where objects begin and end in the columns of the image.

    torchvision's `paste_masks_in_image` truncates boxes to whole pixels, which shifts masks by half a pixel and makes them
    jitter by as much. Here, pixel i has its value at coordinate i, as in the training targets (RoIAlign, `aligned=False`).

    Args:
        masks: (N, M, M) probabilities in the boxes.
        boxes: (N, 4) xyxy (pixels).
        size: height and width of the image (pixels).

    Returns:
        (2, 2K) int64: for each of K runs of an object's pixels its begin and then its end. The first row has the object, the
        second row the pixel's place in the image, which is counted column by column. Objects and places ascend.
    """
    if not len(masks):
        return torch.zeros(2, 0, dtype=torch.int64, device=masks.device)
    height, width = size
    low = (boxes[:, :2].long() - 1).clamp(min=0)
    sides = (boxes[:, 2:].long() + 2 - low).amax(0).tolist()
    columns, rows = (
        _weights(boxes[:, axis], boxes[:, axis + 2], low[:, axis], side, masks.shape[1], most)
        for axis, side, most in ((0, sides[0], width), (1, sides[1], height))
    )
    inside = columns @ masks.mT @ rows.mT > MASK_THRESHOLD  # (N, columns, rows)
    padded = F.pad(inside, (1, 1))
    object_index, column, row = torch.where(padded[..., 1:] != padded[..., :-1])
    place = (low[object_index, 0] + column) * height + low[object_index, 1] + row
    return torch.stack([object_index, place])


def _weights(begin: Tensor, end: Tensor, low: Tensor, side: int, cells: int, most: int) -> Tensor:
    """How much (N, side, cells) each cell of a mask counts along an axis for the pixels from `low` on: linear interpolation.

    Pixels at `most` and beyond are outside of the image.
    """
    pixels = low[:, None] + torch.arange(side, device=begin.device)
    begin, end = begin[:, None], end[:, None]
    place = (pixels - begin) / (end - begin) * cells - 0.5
    weights = 1 - (place[..., None] - torch.arange(cells, device=begin.device)).abs()
    return weights.clamp(min=0) * (pixels < most)[..., None]

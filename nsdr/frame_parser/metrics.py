"""Metrics of the frame parser: detections against the true objects of frames."""

import warnings
from collections.abc import Iterable, Iterator

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.ops import box_iou

from nsdr.frame_parser.roi_heads import MASK_THRESHOLD
from nsdr.tracking.tracker import PROPOSAL_SCORE
from nsdr.world.vocabulary import NAMES

Frame = tuple[Tensor, dict[str, Tensor]]
"""Image (3, H, W) and target, as in `FrameDataset`."""
MIN_AREA_PX = 60
"""True objects with a smaller visible area count neither as missed nor as detected (pixels)."""
MATCH_IOU = 0.5
"""Smallest intersection over union of the boxes of a detection and the object that it matches (0-1)."""


@torch.no_grad()
def detection_scores(model: nn.Module, frames: Iterable[Frame]) -> dict[str, float]:
    """Attribute-exact precision, recall and F1 at a box IoU of 0.5, mean mask IoU and accuracy of each attribute.

    Args:
        model: the network of `build_frame_parser`.
        frames: pairs of image (3, H, W) and target.

    Returns:
        `precision`, `recall`, `f1`, `color_accuracy`, `material_accuracy`, `shape_accuracy` and `mask_iou` (0-1). Mask IoU and
        accuracies are means over matched detections.
    """
    detected = matched = exact = expected = 0
    correct = dict.fromkeys(NAMES, 0)
    mask_iou = 0.0
    for detection, target in _detections(model, frames):
        kept = detection["scores"] > PROPOSAL_SCORE
        iou = box_iou(detection["boxes"][kept], target["boxes"])
        areas = target["masks"].flatten(1).sum(1)
        expected += int((areas >= MIN_AREA_PX).sum())
        for i, attribute in enumerate(detection["attribute"][kept].argmax(1).tolist()):
            best = int(iou[i].argmax()) if len(areas) else -1
            if best < 0 or iou[i, best] < MATCH_IOU:
                detected += 1
                continue
            iou[:, best] = 0  # each object is matched once
            if areas[best] < MIN_AREA_PX:
                continue
            detected += 1
            matched += 1
            words = np.unravel_index(attribute, [detection[name].shape[1] for name in NAMES])
            same = {name: int(word) == int(target[name][best]) for name, word in zip(NAMES, words, strict=True)}
            exact += all(same.values())
            for name, value in same.items():
                correct[name] += value
            mask, true = detection["masks"][kept][i, 0] > MASK_THRESHOLD, target["masks"][best] > 0
            mask_iou += float((mask & true).sum() / (mask | true).sum())
    precision, recall = exact / max(detected, 1), exact / max(expected, 1)
    scores = {"precision": precision, "recall": recall, "f1": 2 * exact / max(detected + expected, 1)}
    scores |= {f"{name}_accuracy": value / max(matched, 1) for name, value in correct.items()}
    return scores | {"mask_iou": mask_iou / max(matched, 1)}


def _detections(model: nn.Module, frames: Iterable[Frame]) -> Iterator[tuple[dict[str, Tensor], dict[str, Tensor]]]:
    """The detections and the target of each frame, on the CPU."""
    model.eval()
    device = next(model.parameters()).device
    for image, target in frames:
        (found,) = model([image.to(device)])
        yield {name: value.cpu() for name, value in found.items()}, target


@torch.no_grad()
def average_precision(model: nn.Module, frames: Iterable[Frame]) -> dict[str, float]:
    """COCO's average precision of masks and boxes in frames (image (3, H, W), target), with all objects in one class.

    Returns:
        `mask_ap`, `mask_ap50`, `box_ap` and `box_ap50` (0-1), computed by torchmetrics; empty where that is not installed
        (extra `train`).
    """
    try:
        from torchmetrics.detection import MeanAveragePrecision
    except ImportError:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torchmetrics' dependencies
        metric = MeanAveragePrecision(iou_type=("bbox", "segm"))
        for detection, target in _detections(model, frames):
            predicted = {name: detection[name] for name in ("boxes", "scores", "labels")}
            true = {"boxes": target["boxes"], "labels": target["labels"], "masks": target["masks"].bool()}
            metric.update([predicted | {"masks": detection["masks"][:, 0] > MASK_THRESHOLD}], [true])
        values = metric.compute()
    return {
        f"{name}_{measure}": float(values[f"{prefix}_map{suffix}"])
        for name, prefix in (("mask", "segm"), ("box", "bbox"))
        for measure, suffix in (("ap", ""), ("ap50", "_50"))
    }

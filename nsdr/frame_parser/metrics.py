"""Metrics of the frame parser: detections against the true objects of frames."""

import warnings
from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torchvision.ops import box_iou

from nsdr.frame_parser.roi_heads import MASK_THRESHOLD
from nsdr.world.vocabulary import ATTRIBUTES, attributes_of

__all__ = ["average_precision", "detection_scores"]

MIN_SCORE = 0.9
"""Detections with a score up to this are ignored (0-1; the paper's threshold for proposals)."""
MIN_AREA_PX = 60
"""True objects with a smaller visible area count neither as missed nor as detected (pixels)."""
MATCH_IOU = 0.5
"""Smallest intersection over union of the boxes of a detection and the object that it matches (0-1)."""


@torch.no_grad()
def detection_scores(
    model: nn.Module,
    frames: Iterable[tuple[Tensor, dict[str, Tensor]]],
    score: float = MIN_SCORE,
    min_area_px: int = MIN_AREA_PX,
) -> dict[str, float]:
    """Attribute-exact precision, recall and F1 at a box IoU of 0.5, mean mask IoU and accuracy of each attribute.

    Args:
        model: the network of `build_frame_parser`.
        frames: pairs of image (3, H, W) and target.
        score: detections with a score up to this are ignored (0-1).
        min_area_px: true objects with a smaller visible area count neither as missed nor as detected (pixels).

    Returns:
        `precision`, `recall`, `f1`, `color_accuracy`, `material_accuracy`, `shape_accuracy` and `mask_iou` (0-1). Mask IoU and
        accuracies are means over matched detections.
    """
    model.eval()
    device = next(model.parameters()).device
    detected = matched = exact = expected = 0
    correct = dict.fromkeys(ATTRIBUTES, 0)
    mask_iou = 0.0
    for image, target in frames:
        (detection,) = model([image.to(device)])
        kept = detection["scores"] > score
        boxes = detection["boxes"][kept].cpu()
        iou = box_iou(boxes, target["boxes"])
        areas = target["masks"].flatten(1).sum(1)
        expected += int((areas >= min_area_px).sum())
        unmatched = torch.ones(len(target["boxes"]), dtype=torch.bool)
        for i in range(len(boxes)):
            best = int((iou[i] * unmatched).argmax()) if len(unmatched) else -1
            if best < 0 or not unmatched[best] or iou[i, best] < MATCH_IOU:
                detected += 1
                continue
            unmatched[best] = False
            if areas[best] < min_area_px:
                continue
            detected += 1
            matched += 1
            names = attributes_of(int(detection["attribute"][kept][i].argmax()))
            true_names = [ATTRIBUTES[n][int(target[n][best])] for n in ATTRIBUTES]
            same = dict(zip(ATTRIBUTES, (a == b for a, b in zip(names, true_names, strict=True)), strict=True))
            exact += all(same.values())
            for name, value in same.items():
                correct[name] += value
            mask = detection["masks"][kept][i, 0].cpu() > MASK_THRESHOLD
            true = target["masks"][best] > 0
            mask_iou += float((mask & true).sum() / (mask | true).sum())
    precision, recall = exact / max(detected, 1), exact / max(expected, 1)
    scores = {"precision": precision, "recall": recall, "f1": 2 * exact / max(detected + expected, 1)}
    scores |= {f"{name}_accuracy": value / max(matched, 1) for name, value in correct.items()}
    return scores | {"mask_iou": mask_iou / max(matched, 1)}


@torch.no_grad()
def average_precision(model: nn.Module, frames: Iterable[tuple[Tensor, dict[str, Tensor]]]) -> dict[str, float]:
    """COCO's average precision of masks and boxes, with all objects in one class.

    Args:
        model: the network of `build_frame_parser`.
        frames: pairs of image (3, H, W) and target.

    Returns:
        `mask_ap`, `mask_ap50`, `box_ap` and `box_ap50` (0-1), computed by torchmetrics; empty where that is not installed
        (extra `train`).
    """
    try:
        from torchmetrics.detection import MeanAveragePrecision
    except ImportError:
        return {}
    model.eval()
    device = next(model.parameters()).device
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torchmetrics' dependencies
        metric = MeanAveragePrecision(iou_type=("bbox", "segm"))
        for image, target in frames:
            (detection,) = model([image.to(device)])
            masks = detection["masks"][:, 0].cpu() > MASK_THRESHOLD
            predicted = {name: detection[name].cpu() for name in ("boxes", "scores", "labels")}
            true = {"boxes": target["boxes"], "labels": target["labels"], "masks": target["masks"].bool()}
            metric.update([predicted | {"masks": masks}], [true])
        values = metric.compute()
    return {
        f"{name}_{measure}": float(values[f"{prefix}_map{suffix}"])
        for name, prefix in (("mask", "segm"), ("box", "bbox"))
        for measure, suffix in (("ap", ""), ("ap50", "_50"))
    }

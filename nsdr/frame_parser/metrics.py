"""How well detections agree with the true objects of frames."""

import warnings
from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torchvision.ops import box_iou

from nsdr.world.vocabulary import ATTRIBUTES, attributes_of

__all__ = ["average_precision", "detection_scores"]


@torch.no_grad()
def detection_scores(
    model: nn.Module, frames: Iterable[tuple[Tensor, dict[str, Tensor]]], score: float = 0.9, min_area_px: int = 60
) -> dict[str, float]:
    """Attribute-exact precision, recall and F1 at box IoU 0.5, the mean mask IoU and the accuracy of each attribute.

    Args:
        model: the network of `build_frame_parser`.
        frames: pairs of image (3, H, W) and target.
        score: detections above it count.
        min_area_px: true objects with fewer visible pixels are neither demanded nor punished.
    """
    model.eval()
    device = next(model.parameters()).device
    found = matched = exact = demanded = 0
    right = dict.fromkeys(ATTRIBUTES, 0)
    mask_iou = 0.0
    for image, target in frames:
        (detection,) = model([image.to(device)])
        kept = detection["scores"] > score
        boxes = detection["boxes"][kept].cpu()
        iou = box_iou(boxes, target["boxes"])
        areas = target["masks"].flatten(1).sum(1)
        demanded += int((areas >= min_area_px).sum())
        free = torch.ones(len(target["boxes"]), dtype=torch.bool)
        for i in range(len(boxes)):
            best = int((iou[i] * free).argmax()) if len(free) else -1
            if best < 0 or not free[best] or iou[i, best] < 0.5:
                found += 1
                continue
            free[best] = False
            if areas[best] < min_area_px:
                continue
            found += 1
            matched += 1
            words = attributes_of(int(detection["attribute"][kept][i].argmax()))
            true_words = [ATTRIBUTES[n][int(target[n][best])] for n in ATTRIBUTES]
            same = dict(zip(ATTRIBUTES, (a == b for a, b in zip(words, true_words, strict=True)), strict=True))
            exact += all(same.values())
            for name, value in same.items():
                right[name] += value
            mask = detection["masks"][kept][i, 0].cpu() > 0.5
            true = target["masks"][best] > 0
            mask_iou += float((mask & true).sum() / (mask | true).sum())
    precision, recall = exact / max(found, 1), exact / max(demanded, 1)
    scores = {"precision": precision, "recall": recall, "f1": 2 * exact / max(found + demanded, 1)}
    scores |= {f"{name}_accuracy": value / max(matched, 1) for name, value in right.items()}
    return scores | {"mask_iou": mask_iou / max(matched, 1)}


@torch.no_grad()
def average_precision(model: nn.Module, frames: Iterable[tuple[Tensor, dict[str, Tensor]]]) -> dict[str, float]:
    """COCO's average precision of masks and boxes, all objects one class: `mask_ap`, `mask_ap50`, `box_ap`, `box_ap50`.

    Computed by torchmetrics (extra `train`); empty where that is missing. `frames` are pairs of image (3, H, W) and target.
    """
    try:
        from torchmetrics.detection import MeanAveragePrecision
    except ImportError:
        return {}
    model.eval()
    device = next(model.parameters()).device
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own dependencies'
        metric = MeanAveragePrecision(iou_type=("bbox", "segm"))
        for image, target in frames:
            (found,) = model([image.to(device)])
            masks = found["masks"][:, 0].cpu() > 0.5
            guess = {"boxes": found["boxes"].cpu(), "scores": found["scores"].cpu(), "labels": found["labels"].cpu()}
            true = {"boxes": target["boxes"], "labels": target["labels"], "masks": target["masks"].bool()}
            metric.update([guess | {"masks": masks}], [true])
        values = metric.compute()
    return {
        f"{name}_{measure}": float(values[f"{prefix}_map{suffix}"])
        for name, prefix in (("mask", "segm"), ("box", "bbox"))
        for measure, suffix in (("ap", ""), ("ap50", "_50"))
    }

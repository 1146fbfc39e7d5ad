"""How well detections agree with the true objects of frames."""

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torchvision.ops import box_iou

from nsdr.clevrer.vocab import ATTRIBUTES

__all__ = ["detection_scores"]


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
            same = {n: int(detection[n][kept][i].argmax()) == int(target[n][best]) for n in ATTRIBUTES}
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

"""torchvision's RoI heads with three attribute classifiers beside the box predictor."""

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F
from torchvision.models.detection.roi_heads import RoIHeads, fastrcnn_loss, maskrcnn_loss

from nsdr.frame_parser.regions import best_of_images, by_image, clipped, has_sides, images_of

MASK_THRESHOLD = 0.5
"""Mask probability above which a pixel belongs to the object (0-1)."""
MIN_BOX_SIDE_PX = 1.0
"""Detections with a shorter box side are dropped (pixels)."""


class AttributePredictor(nn.Module):
    """Linear classifiers of colour, material and shape on the box head's features.

    Args:
        in_features: number of features.
        sizes: number of words of each attribute.
    """

    def __init__(self, in_features: int, sizes: Mapping[str, int]) -> None:
        super().__init__()
        self.sizes = dict(sizes)
        self.heads = nn.ModuleDict({name: nn.Linear(in_features, size) for name, size in sizes.items()})

    def forward(self, features: Tensor) -> dict[str, Tensor]:
        """Box features (N, C) -> logits of words: color (N, 8), material (N, 2) and shape (N, 3) in CLEVRER."""
        return {name: head(features) for name, head in self.heads.items()}


class JointAttributePredictor(nn.Module):
    """One linear classifier of all attribute combinations, as in the paper; in the order of `Vocabulary.index`.

    Args:
        in_features: number of features.
        sizes: number of words of each attribute.
    """

    def __init__(self, in_features: int, sizes: Mapping[str, int]) -> None:
        super().__init__()
        self.sizes = dict(sizes)
        self.head = nn.Linear(in_features, math.prod(sizes.values()))

    def forward(self, features: Tensor) -> dict[str, Tensor]:
        """Box features (N, C) -> logits of the combinations: attribute (N, 48) in CLEVRER."""
        return {"attribute": self.head(features)}


def attribute_probabilities(logits: dict[str, Tensor], sizes: Mapping[str, int]) -> dict[str, Tensor]:
    """Probabilities from either predictor's logits: `color`, `material` and `shape` (N, words), and `attribute` (N, triples).

    With three heads, the probability of a combination is the product of its words' probabilities. With joint labels, the
    probability of a word is the sum over the combinations that contain it.
    """
    if "attribute" in logits:
        table = logits["attribute"].softmax(-1).unflatten(-1, tuple(sizes.values()))
        words = {"color": table.sum((-1, -2)), "material": table.sum((-1, -3)), "shape": table.sum((-2, -3))}
    else:
        words = {name: logit.softmax(-1) for name, logit in logits.items()}
        table = words["color"][:, :, None, None] * words["material"][:, None, :, None] * words["shape"][:, None, None]
    return words | {"attribute": table.flatten(1)}


class AttributeRoIHeads(RoIHeads):
    """Second stage of Mask R-CNN with attribute heads, for the single class "object".

    Targets hold `boxes` (N, 4) xyxy in pixels, `labels` (N,) all 1, `masks` (N, H, W) uint8, and `color`, `material` and
    `shape` (N,) int64 indices of the words.

    Detections hold `boxes` (N, 4) xyxy in pixels, `scores` (N,), `labels` (N,) all 1, `masks` (N, 1, 28, 28) probabilities in
    the boxes (`MaskRCNN` pastes them to (N, 1, H, W)), and the probabilities of `attribute_probabilities`.

    Differs from the paper: three heads by default; `JointAttributePredictor` has the paper's single label.

    Args:
        attribute_predictor: `AttributePredictor` or `JointAttributePredictor`; takes the box head's features.
        options: arguments of torchvision's `RoIHeads`.
    """

    def __init__(self, attribute_predictor: AttributePredictor | JointAttributePredictor, **options: Any) -> None:
        super().__init__(**options)
        self.attribute_predictor = attribute_predictor

    def forward(self, features, proposals, image_shapes, targets=None):  # type: ignore[no-untyped-def]
        if self.training:
            return [], self._losses(features, proposals, image_shapes, targets)
        found = self.detections(features, proposals, image_shapes)
        image = found.pop("image")
        split = {name: by_image(values, image, len(image_shapes)) for name, values in found.items()}
        return [dict(zip(split, values, strict=True)) for values in zip(*split.values(), strict=True)], {}

    def _losses(self, features, proposals, image_shapes, targets) -> dict[str, Tensor]:  # type: ignore[no-untyped-def]
        proposals, matched, labels, regression_targets = self.select_training_samples(proposals, targets)
        box_features = self.box_head(self.box_roi_pool(features, proposals, image_shapes))
        class_logits, box_regression = self.box_predictor(box_features)
        loss_classifier, loss_box = fastrcnn_loss(class_logits, box_regression, labels, regression_targets)
        losses = {"loss_classifier": loss_classifier, "loss_box_reg": loss_box}

        positive = [label > 0 for label in labels]
        logits = self.attribute_predictor(box_features[torch.cat(positive)])
        _, materials, shapes = self.attribute_predictor.sizes.values()
        combined = [(t["color"] * materials + t["material"]) * shapes + t["shape"] for t in targets]
        for name, logit in logits.items():
            # A frame without objects has no positives, so that its `matched` indices are never used.
            true = combined if name == "attribute" else [target[name] for target in targets]
            label = torch.cat([t[m[p]] for t, m, p in zip(true, matched, positive, strict=True)])
            losses[f"loss_{name}"] = F.cross_entropy(logit, label, reduction="sum") / max(len(label), 1)

        mask_proposals = [boxes[p] for boxes, p in zip(proposals, positive, strict=True)]
        mask_logits = self.mask_predictor(self.mask_head(self.mask_roi_pool(features, mask_proposals, image_shapes)))
        losses["loss_mask"] = maskrcnn_loss(
            mask_logits,
            mask_proposals,
            [t["masks"] for t in targets],
            [t["labels"] for t in targets],
            [m[p] for m, p in zip(matched, positive, strict=True)],
        )
        return losses

    def detections(self, features, proposals, image_shapes) -> dict[str, Tensor]:  # type: ignore[no-untyped-def]
        """The detections of all images together, image by image, and `image` (N,): the index of each one's image."""
        box_features = self.box_head(self.box_roi_pool(features, proposals, image_shapes))
        class_logits, box_regression = self.box_predictor(box_features)
        # Without proposals, `decode` returns another shape.
        boxes = self.box_coder.decode(box_regression, proposals).reshape(-1, 2, 4)[:, 1]
        image = images_of(proposals)
        boxes, scores = clipped(boxes, image, image_shapes), class_logits.softmax(-1)[:, 1]
        kept = torch.where((scores > self.score_thresh) & has_sides(boxes, MIN_BOX_SIDE_PX))[0]
        best = best_of_images(
            boxes[kept],
            scores[kept],
            image[kept],
            image[kept],
            len(proposals),
            self.nms_thresh,
            self.detections_per_img,
        )
        kept = kept[best]
        boxes, image = boxes[kept], image[kept]
        of_images = by_image(boxes, image, len(image_shapes))
        mask_logits = self.mask_predictor(self.mask_head(self.mask_roi_pool(features, of_images, image_shapes)))
        found = {"image": image, "boxes": boxes, "scores": scores[kept], "labels": torch.ones_like(kept)}
        found["masks"] = mask_logits[:, 1:].sigmoid()
        return found | attribute_probabilities(
            self.attribute_predictor(box_features[kept]), self.attribute_predictor.sizes
        )

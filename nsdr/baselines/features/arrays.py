"""What the arrays of a video's features hold, and its mirror image."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BOX_NUMBERS", "as_inputs", "mirror_image"]

BOX_NUMBERS = 4
"""Numbers of an object's box after its features: left, top, right and bottom as shares of the image."""


def as_inputs(stored: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """What `Features.get` returns, of features as `nsdr extract-features` stores them."""
    found: dict[str, NDArray[Any]] = {kind: value.astype(np.float32) for kind, value in stored.items()}
    if "objects" in found:
        left, _, right, _ = np.moveaxis(found["objects"][..., -BOX_NUMBERS:], -1, 0)
        found["has_object"] = right > left
    return found


def mirror_image(features: Mapping[str, NDArray[Any]], settings: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Exchange left and right, as if the frames had been flipped.

    CLEVRER's camera looks along the world's x axis, so that the mirror image is a lawful video with the same questions and
    answers. A backbone makes of flipped frames about, not exactly, its flipped maps.

    Args:
        features: as `as_inputs` returns them.
        settings: how they were made, `features` of their manifest.

    Returns:
        Features of the same shapes.
    """
    found, of_truth = dict(features), settings.get("from") == "truth"
    if "objects" in found:
        boxes = _flipped_boxes(found["objects"][..., -BOX_NUMBERS:], 1.0)
        boxes = boxes * found["has_object"][..., None]
        found["objects"] = np.concatenate([found["objects"][..., :-BOX_NUMBERS], boxes], -1)
    if "maps" in found:
        found["maps"] = _flipped_maps(found["maps"], of_truth)
    if "pooled" in found:
        pooled = found["pooled"]
        maps = _flipped_maps(pooled.reshape(len(pooled), -1, *settings["pooled_grid"]), of_truth)
        found["pooled"] = maps.reshape(pooled.shape)
    return found


def _flipped_maps(maps: NDArray[Any], of_truth: bool) -> NDArray[Any]:
    """Maps (F, C, h, w); those of the truth end with the box around their object, relative to the cell."""
    maps = maps[..., ::-1]
    if not of_truth:
        return maps
    boxes = _flipped_boxes(np.moveaxis(maps[:, -BOX_NUMBERS:], 1, -1), 0.0)
    return np.concatenate([maps[:, :-BOX_NUMBERS], np.moveaxis(boxes, -1, 1)], 1)


def _flipped_boxes(boxes: NDArray[Any], width: float) -> NDArray[Any]:
    """Boxes (..., 4) in an image of that width: left and right are measured from the other side."""
    left, top, right, bottom = np.moveaxis(boxes, -1, 0)
    return np.stack([width - right, top, width - left, bottom], -1)

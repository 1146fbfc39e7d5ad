"""Features made of true motion in place of pixels, so that learning to reason is measured apart from perception."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.baselines.features.files import BOX_NUMBERS, TRUTH_CHANNELS, TruthConfig
from nsdr.io.video import spaced
from nsdr.world.camera import CLEVRER_CAMERA, HEIGHT_PX, WIDTH_PX
from nsdr.world.shapes import rendered_rotation, surface_points
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["recolored", "truth_features"]

Array = NDArray[np.floating[Any]]


def truth_features(annotation: dict[str, Any], config: TruthConfig) -> dict[str, Array]:
    """The features of a video.

    Args:
        annotation: content of its annotation file.
        config: the settings.

    Returns:
        By kind, arrays of the shapes of `TruthConfig.shape`:

        - "objects": attribute words as 0 or 1, and the box. An object has the same place in all frames, and is zeros where it
          cannot be seen;
        - "maps": of the object that covers most of a cell, the same with the box relative to the cell and in cells, times the
          share of the cell that it covers;
        - "pooled": the means of the maps over the cells of the coarser grid, in one vector.
    """
    motion = annotation["motion_trajectory"]
    frames = [{row["object_id"]: row for row in motion[i]["objects"]} for i in spaced(len(motion), config.frames)]
    objects = np.zeros(config.shape("objects"))
    for place, thing in enumerate(annotation["object_property"][: config.max_objects]):
        words = [thing[name] == word for name, known in ATTRIBUTES.items() for word in known]
        states = [frame[thing["object_id"]] for frame in frames]
        boxes = _boxes(thing["shape"], *(np.array([s[k] for s in states]) for k in ("location", "orientation")))
        seen = np.array([s["inside_camera_view"] for s in states]) & (boxes[:, 2:] > boxes[:, :2]).all(1)
        objects[seen, place] = np.c_[np.tile(words, (len(boxes), 1)), boxes][seen]
    maps = _painted(objects, config.grid)
    (height, width), (rows, columns) = config.grid, config.pooled_grid
    cells = maps.reshape(*maps.shape[:2], rows, height // rows, columns, width // columns)
    features = {"objects": objects, "maps": maps, "pooled": cells.mean((3, 5)).reshape(len(maps), -1)}
    return {kind: features[kind] for kind in config.kinds}


def recolored(features: Mapping[str, Array], colors: Sequence[int]) -> dict[str, Array]:
    """Features of the truth of the same video with other colours.

    Args:
        features: by kind, of the shapes in `nsdr.baselines.base.Batch` without the axis of the videos.
        colors: for each of `COLORS`, the index of the one that takes its place.

    Returns:
        Arrays of the same shapes.
    """
    channels = np.arange(TRUTH_CHANNELS)
    channels[list(colors)] = range(len(colors))  # those of `COLORS` are the first ones
    found = dict(features)
    if "objects" in found:
        found["objects"] = found["objects"][..., channels]
    if "maps" in found:
        found["maps"] = found["maps"][:, channels]
    if "pooled" in found:
        pooled = found["pooled"]
        found["pooled"] = pooled.reshape(len(pooled), TRUTH_CHANNELS, -1)[:, channels].reshape(pooled.shape)
    return found


def _boxes(shape: str, location: Array, orientation: Array) -> Array:
    """Left, top, right and bottom (F, 4), as shares of the image, of an object at locations (F, 3) with Euler angles (F, 3)."""
    turned = rendered_rotation(shape, orientation).as_matrix() @ surface_points(shape).T
    shares = CLEVRER_CAMERA.pixels(turned.swapaxes(1, 2) + location[:, None]) / (WIDTH_PX, HEIGHT_PX)
    return np.concatenate([shares.min(1), shares.max(1)], 1).clip(0, 1)


def _painted(objects: Array, grid: tuple[int, int]) -> Array:
    """Maps (F, C, h, w) of objects (F, N, C)."""
    height, width = grid
    boxes = objects[..., -BOX_NUMBERS:] * [width, height, width, height]
    left, top, right, bottom = np.moveaxis(boxes, -1, 0)[..., None]
    rows, columns = np.arange(height), np.arange(width)
    down = (np.minimum(bottom, rows + 1) - np.maximum(top, rows)).clip(0)
    across = (np.minimum(right, columns + 1) - np.maximum(left, columns)).clip(0)
    covered = down[..., :, None] * across[..., None, :]  # (F, N, h, w)
    largest = covered.argmax(1)
    frame = np.arange(len(objects))[:, None, None]
    middle = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), -1)
    words, box = objects[..., :-BOX_NUMBERS][frame, largest], boxes[frame, largest] - np.tile(middle, 2)
    return np.moveaxis(np.concatenate([words, box], -1) * covered.max(1)[..., None], -1, 1)

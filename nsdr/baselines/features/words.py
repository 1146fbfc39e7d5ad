"""Features made of words and boxes of objects instead of pixels: true ones, or those that a frame parser found.

True words and boxes separate learning to reason from perception. Networks that learnt from them also read found ones.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.baselines.features.files import BOX_NUMBERS, WordConfig
from nsdr.errors import DataError
from nsdr.io.video import spaced
from nsdr.io.worlds import world_in
from nsdr.tracking.tracker import TrackerConfig
from nsdr.types import VideoProposals
from nsdr.world.camera import Camera
from nsdr.world.shapes import rendered_rotation, surface_points
from nsdr.world.vocabulary import Shape, Vocabulary
from nsdr.world.world import World

Array = NDArray[np.floating[Any]]


@cache
def _words(vocabulary: Vocabulary) -> Array:
    """(attribute indices, words) which words each attribute index stands for, as 0 or 1: (48, 13) in CLEVRER."""
    return np.array([[word in triple for word in vocabulary.attributes] for triple in vocabulary.triples], np.float64)


def _check_words(world: World, config: WordConfig) -> None:
    """Raise `DataError` unless the settings have the words of a world."""
    if world.vocabulary.words != config.words:
        theirs, ours = (", ".join(sum(words.values(), ())) for words in (world.vocabulary.words, config.words))
        raise DataError(f"objects have the words of the world {world.name} ({theirs}); the features are of {ours}")


def truth_features(annotation: dict[str, Any], config: WordConfig) -> dict[str, Array]:
    """The features of a video from its true motion.

    Args:
        annotation: content of its annotation file.
        config: the settings.

    Returns:
        By kind, arrays of the shapes of `WordConfig.shape`:

        - "objects": attribute words as 0 or 1, and the box. An object has the same place in all frames, and is zeros where it
          cannot be seen;
        - "maps": for each cell, words and box of the object that covers most of it, times the share of the cell that the
          object covers; the box is relative to the cell, in units of cells;
        - "pooled": the means of the maps over the cells of the coarser grid, as one vector.

    Raises:
        DataError: the annotation has other words than the settings.
    """
    world, motion = world_in(annotation), annotation["motion_trajectory"]
    vocabulary = world.vocabulary
    _check_words(world, config)
    frames = [{row["object_id"]: row for row in motion[i]["objects"]} for i in spaced(len(motion), config.frames)]
    objects = np.zeros(config.shape("objects"))
    for place, thing in enumerate(annotation["object_property"][: config.max_objects]):
        words = _words(vocabulary)[vocabulary.index(thing["color"], thing["material"], thing["shape"])]
        states = [frame[thing["object_id"]] for frame in frames]
        location, orientation = (np.array([s[k] for s in states]) for k in ("location", "orientation"))
        boxes = _boxes(vocabulary.shape(thing["shape"]), location, orientation, world.camera)
        seen = np.array([s["inside_camera_view"] for s in states]) & (boxes[:, 2:] > boxes[:, :2]).all(1)
        objects[seen, place] = np.c_[np.tile(words, (len(boxes), 1)), boxes][seen]
    return _features(objects, config)


def detected_features(proposals: VideoProposals, config: WordConfig) -> dict[str, Array]:
    """The features of a video from what a frame parser found in it.

    Args:
        proposals: its detections; frames are chosen among the processed ones.
        config: the settings.

    Returns:
        See `truth_features`. Objects come from `linked_boxes`, and their boxes bound what is visible of them.

    Raises:
        DataError: the detections have other words than the settings.
    """
    _check_words(proposals.world, config)
    frames = np.arange(proposals.n_frames) if proposals.processed is None else proposals.processed
    attribute, boxes = linked_boxes(proposals, config.max_objects)
    boxes = boxes[frames[spaced(len(frames), config.frames)]]
    words = _words(proposals.world.vocabulary)[attribute]
    words = np.broadcast_to(words, (*boxes.shape[:2], words.shape[1]))
    return _features(np.concatenate([words * boxes.any(2, keepdims=True), boxes], 2), config)


def linked_boxes(proposals: VideoProposals, max_objects: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Attribute indices (N,) of a video's objects, and their boxes (F, N, 4) as shares of the image, zeros where not seen.

    An object has the same place in all frames. CLEVRER's objects differ in their attributes, so detections with the same
    attributes show one object. Scores up to the tracker's threshold do not count. The N objects that are seen in most frames
    are kept, and the one seen in most frames comes first.
    """
    p, camera = proposals, proposals.world.camera
    found = np.flatnonzero((p.score > TrackerConfig.score) & (p.area_px > 0))
    found = found[np.argsort(p.score[found], kind="stable")]
    seen = np.zeros((p.world.vocabulary.n_triples, p.n_frames, BOX_NUMBERS), np.float32)
    sides = np.array([camera.width, camera.height, camera.width, camera.height], np.float32)
    # The scores ascend, so the best of two detections in a frame is written last and stays.
    seen[p.attribute[found], p.frame_index[found]] = p.box_xyxy_px[found] / sides
    order = np.argsort(-seen.any(2).sum(1), kind="stable")[:max_objects]
    return order, np.ascontiguousarray(seen[order].swapaxes(0, 1))


def _features(objects: Array, config: WordConfig) -> dict[str, Array]:
    """The features of objects (F, N, C)."""
    maps = _painted(objects, config.grid)
    (height, width), (rows, columns) = config.grid, config.pooled_grid
    cells = maps.reshape(*maps.shape[:2], rows, height // rows, columns, width // columns)
    features = {"objects": objects, "maps": maps, "pooled": cells.mean((3, 5)).reshape(len(maps), -1)}
    return {kind: features[kind] for kind in config.kinds}


def recolored(features: Mapping[str, Array], colors: Sequence[int], n_words: int) -> dict[str, Array]:
    """The same features of words and boxes with other colours.

    Args:
        features: by kind, of the shapes in `nsdr.baselines.base.Batch` without the axis of the videos.
        colors: for each colour, the index of the one that takes its place.
        n_words: number of words of all attributes.

    Returns:
        Arrays of the same shapes.
    """
    channels = np.arange(n_words + BOX_NUMBERS)
    channels[list(colors)] = range(len(colors))  # colours are the first words
    found = dict(features)
    if "objects" in found:
        found["objects"] = found["objects"][..., channels]
    if "maps" in found:
        found["maps"] = found["maps"][:, channels]
    if "pooled" in found:
        pooled = found["pooled"]
        found["pooled"] = pooled.reshape(len(pooled), len(channels), -1)[:, channels].reshape(pooled.shape)
    return found


def _boxes(shape: Shape, location: Array, orientation: Array, camera: Camera) -> Array:
    """Left, top, right and bottom (F, 4), as shares of the image, of an object at locations (F, 3) with Euler angles (F, 3)."""
    turned = rendered_rotation(shape, orientation).as_matrix() @ surface_points(shape).T
    shares = camera.pixels(turned.swapaxes(1, 2) + location[:, None]) / (camera.width, camera.height)
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

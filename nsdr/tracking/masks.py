"""Masks of any tracker, such as SAM 2, -> tracks."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.files.masks import MaskNumbers, ObjectRuns, numbers_of_runs, runs_of_mask
from nsdr.errors import DataError
from nsdr.io.decoding import RATE_TOLERANCE, RATES
from nsdr.io.limits import check_limit
from nsdr.tracking.times import first_of, on_time
from nsdr.tracking.tracker import ground_positions, hidden_rows, track_of
from nsdr.types import SceneObject, Track, VideoProposals, VideoTracks
from nsdr.types.tracks import object_of
from nsdr.validation import BoolArray, FloatArray, IntArray, expect
from nsdr.world.camera import image_scale
from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import CLEVRER_WORLD, World


def tracks_from_masks(
    masks: Any, objects: Sequence[str | SceneObject], world: World = CLEVRER_WORLD, fps: float | None = None
) -> VideoTracks:
    """Tracks of objects whose masks are known, from any tracker.

        >>> tracks = nsdr.tracks_from_masks(masks, ["red metal cube", "blue rubber sphere"], nsdr.World(camera=camera))
        >>> pipeline.perceive(tracks=tracks)

    Args:
        masks: where the objects are seen in each of F frames. Each pixel belongs to one object at most: the one that is seen
            there. One of

            - label images: (F, height, width) of integers, 0 for no object and k for object k - 1;
            - (N, F, height, width) of bool, for N objects;
            - COCO run lengths: for each object a list of F masks `{"size": [height, width], "counts": …}`, with None in
              frames in which it is not seen.
        objects: color, material and shape of each of the N objects, in the order of the masks.
        world: the world that the video is of, with the words and the camera; `Camera.from_points` finds the camera.
        fps: frames per second of the masks; None for the world's, such as CLEVRER's 25. Above these, positions are interpolated
            to the world's frames; below, each frame is moved to the nearest of them, and the others have no detection.

    Returns:
        Tracks of the objects, in their order, with frames at the world's rate and pixels of the image scaled to the size of
        the world's. A note says where masks above the horizon were left out.

    Raises:
        DataError: masks of another form, masks that overlap or are never there, words that no object has or that two have,
            or an image of another aspect ratio than the world's, such as CLEVRER's 3:2; names the place and the remedy.
    """
    found, vocabulary, rate = _objects_of(objects, world.vocabulary), world.vocabulary, world.timeline.fps
    fps = rate if fps is None else fps
    images, n_frames, size = _label_images(masks, len(found))
    rate_fits = isinstance(fps, int | float) and RATES[0] <= fps <= RATES[1]
    expect(rate_fits, "fps", f"{RATES[0]:g} to {RATES[1]:g} frames per second", fps)
    try:
        scale = image_scale((size[1], size[0]), image := (world.camera.width, world.camera.height))
    except ValueError as e:
        raise DataError(str(e)) from e
    frame_index, index, numbers = _measured(images, len(found), size[0])
    attributes = np.array([vocabulary.index(o.color, o.material, o.shape) for o in found])
    known = n_frames, frame_index, attributes[index], np.ones(len(index))
    seen = VideoProposals(*known, *_scaled(numbers, scale, image), world=world)
    hidden = hidden_rows(seen, np.arange(len(seen)))
    positions = ground_positions(seen, np.arange(len(seen)), hidden)
    on_ground = np.isfinite(positions).all(1)
    tracks = []
    for o in found:
        rows = np.flatnonzero((index == o.id) & on_ground)
        if not len(rows):
            wrong = "lies above the horizon; is the camera right?" if (index == o.id).any() else "is empty"
            remedy = f"give its masks, or leave out object {o.id}"
            raise DataError(f"masks: object {o.id}, {o.name}: its mask in all frames {wrong}; {remedy}")
        tracks.append(track_of(o, seen, rows, positions, hidden))
    notes = _horizon_notes(len(np.unique(frame_index[~on_ground])))
    if abs(fps - rate) > RATE_TOLERANCE:
        step = rate / fps
        tracks = [_at_times(t, step * t.frame_index) for t in tracks]
        n_frames = max(round(step * n_frames), 1 + int(_slots(step * (n_frames - 1))))
    return VideoTracks(n_frames, tuple(tracks), world, notes)


def _horizon_notes(n_frames: int) -> tuple[str, ...]:
    """A note if masks in some frames have no place on the ground."""
    return (f"masks above the horizon are left out in {n_frames} frames",) if n_frames else ()


def _objects_of(objects: Sequence[str | SceneObject], vocabulary: Vocabulary) -> list[SceneObject]:
    """The objects with ids from 0; their words differ."""
    listed = isinstance(objects, Sequence) and not isinstance(objects, str) and len(objects) > 0
    expect(listed, "objects", f"the words of each object, such as [{vocabulary.example!r}]", objects)
    found = [object_of(i, o.name if isinstance(o, SceneObject) else o, vocabulary) for i, o in enumerate(objects)]
    for a, b in combinations(found, 2):
        told_apart = "other words than each other object, which tell them apart in questions"
        expect(a.name != b.name, f"objects {a.id} and {b.id}", told_apart, f"{a.name!r} twice")
    return found


Images = Iterator[NDArray[np.integer[Any]]]
"""Label images (height, width) of the frames in order."""


def _label_images(masks: Any, n_objects: int) -> tuple[Images, int, tuple[int, int]]:
    """Label images of all frames, their number, and their height and width (pixels)."""
    if _is_run_lengths(masks):
        return _from_run_lengths(masks, n_objects)
    array = np.asarray(masks)
    kinds = "integers (F, height, width), bool (N, F, height, width), or a list of COCO run lengths for each object"
    if array.dtype.kind == "f":
        raise DataError(
            f"masks: expected {kinds}, got numbers with a fraction; give `masks > 0.5`, or `> 0` for logits"
        )
    is_labels, is_bool = array.dtype.kind in "iu" and array.ndim == 3, array.dtype.kind == "b" and array.ndim == 4
    expect((is_labels or is_bool) and array.size > 0, "masks", kinds, f"{array.dtype} {array.shape}")
    n_frames = len(array) if is_labels else array.shape[1]
    check_limit(n_frames, "frames", "masks")
    check_limit(array.shape[-2] * array.shape[-1], "image_pixels", "masks")
    if is_labels:
        return iter(array), n_frames, array.shape[1:]
    expect(len(array) == n_objects, "masks", f"those of {n_objects} objects, as there are words", f"{len(array)}")
    return (_joined(array[:, f], f) for f in range(n_frames)), n_frames, array.shape[2:]


def _is_run_lengths(masks: Any) -> bool:
    if not isinstance(masks, list | tuple) or not masks or not isinstance(masks[0], list | tuple):
        return False
    return all(one is None or isinstance(one, Mapping) for of_object in masks for one in of_object)


def _from_run_lengths(masks: Sequence[Sequence[Any]], n_objects: int) -> tuple[Images, int, tuple[int, int]]:
    expect(len(masks) == n_objects, "masks", f"those of {n_objects} objects, as there are words", f"{len(masks)}")
    n_frames = len(masks[0])
    for i, of_object in enumerate(masks):
        lengths = f"{n_frames} frames, as of object 0, with None where it is not seen"
        expect(len(of_object) == n_frames > 0, f"masks[{i}]", lengths, f"{len(of_object)}")
    check_limit(n_frames, "frames", "masks")
    sizes = {
        (i, f): one.get("size")
        for i, of_object in enumerate(masks)
        for f, one in enumerate(of_object)
        if one is not None
    }
    expect(bool(sizes), "masks", "a mask in some frame", "None in all")
    size = next(iter(sizes.values()))
    for (i, f), other in sizes.items():
        numbers = (
            isinstance(other, list | tuple)
            and len(other) == 2
            and all(isinstance(n, int | np.integer) and n > 0 for n in other)
        )
        expect(numbers, f"masks[{i}][{f}].size", "[height, width] (pixels)", other)
        expect(list(other) == list(size), f"masks[{i}][{f}].size", f"{list(size)}, as of the first mask", other)
    height, width = size
    check_limit(height * width, "image_pixels", "masks")

    def image(f: int) -> NDArray[np.integer[Any]]:
        planes = np.zeros((n_objects, height, width), bool)
        for i, one in enumerate(of_object[f] for of_object in masks):
            if one is not None:
                runs = _runs_of(one.get("counts"), height, width, f"masks[{i}][{f}]")
                planes[i] = np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(width, height).T
        return _joined(planes, f)

    return (image(f) for f in range(n_frames)), n_frames, (height, width)


def _runs_of(counts: Any, height: int, width: int, place: str) -> IntArray:
    """Lengths of the runs of a mask, which may be compressed to a text."""
    if isinstance(counts, bytes):
        counts = counts.decode("ascii", "replace")
    if isinstance(counts, str):
        return runs_of_mask(counts, height, width, place)
    runs = np.asarray(counts if isinstance(counts, list | tuple) else [], dtype=object)
    fits = all(isinstance(n, int | np.integer) and n >= 0 for n in runs) and sum(runs) == height * width
    expect(fits, f"{place}.counts", f"COCO run lengths of {height}x{width} pixels", counts)
    return runs.astype(np.int64)


def _joined(planes: BoolArray, frame: int) -> NDArray[np.integer[Any]]:
    """The label image (height, width) of masks (N, height, width) of one frame, none of which overlap."""
    if (planes.sum(0) > 1).any():
        a, b = next((a, b) for a, b in combinations(range(len(planes)), 2) if (planes[a] & planes[b]).any())
        shared = int((planes[a] & planes[b]).sum())
        raise DataError(
            f"masks: objects {a} and {b} overlap in frame {frame}, by {shared} pixels; each pixel belongs to the object that "
            f"is seen there: take it from the other, such as masks[{b}] &= ~masks[{a}] if object {a} is nearer to the camera"
        )
    return np.asarray(np.tensordot(np.arange(1, len(planes) + 1), planes, 1))


def _measured(images: Images, n_objects: int, height: int) -> tuple[IntArray, IntArray, MaskNumbers]:
    """Frame (D,), object (D,) and numbers of the masks that are not empty, in the order of the frames."""
    frames, objects, numbers = [], [], []
    for f, image in enumerate(images):
        flat = image.T.ravel()  # column by column, as runs are counted
        start = np.flatnonzero(np.append(True, flat[1:] != flat[:-1]))
        stop, label = np.append(start[1:], len(flat)), flat[start]
        for wrong in label[(label < 0) | (label > n_objects)].tolist()[:1]:
            raise DataError(
                f"masks: frame {f} has the label {wrong}; expected 0 for no object, and 1 to {n_objects} for the "
                f"{n_objects} objects that have words; give words for each label, or set it to 0"
            )
        order = np.argsort(label, kind="stable")
        order = order[label[order] > 0]
        seen, index = np.unique(label[order], return_inverse=True)
        frames.append(np.full(len(seen), f))
        objects.append(seen.astype(np.int64) - 1)
        numbers.append(numbers_of_runs(ObjectRuns(index, start[order], stop[order]), height))
    columns = (np.concatenate(column) for column in zip(*numbers, strict=True))
    return np.concatenate(frames), np.concatenate(objects), MaskNumbers(*columns)


def _scaled(numbers: MaskNumbers, scale: NDArray[np.floating[Any]], size_px: tuple[int, int]) -> MaskNumbers:
    """Numbers of masks, in pixels of an image of the width and height `size_px`."""
    box = np.rint(numbers.box_xyxy_px * np.tile(scale, 2)).astype(np.int64)
    low = np.minimum(box[:, :2], (size_px[0] - 1, size_px[1] - 1))
    high = np.maximum(box[:, 2:], low + 1)
    area = np.maximum(np.rint(numbers.area_px * scale.prod()), 1).astype(np.int64)
    return MaskNumbers(numbers.centroid_px * scale, area, np.concatenate([low, high], 1))


def _slots(taken: Any) -> Any:
    """The nearest frames of the world's rate."""
    return np.ceil(taken - 0.5).astype(np.int64)


def _at_times(t: Track, taken: FloatArray) -> Track:
    """A track with frames of the world's rate; its detections were taken at `taken` (T,) (frames)."""
    slots, rows = np.unique(_slots(taken), return_index=True)
    late = np.zeros(slots[-1] + 1)
    late[slots] = taken[rows] - slots
    return on_time(first_of(t, _slots(taken)), late)

"""CLEVRER's annotation files (`annotation_N.json`), and the `ground_truth` block of the released code's proposal files."""

from pathlib import Path
from typing import Any

from nsdr.clevrer.schema import check_objects, get
from nsdr.errors import DataError
from nsdr.io.files import read_json, write_json
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["IRREGULAR_VIDEOS", "check_annotation", "check_ground_truth", "read_annotation", "write_annotation"]

IRREGULAR_VIDEOS = (7648, 9777, 10800)
"""Indices of released videos that do not have 128 frames. Their length also differs between video and proposal file, so it is
not checked."""
VECTORS = ("location", "orientation", "velocity", "angular_velocity")
"""Keys of the 3-vectors of each object in each frame."""
VECTOR_LENGTH = 3
"""Numbers in each of `VECTORS`: x, y, z."""


def read_annotation(path: str | Path) -> dict[str, Any]:
    """Read and check an annotation file; `nsdr.clevrer.scene_from_annotation` makes a scene of it.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    annotation = read_json(path)
    try:
        check_annotation(annotation)
    except DataError as e:
        raise DataError(f"{path}: {e}") from e
    return dict(annotation)


def write_annotation(path: str | Path, annotation: dict[str, Any], n_frames: int = VIDEO_FRAMES) -> None:
    """Check an annotation and write it, atomically; raises `DataError` as `check_annotation`."""
    check_annotation(annotation, n_frames)
    write_json(path, annotation)


def check_annotation(annotation: Any, n_frames: int = VIDEO_FRAMES) -> None:
    """Check the form of an annotation.

    Args:
        annotation: content of the file.
        n_frames: number of frames of the data set's videos; not checked for `IRREGULAR_VIDEOS`.

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    video = get(annotation, "scene_index", int, "annotation")
    get(annotation, "video_filename", str, "annotation")
    objects = check_objects(get(annotation, "object_property", list, "annotation"), "object_id", "object_property")
    frames = get(annotation, "motion_trajectory", list, "annotation")
    if len(frames) != n_frames and video not in IRREGULAR_VIDEOS:
        raise DataError(f"motion_trajectory: expected {n_frames} frames for video {video}, got {len(frames)}")
    for f, frame in enumerate(frames):
        frame_where = f"motion_trajectory[{f}]"
        if get(frame, "frame_id", int, frame_where) != f:
            raise DataError(f"{frame_where}.frame_id: expected {f}, got {frame['frame_id']}")
        for i, row in enumerate(get(frame, "objects", list, frame_where)):
            where = f"{frame_where}.objects[{i}]"
            _check_index(get(row, "object_id", int, where), len(objects), f"{where}.object_id")
            get(row, "inside_camera_view", bool, where)
            for name in VECTORS:
                _check_vector(get(row, name, list, where), f"{where}.{name}")
    for c, collision in enumerate(get(annotation, "collision", list, "annotation")):
        where = f"collision[{c}]"
        _check_pair(get(collision, "object_ids", list, where), len(objects), f"{where}.object_ids")
        get(collision, "frame_id", int, where)


def check_ground_truth(block: Any, where: str = "ground_truth") -> None:
    """Check the form of a `ground_truth` block.

    Args:
        block: the block.
        where: its location in the file, for error messages.

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    objects = check_objects(get(block, "objects", list, where), "id", f"{where}.objects")
    for i, event in enumerate(get(block, "in_outs", list, where)):
        event_where = f"{where}.in_outs[{i}]"
        get(event, "frame", int, event_where)
        _check_index(get(event, "object", int, event_where), len(objects), f"{event_where}.object")
        if get(event, "type", str, event_where) not in ("in", "out"):
            raise DataError(f"{event_where}.type: expected in or out, got {event['type']!r}")
    for i, event in enumerate(get(block, "collisions", list, where)):
        event_where = f"{where}.collisions[{i}]"
        get(event, "frame", int, event_where)
        _check_pair(get(event, "object", list, event_where), len(objects), f"{event_where}.object")


def _check_index(index: int, n: int, where: str) -> None:
    if not 0 <= index < n:
        raise DataError(f"{where}: expected 0 to {n - 1}, got {index}")


def _check_pair(pair: list[Any], n: int, where: str) -> None:
    if len(pair) != 2 or not all(isinstance(i, int) for i in pair) or pair[0] == pair[1]:
        raise DataError(f"{where}: expected two different object ids, got {pair!r}")
    for i in pair:
        _check_index(i, n, where)


def _check_vector(vector: list[Any], where: str) -> None:
    if len(vector) != VECTOR_LENGTH or not all(isinstance(v, int | float) for v in vector):
        raise DataError(f"{where}: expected {VECTOR_LENGTH} numbers, got {vector!r:.60}")

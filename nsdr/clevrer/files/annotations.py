"""True motion and events in files: CLEVRER's annotations (`annotation_N.json`), the `ground_truth` block of the released
code's proposal files, and the truth files of generated videos (`truth_N.json`)."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.schema import (
    LARGEST_COORDINATE,
    check_new,
    check_objects,
    get,
    get_frame,
    get_name,
    get_number,
    get_pair,
    get_scene_index,
    get_whole,
    read_checked,
    shown,
)
from nsdr.errors import DataError
from nsdr.io.files import write_json
from nsdr.io.limits import check_limit
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = [
    "IRREGULAR_VIDEOS",
    "check_annotation",
    "check_ground_truth",
    "check_truth",
    "read_annotation",
    "read_truth_file",
    "write_annotation",
]

IRREGULAR_VIDEOS = (7648, 9777, 10800)
"""Indices of released videos that do not have 128 frames. Their length also differs between video and proposal file, so it is
not checked."""
LARGEST_MASS = 1e6
"""Largest relative mass of an object in a file; CLEVRER's are around 1."""
VECTORS = ("location", "orientation", "velocity", "angular_velocity")
"""Keys of the 3-vectors of each object in each frame."""
VECTOR_LENGTH = 3
"""Numbers in each of `VECTORS`: x, y, z."""


def read_annotation(path: str | Path) -> dict[str, Any]:
    """Read and check an annotation file; `nsdr.clevrer.scene_from_annotation` makes a scene of it.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    return read_checked(path, check_annotation)


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
    video = get_scene_index(annotation, "scene_index", "annotation")
    get_name(annotation, "video_filename", "annotation")
    objects = check_objects(get(annotation, "object_property", list, "annotation"), "object_id", "object_property")
    frames = get(annotation, "motion_trajectory", list, "annotation")
    if len(frames) != n_frames and video not in IRREGULAR_VIDEOS:
        raise DataError(f"motion_trajectory: expected {n_frames} frames for video {video}, got {len(frames)}")
    _check_frames(frames, len(objects), "motion_trajectory", VECTORS)
    _check_collisions(get(annotation, "collision", list, "annotation"), len(objects), "collision", len(frames))


def read_truth_file(path: str | Path, motion: bool = False) -> dict[str, Any]:
    """Read and check a generated video's `truth_N.json`; `nsdr.clevrer.scene_from_truth` makes a scene of it.

    Args:
        path: the file.
        motion: as of `check_truth`.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    return read_checked(path, partial(check_truth, motion=motion))


def check_truth(truth: Any, motion: bool = False) -> None:
    """Check the content of a truth file.

    Args:
        truth: content of the file: `objects`, `frames`, `collisions`, `counterfactual`, and `n_frames` where the video has
            not 128.
        motion: whether to check what scenes are not made of, too: `scene_index`, `seed`, all vectors of `frames`, and masses.

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    n = len(check_objects(get(truth, "objects", list, "truth"), "object_id", "objects"))
    frames = get(truth, "frames", list, "truth")
    _check_frames(frames, n, "frames", VECTORS if motion else ("velocity",))
    if motion:
        get_scene_index(truth, "scene_index", "truth")
        get_whole(truth, "seed", "truth", 0, math.inf)
        for i, row in enumerate(truth["objects"]):
            if "mass" in row:
                get_number(row, "mass", f"objects[{i}]", math.ulp(0.0), LARGEST_MASS)
    if "n_frames" in truth:
        get_whole(truth, "n_frames", "truth", 1, len(frames))
    elif len(frames) < VIDEO_FRAMES:
        raise DataError(f"frames: expected {VIDEO_FRAMES} or more, got {len(frames)}")
    _check_collisions(get(truth, "collisions", list, "truth"), n, "collisions", len(frames))
    for removed, rows in get(truth, "counterfactual", dict, "truth").items():
        where = f"counterfactual.{removed}"
        if removed not in {str(i) for i in range(n)}:
            raise DataError(f"{where}: expected an object id from 0 to {n - 1} as key")
        if not isinstance(rows, list):
            raise DataError(f"{where}: expected a list of collisions, got {shown(rows)}")
        _check_collisions(rows, n, where, len(frames))
        if any(int(removed) in row["object_ids"] for row in rows):
            raise DataError(f"{where}: expected no collision of the removed object {removed}")


def _check_frames(frames: list[Any], n_objects: int, where: str, required: Sequence[str]) -> None:
    """Frames in order, in each of which every object has the vectors and its visibility."""
    if not frames:
        raise DataError(f"{where}: expected at least 1 frame, got none")
    check_limit(len(frames), "frames", where)
    for f, frame in enumerate(frames):
        frame_where = f"{where}[{f}]"
        rows = get(frame, "objects", list, frame_where)
        if (required is VECTORS or "frame_id" in frame) and get(frame, "frame_id", int, frame_where) != f:
            raise DataError(f"{frame_where}.frame_id: expected {f}, got {shown(frame['frame_id'])}")
        seen: set[int] = set()
        for i, row in enumerate(rows):
            object_where = f"{frame_where}.objects[{i}]"
            number = get_whole(row, "object_id", object_where, 0, n_objects - 1)
            check_new(number, seen, f"{object_where}.object_id")
            seen.add(number)
            get(row, "inside_camera_view", bool, object_where)
            for name in VECTORS:
                if name in row or name in required:
                    _check_vector(get(row, name, list, object_where), object_where, name)
        if len(seen) != n_objects:
            missing = sorted(set(range(n_objects)) - seen)
            raise DataError(f"{frame_where}.objects: expected all {n_objects} objects, {missing} are missing")


def _check_collisions(rows: list[Any], n_objects: int, where: str, n_frames: int) -> None:
    check_limit(len(rows), "events", where)
    for c, collision in enumerate(rows):
        get_pair(collision, "object_ids", f"{where}[{c}]", n_objects)
        get_frame(collision, "frame_id", f"{where}[{c}]", n_frames)


def check_ground_truth(block: Any, where: str = "ground_truth", n_frames: int = VIDEO_FRAMES) -> None:
    """Check a `ground_truth` block.

    Args:
        block: the block.
        where: its location in the file, for error messages.
        n_frames: number of frames of the video.

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    objects = check_objects(get(block, "objects", list, where), "id", f"{where}.objects")
    in_outs, collisions = get(block, "in_outs", list, where), get(block, "collisions", list, where)
    check_limit(len(in_outs) + len(collisions), "events", where)
    changes: set[tuple[int, int]] = set()
    for i, event in enumerate(in_outs):
        event_where = f"{where}.in_outs[{i}]"
        frame = get_frame(event, "frame", event_where, n_frames)
        number = get_whole(event, "object", event_where, 0, len(objects) - 1)
        check_new((number, frame), changes, f"{event_where}: (object, frame)")
        changes.add((number, frame))
        if get(event, "type", str, event_where) not in ("in", "out"):
            raise DataError(f"{event_where}.type: expected in or out, got {shown(event['type'])}")
    for i, event in enumerate(collisions):
        event_where = f"{where}.collisions[{i}]"
        get_frame(event, "frame", event_where, n_frames)
        get_pair(event, "object", event_where, len(objects))


def _check_vector(vector: list[Any], where: str, name: str) -> None:
    if len(vector) == VECTOR_LENGTH:
        for v in vector:
            if type(v) not in (float, int) or not -LARGEST_COORDINATE <= v <= LARGEST_COORDINATE:
                break
        else:
            return
    expected = f"{VECTOR_LENGTH} numbers from {-LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}"
    raise DataError(f"{where}.{name}: expected {expected}, got {shown(vector)}")

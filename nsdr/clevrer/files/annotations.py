"""True motion and events in files: CLEVRER's annotations (`annotation_N.json`), the `ground_truth` block of the released
code's proposal files, lists of such blocks, and the truth files of generated videos (`truth_N.json`)."""

import gzip
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from nsdr.clevrer.files.schema import (
    FileName,
    Id,
    Pair,
    Vector,
    Words,
    check_frame,
    check_objects,
    check_pair,
    check_unique,
)
from nsdr.errors import DataError
from nsdr.io.files import write_file, write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.io.worlds import stored_world, world_in
from nsdr.types import Scene
from nsdr.validation import Count, PositiveCount, convert, expect
from nsdr.world.world import World

__all__ = [
    "IRREGULAR_VIDEOS",
    "check_annotation",
    "check_ground_truth",
    "check_truth",
    "check_truth_blocks",
    "read_annotation",
    "read_truth",
    "read_truth_file",
    "truth_block",
    "write_annotation",
    "write_truth",
]

IRREGULAR_VIDEOS = (7648, 9777, 10800)
"""Indices of released videos that do not have 128 frames. Their length also differs between video, annotation and proposal
file, so it is not compared."""


class _Object(Words):
    object_id: int
    mass: NotRequired[Annotated[float, Meta(gt=0, le=1e6)]]  # CLEVRER's are around 1


class _Motion(TypedDict):
    object_id: int
    inside_camera_view: bool
    location: Vector
    orientation: Vector
    velocity: Vector
    angular_velocity: Vector


class _Frame(TypedDict):
    frame_id: int
    objects: list[_Motion]


class _Collision(TypedDict):
    object_ids: Pair
    frame_id: int


class _Annotation(TypedDict):
    scene_index: Id
    video_filename: FileName
    object_property: list[_Object]
    motion_trajectory: list[_Frame]
    collision: list[_Collision]


class _Truth(TypedDict):
    scene_index: Id
    seed: Count
    objects: list[_Object]
    frames: list[_Frame]
    collisions: list[_Collision]
    counterfactual: dict[str, list[_Collision]]
    n_frames: NotRequired[PositiveCount]


class _BlockObject(Words):
    id: int


class _InOut(TypedDict):
    type: Literal["in", "out"]
    object: int
    frame: int


class _BlockCollision(TypedDict):
    object: Pair
    frame: int


class _Block(TypedDict):
    objects: list[_BlockObject]
    in_outs: list[_InOut]
    collisions: list[_BlockCollision]


class _VideoBlock(_Block):
    video: Id
    n_frames: PositiveCount


def read_annotation(path: str | Path) -> dict[str, Any]:
    """Read and check an annotation file; `nsdr.clevrer.scene_from_annotation` makes a scene of it.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    content: dict[str, Any] = read_json(path)
    check_annotation(content, f"{path}: ")
    return content


def write_annotation(path: str | Path, annotation: dict[str, Any]) -> None:
    """Check an annotation and write it, atomically; raises `DataError` as `check_annotation`."""
    check_annotation(annotation)
    write_json(path, annotation)


def check_annotation(annotation: Any, where: str = "") -> None:
    """Check the form of an annotation, which has as many frames as it lists.

    Args:
        annotation: content of the file.
        where: what stands before the place in error messages, such as "file.json: ".

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    content: _Annotation = convert(annotation, _Annotation, where)
    vocabulary = world_in(annotation, where).vocabulary
    check_objects(content["object_property"], "object_id", f"{where}object_property", vocabulary)
    n, frames = len(content["object_property"]), content["motion_trajectory"]
    _check_frames(frames, n, f"{where}motion_trajectory")
    _check_collisions(content["collision"], n, f"{where}collision", len(frames))


def read_truth_file(path: str | Path) -> dict[str, Any]:
    """Read and check a generated video's `truth_N.json`; `nsdr.clevrer.scene_from_truth` makes a scene of it.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    content: dict[str, Any] = read_json(path)
    check_truth(content, f"{path}: ")
    return content


def check_truth(truth: Any, where: str = "") -> None:
    """Check the content of a truth file.

    Args:
        truth: content of the file: `scene_index`, `seed`, `objects`, `frames`, `collisions`, `counterfactual`, and `n_frames`
            where the video has not the number of its world's videos, in CLEVRER 128; and `world` if it is another one.
        where: see `check_annotation`.

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    content: _Truth = convert(truth, _Truth, where)
    world = world_in(truth, where)
    check_objects(content["objects"], "object_id", f"{where}objects", world.vocabulary)
    n, frames = len(content["objects"]), content["frames"]
    _check_frames(frames, n, f"{where}frames")
    n_frames = content.get("n_frames", world.timeline.frames)
    expect(n_frames <= len(frames), f"{where}n_frames", f"at most {len(frames)}, the number of frames", n_frames)
    _check_collisions(content["collisions"], n, f"{where}collisions", len(frames))
    for removed, rows in content["counterfactual"].items():
        place = f"{where}counterfactual.{removed}"
        expect(removed in map(str, range(n)), place, f"an object id from 0 to {n - 1} as key", removed)
        _check_collisions(rows, n, place, len(frames))
        happens = any(int(removed) in row["object_ids"] for row in rows)
        expect(not happens, place, f"no collision of the removed object {removed}", "one")


def _check_frames(frames: Sequence[_Frame], n_objects: int, place: str) -> None:
    """Frames are in order, and each has every object once."""
    expect(len(frames) > 0, place, "at least 1 frame", "none")
    check_limit(len(frames), "frames", place)
    expected = list(range(n_objects))
    for f, frame in enumerate(frames):
        expect(frame["frame_id"] == f, f"{place}[{f}].frame_id", str(f), frame["frame_id"])
        ids = [row["object_id"] for row in frame["objects"]]
        expect(sorted(ids) == expected, f"{place}[{f}].objects", f"object_id 0 to {n_objects - 1}, each once", ids)


def _check_collisions(rows: Sequence[_Collision], n_objects: int, place: str, n_frames: int) -> None:
    check_limit(len(rows), "events", place)
    for c, collision in enumerate(rows):
        check_pair(collision["object_ids"], n_objects, f"{place}[{c}].object_ids")
        check_frame(collision["frame_id"], f"{place}[{c}].frame_id", n_frames)


def check_ground_truth(block: Any, where: str = "ground_truth", n_frames: int | None = None) -> None:
    """Check a `ground_truth` block.

    Args:
        block: the block.
        where: its location in the file, for error messages.
        n_frames: number of frames of the video; None for those of its world's videos.

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    content: _Block = convert(block, _Block, f"{where}: ")
    world = world_in(block, f"{where}.")
    _check_block(content, where, n_frames or world.timeline.frames, world)


def _check_block(content: _Block, where: str, n_frames: int, world: World) -> None:
    check_objects(content["objects"], "id", f"{where}.objects", world.vocabulary)
    n, in_outs, collisions = len(content["objects"]), content["in_outs"], content["collisions"]
    check_limit(len(in_outs) + len(collisions), "events", where)
    for i, change in enumerate(in_outs):
        check_frame(change["frame"], f"{where}.in_outs[{i}].frame", n_frames)
        expect(0 <= change["object"] < n, f"{where}.in_outs[{i}].object", f"0 to {n - 1}", change["object"])
    check_unique([(e["object"], e["frame"]) for e in in_outs], f"{where}.in_outs", ": (object, frame)")
    for i, collision in enumerate(collisions):
        check_frame(collision["frame"], f"{where}.collisions[{i}].frame", n_frames)
        check_pair(collision["object"], n, f"{where}.collisions[{i}].object")


def read_truth(path: str | Path) -> dict[int, dict[str, Any]]:
    """Read and check ground-truth blocks of many videos from a JSON list, plain or gzipped.

    Returns:
        Blocks by video index, each with `n_frames`, `objects`, `in_outs` and `collisions` (see `scene_from_ground_truth`), and
        `world` if it is another than CLEVRER's.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    return check_truth_blocks(read_json(path), str(path))


def check_truth_blocks(rows: Any, name: str) -> dict[int, dict[str, Any]]:
    """Blocks by video index, checked; as `read_truth`, from the content of a file with that name."""
    if not isinstance(rows, list) or not rows:
        raise DataError(f"{name}: not a file of ground-truth blocks; expected a list of at least one block")
    check_limit(len(rows), "videos", name)
    for i, block in enumerate(convert(rows, list[_VideoBlock], f"{name}: ")):
        n_frames, world = block["n_frames"], world_in(rows[i], f"{name}: [{i}].")
        check_limit(n_frames, "frames", f"{name}: [{i}].n_frames")
        last = max(n_frames, world.timeline.frames) if block["video"] in IRREGULAR_VIDEOS else n_frames
        _check_block(block, f"{name}: [{i}]", last, world)
    check_unique([block["video"] for block in rows], f"{name}: ", ".video")
    return {block["video"]: block for block in rows}


def write_truth(path: str | Path, blocks: Sequence[dict[str, Any]]) -> None:
    """Write ground-truth blocks (each with `video` and `n_frames`) as a gzipped JSON list, atomically."""
    write_file(path, gzip.compress(json.dumps(blocks).encode(), mtime=0))


def truth_block(scene: Scene) -> dict[str, Any]:
    """The ground-truth block of a scene's observed events; inverse of `scene_from_ground_truth`, but for motion."""
    collisions = [e for e in scene.events if e.kind == "collision"]
    return {
        "objects": [{"id": o.id, "color": o.color, "material": o.material, "shape": o.shape} for o in scene.objects],
        "in_outs": [
            {"type": e.kind, "object": e.objects[0], "frame": e.frame} for e in scene.events if e.kind in ("in", "out")
        ],
        "collisions": [{"type": "collision", "object": list(e.objects), "frame": e.frame} for e in collisions],
    } | stored_world(scene.world)

"""Ground-truth blocks of many videos in one gzipped JSON list."""

import gzip
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.annotations import IRREGULAR_VIDEOS, check_ground_truth
from nsdr.clevrer.files.schema import check_new, get_scene_index, get_whole
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.limits import check_limit, limits
from nsdr.io.reading import read_json
from nsdr.types import Scene
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["check_truth_blocks", "read_truth", "truth_block", "write_truth"]


def read_truth(path: str | Path) -> dict[int, dict[str, Any]]:
    """Read and check ground-truth blocks from a JSON list, plain or gzipped.

    Returns:
        Blocks by video index, each with `n_frames`, `objects`, `in_outs` and `collisions` (see `scene_from_ground_truth`).

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    return check_truth_blocks(read_json(path), str(path))


def check_truth_blocks(rows: Any, name: str) -> dict[int, dict[str, Any]]:
    """Blocks by video index, checked; as `read_truth`, from the content of a file with that name."""
    if not isinstance(rows, list) or not rows:
        raise DataError(f"{name}: not a file of ground-truth blocks; expected a list of at least one block")
    check_limit(len(rows), "videos", name)
    blocks: dict[int, dict[str, Any]] = {}
    for i, block in enumerate(rows):
        where = f"{name}: [{i}]"
        video = get_scene_index(block, "video", where)
        check_new(video, blocks, f"{where}.video")
        n_frames = get_whole(block, "n_frames", where, 1, limits().frames)
        check_ground_truth(block, where, max(n_frames, VIDEO_FRAMES) if video in IRREGULAR_VIDEOS else n_frames)
        blocks[video] = block
    return blocks


def write_truth(path: str | Path, blocks: Sequence[dict[str, Any]]) -> None:
    """Write ground-truth blocks (each with `video` and `n_frames`) as a gzipped JSON list, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(gzip.compress(json.dumps(blocks).encode(), mtime=0))


def truth_block(scene: Scene) -> dict[str, Any]:
    """The ground-truth block of a scene's observed events; inverse of `scene_from_ground_truth`, but for motion."""
    collisions = [e for e in scene.events if e.kind == "collision"]
    return {
        "objects": [{"id": o.id, "color": o.color, "material": o.material, "shape": o.shape} for o in scene.objects],
        "in_outs": [
            {"type": e.kind, "object": e.objects[0], "frame": e.frame} for e in scene.events if e.kind in ("in", "out")
        ],
        "collisions": [{"type": "collision", "object": list(e.objects), "frame": e.frame} for e in collisions],
    }

"""Ground-truth blocks of many videos in one gzipped JSON list."""

import gzip
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.types import Scene

__all__ = ["read_truth", "truth_block", "write_truth"]


def read_truth(path: str | Path) -> dict[int, dict[str, Any]]:
    """Read ground-truth blocks from a gzipped JSON list.

    Returns:
        Blocks by video index, each with `objects`, `in_outs` and `collisions` (see `scene_from_ground_truth`).

    Raises:
        DataError: the file is missing or not such a list.
    """
    try:
        rows = json.loads(gzip.decompress(Path(path).read_bytes()))
        return {int(row["video"]): row for row in rows}
    except (OSError, EOFError, ValueError, KeyError, TypeError) as e:
        raise DataError(f"{path}: not a file of ground-truth blocks ({e})") from e


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

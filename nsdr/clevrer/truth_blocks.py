"""Ground-truth blocks of many videos in one gzipped JSON list."""

import gzip
import json
from pathlib import Path
from typing import Any

from nsdr.errors import DataError

__all__ = ["read_truth"]


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
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise DataError(f"{path}: not a file of ground-truth blocks ({e})") from e

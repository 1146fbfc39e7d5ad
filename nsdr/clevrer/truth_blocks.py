"""Ground-truth blocks of many videos in one gzipped JSON list: objects, entrances, exits and collisions."""

import gzip
import json
from pathlib import Path
from typing import Any

from nsdr.errors import DataError

__all__ = ["read_truth"]


def read_truth(path: str | Path) -> dict[int, dict[str, Any]]:
    """Ground-truth blocks by video index from a gzipped JSON list.

    Raises:
        DataError: a missing or unreadable file.
    """
    try:
        rows = json.loads(gzip.decompress(Path(path).read_bytes()))
        return {int(row["video"]): row for row in rows}
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise DataError(f"{path}: not a file of ground-truth blocks ({e})") from e

"""What makes a kept result stale: the content of its input, the resolved configuration, the weights, and a stage's version.

A stage that makes results which are kept has a whole number `VERSION` in its folder's `__init__.py`, which callers add to the
configuration. Whoever changes what a stage gives raises it; `tests/test_stage_versions.py` notices.
"""

import hashlib
import json
import pickle
import subprocess
from collections.abc import Iterable
from dataclasses import asdict, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from nsdr.errors import DataError

__all__ = ["code_revision", "fingerprint"]

DIGITS = 16
"""Hexadecimal digits of a fingerprint."""
PIECE_BYTES = 1 << 20
"""Bytes of a file that are in memory at once."""


def fingerprint(*, inputs: Iterable[Any] = (), config: Any = None, weights: Iterable[str | Path] = ()) -> str:
    """A short text that changes when anything changes on which a result depends.

    Args:
        inputs: what is worked on: a `Path` stands for the content of that file, bytes for themselves, other values (such as
            `VideoProposals`) for their pickled form.
        config: the resolved configuration with the versions of the stages: a dataclass, or plain values.
        weights: files, or folders with `*.safetensors` and `*.json`.

    Raises:
        DataError: a file cannot be read; names it.
    """
    plain = asdict(config) if is_dataclass(config) and not isinstance(config, type) else config
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True, default=str).encode())
    for path in weights:
        folder = Path(path)
        files = sorted([*folder.glob("*.safetensors"), *folder.glob("*.json")]) if folder.is_dir() else [folder]
        for file in files:
            digest.update(file.name.encode())
            _add_content(digest, file)
    for item in inputs:
        own = hashlib.sha256()
        if isinstance(item, Path):
            _add_content(own, item)
        else:
            own.update(item if isinstance(item, bytes) else pickle.dumps(item, protocol=5))
        digest.update(own.digest())
    return digest.hexdigest()[:DIGITS]


def _add_content(digest: "hashlib._Hash", path: Path) -> None:
    """Add a file of any size, piece by piece."""
    try:
        with path.open("rb") as file:
            while piece := file.read(PIECE_BYTES):
                digest.update(piece)
    except FileNotFoundError as e:
        raise DataError(f"{path}: no such file") from e
    except OSError as e:
        raise DataError(f"{path}: cannot be read ({e})") from e


def code_revision() -> str:
    """The git commit of this checkout, with `+changes` when the package has uncommitted ones; else the package's version."""
    folder = Path(__file__).parents[1]
    commands = (["git", "rev-parse", "--short", "HEAD"], ["git", "status", "--porcelain", "."])
    try:
        head, changes = (
            subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.strip()
            for command in commands
        )
    except (OSError, subprocess.CalledProcessError):
        return version("nsdr")
    return head + ("+changes" if changes else "")

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

DIGITS = 16
"""Hexadecimal digits of a fingerprint."""


def fingerprint(*, inputs: Iterable[Any] = (), config: Any = None, weights: Iterable[str | Path] = ()) -> str:
    """A short text that changes when anything changes on which a result depends.

    Args:
        inputs: what is worked on: a `Path` stands for the content of that file or for that of the files in that folder, bytes
            for themselves, other values (such as `VideoProposals`) for their pickled form.
        config: the resolved configuration with the versions of the stages: a dataclass, or plain values.
        weights: files, or folders with `*.safetensors` and `*.json`.

    Raises:
        DataError: a file cannot be read; names it.
    """
    plain = asdict(config) if is_dataclass(config) and not isinstance(config, type) else config
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True, default=str).encode())
    for path in map(Path, weights):
        for file in sorted([*path.glob("*.safetensors"), *path.glob("*.json")]) if path.is_dir() else [path]:
            digest.update(file.name.encode() + _content_digest(file))
    for item in inputs:
        if isinstance(item, Path):
            digest.update(_content_digest(item))
        else:
            content_or_pickle = item if isinstance(item, bytes) else pickle.dumps(item, protocol=5)
            digest.update(hashlib.sha256(content_or_pickle).digest())
    return digest.hexdigest()[:DIGITS]


def _content_digest(path: Path) -> bytes:
    if path.is_dir():
        files = [file for file in sorted(path.iterdir()) if file.is_file()]
        return hashlib.sha256(b"".join(file.name.encode() + _content_digest(file) for file in files)).digest()
    try:
        with path.open("rb") as content:
            return hashlib.file_digest(content, "sha256").digest()
    except OSError as e:
        reason = "no such file" if isinstance(e, FileNotFoundError) else f"cannot be read ({e.strerror})"
        raise DataError(f"{path}: {reason}") from e


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

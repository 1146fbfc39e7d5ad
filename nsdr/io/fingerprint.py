"""What makes a kept result stale: the content of its input, the resolved configuration, the weights, and a stage's version.

A stage that makes results which are kept has a whole number `VERSION` in its folder's `__init__.py`, which callers add to the
configuration. Whoever changes what a stage gives raises it; `tests/test_stage_versions.py` notices.
"""

import hashlib
import json
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from nsdr.errors import DataError, machine_error
from nsdr.world.vocabulary import indefinite

DIGITS = 16
"""Hexadecimal digits of a fingerprint."""


def fingerprint(*, inputs: Iterable[Any] = (), config: Any = None, weights: Iterable[str | Path] = ()) -> str:
    """A short text that changes when anything changes on which a result depends.

    Args:
        inputs: what is worked on: a `Path` stands for the content of that file or for that of the files in that folder; bytes,
            dataclasses (such as `VideoProposals`), arrays, mappings, sequences and plain values for themselves: equal values of
            one type have one fingerprint.
        config: the resolved configuration with the versions of the stages: a dataclass, or plain values.
        weights: files, or folders with `*.safetensors` and `*.json`.

    Raises:
        DataError: a file cannot be read; names it. Or a value of `inputs` is of another kind.
    """
    plain = asdict(config) if is_dataclass(config) and not isinstance(config, type) else config
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True, default=str).encode())
    for path in map(Path, weights):
        for file in sorted([*path.glob("*.safetensors"), *path.glob("*.json")]) if path.is_dir() else [path]:
            digest.update(file.name.encode() + _content_digest(file))
    for item in inputs:
        digest.update(_value_digest(item))
    return digest.hexdigest()[:DIGITS]


def _value_digest(value: Any) -> bytes:
    """The digest of an input. That of a value with parts is made of its kind and the digests of the parts."""
    parts: list[bytes]
    match value:
        case Path():
            return _content_digest(value)
        case bytes():
            return hashlib.sha256(value).digest()
        case np.ndarray():
            parts = [f"array {value.dtype.str} {value.shape}".encode(), np.ascontiguousarray(value).tobytes()]
        case Mapping():
            pairs = sorted(_value_digest(k) + _value_digest(v) for k, v in value.items())
            parts = [b"mapping", *pairs]
        case tuple() | list():
            parts = [b"sequence", *map(_value_digest, value)]
        case np.generic():
            return _value_digest(value.item())
        case None | bool():
            parts = [repr(value).encode()]
        case int() | float() | str():
            kind = next(k for k in (int, float, str) if isinstance(value, k))
            parts = [f"{kind.__name__} {kind(value)!r}".encode()]
        case _ if is_dataclass(value):
            content = [_value_digest(getattr(value, field.name)) for field in fields(value)]
            parts = [f"dataclass {type(value).__name__}".encode(), *content]
        case _:
            raise DataError(
                f"{indefinite(type(value).__name__)} has no fingerprint; expected a file, bytes, or plain values"
            )
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).digest()


def _content_digest(path: Path) -> bytes:
    if path.is_dir():
        files = [file for file in sorted(path.iterdir()) if file.is_file()]
        return hashlib.sha256(b"".join(file.name.encode() + _content_digest(file) for file in files)).digest()
    try:
        with path.open("rb") as content:
            return hashlib.file_digest(content, "sha256").digest()
    except OSError as e:
        if failure := machine_error(e, path):
            raise failure from e
        reason = "no such file" if isinstance(e, FileNotFoundError) else f"cannot be read ({e.strerror})"
        raise DataError(f"{path}: {reason}") from e


def code_revision() -> str:
    """The git commit of this checkout, with `+changes` when the package has uncommitted ones; else the package's version.

    A repository around an installed package, such as one with the environment inside it, is none of this package's.
    """
    folder = Path(__file__).parents[1]
    is_tracked = ["git", "ls-files", "--error-unmatch", "__init__.py"]
    commands = (is_tracked, ["git", "rev-parse", "--short", "HEAD"], ["git", "status", "--porcelain", "."])
    try:
        _, head, changes = (
            subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.strip()
            for command in commands
        )
    except (OSError, subprocess.CalledProcessError):
        return version("nsdr")
    return head + ("+changes" if changes else "")

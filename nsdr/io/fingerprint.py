"""What makes a kept result stale: the content of its input, the resolved configuration, the weights and the code."""

import ast
import hashlib
import json
import pickle
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import asdict, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from nsdr.errors import DataError

__all__ = ["code_fingerprint", "code_revision", "fingerprint"]

DIGITS = 16
"""Hexadecimal digits of a fingerprint."""
PIECE_BYTES = 1 << 20
"""Bytes of a file that are in memory at once."""
_PACKAGE = Path(__file__).resolve().parents[1]


def fingerprint(
    *, inputs: Iterable[Any] = (), config: Any = None, weights: Iterable[str | Path] = (), code: bool | str = True
) -> str:
    """A short text that changes when anything changes on which a result depends.

    Args:
        inputs: what is worked on: a `Path` stands for the content of that file, bytes for themselves, other values (such as
            `VideoProposals`) for their pickled form.
        config: the resolved configuration: a dataclass, or plain values.
        weights: files, or folders with `*.safetensors` and `*.json`.
        code: the code of `nsdr` counts, or of one module, by its name, with all that it imports. False for what is kept in
            memory only.

    Raises:
        DataError: a file cannot be read; names it.
    """
    digest = hashlib.sha256(code_fingerprint(code if isinstance(code, str) else "").encode() if code else b"")
    digest.update(json.dumps(_plain(config), sort_keys=True, default=str).encode())
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
            own.update(item if isinstance(item, bytes) else _pickled(item))
        digest.update(own.digest())
    return digest.hexdigest()[:DIGITS]


def _plain(config: Any) -> Any:
    return asdict(config) if is_dataclass(config) and not isinstance(config, type) else config


def _pickled(value: Any) -> bytes:
    return pickle.dumps(value, protocol=5)


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


@lru_cache
def code_fingerprint(module: str = "") -> str:
    """Of the package's code, whatever its comments, docstrings and layout of lines.

    Args:
        module: name of a module, if only its code counts, with that of all modules of the package that it imports, in functions
            or through others. Modules that are named in texts only are not found.
    """
    digest = hashlib.sha256()
    for path in sorted(_imported(module)) if module else sorted(_PACKAGE.rglob("*.py")):
        tree = _syntax_tree(path)
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                node.body = [s for s in node.body if not _is_text(s)]
        digest.update(str(path.relative_to(_PACKAGE)).encode() + ast.dump(tree).encode())
    return digest.hexdigest()[:DIGITS]


def _imported(module: str) -> set[Path]:
    """Files of a module and of all modules of the package that it imports."""
    found: set[Path] = set()
    waiting = [_file_of(module)]
    while waiting:
        path = waiting.pop()
        if path is not None and path not in found:
            found.add(path)
            waiting += [_file_of(name) for name in _names_imported(path)]
    return found


def _names_imported(path: Path) -> Iterator[str]:
    for node in ast.walk(_syntax_tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _file_of(module: str) -> Path | None:
    """The file of a module of the package; None for other modules and names."""
    top, *parts = module.split(".")
    if top != _PACKAGE.name:
        return None
    path = _PACKAGE.joinpath(*parts)
    return next((file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()), None)


def _syntax_tree(path: Path) -> ast.Module:
    return ast.parse(path.read_bytes())


def _is_text(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def code_revision() -> str:
    """The git commit of this checkout, with `+changes` when the package has uncommitted ones; else the package's version."""
    try:
        head = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], cwd=_PACKAGE, capture_output=True, text=True, check=True
        )
        dirty = subprocess.run(
            ["git", "status", "--porcelain", "."], cwd=_PACKAGE, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return version("nsdr")
    return head.stdout.strip() + ("+changes" if dirty.stdout.strip() else "")

"""Reading JSON with clear errors, and writing files atomically."""

import errno
import gzip
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nsdr.errors import DataError

__all__ = ["atomic_path", "parse_json", "read_json", "remove_partial_files", "sync", "write_json"]

GZIP_MAGIC = b"\x1f\x8b"
"""First bytes of every gzip file."""
PARTIAL = ".partial"
"""Part of the name of unfinished files, which begins with a dot."""
UNWRITABLE = (
    errno.EEXIST,
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EROFS,
    errno.EACCES,
    errno.EPERM,
    errno.ENOTDIR,
    errno.ENAMETOOLONG,
)
"""System errors that are the target's."""
FILE_MODE = 0o644
"""Permissions of written files; `tempfile.mkstemp` alone would make them readable by the owner only."""


def read_json(path: str | Path, error: Callable[[str], Exception] = DataError) -> Any:
    """Read a JSON file, plain or gzipped.

    Args:
        path: the file.
        error: makes the exception from a message that names the file.

    Raises:
        DataError: the file is missing or not JSON; with `error` given, what that returns.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
        return json.loads(gzip.decompress(data) if data.startswith(GZIP_MAGIC) else data)
    except FileNotFoundError as e:
        raise error(f"{path}: no such file") from e
    except (OSError, EOFError, UnicodeDecodeError, json.JSONDecodeError) as e:
        raise error(f"{path}: not a readable JSON file ({e})") from e


def parse_json(data: bytes, name: str) -> Any:
    """Parse JSON from bytes, which may be gzipped.

    Args:
        data: the bytes.
        name: where they come from, for the error message.

    Raises:
        DataError: not JSON; names `name`.
    """
    try:
        return json.loads(gzip.decompress(data) if data.startswith(GZIP_MAGIC) else data)
    except (OSError, EOFError, UnicodeDecodeError, json.JSONDecodeError) as e:
        raise DataError(f"{name}: not a readable JSON file ({e})") from e


def write_json(path: str | Path, value: Any, indent: int | None = None) -> None:
    """Write `value` as JSON, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(value, indent=indent) + "\n")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`; it is flushed to disk and replaces `path` when the block ends without an error.

    What is no regular file, such as `/dev/null` or a pipe, is written to and never replaced; of a link, the file that it points
    to is replaced.

    Raises:
        DataError: `path` is a folder, or cannot be written: no permission, no space left.
    """
    path = Path(os.path.realpath(path))
    special = path.exists() and not path.is_file()
    if path.is_dir():
        raise DataError(f"{path}: is a folder; expected a file")
    temporary: Path | None = None
    try:
        if not special:
            path.parent.mkdir(parents=True, exist_ok=True)
        folder = None if special else path.parent
        handle, name = tempfile.mkstemp(dir=folder, prefix=f".{path.stem}-", suffix=f"{PARTIAL}{path.suffix}")
        os.close(handle)
        temporary = Path(name)
        yield temporary
        if special:
            with temporary.open("rb") as source, path.open("wb") as target:
                shutil.copyfileobj(source, target)
        else:
            sync(temporary)
            temporary.chmod(FILE_MODE)
            os.replace(temporary, path)
            sync(path.parent)
    except OSError as e:
        if e.errno in UNWRITABLE:
            raise DataError(f"{path}: cannot be written ({e.strerror}); free or choose another place") from e
        raise
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def remove_partial_files(folder: Path) -> None:
    """Delete what killed processes left in a folder; call it where no other process writes to it."""
    for path in folder.rglob(f".*-*{PARTIAL}*"):
        path.unlink(missing_ok=True)


def sync(*paths: Path) -> None:
    """Flush files and folders to disk."""
    for path in paths:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

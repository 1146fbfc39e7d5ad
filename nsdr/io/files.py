"""Writing files atomically."""

import errno
import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from nsdr.errors import DataError

__all__ = ["atomic_path", "remove_partial_files", "sync", "write_json"]

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
    errno.EISDIR,
    errno.ELOOP,
    errno.EPIPE,
    errno.EIO,
)
"""System errors that are the target's."""
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
"""System errors of file systems that cannot lock files."""
FILE_MODE = 0o644
"""Permissions of written files."""


def write_json(path: str | Path, value: Any, indent: int | None = None) -> None:
    """Write `value` as JSON, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(value, indent=indent) + "\n")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`; it is flushed to disk and replaces `path` when the block ends without an error.

    What is no regular file, such as `/dev/null` or a pipe, is written to and never replaced; of a link, the file that it points
    to is replaced. What a killed process left of the same file is written over.

    Raises:
        DataError: `path` is a folder, or cannot be written: no permission, no space left.
    """
    path = Path(os.path.realpath(path))
    with writing(path):
        if path.is_dir():
            raise DataError(f"{path}: is a folder; expected a file")
        if path.exists() and not path.is_file():
            with tempfile.TemporaryDirectory() as folder:
                temporary = Path(folder) / path.name
                temporary.touch()
                yield temporary
                with temporary.open("rb") as source, path.open("wb") as target:
                    shutil.copyfileobj(source, target)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        with _partial_file(path) as temporary:
            yield temporary
            sync(temporary)
            temporary.chmod(FILE_MODE)
            os.replace(temporary, path)
            sync(path.parent)


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """The system's errors while `path` is written, in one line.

    Raises:
        DataError: `path` cannot be written: no permission, no space left.
    """
    try:
        yield
    except OSError as e:
        if e.errno in UNWRITABLE:
            raise DataError(f"{path}: cannot be written ({e.strerror}); free or choose another place") from e
        raise


@contextmanager
def _partial_file(path: Path) -> Iterator[Path]:
    """An empty hidden file beside `path`, locked while it is written; deleted, unless it was renamed."""
    temporary = path.with_name(f".{path.stem}{PARTIAL}{path.suffix}")
    handle = hold(temporary)
    while handle is None:  # another process writes the same file
        temporary = path.with_name(f".{path.stem}-{os.urandom(4).hex()}{PARTIAL}{path.suffix}")
        handle = hold(temporary)
    try:
        os.ftruncate(handle, 0)
        yield temporary
    finally:
        if _is_at(handle, temporary):
            temporary.unlink()
        os.close(handle)


def hold(path: Path, create: bool = True) -> int | None:
    """Lock a file. The system releases the lock when the returned descriptor is closed, or its process ends.

    Whoever renames or deletes the file does so while holding it. File systems without locks grant all.

    Args:
        path: the file.
        create: create it if missing.

    Returns:
        The file's descriptor; None if it is held already, or missing and not to be created.
    """
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | (os.O_CREAT if create else 0), FILE_MODE)
        except FileNotFoundError:
            if create:
                raise
            return None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as e:
            if e.errno not in NO_LOCKS:
                os.close(handle)
                if isinstance(e, BlockingIOError):
                    return None
                raise
        if _is_at(handle, path):
            return handle
        os.close(handle)  # renamed or deleted meanwhile


def _is_at(handle: int, path: Path) -> bool:
    """Whether the open file is the one of that name."""
    try:
        return os.path.samestat(os.fstat(handle), path.lstat())
    except FileNotFoundError:
        return False


def remove_partial_files(folder: Path) -> None:
    """Delete the unfinished files in a folder that killed processes left; those that a process writes stay."""
    for path in folder.rglob(f".*{PARTIAL}*"):
        with suppress(PermissionError):  # of another user
            handle = hold(path, create=False) if path.is_file() else None
            if handle is not None:
                path.unlink()
                os.close(handle)


def sync(*paths: Path) -> None:
    """Flush files and folders to disk."""
    for path in paths:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

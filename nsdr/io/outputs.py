"""Outputs are checked before the work whose results they take."""

import importlib.util
import os
import stat
import tempfile
from collections.abc import Sequence
from pathlib import Path

from nsdr.errors import DataError
from nsdr.io.files import writing

__all__ = ["check_installed", "check_output", "check_output_folder"]

PROBE_BYTES = 4096
"""Bytes that are written for a test, and deleted."""


def check_output(path: str | Path, suffixes: Sequence[str] = (), inputs: Sequence[str | Path] = ()) -> str:
    """Check that a file can be written, now or in folders that are still to be made.

    Args:
        path: the file. What is no regular file, such as `/dev/null`, may have any ending.
        suffixes: endings that say how it is written; () for any.
        inputs: files that are read, or written as well: `path` must be none of them.

    Returns:
        The ending, in lower case; for a target that is no regular file and has none of the endings, the first one.

    Raises:
        DataError: another ending, one of the inputs, a folder, or a place that is read-only, full or not to be written by this
            user; names the path.
    """
    _check_name(path)
    path = Path(path)
    suffix = path.suffix.lower()
    with writing(path):
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise DataError(f"{path}: is a folder; expected a file")
        is_special = target.exists() and not target.is_file()
        if suffixes and suffix not in suffixes:
            if not is_special:
                raise DataError(f"{path}: expected a name ending in {' or '.join(suffixes)}")
            suffix = suffixes[0]
        if is_special:
            _probe_special(target)
            return suffix
        if any(target == Path(os.path.realpath(other)) for other in inputs):
            raise DataError(f"{path}: is already another input or output; choose another name")
        if target.exists() and (_is_read_only(target) or not os.access(target, os.W_OK)):
            raise DataError(f"{path}: is read-only; make it writable (chmod u+w), or choose another name")
        _probe_folder(target.parent, path)
    return suffix


def check_installed(module: str, purpose: str, extra: str) -> None:
    """Refuse before the work what needs a package that is not installed.

    Args:
        module: the package's module.
        purpose: what needs it and its name, such as "figures need matplotlib".
        extra: the extra of nsdr that brings it.

    Raises:
        DataError: it is not installed; says how to install it.
    """
    if importlib.util.find_spec(module) is None:
        raise DataError(f"{purpose}: pip install 'nsdr[{extra}]'")


def check_output_folder(path: str | Path) -> None:
    """Check that files can be written to a folder, which may be missing.

    Raises:
        DataError: it is a file, read-only, full or not to be written by this user; names the path.
    """
    _check_name(path)
    with writing(path):
        _probe_folder(Path(os.path.realpath(path)), path)


def _check_name(path: str | Path) -> None:
    if not str(path).strip() or "\0" in str(path):
        raise DataError(f"{str(path)!r}: is no name of an output")


def _probe_folder(folder: Path, path: str | Path) -> None:
    """Write to the folder, or to the nearest one above it that exists."""
    while not os.path.lexists(folder):
        folder = folder.parent
    if not folder.is_dir():
        raise DataError(f"{path}: {folder} is no folder")
    if _is_read_only(folder):
        raise DataError(f"{path}: {folder} is a read-only folder; make it writable (chmod u+w), or choose another one")
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(b"\0" * PROBE_BYTES)
        file.flush()
        os.fsync(file.fileno())


def _probe_special(target: Path) -> None:
    """Write nothing to a device; what else is no regular file, such as a pipe, might wait for its reader."""
    if stat.S_ISCHR(target.stat().st_mode):
        handle = os.open(target, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        try:
            os.write(handle, b"")
        finally:
            os.close(handle)


def _is_read_only(path: Path) -> bool:
    """Whether nobody may write it; the superuser could."""
    return not path.stat().st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH)

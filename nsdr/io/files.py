"""Outputs: written whole or not at all, by one process at a time, and checked before the work; and the files of a folder."""

import errno
import fnmatch
import importlib.util
import json
import logging
import os
import socket
import stat
import tempfile
import time
import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from nsdr.errors import DataError, MachineError, machine_error

PARTIAL = ".partial"
"""Part of the name of unfinished files, which begins with a dot."""
LOCK = ".lock"
"""End of a lock file's name. The file says who holds the lock; it may stay behind after a kill, the lock does not."""
PROBE_BYTES = 4096
"""Bytes that are written for a test, and deleted."""
OF_THE_NAME = (errno.EEXIST, errno.ENOTDIR, errno.ENAMETOOLONG, errno.EISDIR, errno.ELOOP)
"""System errors which say that no file can have this name."""
OF_THE_PLACE = (errno.EACCES, errno.EPERM, errno.EPIPE)
"""System errors which say that this place cannot be written to. `machine_error` knows further ones."""
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)
"""System errors of file systems that cannot lock files."""
log = logging.getLogger(__name__)


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """Within the block, system errors about writing `path` become errors of one line.

    Raises:
        MachineError: `path` cannot be written: no permission, no space left.
        DataError: no file can have this name.
    """
    try:
        yield
    except OSError as e:
        message = f"{path}: cannot be written ({e.strerror}); free or choose another place"
        if e.errno in OF_THE_NAME:
            raise DataError(message) from e
        if e.errno in OF_THE_PLACE or machine_error(e, path):
            raise MachineError(message) from e
        raise  # it is about something that is read in the block


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`; it is flushed to disk and replaces `path` when the block ends without an error.

    If `path` is a link, the file that it points to is replaced. A killed process leaves a hidden file (`remove_partial_files`).

    Raises:
        MachineError: `path` cannot be written: no permission, no space left.
        DataError: `path` is a folder, a device or a pipe.
    """
    path = Path(os.path.realpath(path))
    with writing(path):
        _check_is_file(path, path)
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.stem}-{os.urandom(4).hex()}{PARTIAL}{path.suffix}")
        try:
            with _marked(temporary):
                yield temporary
                sync(temporary)
                os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        sync(path.parent)


def _check_is_file(target: Path, path: str | Path) -> None:
    if target.exists() and not target.is_file():
        raise DataError(f"{path}: is a {'folder' if target.is_dir() else 'device or a pipe'}; expected a file")


@contextmanager
def _marked(path: Path) -> Iterator[None]:
    """Create an empty file. Until the block or this process ends, `_is_written` is true for it."""
    try:
        import fcntl
    except ImportError:  # Windows deletes no file that is open
        path.touch()
        yield
        return
    with path.open("xb") as file:
        with suppress(OSError):  # of file systems that cannot lock
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield


def _is_written(path: Path) -> bool:
    """Whether a process is still writing an unfinished file; also True if that cannot be known."""
    try:
        import fcntl
    except ImportError:
        return False
    try:
        with path.open("rb+") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    return False


def remove_partial_files(folder: Path) -> None:
    """Delete the unfinished files that killed processes left below a folder, but not those that a process is still writing.

    Unfinished folders, such as that of an interrupted download, stay: the command that made them goes on with them.
    """
    for path in folder.rglob(f".*{PARTIAL}*"):
        if path.is_file() and not _is_written(path):
            with suppress(PermissionError):  # of another user
                path.unlink(missing_ok=True)


def write_file(path: str | Path, content: str | bytes) -> None:
    """Write a file, atomically; text as UTF-8.

    Raises:
        DataError, MachineError: those of `atomic_path`.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def write_json(path: str | Path, value: Any, indent: int | None = None) -> None:
    """Write `value` as JSON, atomically.

    Raises:
        DataError: as `atomic_path`, or the value holds NaN or an infinite number, which JSON lacks and `read_json` refuses.
    """
    write_file(path, json_text(value, path, indent) + "\n")


def json_text(value: Any, name: str | Path, indent: int | None = None) -> str:
    """The JSON text of a value.

    Args:
        value: plain values.
        name: where the text goes, for the error message.
        indent: spaces of each level; None for one line.

    Raises:
        DataError: NaN or an infinite number in it; names `name`.
    """
    try:
        return json.dumps(value, indent=indent, allow_nan=False)
    except ValueError as e:
        raise DataError(f"{name}: not written: a value is not a finite number ({e})") from e


def sync(*paths: Path) -> None:
    """Flush files and folders to disk; Windows flushes folders by itself."""
    for path in paths:
        if os.name == "nt" and path.is_dir():
            continue
        handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def locked(folder: str | Path, name: str = "", wait: bool = False) -> Iterator[None]:
    """Hold the lock of a folder, or of some output in it; code within the block may take it again.

    Args:
        folder: created if missing.
        name: name of the output; "" for the whole folder.
        wait: wait for another process that has the lock, and say so.

    Raises:
        DataError: another process has it; names the process, its machine and the time.
        MachineError: the folder cannot be written.
    """
    target = Path(folder) / name
    with writing(folder):
        Path(folder).mkdir(parents=True, exist_ok=True)
        path = Path(folder).resolve() / f"{'.' if name else ''}{name}{LOCK}"
        lock = FileLock(path, is_singleton=True)  # of each thread, which may take it several times
        try:
            lock.acquire(timeout=0)
        except Timeout as e:
            if not wait:
                raise DataError(f"{target}: {_owner(path)} writes to it; wait for it, or choose another place") from e
            log.warning("%s: %s writes to it; waiting for its end", target, _owner(path))
            lock.acquire()
        except OSError as e:
            if e.errno not in NO_LOCKS:
                raise
    try:
        if lock.lock_counter <= 1:
            since = time.strftime("%Y-%m-%d %H:%M:%S")
            with suppress(OSError):  # the lock holds on a full disk, too
                path.write_text(f"process {os.getpid()} on {socket.gethostname()} (since {since})")
        yield
    finally:
        if lock.lock_counter <= 1:
            with suppress(OSError):
                path.unlink()
        lock.release()


def _owner(path: Path) -> str:
    try:
        return path.read_text() or "another process"
    except OSError:  # Windows lets nobody read it
        return "another process"


def check_output(path: str | Path, suffixes: Sequence[str] = (), inputs: Sequence[str | Path] = ()) -> str:
    """Check that a file can be written. Its folder may be missing.

    Args:
        path: the file.
        suffixes: endings that say how it is written; () for any.
        inputs: files that are read, or written as well: `path` must be none of them.

    Returns:
        The ending, in lower case.

    Raises:
        DataError: another ending, one of the inputs, no regular file, or a read-only place; names the path.
        MachineError: a place that is full, or not to be written by this user; names the path.
    """
    _check_output_name(path)
    path = Path(path)
    suffix = path.suffix.lower()
    with writing(path):
        target = Path(os.path.realpath(path))
        _check_is_file(target, path)
        if suffixes and suffix not in suffixes:
            raise DataError(f"{path}: expected a name ending in {' or '.join(suffixes)}")
        if any(target == Path(os.path.realpath(other)) for other in inputs):
            raise DataError(f"{path}: is already another input or output; choose another name")
        if target.exists() and (_is_read_only(target) or not os.access(target, os.W_OK)):
            raise DataError(f"{path}: is read-only; make it writable (chmod u+w), or choose another name")
        _probe_folder(target.parent, path)
    return suffix


def check_output_folder(path: str | Path) -> None:
    """Check that files can be written to a folder, which may be missing.

    Raises:
        DataError: it is a file or read-only; names the path.
        MachineError: it is full, or not to be written by this user; names the path.
    """
    _check_output_name(path)
    with writing(path):
        _probe_folder(Path(os.path.realpath(path)), path)


def check_installed(module: str, purpose: str, extra: str) -> None:
    """Refuse work that needs a package that is not installed, before it starts.

    Args:
        module: the package's module.
        purpose: what needs it and its name, such as "figures need matplotlib".
        extra: the extra of nsdr that brings it.

    Raises:
        DataError: it is not installed; says how to install it.
    """
    if importlib.util.find_spec(module) is None:
        raise DataError(f"{purpose}: pip install 'nsdr[{extra}]'")


def _check_output_name(path: str | Path) -> None:
    if not str(path).strip() or "\0" in str(path):
        raise DataError(f"{str(path)!r}: is no name of an output")
    check_name(path)


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


def _is_read_only(path: Path) -> bool:
    """Whether nobody may write it; the superuser could."""
    return not path.stat().st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH)


def find_files(folder: str | Path, pattern: str) -> list[Path]:
    """Files below a folder whose names match, sorted; without hidden ones, such as the unfinished files of a killed process.

    Links to folders are followed. A folder that is reached in several ways is read once, by the way without links if there is
    one. Files whose names are not UTF-8 are left out with a warning.

    Args:
        folder: searched with its subfolders.
        pattern: of names, such as `video_*.mp4`.
    """
    found: list[Path] = []
    read: set[str] = set()
    links = deque([str(folder)])
    while links:
        for place, folders, names in os.walk(links.popleft()):
            if os.path.realpath(place) in read:
                folders.clear()
                continue
            read.add(os.path.realpath(place))
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            links += (path for name in folders if os.path.islink(path := os.path.join(place, name)))
            found += (Path(place, name) for name in fnmatch.filter(names, pattern) if not name.startswith("."))
    files = sorted(path for path in found if path.is_file())
    odd = [path for path in files if not _is_utf8(path)]
    if odd:
        others = f" and {len(odd) - 1} more files" if len(odd) > 1 else ""
        warnings.warn(f"{shown_path(odd[0])}{others}: left out, as the name is not UTF-8; rename it", stacklevel=2)
    return [path for path in files if _is_utf8(path)]


def check_name(path: str | Path) -> None:
    """Refuse a name that is not UTF-8, which libraries cannot open, some of them ending the process.

    Raises:
        DataError: names the file, with the odd bytes in hexadecimal form.
    """
    if not _is_utf8(path):
        raise DataError(f"{shown_path(path)}: the name is not UTF-8; rename it")


def _is_utf8(path: str | Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def shown_path(path: str | Path) -> str:
    """A path for a message: bytes that are not UTF-8 in hexadecimal form."""
    return os.fsencode(path).decode(errors="backslashreplace")


def by_number(paths: Mapping[str, Path]) -> dict[str, tuple[str, Path]]:
    """(name, path) by the last part of the file's name, such as "00012" of `video_00012.mp4`.

    Raises:
        DataError: two files have one number.
    """
    found: dict[str, tuple[str, Path]] = {}
    for name, path in paths.items():
        number = path.name.split(".")[0].split("_")[-1]
        if number in found:
            raise DataError(f"{found[number][1]} and {path}: both are number {number}; rename one, or use two folders")
        found[number] = (name, path)
    return found


def is_hidden(path: Path) -> bool:
    """Whether the file or a folder of the (relative) path has a name that begins with a dot."""
    return any(part.startswith(".") for part in path.parts)

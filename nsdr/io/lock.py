"""Output is written by one process at a time."""

import json
import logging
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from nsdr.errors import DataError
from nsdr.io.files import hold, writing

__all__ = ["locked"]

LOCK = ".lock"
"""End of a lock file's name. The file says who holds the lock; it may stay behind after a kill, the lock does not."""
POLL_S = 0.2
"""Time between two looks at a lock that is waited for (s)."""
_held: ContextVar[frozenset[Path]] = ContextVar("held", default=frozenset())
"""Lock files that this thread holds."""
log = logging.getLogger(__name__)


@contextmanager
def locked(folder: str | Path, name: str = "", wait: bool = False) -> Iterator[None]:
    """Hold the lock of a folder, or of some output in it; what runs within the block may take it again.

    Args:
        folder: created if missing.
        name: of the output in it; "" for the whole folder.
        wait: wait for another process that has the lock, and say so.

    Raises:
        DataError: another process has it; names the process, its machine and the time. Or the folder cannot be written.
    """
    target = Path(folder) / name
    with writing(folder):
        Path(folder).mkdir(parents=True, exist_ok=True)
        path = Path(folder).resolve() / f"{'.' if name else ''}{name}{LOCK}"
        handle = None if path in _held.get() else _taken(path, target, wait)
    if handle is None:
        yield
        return
    token = _held.set(_held.get() | {path})
    try:
        owner = {"process": os.getpid(), "host": socket.gethostname(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
        with suppress(OSError):  # the lock holds on a full disk, too
            os.ftruncate(handle, 0)
            os.write(handle, json.dumps(owner).encode())
        yield
    finally:
        _held.reset(token)
        with suppress(OSError):
            path.unlink()
        os.close(handle)


def _taken(path: Path, target: Path, wait: bool) -> int:
    """The descriptor of the lock file, once it is ours."""
    told = False
    while (handle := hold(path)) is None:
        if not wait:
            raise DataError(f"{target}: {_owner(path)} writes to it; wait for it, or choose another place")
        if not told:
            log.warning("%s: %s writes to it; waiting for its end", target, _owner(path))
            told = True
        time.sleep(POLL_S)
    return handle


def _owner(path: Path) -> str:
    try:
        owner = json.loads(path.read_text())
        return f"process {owner['process']} on {owner['host']} (since {owner['since']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"

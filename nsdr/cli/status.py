"""How the command line ends: exit statuses, the line about an error, and what Ctrl-C does."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jsonargparse

from nsdr.errors import NsdrError
from nsdr.io.jobs import FAILURES
from nsdr.io.reading import read_json

__all__ = ["BUG", "ERROR", "PARTLY", "Terminated", "failures_line", "interruptible", "left_out", "outcome_of"]

PARTLY, ERROR, BUG = 1, 2, 70
"""Exit statuses: a part of the work failed; an error; a bug of ours (EX_SOFTWARE of sysexits.h)."""
BY_SIGNAL = 128
"""Added to a signal's number, as shells do."""


class Terminated(BaseException):
    """The program got SIGTERM."""


@contextmanager
def interruptible() -> Iterator[None]:
    """The first Ctrl-C or SIGTERM ends the block by an exception, so that workers and files are tidied up; a second one kills.

    Outside of the main thread, where Python does not handle signals, this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: Any) -> None:
        signal.signal(number, signal.SIG_DFL)
        raise KeyboardInterrupt if number == signal.SIGINT else Terminated

    handled = [s for s in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(s) is not signal.SIG_IGN]
    before = {number: signal.signal(number, end) for number in handled}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def outcome_of(error: BaseException) -> tuple[int, str]:
    """The exit status and the line for stderr after an exception that ended the command; other lines are empty."""
    if isinstance(error, SystemExit):
        return (0 if error.code is None else error.code if isinstance(error.code, int) else ERROR), ""
    if isinstance(error, KeyboardInterrupt):
        return BY_SIGNAL + signal.SIGINT, "interrupted"
    if isinstance(error, Terminated):
        return BY_SIGNAL + signal.SIGTERM, "terminated"
    if isinstance(error, BrokenPipeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left to print goes nowhere
        return BY_SIGNAL + signal.SIGPIPE, ""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    elif isinstance(error, MemoryError):
        text = f"not enough memory ({text or 'MemoryError'}); use smaller inputs, batches or networks, or fewer workers"
    elif isinstance(error, RecursionError):
        text = "a file or value is nested too deeply"
    elif not isinstance(error, NsdrError | jsonargparse.ArgumentError | FloatingPointError | OSError):
        kind = type(error).__name__
        return BUG, f"error: a bug in nsdr, please report it: {kind}: {text} (--debug shows where)"
    return ERROR, f"error: {text}"


def failures_line(failed: int, total: int, what: str, example: str, keep_going: bool) -> int:
    """Print how much failed, if anything, as the last line; returns the exit status.

    Args:
        failed, total: numbers of things.
        what: what they are, in the plural.
        example: one of them, with what went wrong.
        keep_going: failures are no reason for a status other than 0.
    """
    if not failed:
        return 0
    line = f"{failed} of {total} {what} failed, such as {' '.join(example.split())}"
    if keep_going:
        print(line)
        return 0
    sys.stdout.flush()
    print(f"error: {line}; --keep-going accepts that", file=sys.stderr)
    return PARTLY


def left_out(folder: str | Path) -> int:
    """Print how many jobs failed, if any, in a folder where `run_jobs` worked; returns 0, the exit status of `--keep-going`."""
    path = Path(folder) / FAILURES
    if path.is_file():
        print(f"{len(read_json(path))} failed and are left out; see {path}")
    return 0

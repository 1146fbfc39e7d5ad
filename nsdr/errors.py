"""Exceptions a user can act on. The command line prints their message in one line and exits with code 2."""

import errno
from collections.abc import Sequence

__all__ = [
    "CheckpointError",
    "DataError",
    "EndpointError",
    "ExecutionError",
    "MachineError",
    "NsdrError",
    "ProgramError",
    "QuestionError",
    "VideoError",
    "machine_error",
]


MACHINE_ERRNOS = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS, errno.ENOMEM, errno.EMFILE, errno.ENFILE, errno.ESTALE}
)  # fmt: skip
"""System errors that no input causes: full and broken disks, exhausted memory, too many open files."""
MACHINE_TEXTS = ("out of memory", "not enough memory", "can't allocate memory", "Insufficient memory", "CUDA error",
                 "cuDNN error", "can't start new thread")  # fmt: skip
"""Parts of what PyTorch, OpenCV and Python say in exceptions of general types when memory or a device fails."""


class NsdrError(Exception):
    """Base of all errors about what `nsdr` is given; the message names the cause and, where there is one, the remedy."""


class MachineError(Exception):
    """The machine failed, and not what it was given: no space left, no memory, a lost worker process, a broken device.

    It is no `NsdrError`: work that catches those of single inputs, notes them and goes on must end at this one.
    """


class DataError(NsdrError, ValueError):
    """A file or value does not have the expected form."""


class VideoError(NsdrError, ValueError):
    """A video cannot be read, or has no usable frames."""


class CheckpointError(NsdrError, ValueError):
    """A checkpoint is missing, incomplete or corrupt."""


class QuestionError(NsdrError, ValueError):
    """A question or choice cannot be parsed into a program.

    Args:
        reason: what is wrong, in words.
        nearest: the nearest texts that can be parsed, which the message lists after the reason.
        what: what these texts are, in the plural.
    """

    def __init__(self, reason: str, nearest: Sequence[str] = (), what: str = "questions") -> None:
        super().__init__(reason + (f"; the nearest {what}: {' | '.join(nearest)}" if nearest else ""))
        self.reason, self.nearest = reason, tuple(nearest)


class EndpointError(QuestionError):
    """The server of a question parser is not there, fails, or does not speak its protocol; other texts would fail, too."""


class ProgramError(NsdrError, ValueError):
    """A program is malformed: an unknown token, or a module that gets values of the wrong type."""


class ExecutionError(NsdrError, ValueError):
    """A well-formed program does not fit the scene, such as `unique` on two objects.

    `nsdr.symbolic.failures` makes the message of a failed step.

    Args:
        message: what is wrong, in words.
        step: number of the failed step, from 1; 0 where no step ran.
        module: its token.
    """

    def __init__(self, message: str, step: int = 0, module: str = "") -> None:
        super().__init__(message)
        self.step, self.module = step, module


def machine_error(error: BaseException, what: object = "") -> MachineError | None:
    """An exception as an error of the machine; None where something else is the cause.

    This is the one place that says which exceptions are the machine's.

    Args:
        error: the exception.
        what: the file or the task, for the message; "" where that is not known.
    """
    if isinstance(error, MachineError):
        return error
    if isinstance(error, NsdrError):
        return None
    text, place = " ".join(str(error).split()), f"{what}: " if what else ""
    if isinstance(error, OSError):
        return MachineError(f"{place}{error.strerror}") if error.errno in MACHINE_ERRNOS else None
    if isinstance(error, MemoryError):
        text = f"not enough memory{f' ({text})' if text else ''}"
    elif not any(part in text for part in MACHINE_TEXTS):
        return None
    remedy = (
        "use smaller inputs, batches or networks, or fewer workers" if "memory" in text else "nothing of it is kept"
    )
    return MachineError(f"{place}{text}; {remedy}")

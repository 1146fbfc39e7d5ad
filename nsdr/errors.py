"""Exceptions a user can act on. The command line prints their message in one line and exits with code 2."""

__all__ = [
    "CheckpointError",
    "DataError",
    "EndpointError",
    "ExecutionError",
    "NsdrError",
    "ProgramError",
    "QuestionError",
    "VideoError",
]


class NsdrError(Exception):
    """Base of all errors that `nsdr` raises on purpose; the message names the cause and, where there is one, the remedy."""


class DataError(NsdrError, ValueError):
    """A file or value does not have the expected form."""


class VideoError(NsdrError, ValueError):
    """A video cannot be read, or has no usable frames."""


class CheckpointError(NsdrError, ValueError):
    """A checkpoint is missing, incomplete or corrupt."""


class QuestionError(NsdrError, ValueError):
    """A question or choice cannot be parsed into a program."""


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

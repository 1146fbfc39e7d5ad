"""What a user should know about a result: said while the result is made, and kept as its `notes`."""

import warnings
from collections.abc import Callable, Iterable
from itertools import chain

Note = Callable[[str], object]
"""A function that is called with one thing that a user should know, without the name of the file. `list.append` keeps it."""


def as_warnings(path: object) -> Note:
    """Python warnings that begin with the name of a file or video, for functions whose results carry no notes."""
    return lambda text: warnings.warn(f"{path}: {text}", stacklevel=3)


def unsaid(_: str) -> None:
    """Drop a note, because another result of the same file has it already."""


def distinct(*groups: Iterable[str]) -> tuple[str, ...]:
    """Notes from several places in their order, each of them once."""
    return tuple(dict.fromkeys(chain.from_iterable(groups)))

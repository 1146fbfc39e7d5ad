"""Types of a program's values, and the rows of the signature table (`nsdr.symbolic.modules`)."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

__all__ = ["Kind", "Module"]


class Kind(StrEnum):
    """Types of values in a program."""

    OBJECTS = "objects"
    EVENTS = "events"
    OBJECT = "object"
    EVENT = "event"
    FRAME = "frame"
    NUMBER = "number"
    BOOLEAN = "boolean"
    COLOR = "color"
    MATERIAL = "material"
    SHAPE = "shape"
    ORDER = "order"
    DIRECTION = "direction"
    SPEED = "speed"
    NAME = "name"
    CHANGE = "change"
    UNKNOWN = "unknown"

    __hash__ = str.__hash__  # an enumeration's own hash is ten times as slow


@dataclass(frozen=True)
class Module:
    """A row of the signature table.

    Attributes:
        name: the program token.
        arguments: accepted types of each argument, first argument (deepest on the stack) first.
        result: type of the result; None for `unique`: `object` of a set of objects, `event` of a set of events.
        run: function called as `run(world, *arguments)`.
        meaning: one line of documentation.
        in_data_set: whether CLEVRER's own programs use it; if not, the released executor has it, or it is an extension.
        extension: whether it is for questions beyond CLEVRER.
    """

    name: str
    arguments: tuple[tuple[Kind, ...], ...]
    result: Kind | None
    run: Callable[..., Any]
    meaning: str
    in_data_set: bool = True
    extension: bool = False

"""Checks of configurations, for their `__post_init__`."""

import math
from collections.abc import Collection, Mapping
from dataclasses import fields
from numbers import Integral, Real
from typing import Any

from nsdr.errors import DataError

__all__ = [
    "COUNT",
    "MANY",
    "MAX_SIZE",
    "NOT_NEGATIVE",
    "NUMBER",
    "POSITIVE",
    "SHARE",
    "SIZE",
    "check_choices",
    "check_interval",
    "check_paths",
    "check_ranges",
]

MAX_SIZE = 65_536
"""Largest width of a network and number of its steps, samples or proposals: more is a mistake, and would fill the memory."""
COUNT, MANY, SIZE = (0, math.inf), (1, math.inf), (1, MAX_SIZE)
NOT_NEGATIVE, POSITIVE, SHARE, NUMBER = (0.0, math.inf), (math.ulp(0.0), math.inf), (0.0, 1.0), (-math.inf, math.inf)
"""Closed ranges for `check_ranges`."""


def check_ranges(config: Any, **ranges: tuple[float, float]) -> None:
    """Each named attribute, or each value of a sequence or mapping, must be a finite number in its range (lowest, highest).

    Attributes that are declared as `int` must be whole numbers.

    Raises:
        DataError: one is not; names it, its value and the range.
    """
    declared = {f.name: f.type for f in fields(config)}
    for name, (lowest, highest) in ranges.items():
        value = getattr(config, name)
        kind = Integral if declared[name] is int else Real
        values = list(value.values()) if isinstance(value, Mapping) else value
        for number in values if isinstance(values, list | tuple) else [values]:
            is_number = isinstance(number, kind) and not isinstance(number, bool)
            if not is_number or not lowest <= number <= highest or abs(number) == math.inf:
                raise DataError(f"{name} is {value!r}; expected {_range(lowest, highest)}")


def _range(lowest: float, highest: float) -> str:
    if lowest == -math.inf:
        return "a finite number"
    if lowest == math.ulp(0.0):
        return "more than 0" if math.isinf(highest) else f"more than 0, up to {highest}"
    return f"{lowest:.10g} or more" if math.isinf(highest) else f"{lowest:.10g} to {highest:.10g}"


def check_choices(config: Any, **choices: Collection[Any] | Mapping[Any, Any]) -> None:
    """Each named attribute must be one of its choices.

    Raises:
        DataError: one is not; names it, its value and the choices.
    """
    for name, known in choices.items():
        if getattr(config, name) not in known:
            raise DataError(f"{name} is {getattr(config, name)!r}; expected {' or '.join(map(str, known))}")


def check_paths(config: Any, *names: str) -> None:
    """Each named attribute must be a path: some text without null characters.

    Raises:
        DataError: one is not; names it and its value.
    """
    for name in names:
        value = getattr(config, name)
        if not str(value).strip() or "\0" in str(value):
            raise DataError(f"{name} is {str(value)!r}; expected a path")


def check_interval(config: Any, *names: str) -> None:
    """Each named attribute must be two numbers (lowest, highest) in this order.

    Raises:
        DataError: one is not; names it and its value.
    """
    for name in names:
        value = getattr(config, name)
        if len(value) != 2 or value[0] > value[1]:
            raise DataError(f"{name} is {value!r}; expected a minimum and a maximum that is not below it")

"""Checks of configurations, for their `__post_init__`."""

import math
from collections.abc import Collection, Mapping
from typing import Any

from nsdr.errors import DataError

__all__ = ["check_choices", "check_ranges"]


def check_ranges(config: Any, **ranges: tuple[float, float]) -> None:
    """Each named attribute must be a finite number in its closed range (lowest, highest).

    Raises:
        DataError: one is not; names it, its value and the range.
    """
    for name, (lowest, highest) in ranges.items():
        value = getattr(config, name)
        if not isinstance(value, int | float) or not math.isfinite(value) or not lowest <= value <= highest:
            expected = f"{lowest} or more" if math.isinf(highest) else f"{lowest} to {highest}"
            raise DataError(f"{name} is {value!r}; expected {expected}")


def check_choices(config: Any, **choices: Collection[Any] | Mapping[Any, Any]) -> None:
    """Each named attribute must be one of its choices.

    Raises:
        DataError: one is not; names it, its value and the choices.
    """
    for name, known in choices.items():
        if getattr(config, name) not in known:
            raise DataError(f"{name} is {getattr(config, name)!r}; expected {' or '.join(map(str, known))}")

"""What the data types have in common: checks of their values, and equality of those that hold arrays."""

from collections.abc import Sequence
from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]

MAX_SHOWN = 12
"""Items of the longest tuple that is printed in full."""


def store_array(owner: object, name: str, shape: Sequence[int | None], kind: str) -> None:
    """Check an array's shape (None = any length) and dtype kind ("f" float, "i" integer, "b" boolean); make it read-only."""
    value = getattr(owner, name)
    where = f"{type(owner).__name__}.{name}"
    if not isinstance(value, np.ndarray):
        raise DataError(f"{where}: expected a numpy array, got {type(value).__name__}")
    if len(value.shape) != len(shape) or any(e not in (None, a) for e, a in zip(shape, value.shape, strict=True)):
        raise DataError(f"{where}: expected shape {tuple('?' if e is None else e for e in shape)}, got {value.shape}")
    if not (value.dtype.kind == kind or (kind == "i" and value.dtype.kind == "u")):
        raise DataError(f"{where}: expected dtype kind {kind!r}, got {value.dtype}")
    view = value.view()  # the caller's own array stays writable
    view.flags.writeable = False
    object.__setattr__(owner, name, view)


def check(condition: bool, message: str) -> None:
    """Raise `DataError` with the message unless the condition holds."""
    if not condition:
        raise DataError(message)


def check_whole(owner: str, name: str, value: object, lowest: int) -> None:
    """Raise `DataError` unless the value is a whole number from `lowest` on."""
    whole = type(value) is int or isinstance(value, np.integer)
    if not whole or value < lowest:  # type: ignore[operator]
        raise DataError(f"{owner}.{name}: expected a whole number from {lowest} on, got {value!r:.60}")


def check_values(owner: str, name: str, array: NDArray[Any], lowest: float, highest: float, nan: bool = False) -> None:
    """Raise `DataError` unless all values are finite and in the closed range; `nan` allows NaN, too."""
    if not array.size:
        return
    low, high = array.min(), array.max()
    if lowest <= low <= high <= highest and np.isfinite(low) and np.isfinite(high):
        return
    right = (array >= lowest) & (array <= highest) & np.isfinite(array)
    if nan:
        right |= np.isnan(array)
    if not right.all():
        expected = "finite numbers" if lowest == -np.inf else f"{lowest:g} to {highest:g}"
        check(False, f"{owner}.{name}: expected {expected}, got {array[~right][0]}")


class ArrayHolder:
    """Base of the dataclasses that hold arrays or mappings.

    Instances are compared by value and are not hashable. Printed, an array is its dtype and shape, such as
    `float32[5, 128, 2]`. Pickling and copying go through the constructor: read-only mappings cannot be pickled themselves,
    and unpickled arrays would be writable.
    """

    def _values(self) -> list[Any]:
        return [getattr(self, f.name) for f in fields(self)]  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ArrayHolder) or type(other) is not type(self):
            return NotImplemented
        return all(_equal(a, b) for a, b in zip(self._values(), other._values(), strict=True))

    def __repr__(self) -> str:
        shown = (f"{f.name}={_short(v)}" for f, v in zip(fields(self), self._values(), strict=True))  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(shown)})"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in self._values())


def _equal(a: Any, b: Any) -> bool:
    """Equality of two field values; NaN equals NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return not isinstance(a, np.ndarray) and not isinstance(b, np.ndarray) and bool(a == b)


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{list(value.shape)}"
    if isinstance(value, tuple) and len(value) > MAX_SHOWN:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    return repr(dict(value) if isinstance(value, MappingProxyType) else value)

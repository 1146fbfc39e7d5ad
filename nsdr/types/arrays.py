"""Equality, printing and copying of the data types that hold arrays."""

from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np

from nsdr.validation import Checked

MAX_SHOWN = 12
"""Items of the longest tuple that is printed in full."""


class ArrayHolder(Checked):
    """Base of the dataclasses that hold arrays or mappings.

    Instances are compared by value and are not hashable. Printed, an array is its dtype and shape, such as
    `float32[5, 128, 2]`. Pickling and copying go through the constructor: read-only mappings cannot be pickled themselves,
    and unpickled arrays would be writable.
    """

    def _values(self) -> list[Any]:
        return [getattr(self, f.name) for f in fields(self)]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ArrayHolder) or type(other) is not type(self):
            return NotImplemented
        return all(_equal(a, b) for a, b in zip(self._values(), other._values(), strict=True))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        shown = (f"{f.name}={_short(v)}" for f, v in zip(fields(self), self._values(), strict=True))
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

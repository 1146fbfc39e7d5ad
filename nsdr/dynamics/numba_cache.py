"""Compilation by Numba whose cache on disk is fresh only as long as all that was compiled in is unchanged."""

import builtins
import dis
import hashlib
import inspect
import pickle
from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType, ModuleType
from typing import Any, Literal

from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.dispatcher import Dispatcher

ERROR_MODEL: Literal["numpy"] = "numpy"
"""A division by zero gives infinity; a test and an exception for each would take long to compile."""
DIGITS = 12
"""Hexadecimal digits of the digest in the names of cache files."""


def cached_njit(function: Callable[..., Any], inline: bool = False) -> Any:
    """Compile a function as `numba.njit(cache=True)` does, with a cache that sees changes in other files.

    Numba compiles in the values of global names and the functions that are called, but its cache looks at the function's own
    file alone. Here a digest of these values and functions is part of the names of the cache files, so other values have files
    of their own, in processes that run at the same time, too. Everything that the function reads must be defined before it.

    Raises:
        NameError: a global name that the function reads is not defined yet.
    """
    dispatcher: Any = njit(error_model=ERROR_MODEL, forceinline=inline)(function)
    if hasattr(dispatcher, "enable_caching"):  # not with NUMBA_DISABLE_JIT
        dispatcher._cache = _Cache(function)
    return dispatcher


def inlined_njit(function: Callable[..., Any]) -> Any:
    """As `cached_njit`, compiled into each function that calls it: a call with arrays and tuples costs some 10 ns."""
    return cached_njit(function, inline=True)


class _Files(CompileResultCacheImpl):
    def __init__(self, function: Callable[..., Any]) -> None:
        self._digest = _digest(function)
        super().__init__(function)

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"{super().get_filename_base(fullname, abiflags)}-{self._digest}"


class _Cache(FunctionCache):
    _impl_class = _Files


@cache
def _digest(function: Callable[..., Any]) -> str:
    """Of a function's source, and of everything that its global names stand for."""
    digest = hashlib.sha256(f"{ERROR_MODEL}{inspect.getsource(function)}".encode())
    values = {**vars(builtins), **function.__globals__}
    for name in sorted(set(_global_names(function.__code__))):
        if name not in values:
            raise NameError(f"{function.__module__}.{function.__qualname__}: {name} must be defined before it")
        value = values[name]
        if isinstance(value, Dispatcher):
            content = _digest(value.py_func).encode()
        elif isinstance(value, ModuleType):
            content = value.__name__.encode()
        else:
            content = pickle.dumps(value, protocol=5)
        digest.update(name.encode() + b"\0" + content)
    return digest.hexdigest()[:DIGITS]


def _global_names(code: CodeType) -> Iterator[str]:
    yield from (i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL")
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _global_names(constant)

"""Compilation by Numba whose cache on disk is fresh only as long as all that was compiled in is unchanged."""

import builtins
import dis
import hashlib
import inspect
import logging
import pickle
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from multiprocessing import current_process
from types import CodeType, ModuleType
from typing import Any, Literal

from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.dispatcher import Dispatcher

ERROR_MODEL: Literal["numpy"] = "numpy"
"""A division by zero gives infinity; a test and an exception for each would take long to compile."""
DIGITS = 12
"""Hexadecimal digits of the digest in the names of cache files."""
log = logging.getLogger(__name__)


def cached_njit(function: Callable[..., Any], inline: bool = False) -> Any:
    """Compile a function as `numba.njit(cache=True)` does, with a cache that sees changes in other files.

    Numba compiles in the values of global names and the functions that are called, but its cache looks at the function's own
    file alone. Here a digest of these values and functions is part of the names of the cache files, so other values have files
    of their own, in processes that run at the same time, too. Everything that the function reads must be defined before it.
    Where no folder can be written, each process compiles for itself, and says so once.

    Raises:
        NameError: a global name that the function reads is not defined yet.
    """
    dispatcher: Any = njit(error_model=ERROR_MODEL, forceinline=inline)(function)
    if hasattr(dispatcher, "enable_caching"):  # not with NUMBA_DISABLE_JIT
        try:
            dispatcher._cache = _Cache(function)
        except RuntimeError:  # no folder for it
            _say_without_cache()
    return dispatcher


@cache
def _say_without_cache() -> None:
    if current_process().name == "MainProcess":  # and not in each worker
        log.warning(
            "neither the installation nor the user's cache folder can be written, so every start compiles anew, which takes "
            "up to half a minute; NUMBA_CACHE_DIR=FOLDER keeps what was compiled"
        )


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

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # on a full disk, the next process compiles again
            super().save_overload(sig, data)


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

"""Compilation by Numba with a cache on disk that notices changes in every file that was compiled in."""

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
"""Numba's error model. A division by zero gives infinity, because a check of every division would take long to compile."""
DIGITS = 12
"""Number of hexadecimal digits of the digest in the names of cache files."""
log = logging.getLogger(__name__)


def cached_njit(function: Callable[..., Any], inline: bool = False) -> Any:
    """Compile a function like `numba.njit(cache=True)`, with a cache that notices changes in other files.

    Numba compiles the values of global names and the called functions into a function, but its cache checks only the function's
    own file. Here a digest of these values and functions is part of the names of the cache files, so different values
    have different files, also when several processes run at the same time. Everything that the function reads must be defined
    before it. If no folder is writable, every process compiles for itself and logs one warning.

    Args:
        function: function to compile.
        inline: whether it is compiled into each function that calls it.

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
    """Log once that compiled functions cannot be kept."""
    if current_process().name == "MainProcess":  # and not in each worker
        log.warning(
            "neither the installation nor the user's cache folder can be written, so every start compiles anew, which takes "
            "up to half a minute; NUMBA_CACHE_DIR=FOLDER keeps what was compiled"
        )


def inlined_njit(function: Callable[..., Any]) -> Any:
    """Like `cached_njit`, but inlined into each function that calls it; a call with arrays and tuples costs some 10 ns."""
    return cached_njit(function, inline=True)


class _Files(CompileResultCacheImpl):
    """Cache files of a function with its digest in their names."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._digest = _digest(function)
        super().__init__(function)

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"{super().get_filename_base(fullname, abiflags)}-{self._digest}"


class _Cache(FunctionCache):
    """A cache of compiled functions that ignores a full disk."""

    _impl_class = _Files

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # on a full disk, the next process compiles again
            super().save_overload(sig, data)


@cache
def _digest(function: Callable[..., Any]) -> str:
    """Digest of the source of a function and of the values of all global names in it."""
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
    """Names of the globals that code reads, including the code of functions inside it."""
    yield from (i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL")
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _global_names(constant)

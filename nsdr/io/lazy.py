"""Modules that are loaded when first used, so that imports stay light."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

__all__ = ["deferred_function"]


@contextmanager
def deferred_function(module: str, function: str) -> Iterator[None]:
    """Within it, `from module import function` imports the module only when the function is called.

    For libraries that import a heavy module at their start and hardly ever use it. Any other name that is taken from the
    module imports it at once; a module that is already loaded stays as it is.
    """
    if module in sys.modules:
        yield
        return
    stand_in = ModuleType(module)

    def call(*arguments: Any, **options: Any) -> Any:
        return getattr(import_module(module), function)(*arguments, **options)

    def get(name: str) -> Any:
        if name == function:
            return call
        if name.startswith("__"):  # inspect asks every loaded module for its __file__
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        if sys.modules.get(module) is stand_in:
            del sys.modules[module]
        return getattr(import_module(module), name)

    stand_in.__dict__["__getattr__"] = get
    sys.modules[module] = stand_in
    try:
        yield
    finally:
        if sys.modules.get(module) is stand_in:
            del sys.modules[module]

"""Modules that are loaded when first used, so that imports stay light."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

__all__ = ["deferred_function", "lazy_exports"]


def lazy_exports(
    package: str, modules: Mapping[str, Sequence[str]], names: Sequence[str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The `__getattr__` and `__dir__` of a package (PEP 562).

    Args:
        package: its `__name__`.
        modules: public names by the full name of their module.
        names: its `__all__`.
    """
    module_of = {name: module for module, exported in modules.items() for name in exported}

    def get(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(module_of[name]), name)

    return get, lambda: list(names)


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

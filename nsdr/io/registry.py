"""Named parts that other packages can add by entry points."""

import traceback
from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Generic, TypeVar, cast

from nsdr.errors import DataError
from nsdr.world.vocabulary import indefinite

T = TypeVar("T")
GROUPS = ("nsdr.dynamics", "nsdr.scene_sources")
"""All groups of entry points."""


def check_part(name: str, part: object, method: str) -> None:
    """Refuse a part without its method, before it is used; None is no part, where it is not needed.

    Args:
        name: what the part is called.
        part: an object, which may be another package's.
        method: the method's signature, such as "parse(text, kind) -> Program".

    Raises:
        DataError: the part has no such method, or is a class; names the method.
    """
    if isinstance(part, type):
        found = f"the class {part.__name__}; give an object of it"
    elif part is None or callable(getattr(part, method.partition("(")[0], None)):
        return
    else:
        found = f"{indefinite(type(part).__name__)} without it"
    raise DataError(f"{name}: expected an object with the method {method}, got {found} (docs/plugins.md)")


def checked_result(value: Any, kind: type[T], part: object, method: str) -> T:
    """What a part's method returned, which may be another package's. Another kind of value raises `DataError`."""
    if not isinstance(value, kind):
        found = type(value).__name__
        raise DataError(
            f"{type(part).__name__}.{method} returned {indefinite(found)}; expected an nsdr.{kind.__name__}"
        )
    return value


def installed_part(error: BaseException) -> str:
    """Which installed part of another package raised an error, as "NAME (MODULE)"; "" if none did."""
    installed = [e for group in GROUPS for e in entry_points(group=group)]
    parts = {e.module.partition(".")[0]: f"{e.name} ({e.module})" for e in installed}
    for frame, _ in traceback.walk_tb(error.__traceback__):
        package = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if package in parts and package != "nsdr":
            return parts[package]
    return ""


class Registry(Generic[T]):
    """Parts by name, imported when first used.

    Another package adds one by an entry point in its `pyproject.toml`, such as
    `[project.entry-points."nsdr.dynamics"]` with `mine = "package.module:factory"`. Built-in names win.

    Args:
        what: what the parts are, for error messages.
        group: name of the entry-point group.
        builtin: "module:attribute" by name.
    """

    def __init__(self, what: str, group: str, builtin: Mapping[str, str]) -> None:
        self.what, self.group = what, group
        self._parts: dict[str, str | T] = dict(builtin)

    def names(self) -> list[str]:
        """All names: built-in and those of installed packages."""
        return list(dict.fromkeys([*self._parts, *(e.name for e in entry_points(group=self.group))]))

    def check(self, name: str) -> None:
        """Refuse an unknown name, without importing anything; raises `DataError`."""
        if name not in self.names():
            raise DataError(f"{self.what} {name!r}: expected one of {', '.join(self.names())}")

    def __getitem__(self, name: str) -> T:
        """The part of a name.

        Raises:
            DataError: no such name, or its package cannot be imported.
        """
        self.check(name)
        installed = {e.name: e.value for e in entry_points(group=self.group)}
        part: Any = self._parts.get(name) or installed[name]
        if isinstance(part, str):
            module, _, attribute = part.partition(":")
            try:
                part = self._parts[name] = getattr(import_module(module), attribute)
            except (ImportError, AttributeError) as e:
                raise DataError(f"{self.what} {name!r}: cannot load {module}:{attribute} ({e})") from e
        return cast(T, part)

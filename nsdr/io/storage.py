"""Saving and loading the data types of `nsdr.types` as JSON."""

import dataclasses
import inspect
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from nsdr import types
from nsdr.errors import DataError
from nsdr.io.files import write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.io.worlds import world_in
from nsdr.validation import Checked, Count, check_fields, convert, expect, shown
from nsdr.world.vocabulary import indefinite
from nsdr.world.world import CLEVRER_WORLD, World

T = TypeVar("T")
_KINDS: dict[str, type] = {name: kind for name in types.__all__ if isinstance(kind := getattr(types, name), type)}
LIMITS = {
    "n_frames": "frames",
    "frame": "frames",
    "objects": "scene_objects",
    "events": "events",
    "predicted": "events",
    "collisions": "events",
    "uncertain": "events",
}
"""Keys whose numbers or lengths are limited by `nsdr.io.limits`, each with the name of its limit."""


class _StoredArray(msgspec.Struct):
    """An array in a JSON file: booleans as one text of 0 and 1, NaN as null."""

    dtype: Literal[
        "bool", "float16", "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"
    ]  # fmt: skip
    shape: list[Count]
    values: str | list[int | float | None]

    def array(self, where: str) -> NDArray[Any]:
        """The array; raises `DataError` where the values do not fit."""
        is_bool, values = self.dtype == "bool", self.values
        expected = "a text of 0 and 1" if is_bool else f"a list of numbers of {self.dtype}"
        expect(set(values) <= {"0", "1"} if is_bool else isinstance(values, list), f"{where}.values", expected, values)
        if not isinstance(values, str) and self.dtype.startswith("float"):
            values = [np.nan if v is None else v for v in values]
        n = math.prod(self.shape)
        expect(n == len(values), where, f"{n} values of the shape {self.shape}", len(values))
        try:
            return np.array([v == "1" for v in values] if is_bool else values, self.dtype).reshape(self.shape)
        except (TypeError, ValueError, OverflowError) as e:
            raise DataError(f"{where}.values: expected numbers of {self.dtype} ({e})") from e


def save(path: str | Path, value: Any) -> None:
    """Write a value as JSON, atomically.

    Args:
        path: the file, whose name ends in `.json`.
        value: an instance of a type of `nsdr.types`.

    Raises:
        DataError: a path that is none, another file name extension, or a value of another type.
    """
    if not isinstance(path, str | Path):
        raise DataError(
            f"nsdr.save takes the path first: save(path, value); got {indefinite(type(path).__name__)} as the path"
        )
    path = Path(path)
    if type(value).__name__ not in _KINDS:
        raise DataError(f"cannot save {indefinite(type(value).__name__)}; expected one of {', '.join(_KINDS)}")
    if path.suffix != ".json":
        raise DataError(f"{path}: expected a name ending in .json")
    write_json(path, _encoded(value))


@overload
def load(path: str | Path) -> Any: ...


@overload
def load(path: str | Path, kind: type[T]) -> T: ...


def load(path: str | Path, kind: type[Any] = object) -> Any:
    """Read and validate a file that `save` wrote.

    Args:
        path: the file.
        kind: the expected type, such as `nsdr.Scene`.

    Raises:
        DataError: the file is missing or corrupt, or holds another type; names the file.
    """
    tree = read_json(path)
    if not isinstance(tree, dict) or "type" not in tree:
        others = "annotations and truth files are read by nsdr.clevrer (`scene_from_annotation`) and `nsdr evaluate`"
        raise DataError(f"{path}: nothing that `nsdr.save` or `nsdr parse` wrote: it has no key 'type'; {others}")
    try:
        value = _decoded(tree, "")
    except (DataError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as e:
        raise DataError(f"{path}: not {indefinite(str(tree['type']))} ({str(e).splitlines()[0]:.300})") from e
    if not isinstance(value, kind):
        found = type(value).__name__ if type(value).__name__ in _KINDS else "something else"
        raise DataError(f"{path}: holds {found}; expected {indefinite(kind.__name__)}")
    return value


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"dtype": str(value.dtype), "shape": list(value.shape), "values": _listed(value)}
    if isinstance(value, World):
        return dataclasses.asdict(value)
    if dataclasses.is_dataclass(value):
        given = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        content = {k: _encoded(v) for k, v in given.items() if not (isinstance(v, World) and v == CLEVRER_WORLD)}
        return {"type": type(value).__name__, **content}
    if isinstance(value, Mapping):
        return {"map": [[_encoded(k), _encoded(v)] for k, v in value.items()]}
    if isinstance(value, list | tuple):
        return [_encoded(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def _listed(array: NDArray[Any]) -> Any:
    """Flat list of values for JSON: booleans as one string of 0 and 1, NaN as null."""
    if array.dtype.kind == "b":
        return "".join("1" if on else "0" for on in array.ravel().tolist())
    if array.dtype.kind == "f":
        return [None if np.isnan(v) else v for v in array.ravel().tolist()]
    return array.ravel().tolist()


def _decoded(tree: Any, where: str) -> Any:
    """The value of a tree; `where` is its place in the file, for error messages."""
    if isinstance(tree, list):
        return tuple(_decoded(v, f"{where}[{i}]") for i, v in enumerate(tree))
    if not isinstance(tree, dict):
        return tree
    place = where.removeprefix(".") or "file"
    if "map" in tree:
        rows = convert(tree["map"], list[tuple[int, Any]], f"{place}.map: ")
        check_limit(sum(len(v) for _, v in rows if isinstance(v, list)), "events", place)
        return {k: _decoded(v, f"{where}.map[{i}][1]") for i, (k, v) in enumerate(rows)}
    if "dtype" in tree or "values" in tree:
        stored: _StoredArray = convert(tree, _StoredArray, f"{place}: ")
        return stored.array(place)
    content: dict[Any, Any] = dict(tree)
    name = content.pop("type", None)
    kind = _KINDS.get(str(name))
    if kind is None:
        raise DataError(
            f"{place}: expected an array, a map, or a type of `nsdr.types`, such as Scene, got type {shown(name)}"
        )
    for key, limit in LIMITS.items():
        size = len(content[key]) if isinstance(content.get(key), list) else content.get(key)
        if isinstance(size, int):
            check_limit(size, limit, f"{place}.{key}")
    world = {"world": world_in({"world": content.pop("world")}, f"{place}.")} if "world" in content else {}
    decoded: dict[str, Any] = {key: _decoded(v, f"{where}.{key}") for key, v in content.items()} | world
    try:
        inspect.signature(kind).bind(**decoded)
        value = kind(**decoded)
        if not isinstance(value, Checked):
            check_fields(value, f"{name}: ")
    except TypeError as e:
        raise DataError(f"{place}: not {indefinite(name)}: {e}") from e
    except DataError as e:
        raise DataError(f"{place}: {e}" if where else str(e)) from e
    return value

"""Saving and loading the data types of `nsdr.types`: as JSON, or as NPZ where arrays are large."""

import dataclasses
import inspect
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from nsdr import types
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import parse_json, read_json, read_npz
from nsdr.validation import Checked, Count, check_fields, convert, expect, shown

__all__ = ["load", "save"]

T = TypeVar("T")
_KINDS: dict[str, type] = {name: getattr(types, name) for name in types.__all__}
OLD_KEYS = {"doubts": "uncertain"}
"""Keys of files of version 0.2 and earlier -> those of today."""
LIMITS = {
    "n_frames": "frames",
    "frame": "frames",
    "objects": "scene_objects",
    "events": "events",
    "unseen": "events",
    "collisions": "events",
    "uncertain": "events",
}
"""Keys whose numbers or lengths `nsdr.io.limits` ends, and by which limit."""


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


def save(value: Any, path: str | Path) -> None:
    """Write a value to `path`, atomically: `.json` (readable; also what is no regular file) or `.npz` (compact).

    Args:
        value: an instance of a type of `nsdr.types`.
        path: the file.

    Raises:
        DataError: another file name extension, or a value of another type.
    """
    path = Path(path)
    if type(value).__name__ not in _KINDS:
        raise DataError(f"cannot save a {type(value).__name__}; expected one of {', '.join(_KINDS)}")
    is_special = path.exists() and not path.is_file()  # such as /dev/null
    if path.suffix == ".json" or is_special:
        write_json(path, _encoded(value, None))
    elif path.suffix == ".npz":
        arrays: dict[str, NDArray[Any]] = {}
        tree = json.dumps(_encoded(value, arrays))
        with atomic_path(path) as temporary:
            np.savez_compressed(temporary, tree=np.array(tree), **arrays)  # type: ignore[arg-type]
    else:
        raise DataError(f"{path}: cannot save as {path.suffix or 'a file without extension'!r}; expected .json or .npz")


def load(kind: type[T], path: str | Path) -> T:
    """Read and validate a file that `save` wrote.

    Args:
        kind: the expected type, such as `nsdr.Scene`.
        path: the file.

    Raises:
        DataError: the file is missing or corrupt, or holds another type; names the file.
    """
    path = Path(path)
    arrays: dict[str, NDArray[Any]] = {}
    if path.suffix == ".npz":
        arrays = read_npz(path)
        if "tree" not in arrays:
            raise DataError(f"{path}: not a file of nsdr: it has no array `tree`")
        tree = parse_json(str(arrays.pop("tree")).encode(), f"{path}: tree")
    else:
        tree = read_json(path)
    try:
        value = _decoded(tree, arrays, "")
    except (DataError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as e:
        raise DataError(f"{path}: not a {kind.__name__} ({str(e).splitlines()[0]:.300})") from e
    if not isinstance(value, kind):
        found = type(value).__name__ if type(value).__name__ in _KINDS else "something else"
        raise DataError(f"{path}: holds {found}; expected a {kind.__name__}")
    return value


def _encoded(value: Any, arrays: dict[str, NDArray[Any]] | None) -> Any:
    if isinstance(value, np.ndarray):
        if arrays is not None:
            name = f"array_{len(arrays)}"
            arrays[name] = value
            return {"array": name}
        return {"dtype": str(value.dtype), "shape": list(value.shape), "values": _listed(value)}
    if dataclasses.is_dataclass(value):
        content = {f.name: _encoded(getattr(value, f.name), arrays) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__, **content}
    if isinstance(value, Mapping):
        return {"map": [[_encoded(k, arrays), _encoded(v, arrays)] for k, v in value.items()]}
    if isinstance(value, list | tuple):
        return [_encoded(v, arrays) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def _listed(array: NDArray[Any]) -> Any:
    """Flat list of values for JSON: booleans as one string of 0 and 1, NaN as null."""
    if array.dtype.kind == "b":
        return "".join("1" if on else "0" for on in array.ravel().tolist())
    if array.dtype.kind == "f":
        return [None if np.isnan(v) else v for v in array.ravel().tolist()]
    return array.ravel().tolist()


def _decoded(tree: Any, arrays: Mapping[str, NDArray[Any]], where: str) -> Any:
    """The value of a tree; `where` is its place in the file, for error messages."""
    if isinstance(tree, list):
        return tuple(_decoded(v, arrays, f"{where}[{i}]") for i, v in enumerate(tree))
    if not isinstance(tree, dict):
        return tree
    place = where.removeprefix(".") or "file"
    if "array" in tree:
        name = tree["array"]
        expect(isinstance(name, str) and name in arrays, place, "the name of an array", name)
        return arrays[name]
    if "map" in tree:
        rows = convert(tree["map"], list[tuple[int, Any]], f"{place}.map: ")
        check_limit(sum(len(v) for _, v in rows if isinstance(v, list)), "events", place)
        return {k: _decoded(v, arrays, f"{where}.map[{i}][1]") for i, (k, v) in enumerate(rows)}
    if "dtype" in tree or "values" in tree:
        stored: _StoredArray = convert(tree, _StoredArray, f"{place}.")
        return stored.array(place)
    content: dict[Any, Any] = {OLD_KEYS.get(k, k): v for k, v in tree.items()}
    name = content.pop("type", None)
    kind = _KINDS.get("UncertainCollision" if name == "Doubt" else str(name))
    if kind is None:
        raise DataError(
            f"{place}: expected an array, a map, or a type of `nsdr.types`, such as Scene, got type {shown(name)}"
        )
    for key, limit in LIMITS.items():
        size = len(content[key]) if isinstance(content.get(key), list) else content.get(key)
        if isinstance(size, int):
            check_limit(size, limit, f"{place}.{key}")
    decoded: dict[str, Any] = {key: _decoded(v, arrays, f"{where}.{key}") for key, v in content.items()}
    try:
        inspect.signature(kind).bind(**decoded)
        value = kind(**decoded)
        if not isinstance(value, Checked):
            check_fields(value, f"{name}.")
    except TypeError as e:
        raise DataError(f"{place}: not a {name}: {e}") from e
    except DataError as e:
        raise DataError(f"{place}: {e}" if where else str(e)) from e
    return value

"""Saving and loading the data types of `nsdr.types`: as JSON, or as NPZ where arrays are large."""

import dataclasses
import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from nsdr import types
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import parse_json, read_json, read_npz
from nsdr.types import DynamicsPrediction, Scene

__all__ = ["load", "save"]

T = TypeVar("T")
_KINDS: dict[str, type] = {name: getattr(types, name) for name in types.__all__}
DTYPES = ("bool", "float16", "float32", "float64", *(f"{u}int{bits}" for u in ("", "u") for bits in (8, 16, 32, 64)))
"""Types of arrays in JSON files."""
OLD_KEYS = {"doubts": "uncertain"}
"""Keys of files of version 0.2 and earlier -> those of today."""
PAIR = 2
"""Length of a row of a map: key and value."""
NAMES: dict[Any, str] = {
    int: "a whole number",
    str: "a text",
    tuple: "a list",
    Mapping: "a map",
    np.ndarray: "an array",
    NoneType: "null",
}
"""What a field holds, in messages."""


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
        _check_sizes(value)
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


def _check_sizes(value: Any) -> None:
    """Check what is read against `nsdr.io.limits`."""
    if isinstance(value, Scene):
        later = [*(value.unseen or ()), *(e for events in (value.counterfactual or {}).values() for e in events)]
        later += [one.event for one in value.uncertain or ()]
        check_limit(len(value.events) + len(later), "events", "events")
        check_limit(
            max((e.frame for e in later), default=0), "frames", "unseen, counterfactual and uncertain events: frame"
        )
    if isinstance(value, Scene | DynamicsPrediction):
        check_limit(len(value.objects), "scene_objects", "objects")


def _decoded(tree: Any, arrays: Mapping[str, NDArray[Any]], where: str) -> Any:
    """The value of a tree; `where` is its place in the file, for error messages."""
    if isinstance(tree, list):
        return tuple(_decoded(v, arrays, f"{where}[{i}]") for i, v in enumerate(tree))
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        name = tree["array"]
        if not isinstance(name, str) or name not in arrays:
            raise DataError(f"{where}: there is no array {name!r:.60}")
        return arrays[name]
    if "map" in tree:
        rows = tree["map"]
        if not isinstance(rows, list) or any(not isinstance(row, list) or len(row) != PAIR for row in rows):
            raise DataError(f"{where}.map: expected a list of [key, value], got {rows!r:.60}")
        return {_key(k, where): _decoded(v, arrays, f"{where}.map[{i}][1]") for i, (k, v) in enumerate(rows)}
    if "dtype" in tree:
        return _decoded_array(tree, where)
    tree = {OLD_KEYS.get(k, k): v for k, v in tree.items()}
    kind = "UncertainCollision" if tree.get("type") == "Doubt" else tree.get("type")
    if not isinstance(kind, str) or kind not in _KINDS:
        expected = "an array with dtype, shape and values, a map, or a type of `nsdr.types`, such as Scene"
        raise DataError(f"{where or 'file'}: expected {expected}, got type {kind!r:.60}")
    found, hints = {k: v for k, v in tree.items() if k != "type"}, _hints(kind)
    required = {
        f.name for f in dataclasses.fields(_KINDS[kind]) if f.default is f.default_factory is dataclasses.MISSING
    }
    for name in sorted((required - found.keys()) | (found.keys() - hints.keys())):
        raise DataError(f"{where or 'file'}: {'missing' if name in hints else 'unknown'} key {name!r:.60} of a {kind}")
    content = {}
    for name, tree in found.items():
        place = f"{where}.{name}".removeprefix(".")
        content[name] = _decoded(tree, arrays, place)
        _check_kind(content[name], hints[name], place, tree)
        if name == "n_frames":
            check_limit(content[name], "frames", place)
    try:
        return _KINDS[kind](**content)
    except DataError as e:
        raise DataError(f"{where}: {e}" if where else str(e)) from e


@cache
def _hints(kind: str) -> dict[str, Any]:
    return get_type_hints(_KINDS[kind])


def _check_kind(value: Any, hint: Any, where: str, shown: Any) -> None:
    """Check a field's value, and the items of a list, against the field's type."""
    options = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    for option in options:
        kind = get_origin(option) or option
        if kind is Any or (isinstance(value, kind) and not (kind is int and isinstance(value, bool))):
            items = get_args(option)
            if kind is tuple and Ellipsis in items:
                for i, item in enumerate(value):
                    _check_kind(item, items[0], f"{where}[{i}]", item)
            return
    names = " or ".join(NAMES.get(get_origin(o) or o, getattr(o, "__name__", str(o))) for o in options)
    raise DataError(f"{where}: expected {names}, got {shown!r:.60}")


def _key(key: Any, where: str) -> int:
    if type(key) is not int:
        raise DataError(f"{where}.map: expected object ids as keys, got {key!r:.60}")
    return key


def _decoded_array(tree: dict[str, Any], where: str) -> NDArray[Any]:
    dtype, shape, values = (tree.get(name) for name in ("dtype", "shape", "values"))
    if dtype not in DTYPES:
        raise DataError(f"{where}.dtype: expected one of {', '.join(DTYPES)}, got {dtype!r:.60}")
    if not isinstance(shape, list) or any(type(n) is not int or n < 0 for n in shape):
        raise DataError(f"{where}.shape: expected a list of sizes, got {shape!r:.60}")
    if dtype == "bool":
        if not isinstance(values, str) or set(values) - {"0", "1"}:
            raise DataError(f"{where}.values: expected a text of 0 and 1, got {values!r:.60}")
        values = [c == "1" for c in values]
    elif not isinstance(values, list) or any(type(v) not in (int, float, NoneType) for v in values):
        raise DataError(f"{where}.values: expected a list of numbers, got {values!r:.60}")
    elif dtype.startswith("float"):
        values = [np.nan if v is None else v for v in values]
    if math.prod(shape) != len(values):
        raise DataError(f"{where}: expected {math.prod(shape)} values of the shape {shape}, got {len(values)}")
    try:
        return np.array(values, dtype).reshape(shape)
    except (TypeError, ValueError, OverflowError) as e:
        raise DataError(f"{where}.values: expected numbers of {dtype} ({e})") from e

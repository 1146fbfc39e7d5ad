"""Saving and loading the data types of `nsdr.types`: as JSON, or as NPZ where arrays are large."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from nsdr import types
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, read_json, write_json

__all__ = ["load", "save"]

T = TypeVar("T")
_KINDS: dict[str, type] = {name: getattr(types, name) for name in types.__all__}


def save(value: Any, path: str | Path) -> None:
    """Write a value to `path`, atomically: `.json` (readable) or `.npz` (compact).

    Args:
        value: an instance of a type of `nsdr.types`.
        path: the file.

    Raises:
        DataError: another file name extension, or a value of another type.
    """
    path = Path(path)
    if type(value).__name__ not in _KINDS:
        raise DataError(f"cannot save a {type(value).__name__}; expected one of {', '.join(_KINDS)}")
    if path.suffix == ".json":
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
        try:
            with np.load(path) as stored:
                arrays = {name: stored[name] for name in stored.files}
            tree = json.loads(str(arrays.pop("tree")))
        except (OSError, KeyError, ValueError, EOFError) as e:
            raise DataError(f"{path}: not a readable NPZ file of nsdr ({e})") from e
    else:
        tree = read_json(path)
    try:
        value = _decoded(tree, arrays)
    except (KeyError, TypeError, ValueError, AttributeError) as e:
        raise DataError(f"{path}: not a {kind.__name__} ({e})") from e
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


def _decoded(tree: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    if isinstance(tree, list):
        return tuple(_decoded(v, arrays) for v in tree)
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return arrays[tree["array"]]
    if "map" in tree:
        return {_decoded(k, arrays): _decoded(v, arrays) for k, v in tree["map"]}
    if "dtype" in tree:
        values = tree["values"]
        if tree["dtype"] == "bool":
            values = [c == "1" for c in values]
        elif tree["dtype"].startswith("float"):
            values = [np.nan if v is None else v for v in values]
        return np.array(values, tree["dtype"]).reshape(tree["shape"])
    if tree.get("type") not in _KINDS:
        raise DataError(f"unknown type {tree.get('type')!r}")
    content = {name: _decoded(v, arrays) for name, v in tree.items() if name != "type"}
    return _KINDS[tree["type"]](**content)

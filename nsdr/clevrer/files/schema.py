"""Checked access to values in JSON documents: errors name the location in the file and what was expected there."""

from collections.abc import Callable, Collection
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from nsdr.errors import DataError
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.types import SceneObject
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = [
    "LARGEST_COORDINATE",
    "LARGEST_ID",
    "cached_object",
    "check_new",
    "check_objects",
    "checked",
    "get",
    "get_frame",
    "get_name",
    "get_number",
    "get_pair",
    "get_scene_index",
    "get_text",
    "get_whole",
    "read_checked",
    "scene_object",
    "shown",
]

T = TypeVar("T")
LARGEST_ID = 10**9
"""Largest index of a video, and largest id of a question or choice."""
LARGEST_COORDINATE = 1000.0
"""Largest magnitude of a coordinate, angle or velocity in files (CLEVRER's are below 20, the grid has 150)."""


def read_checked(path: str | Path, check: Callable[[Any], None]) -> dict[str, Any]:
    """A JSON file's content, after `check(content)`, whose errors get the file's name.

    Raises:
        DataError: the file is missing or not JSON, or what `check` raises; names the file.
    """
    return checked(read_json(path), path, check)


def checked(content: Any, path: str | Path, check: Callable[[Any], None]) -> dict[str, Any]:
    """The content of a JSON file, after `check(content)`, whose errors get the file's name."""
    try:
        check(content)
    except DataError as e:
        raise DataError(f"{path}: {e}") from e
    return dict(content)


def get(holder: Any, key: str, kind: type[T] | tuple[type[T], ...], where: str) -> T:
    """`holder[key]`, checked.

    Args:
        holder: a JSON object.
        key: the key.
        kind: expected type or types of the value.
        where: location of `holder` in the file, for error messages.

    Raises:
        DataError: `holder` is not a JSON object, the key is missing, or the value is of another type.
    """
    if not isinstance(holder, dict):
        raise DataError(f"{where}: expected an object, got {type(holder).__name__}")
    if key not in holder:
        raise DataError(f"{where}: missing key {key!r}")
    value = holder[key]
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        raise DataError(f"{where}.{key}: expected {' or '.join(k.__name__ for k in kinds)}, got {shown(value)}")
    return value


def shown(value: Any) -> str:
    """A value of a file for an error message: one line of at most 60 characters."""
    try:
        return f"{value!r:.60}"
    except ValueError:  # more digits than Python prints
        return "a huge number"


def get_whole(holder: Any, key: str, where: str, lowest: int, highest: float) -> int:
    """`holder[key]`, a whole number in the closed range; raises `DataError` as `get`, or with the range."""
    value = get(holder, key, int, where)
    if not lowest <= value <= highest:
        raise DataError(f"{where}.{key}: expected {lowest} to {highest}, got {shown(value)}")
    return value


def get_number(holder: Any, key: str, where: str, lowest: float, highest: float) -> float:
    """`holder[key]`, a finite number in the closed range; raises `DataError` as `get`, or with the range."""
    value = get(holder, key, (float, int), where)
    if not lowest <= value <= highest:
        raise DataError(f"{where}.{key}: expected a number from {lowest:g} to {highest:g}, got {shown(value)}")
    return float(value)


def get_frame(holder: Any, key: str, where: str, n_frames: int) -> int:
    """`holder[key]`, a frame of a video of `n_frames`; raises `DataError` as `get`, or with the frames of the video."""
    frame = get(holder, key, int, where)
    if not 0 <= frame < n_frames:
        raise DataError(f"{where}.{key}: expected a frame from 0 to {n_frames - 1}, got {shown(frame)}")
    return frame


def get_scene_index(holder: Any, key: str, where: str) -> int:
    """`holder[key]`, the index of a video; raises `DataError` as `get`, or where it is negative or too large."""
    return get_whole(holder, key, where, 0, LARGEST_ID)


def get_text(holder: Any, key: str, where: str) -> str:
    """`holder[key]`, a text that is not empty; raises `DataError` as `get`, or where it is empty or too long."""
    text = get(holder, key, str, where)
    check_limit(len(text), "text_characters", f"{where}.{key}")
    if not text.strip() or not text.isprintable():
        raise DataError(f"{where}.{key}: expected a line of text, got {shown(text)}")
    return text


def get_name(holder: Any, key: str, where: str) -> str:
    """`holder[key]`, the name of a file without a folder; raises `DataError` as `get`, or for any other text."""
    name = get_text(holder, key, where)
    if name in (".", "..") or "/" in name or "\\" in name:
        raise DataError(f"{where}.{key}: expected the name of a file without a folder, got {shown(name)}")
    return name


def get_pair(holder: Any, key: str, where: str, n: int) -> list[int]:
    """`holder[key]`, the ids of two of `n` objects; raises `DataError` as `get`, or for any other list."""
    pair = get(holder, key, list, where)
    if len(pair) != 2 or not all(type(i) is int for i in pair) or pair[0] == pair[1]:
        raise DataError(f"{where}.{key}: expected two different object ids, got {shown(pair)}")
    for i in pair:
        if not 0 <= i < n:
            raise DataError(f"{where}.{key}: expected object ids from 0 to {n - 1}, got {shown(i)}")
    return pair


def check_new(value: Any, seen: Collection[Any], where: str) -> None:
    """Raise `DataError` where an id or object was `seen` before."""
    if value in seen:
        raise DataError(f"{where}: {getattr(value, 'name', value)} is there twice; expected it once")


def scene_object(row: Any, number: int, where: str) -> SceneObject:
    """The object that a row describes with `color`, `material` and `shape`.

    Args:
        row: a JSON object.
        number: id of the object.
        where: location of `row` in the file, for error messages.

    Raises:
        DataError: an unknown or missing attribute word.
    """
    try:
        return cached_object(number, row["color"], row["material"], row["shape"])
    except (KeyError, TypeError, DataError):
        for name, known in ATTRIBUTES.items():
            word = get(row, name, str, where)
            if word not in known:
                raise DataError(f"{where}.{name}: {shown(word)}; expected one of {', '.join(known)}") from None
        raise


@lru_cache(maxsize=1024)
def cached_object(number: int, color: str, material: str, shape: str) -> SceneObject:
    """`SceneObject(number, color, material, shape)`; files repeat few objects very often."""
    return SceneObject(number, color, material, shape)


def check_objects(rows: Any, key: str, where: str, fewest: int = 1) -> tuple[SceneObject, ...]:
    """The objects of a list of rows with ids 0, 1, ... under `key` and unique attribute triples.

    Args:
        rows: JSON objects.
        key: key of the id.
        where: location of the list in the file, for error messages.
        fewest: smallest number of objects.

    Raises:
        DataError: too few or too many objects, an unknown attribute word, ids out of order, or a repeated triple.
    """
    objects: list[SceneObject] = []
    if len(rows) < fewest:
        raise DataError(f"{where}: expected at least {fewest} object, got none")
    check_limit(len(rows), "scene_objects", where)
    names: set[str] = set()
    for i, row in enumerate(rows):
        o = scene_object(row, i, f"{where}[{i}]")
        if get(row, key, int, f"{where}[{i}]") != i:
            raise DataError(f"{where}[{i}].{key}: expected {i}, got {shown(row[key])}")
        name = o.name
        if name in names:
            raise DataError(f"{where}[{i}]: a second {name}; attribute triples are unique in a video")
        names.add(name)
        objects.append(o)
    return tuple(objects)

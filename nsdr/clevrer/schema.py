"""Checked access to values in JSON documents: errors name the location in the file and what was expected there."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, TypeVar

from nsdr.errors import DataError
from nsdr.types import SceneObject
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["check_objects", "get", "iterate_list", "scene_object"]

T = TypeVar("T")
CHUNK_CHARACTERS = 1 << 16
"""Number of characters read at a time by `iterate_list`."""


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
        raise DataError(f"{where}.{key}: expected {' or '.join(k.__name__ for k in kinds)}, got {value!r:.60}")
    return value


def scene_object(row: Any, number: int, where: str) -> SceneObject:
    """The object that a row describes with `color`, `material` and `shape`.

    Args:
        row: a JSON object.
        number: id of the object.
        where: location of `row` in the file, for error messages.

    Raises:
        DataError: an unknown or missing attribute word.
    """
    words = {}
    for name, known in ATTRIBUTES.items():
        words[name] = get(row, name, str, where)
        if words[name] not in known:
            raise DataError(f"{where}.{name}: {words[name]!r}; expected one of {', '.join(known)}")
    return SceneObject(number, **words)


def check_objects(rows: Any, key: str, where: str) -> tuple[SceneObject, ...]:
    """The objects of a list of rows with ids 0, 1, ... under `key` and unique attribute triples.

    Args:
        rows: JSON objects.
        key: key of the id.
        where: location of the list in the file, for error messages.

    Raises:
        DataError: an unknown attribute word, ids out of order, or a repeated triple.
    """
    objects: list[SceneObject] = []
    for i, row in enumerate(rows):
        o = scene_object(row, i, f"{where}[{i}]")
        if get(row, key, int, f"{where}[{i}]") != i:
            raise DataError(f"{where}[{i}].{key}: expected {i}, got {row[key]}")
        if any(o.name == other.name for other in objects):
            raise DataError(f"{where}[{i}]: a second {o.name}; attribute triples are unique in a video")
        objects.append(o)
    return tuple(objects)


def iterate_list(path: str | Path) -> Iterator[Any]:
    """Yield the items of a file that holds one JSON list, without reading the whole file into memory.

    Raises:
        DataError: the file is missing, is not a list, or is not valid JSON; names the file and the item.
    """
    try:
        with open(path, encoding="utf-8") as file:
            yield from _items(file, str(path))
    except FileNotFoundError as e:
        raise DataError(f"{path}: no such file") from e
    except (OSError, UnicodeDecodeError) as e:
        raise DataError(f"{path}: cannot be read ({e})") from e


def _items(file: IO[str], name: str) -> Iterator[Any]:
    decoder = json.JSONDecoder()
    text, offset, number, ended = "", 0, 0, False

    def read_chunk() -> bool:
        """Read the next chunk; False at the end of the file."""
        nonlocal text, offset, ended
        chunk = file.read(CHUNK_CHARACTERS)
        ended = not chunk
        text, offset = text[offset:] + chunk, 0
        return not ended

    def next_character() -> str:
        """The next character that is not white space; empty at the end of the file."""
        nonlocal offset
        while True:
            while offset < len(text) and text[offset].isspace():
                offset += 1
            if offset < len(text):
                return text[offset]
            if not read_chunk():
                return ""

    if next_character() != "[":
        raise DataError(f"{name}: expected a JSON list")
    offset += 1
    if next_character() == "]":
        return
    while True:
        next_character()
        try:
            item, end = decoder.raw_decode(text, offset)
            # A number at the end of the chunk may continue in the next one.
            complete = end < len(text) or ended
        except json.JSONDecodeError as e:
            if not read_chunk():
                raise DataError(f"{name}: [{number}]: not valid JSON ({e.msg}); the file may be truncated") from e
            continue
        if not complete:
            read_chunk()
            continue
        yield item
        offset, number = end, number + 1
        character = next_character()
        if character == "]":
            return
        if character != ",":
            raise DataError(f"{name}: [{number}]: expected , or ], got {character!r}; the file may be truncated")
        offset += 1

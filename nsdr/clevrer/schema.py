"""Checked access to values inside JSON documents: errors name the position and what was expected."""

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


def get(holder: Any, key: str, kind: type[T] | tuple[type[T], ...], where: str) -> T:
    """`holder[key]`, of a type.

    Raises:
        DataError: `holder` is no object, or the key is missing or of another type.
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
    """The object described by `color`, `material` and `shape`.

    Raises:
        DataError: an unknown or missing word.
    """
    words = {}
    for name, known in ATTRIBUTES.items():
        words[name] = get(row, name, str, where)
        if words[name] not in known:
            raise DataError(f"{where}.{name}: {words[name]!r}; expected one of {', '.join(known)}")
    return SceneObject(number, **words)


def check_objects(rows: Any, key: str, where: str) -> tuple[SceneObject, ...]:
    """Objects listed with ids 0, 1, ... under `key`, no attribute triple twice.

    Raises:
        DataError: an unknown word, ids out of order, or a triple that occurs twice.
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
    """Items of a file that holds one JSON list, read piece by piece.

    Raises:
        DataError: missing, not a list, or broken; names the file and the item.
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
    text, position, number, ended = "", 0, 0, False

    def more() -> bool:
        """Read on; False at the end of the file."""
        nonlocal text, position, ended
        piece = file.read(CHUNK_CHARACTERS)
        ended = not piece
        text, position = text[position:] + piece, 0
        return not ended

    def next_mark() -> str:
        """The next character that is no white space."""
        nonlocal position
        while True:
            while position < len(text) and text[position].isspace():
                position += 1
            if position < len(text):
                return text[position]
            if not more():
                return ""

    if next_mark() != "[":
        raise DataError(f"{name}: expected a JSON list")
    position += 1
    if next_mark() == "]":
        return
    while True:
        next_mark()
        try:
            item, end = decoder.raw_decode(text, position)
            # A number at the end of the piece may go on in the next one.
            complete = end < len(text) or ended
        except json.JSONDecodeError as e:
            if not more():
                raise DataError(f"{name}: [{number}]: not readable as JSON ({e.msg}); the file may be cut off") from e
            continue
        if not complete:
            more()
            continue
        yield item
        position, number = end, number + 1
        mark = next_mark()
        if mark == "]":
            return
        if mark != ",":
            raise DataError(f"{name}: [{number}]: expected , or ], got {mark!r}; the file may be cut off")
        position += 1

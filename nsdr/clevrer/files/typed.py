"""JSON as typed structures: decoded and checked in one pass by msgspec, with errors like those of `schema`."""

import re
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from nsdr.clevrer.files.schema import shown
from nsdr.errors import DataError
from nsdr.io.reading import read_json, read_json_bytes
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["convert", "read_typed"]

T = TypeVar("T")
PLACE = re.compile(r"(.*?)(?: - at `\$\.?(.*)`)?", re.DOTALL)
"""msgspec's message, and the place in the document."""
REASONS = (
    (r"Object missing required field `(\w+)`", r"missing key '\1'"),
    (r"Expected `object`, got `(\w+)`", r"expected an object, got \1"),
    (r"Expected `array`, got .*", "expected list, got {}"),
    (r"Expected `array` of length [<>]= (\d+)", r"expected \1 objects, got {n}"),
    (r"Expected `(\w+)` ([<>]=) (\S+)", r"expected a number \2 \3, got {}"),
    (r"Expected `(\w+)`, got .*", r"expected \1, got {}"),
    (r"Number out of range", "expected a number of ordinary size, got {}"),
)
"""msgspec's messages and ours; {} stands for the value that was found, {n} for its length."""


def read_typed(path: str | Path, kind: type[T]) -> T:
    """The content of a JSON file, which may be gzipped, as a msgspec structure.

    Raises:
        DataError: the file is missing, not JSON, or does not fit `kind`; names the file, the place, what was expected.
    """
    try:
        content: T = _decoder(kind).decode(read_json_bytes(path))  # type: ignore[arg-type]
        return content
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, OverflowError):
        document = read_json(path)  # says what is no JSON at all
    try:
        return convert(document, kind)
    except DataError as e:
        raise DataError(f"{path}: {e}") from e


@lru_cache(maxsize=32)
def _decoder(kind: Any) -> msgspec.json.Decoder[Any]:
    return msgspec.json.Decoder(kind)


def convert(document: Any, kind: type[T]) -> T:
    """The content of a JSON file as a msgspec structure; raises `DataError` as `read_typed`, without the file."""
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as e:
        raise DataError(_message(str(e), document)) from e


def _message(error: str, document: Any) -> str:
    match = PLACE.fullmatch(error)
    assert match is not None
    reason, place = match[1], match[2] or ""
    value = document
    for key, index in re.findall(r"(\w+)|\[(\d+)\]", place):
        value = value[key] if key else value[int(index)]
    where = place or "file"
    known = ATTRIBUTES.get(place.rpartition(".")[2])
    if known and isinstance(value, str):
        return f"{where}: {shown(value)}; expected one of {', '.join(known)}"
    for pattern, ours in REASONS:
        found = re.fullmatch(pattern, reason)
        if found:
            length = str(len(value)) if isinstance(value, list) else ""
            return f"{where}: {found.expand(ours).replace('{n}', length).replace('{}', shown(value))}"
    return f"{where}: {reason}"

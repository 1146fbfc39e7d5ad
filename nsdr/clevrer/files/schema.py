"""Types and rules that several kinds of files have in common."""

from collections.abc import Hashable, Iterable, Sequence
from typing import Annotated, Any, TypedDict

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.io.limits import check_limit, limits
from nsdr.validation import Count, expect
from nsdr.world.vocabulary import Vocabulary, Word

__all__ = [
    "LARGEST_COORDINATE",
    "LARGEST_ID",
    "Coordinate",
    "FileName",
    "Id",
    "Pair",
    "Program",
    "RecordId",
    "Vector",
    "Words",
    "check_frame",
    "check_lines",
    "check_objects",
    "check_pair",
    "check_unique",
]

LARGEST_ID = 10**9
"""Largest index of a video, and largest id of a question or choice."""
LARGEST_COORDINATE = 1000.0
"""Largest magnitude of a coordinate, angle or velocity in files (CLEVRER's are below 20, the grid has 150)."""

Id = Annotated[int, Meta(ge=0, le=LARGEST_ID)]
Coordinate = Annotated[float, Meta(ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Pair = tuple[Count, Count]
Program = Annotated[tuple[str, ...], Meta(min_length=1)]
RecordId = Annotated[str, Meta(pattern=r"^[0-9]{1,9}-[0-9]{1,9}$")]
"""SCENE_INDEX-QUESTION_ID, such as 10003-7."""
FileName = Annotated[str, Meta(pattern=r"^(?!\.{1,2}$)[^/\\\x00-\x1f]+$")]
"""The name of a file without a folder."""


class Words(TypedDict):
    """An object by its attribute words; `check_objects` checks that a world has them."""

    color: Word
    material: Word
    shape: Word


def check_objects(rows: Sequence[Any], key: str, place: str, vocabulary: Vocabulary) -> None:
    """Ids under `key` are 0, 1, ..., words are those of a vocabulary, and attribute triples are unique.

    Raises:
        DataError: names the place.
    """
    expect(len(rows) > 0, place, "at least 1 object", "none")
    check_limit(len(rows), "scene_objects", place)
    for i, row in enumerate(rows):
        expect(row[key] == i, f"{place}[{i}].{key}", str(i), row[key])
        for kind, known in vocabulary.words.items():
            expect(row[kind] in known, f"{place}[{i}].{kind}", f"one of {', '.join(known)}", row[kind])
    check_unique([f"{o['color']} {o['material']} {o['shape']}" for o in rows], place)


def check_unique(values: Iterable[Hashable], place: str, key: str = "") -> None:
    """No id or name is there twice; raises `DataError` that names the second place."""
    seen: set[Hashable] = set()
    for i, value in enumerate(values):
        if value in seen:
            raise DataError(f"{place}[{i}]{key}: {value} is there twice; expected it once")
        seen.add(value)


def check_frame(frame: int, place: str, n_frames: int | None = None) -> None:
    """A frame is one of a video of `n_frames`, or of the longest that is read; raises `DataError` that names the place."""
    last = (limits().frames if n_frames is None else n_frames) - 1
    expect(0 <= frame <= last, place, f"a frame from 0 to {last}", frame)


def check_pair(pair: Sequence[int], n_objects: int, place: str) -> None:
    """Two different objects of `n_objects`; raises `DataError` that names the place."""
    expect(pair[0] != pair[1], place, "two different object ids", list(pair))
    expect(max(pair) < n_objects, place, f"object ids from 0 to {n_objects - 1}", max(pair))


def check_lines(place: str, **texts: str | None) -> None:
    """Each is a line of text, not too long; raises `DataError` that names the place and the key."""
    for key, text in texts.items():
        if text is not None:
            inside = f"{place}.{key}" if place else key
            check_limit(len(text), "text_characters", inside)
            expect(bool(text.strip()) and text.isprintable(), inside, "a line of text", repr(text))

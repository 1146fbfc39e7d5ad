"""What a case of the campaign is, and the rules that make bad JSON documents from good ones."""

import copy
import gzip
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Write = Callable[[Path, Path], object]
"""Writes into the case's folder, given that and the folder of good inputs."""
Change = Callable[[Any], object]
"""Changes a document in place."""


@dataclass(frozen=True)
class Case:
    """One bad input.

    Attributes:
        rule: what is wrong, for all inputs made alike, such as "questions: remove".
        name: unique within the rule.
        argv: arguments of `nsdr`; "{good}" stands for the folder of good inputs, paths are relative to the case's folder.
        write: puts the bad input into the case's folder.
        named: text that the error must hold: the bad file's name or the option; alternatives are separated by |.
        place: another such text: the key or value.
    """

    rule: str
    name: str
    argv: tuple[str, ...]
    write: Write = lambda folder, good: None
    named: str = ""
    place: str = ""

    @property
    def id(self) -> str:
        """Unique name of the case."""
        return f"{self.rule}: {self.name}"


@dataclass(frozen=True)
class Field:
    """A field of a document: the keys that lead to it, and what it holds (a key of `WRONG`).

    Attributes:
        path: keys and indices from the root.
        kind: what values are right.
        optional: whether it may be missing or null.
    """

    path: tuple[str | int, ...]
    kind: str
    optional: bool = False


def raw(text: str) -> str:
    """Text that `dumped` writes as it is, such as NaN."""
    return f"@raw {text}@"


NUMBERS = (raw("NaN"), raw("Infinity"), raw("1e400"), raw("9" * 5000))
NO_LIST = (None, 5, "x", {}, True)
WORDS = ("zebra", "", "🙂", "red\x00")
WRONG: dict[str, Sequence[Any]] = {
    "id": ("7", 1.5, None, True, [1], {}, -1, *NUMBERS),
    "frame": ("7", 1.5, None, True, [1], {}, -1, 10**12, *NUMBERS),
    "object id": ("0", 1.5, None, True, [0], {}, -1, 99, *NUMBERS),
    "count": ("7", 1.5, True, [1], {}, 0, -1, 10**12, *NUMBERS),
    "number": ("x", None, True, [], {}, *NUMBERS),
    "share": ("x", None, True, [], {}, -0.1, 1.5, *NUMBERS),
    "word": (5, None, [], {}, True, *WORDS),
    "answer": (33, 1.5, [], {}, *WORDS, *NUMBERS),
    "judgement": (5, None, [], {}, *WORDS),
    "given": (1.5, [], {}, *NUMBERS),
    "text": (5, None, [], {}, True),
    "boolean": (1, "true", None, [], {}),
    "list": NO_LIST,
    "object": (None, 5, "x", [], True),
    "tokens": (5, "count", {}, [5], [None], [["count"]]),
    "vector": (None, 5, "x", {}, [], [1.0, 2.0], [0.0] * 4, ["a", 0, 0], [None, 0, 0], [raw("NaN"), 0, 0],
               [raw("1e400"), 0, 0]),
    "pair": (None, 5, "x", {}, [], [0], [0, 1, 2], [0, 0], [0, 99], [-1, 0], ["0", "1"], [0.5, 1], [None, 0]),
    "mask size": (None, 5, "x", [], [320], [480, 320], [10**6, 10**6], [-320, -480], [320.5, 480], ["320", "480"]),
    "mask": (None, 5, [], "", "zebra", "🙂" * 9, "0" * 9, "\x00\x01", "o" * 100_000, "PPo`3" * 50, " "),
}  # fmt: skip
"""Values that are wrong for each kind of field."""


def dumped(document: Any) -> str:
    """JSON text, with `raw` values."""
    return re.sub(r'"@raw ([^"]*)@"', r"\1", json.dumps(document))


def _labelled(value: Any) -> str:
    text = re.sub(r"@raw ([^@]*)@", r"\1", json.dumps(value, ensure_ascii=True))
    return text if len(text) <= 40 else f"{text[:20]}… ({len(text)})"


def field_cases(
    kind: str, fields: Sequence[Field], argv: Sequence[str], file: str, writer: Callable[[Change], Write]
) -> Iterator[Case]:
    """Every field removed, and with every wrong value.

    Args:
        kind: name of the format.
        fields: its fields.
        argv: command that reads the document.
        file: name of the document, which the error must hold.
        writer: makes what writes a good document after a change.
    """
    for field in fields:
        where = ".".join(map(str, field.path))
        place = next((str(key) for key in reversed(field.path) if isinstance(key, str) and not key.isdigit()), "")
        if isinstance(field.path[-1], str) and not field.optional:
            yield Case(f"{kind}, remove", where, tuple(argv), writer(removed(*field.path)), file, place)
        for value in WRONG[field.kind]:
            if value is None and field.optional:
                continue
            name = f"{where} = {_labelled(value)}"
            unparsed = "@raw" in json.dumps(value)  # the parser refuses it, which knows no places
            write = writer(replaced(*field.path, value))
            yield Case(f"{kind}, value", name, tuple(argv), write, file, "" if unparsed else place)


def replaced(*keys_and_value: Any) -> Change:
    """A change that sets the value at some keys."""
    *keys, last, value = keys_and_value

    def change(document: Any) -> None:
        for key in keys:
            document = document[key]
        document[last] = value

    return change


def removed(*keys: Any) -> Change:
    """A change that removes what is at some keys."""

    def change(document: Any) -> None:
        for key in keys[:-1]:
            document = document[key]
        del document[keys[-1]]

    return change


def repeated(*keys: Any) -> Change:
    """A change that repeats an item of a list."""

    def change(document: Any) -> None:
        for key in keys[:-1]:
            document = document[key]
        document.insert(keys[-1], copy.deepcopy(document[keys[-1]]))

    return change


def text_writer(file: str, content: str | bytes) -> Write:
    """Writes a file into the case's folder; text is compressed if the name ends in .gz."""

    def write(folder: Path, good: Path) -> None:
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        data = content.encode() if isinstance(content, str) else content
        path.write_bytes(gzip.compress(data) if isinstance(content, str) and file.endswith(".gz") else data)

    return write

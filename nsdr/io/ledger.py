"""The ledger of a folder: which of its files are finished, and from what each was made."""

import json
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from pathlib import Path

import msgspec

from nsdr.io.files import sync, writing

LEDGER = ".fingerprints.jsonl"
"""Name of the file."""


@dataclass(frozen=True)
class Entry:
    """A line of the ledger.

    Attributes:
        output: path of the file below the folder.
        fingerprint: of everything that the file was made from; "" while it is made.
        source: absolute path of the one input that the file has its name from; "" where it is named otherwise.
    """

    output: str
    fingerprint: str
    source: str = ""


def append_to_ledger(folder: Path, entries: Iterable[Entry]) -> None:
    """Write lines to the disk; what a kill or a full disk left unfinished before them is a line of its own.

    Raises:
        MachineError: the ledger cannot be written.
    """
    path = folder / LEDGER
    with writing(path):
        with path.open("a", encoding="utf-8") as ledger:
            ledger.writelines(f"\n{json.dumps(astuple(entry))}" for entry in entries)
        sync(path)


def read_ledger(folder: Path) -> dict[str, Entry]:
    """The newest line of each output, by its path; lines that a kill left unfinished, and other things, are passed over."""
    path, entries = folder / LEDGER, {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else ():
        try:
            entry = Entry(*msgspec.json.decode(line, type=list[str]))
        except (TypeError, msgspec.DecodeError):
            continue
        entries[entry.output] = entry
    return entries

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
        fingerprint: fingerprint of everything that the file was made from; "" while it is being made.
        source: absolute path of the input from which the file takes its name; "" if it is named otherwise.
    """

    output: str
    fingerprint: str
    source: str = ""


def append_to_ledger(folder: Path, entries: Iterable[Entry]) -> None:
    """Append lines and flush them to disk. They begin on a new line even if a kill or a full disk left the last one unfinished.

    Raises:
        MachineError: the ledger cannot be written.
    """
    path = folder / LEDGER
    with writing(path):
        with path.open("a", encoding="utf-8") as ledger:
            ledger.writelines(f"\n{json.dumps(astuple(entry))}" for entry in entries)
        sync(path)


def read_ledger(folder: Path) -> dict[str, Entry]:
    """The newest line of each output, by its path. Lines that a killed process left unfinished are skipped."""
    path, entries = folder / LEDGER, {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else ():
        try:
            entry = Entry(*msgspec.json.decode(line, type=list[str]))
        except (TypeError, msgspec.DecodeError):
            continue
        entries[entry.output] = entry
    return entries

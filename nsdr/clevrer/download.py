"""Downloading CLEVRER's official files, over HTTPS or with checksums.

`nsdr.clevrer` imports this module eagerly, because function and module have the same name. So what the download needs is
imported when it starts.
"""

from collections.abc import Iterable
from pathlib import Path

from nsdr.errors import DataError

__all__ = ["OFFICIAL_ROOT", "download"]

OFFICIAL_ROOT = "https://data.csail.mit.edu/clevrer"
"""Where the authors publish the data set."""
CHECKSUMS = "checksums.json"
"""File in the target folder with the SHA-256 of every file as it was first seen, by path."""

WHAT = {
    "videos": "videos/{split}/video_{split}.zip",
    "annotations": "annotations/{split}/annotation_{split}.zip",
    "questions": "questions/{split}.json",
}
"""Path below `OFFICIAL_ROOT` of each kind of files."""
RETRIES = 5
"""Default number of retries of a broken connection."""
WAIT_S = 2.0
"""Default pause before the first retry (s)."""


def download(
    root: str | Path,
    split: str,
    what: Iterable[str] = tuple(WHAT),
    base_url: str = OFFICIAL_ROOT,
    retries: int = RETRIES,
    wait_s: float = WAIT_S,
    progress: bool = True,
    trust_first_use: bool = False,
) -> list[Path]:
    """Download the files of a split into the official layout. Complete files are skipped, incomplete ones continued.

    The SHA-256 of every file is written to `checksums.json` when it is first seen, and compared ever after. Over plain HTTP,
    which anyone on the way can change, a file without a known checksum is refused.

    Args:
        root: target folder.
        split: "train", "validation" or "test" (which has no annotations).
        what: any of "videos", "annotations", "questions".
        base_url: where the official layout is served.
        retries: number of retries in a row that may fail without any progress.
        wait_s: pause before the first retry (s); it doubles with each further one.
        progress: whether to show a progress bar.
        trust_first_use: accept files over plain HTTP that have no checksum yet.

    Returns:
        Paths of the files.

    Raises:
        DataError: an unknown split or kind, a file that the server does not have, a connection that keeps breaking, or a file
            that cannot be trusted or does not have its checksum; or another process downloads to `root`.
    """
    from nsdr.clevrer.dataset import SPLITS
    from nsdr.clevrer.transfer import fetch
    from nsdr.io.files import locked, write_json
    from nsdr.io.reading import read_json

    if split not in SPLITS:
        raise DataError(f"split is {split!r}; expected one of {', '.join(SPLITS)}")
    paths, ledger = [], Path(root) / CHECKSUMS
    with locked(root, CHECKSUMS):
        known: dict[str, str] = read_json(ledger) if ledger.exists() else {}
        for kind in what:
            if kind not in WHAT:
                raise DataError(f"cannot download {kind!r}; expected one of {', '.join(WHAT)}")
            if kind == "annotations" and split == "test":
                continue
            name = WHAT[kind].format(split=split)
            target = Path(root) / name
            if not target.exists():
                url = f"{base_url.rstrip('/')}/{name}"
                if not (url.startswith("https://") or name in known or trust_first_use):
                    raise DataError(f"{url}: plain HTTP, and no checksum is known; use HTTPS or --trust-first-use")
                found = fetch(url, target, retries, wait_s, progress, known.get(name))
                known = {**known, name: found}
                write_json(ledger, known, indent=1)
            paths.append(target)
    return paths

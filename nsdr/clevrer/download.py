"""Fetching CLEVRER's official files, resumable."""

import time
import urllib.error
import urllib.request
from collections.abc import Iterable
from pathlib import Path

from tqdm import tqdm

from nsdr.clevrer.dataset import SPLITS
from nsdr.errors import DataError

__all__ = ["OFFICIAL_ROOT", "download"]

OFFICIAL_ROOT = "http://data.csail.mit.edu/clevrer"
"""Where the authors publish the data set."""

WHAT = {
    "videos": "videos/{split}/video_{split}.zip",
    "annotations": "annotations/{split}/annotation_{split}.zip",
    "questions": "questions/{split}.json",
}
CHUNK_BYTES = 1 << 20


def download(
    root: str | Path,
    split: str,
    what: Iterable[str] = tuple(WHAT),
    base_url: str = OFFICIAL_ROOT,
    retries: int = 5,
    wait_s: float = 2.0,
    progress: bool = True,
) -> list[Path]:
    """Fetch files of a split into the official layout; files that are complete stay, parts go on where they ended.

    Args:
        root: target folder.
        split: "train", "validation" or "test" (which has no annotations).
        what: of "videos", "annotations", "questions".
        base_url: where the official layout is served.
        retries: how often a broken connection is taken up again.
        wait_s: pause before the first retry; it doubles each time.
        progress: show a bar.

    Returns:
        The files' paths.

    Raises:
        DataError: an unknown split or kind, a file the server does not have, or a connection that stays broken.
    """
    if split not in SPLITS:
        raise DataError(f"split is {split!r}; expected one of {', '.join(SPLITS)}")
    paths = []
    for kind in what:
        if kind not in WHAT:
            raise DataError(f"cannot download {kind!r}; expected {', '.join(WHAT)}")
        if kind == "annotations" and split == "test":
            continue
        name = WHAT[kind].format(split=split)
        target = Path(root) / name
        if not target.exists():
            _fetch(f"{base_url.rstrip('/')}/{name}", target, retries, wait_s, progress)
        paths.append(target)
    return paths


def _fetch(url: str, target: Path, retries: int, wait_s: float, progress: bool) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".part")
    failures = 0
    while True:
        before = part.stat().st_size if part.exists() else 0
        try:
            _fetch_rest(url, part, progress)
            break
        except urllib.error.HTTPError as e:
            e.close()
            if e.code < 500:
                raise DataError(f"{url}: the server answers {e.code} {e.reason}") from e
            reason: Exception = e
        except (OSError, _Incomplete) as e:
            reason = e
        grown = part.exists() and part.stat().st_size > before
        failures = 1 if grown else failures + 1
        if failures > retries:
            raise DataError(f"{url}: broke off {failures} times in a row ({reason}); run again to go on from there")
        time.sleep(wait_s * 2 ** (failures - 1))
    part.replace(target)


class _Incomplete(Exception):
    """The connection ended before all bytes were there."""


def _fetch_rest(url: str, part: Path, progress: bool) -> None:
    """Append what is missing to `part`, and check its size against the server's."""
    start = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(url, headers={"Range": f"bytes={start}-"} if start else {})
    try:
        response = urllib.request.urlopen(request, timeout=60)
    except urllib.error.HTTPError as e:
        e.close()
        if e.code == 416 and start:  # nothing is missing, or the part is of another file
            if _size(url) == start:
                return
            part.unlink()
            raise _Incomplete("the part did not belong to this file") from e
        raise
    with response:
        if start and response.status != 206:  # the server sends everything again
            start = 0
        length = response.headers.get("Content-Length")
        total = start + int(length) if length is not None else None
        mode = "ab" if start else "wb"
        bar = tqdm(total=total, initial=start, unit="B", unit_scale=True, desc=part.stem, disable=not progress)
        with bar, open(part, mode) as file:
            while chunk := response.read(CHUNK_BYTES):
                file.write(chunk)
                bar.update(len(chunk))
    size = part.stat().st_size
    if total is not None and size != total:
        raise _Incomplete(f"{size} of {total} bytes")


def _size(url: str) -> int:
    with urllib.request.urlopen(urllib.request.Request(url, method="HEAD"), timeout=60) as response:
        return int(response.headers.get("Content-Length", -1))

"""Resumable fetching of one file over HTTP."""

import hashlib
import time
import urllib.error
import urllib.request
from http import HTTPStatus
from pathlib import Path

from tqdm import tqdm

from nsdr.errors import DataError
from nsdr.io.files import sync

__all__ = ["fetch"]

CHUNK_BYTES = 1 << 20
"""Bytes read at a time."""
TIMEOUT_S = 60.0
"""Time without an answer after which a connection counts as broken (s)."""


def fetch(url: str, target: str | Path, retries: int, wait_s: float, progress: bool, sha256: str | None = None) -> str:
    """Fetch `url` to `target`; `target.part` holds an incomplete file, and a later call continues it.

    Args:
        url: the source.
        target: the file to write.
        retries: number of retries in a row that may fail without any progress.
        wait_s: pause before the first retry (s); it doubles with each further one.
        progress: whether to show a progress bar.
        sha256: the checksum that the file must have; None for any.

    Returns:
        The file's SHA-256.

    Raises:
        DataError: the server does not have the file, the connection keeps breaking, or the file has another checksum; such a
            file is deleted.
    """
    target = Path(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".part")
    failures = 0
    while True:
        size_before = part.stat().st_size if part.exists() else 0
        try:
            _fetch_rest(url, part, progress)
            break
        except urllib.error.HTTPError as e:
            e.close()
            if e.code < HTTPStatus.INTERNAL_SERVER_ERROR:
                raise DataError(f"{url}: the server answers {e.code} {e.reason}") from e
            reason: Exception = e
        except (OSError, _Incomplete) as e:
            reason = e
        has_grown = part.exists() and part.stat().st_size > size_before
        failures = 1 if has_grown else failures + 1
        if failures > retries:
            raise DataError(f"{url}: failed {failures} times in a row ({reason}); run the command again to continue")
        time.sleep(wait_s * 2 ** (failures - 1))
    with open(part, "rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != (sha256 or found):
        part.unlink()
        raise DataError(f"{url}: has SHA-256 {found}, expected {sha256}; it was changed on the way or at its source")
    sync(part)
    part.replace(target)
    return found


class _Incomplete(Exception):
    """The connection ended before all bytes had arrived."""


def _fetch_rest(url: str, part: Path, progress: bool) -> None:
    """Append the missing bytes to `part`, and compare its size with the server's."""
    start = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(url, headers={"Range": f"bytes={start}-"} if start else {})
    try:
        response = urllib.request.urlopen(request, timeout=TIMEOUT_S)
    except urllib.error.HTTPError as e:
        e.close()
        if e.code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE and start:  # `part` is complete, or is another file's
            if _size(url) == start:
                return
            part.unlink()
            raise _Incomplete("the part did not belong to this file") from e
        raise
    with response:
        if start and response.status != HTTPStatus.PARTIAL_CONTENT:  # the server sends the whole file
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
    with urllib.request.urlopen(urllib.request.Request(url, method="HEAD"), timeout=TIMEOUT_S) as response:
        return int(response.headers.get("Content-Length", -1))

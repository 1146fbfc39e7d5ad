"""What stands between visitors and Gradio: an ASGI middleware that limits what may be sent to the page."""

import asyncio
import contextlib
import json
import shutil
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; media-src 'self' data: blob:; worker-src 'self' blob:; object-src 'none'; form-action 'self'"
)
"""Content-Security-Policy of every reply: browsers fetch nothing from other hosts."""
POSTS = ("/upload", "/queue/join", "/run/predict", "/cancel", "/reset")
"""Ends of the paths that the page sends to. Gradio has others, which it does not need and which write files, too."""
MAX_REQUEST_BYTES = 100_000
"""Size of a request that is no upload: several times that of the longest question with its choices (bytes)."""
ENVELOPE_BYTES = 10_000
"""What an upload's request may hold besides its file (bytes)."""
UPLOAD_SECONDS = 300
"""How long an upload may take (seconds)."""
RESERVE_SHARE = 0.2
"""Share of the disk of uploads that is left free for the videos that the page shows."""
MAX_UPLOADS = 100
"""Uploads that are kept at a time."""
App = Callable[[Any, Any, Any], Awaitable[None]]


class Guard:
    """The middleware.

    It adds the Content-Security-Policy to every reply. It refuses requests that pages of other sites send, requests that are
    too large, and those that would make Gradio fetch something from another host. Uploads end after a while. So that they fit
    on the disk and into their limit, those that lie there longest are deleted; uploads that do not fit even so are refused.

    Args:
        app: what is guarded.
        uploads: folder in which Gradio keeps uploads, each in a folder of its own, and unfinished ones beside these folders.
        max_file_bytes: size of the largest upload.
        max_bytes: size of all uploads together.
    """

    def __init__(self, app: App, uploads: Path, max_file_bytes: int, max_bytes: int) -> None:
        self.app, self.uploads, self.max_file_bytes, self.max_bytes = app, uploads, max_file_bytes, max_bytes
        self.expected_bytes: list[int] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        from starlette.datastructures import Headers
        from starlette.requests import Request
        from starlette.responses import PlainTextResponse

        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def send_with_policy(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (b"content-security-policy", POLICY.encode())]
            await send(message)

        headers = Headers(scope=scope)
        reads = scope["method"] in ("GET", "HEAD")
        refusal = _refused_read(scope["path"]) if reads else self._refused_post(scope["path"], headers)
        if refusal is None and scope["path"].endswith("/upload"):
            refusal = await self._upload(int(headers["content-length"]), scope, receive, send_with_policy)
        elif refusal is None and reads:
            await self.app(scope, receive, send_with_policy)
        elif refusal is None and not _names_other_hosts(body := await Request(scope, receive).body()):
            await self.app(scope, _replayed(body, receive), send_with_policy)
        elif refusal is None:
            refusal = FETCHES_NOTHING
        if refusal is not None:
            status, reason = refusal
            await PlainTextResponse(reason, status)(scope, receive, send_with_policy)

    def _refused_post(self, path: str, headers: Any) -> tuple[int, str] | None:
        """Why a request that sends something is refused: status and reason; None if it is not."""
        origin, host = headers.get("origin"), headers.get("host", "")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return (
                403,
                f"pages of other sites may not send anything here (origin {origin!r:.100}, expected that of {host!r:.100})",
            )
        if not path.rstrip("/").endswith(POSTS):
            return 404, "the page has no such request"
        length = headers.get("content-length", "")
        if not length.isdecimal() or "transfer-encoding" in headers:  # servers then pass over the length
            return 411, "expected a request that gives its length"
        most = self.max_file_bytes + ENVELOPE_BYTES if path.endswith("/upload") else MAX_REQUEST_BYTES
        return (413, f"too large: {int(length):,} bytes, at most {most:,} are taken") if int(length) > most else None

    async def _upload(self, size: int, scope: Any, receive: Any, send: Any) -> tuple[int, str] | None:
        """Let an upload pass if there is room for it; otherwise return why it is refused, as `_refused_post` does."""
        if not self._make_room(size):
            return 507, "there is no room for this upload now; try again in a few minutes"
        self.expected_bytes.append(size)
        try:
            async with asyncio.timeout(UPLOAD_SECONDS):
                await self.app(scope, receive, send)
            return None
        except TimeoutError:
            return 408, f"the upload took more than {UPLOAD_SECONDS} s"
        except OSError as e:
            return 507, f"the upload cannot be kept ({e.strerror}); try again in a few minutes"
        finally:
            self.expected_bytes.remove(size)
            self._delete_unfinished()

    def _make_room(self, size: int) -> bool:
        """Delete the oldest uploads until a file of this size fits beside those on their way; returns whether it fits."""
        self.uploads.mkdir(parents=True, exist_ok=True)
        self._delete_unfinished()
        coming = size + sum(self.expected_bytes)
        oldest_first = sorted(self.uploads.glob("*/*"), key=_written)
        while oldest_first and (len(oldest_first) >= MAX_UPLOADS or not self._fits(coming)):
            delete_upload(oldest_first.pop(0))
        return self._fits(coming)

    def _fits(self, coming: int) -> bool:
        disk, kept = shutil.disk_usage(self.uploads), 0
        for file in self.uploads.rglob("*"):
            with contextlib.suppress(FileNotFoundError):  # deleted meanwhile
                kept += file.stat().st_size if file.is_file() else 0
        return kept + coming <= self.max_bytes and coming <= disk.free - RESERVE_SHARE * disk.total

    def _delete_unfinished(self) -> None:
        """Delete the remains of interrupted uploads."""
        for file in self.uploads.iterdir():
            if file.is_file() and (not self.expected_bytes or time.time() - _written(file) > UPLOAD_SECONDS):
                file.unlink(missing_ok=True)


def delete_upload(path: Path) -> None:
    """Delete an upload and its folder."""
    path.unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # another file of the same content has another name
        path.parent.rmdir()


def _written(file: Path) -> float:
    """When a file was last written (seconds of the system's clock); 0 if it has been deleted since."""
    try:
        return file.stat().st_mtime
    except FileNotFoundError:
        return 0.0


FETCHES_NOTHING = 403, "the page fetches nothing from other hosts"
"""Status and reason of a refusal."""


def _refused_read(path: str) -> tuple[int, str] | None:
    """Why a request that sends nothing is refused, as in `Guard._refused_post`."""
    foreign = any(part in path.lower() for part in ("/proxy=", "/file=http", "/file/http"))
    return FETCHES_NOTHING if foreign else None


def _names_other_hosts(body: bytes) -> bool:
    """Whether a request gives an address as a file's path, which Gradio would download."""

    def paths(value: Any) -> Iterator[str]:
        if isinstance(value, dict):
            yield str(value.get("path", ""))
        for part in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            yield from paths(part)

    try:
        return any("://" in path for path in paths(json.loads(body)))
    except (ValueError, RecursionError):
        return False  # which Gradio refuses itself


def _replayed(body: bytes, receive: Any) -> Any:
    """A `receive` that gives the body, which has been read, once more, and then what follows it."""
    first = iter([{"type": "http.request", "body": body, "more_body": False}])

    async def replayed() -> Any:
        return next(first, None) or await receive()

    return replayed

"""Chat completions of an OpenAI-compatible server, over HTTP and in bounded memory."""

import http.client
import json
import os
import re
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

from nsdr.errors import DataError, EndpointError, QuestionError
from nsdr.io.limits import check_limit
from nsdr.io.reading import parse_json

__all__ = ["KEY_VARIABLE", "ChatClient"]

KEY_VARIABLE = "OPENAI_API_KEY"
"""Environment variable with the key that the server wants, if it wants one."""
CHUNK_BYTES = 1 << 16
"""Bytes read at a time."""
QUOTED_CHARACTERS = 200
"""Length of what an error quotes of a reply."""
NAMED_MODELS = 5
"""Models that an error names."""
LEAVE_OUT = "or leave --parser out: the shipped parser needs no server"


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """Redirects are errors: the key is for the named server only."""

    def redirect_request(self, *_: Any, **__: Any) -> None:
        return None


class ChatClient:
    """A server with the paths `/models` and `/chat/completions`.

    Args:
        url: the part of the address before these paths, such as "http://localhost:8000/v1".
        timeout_s: longest time for a reply (s).

    Raises:
        QuestionError: an address of another form, or a `timeout_s` that is not positive.
    """

    def __init__(self, url: str, timeout_s: float) -> None:
        self.url = _checked_url(url)
        if not 0 < timeout_s < float("inf"):
            raise QuestionError(f"timeout_s is {timeout_s}; expected a number of seconds above 0")
        self.timeout_s = timeout_s
        self._opener = urllib.request.build_opener(_NoRedirects())

    def models(self) -> list[str] | None:
        """Names of the models that the server lists; None when it has no list.

        Raises:
            EndpointError: the server is not there, refuses, or its reply is not understood.
        """
        try:
            document = self._request("/models", None)
        except _NoSuchPath:
            return None
        rows = document.get("data")
        if not isinstance(rows, list) or not all(isinstance(r, dict) and isinstance(r.get("id"), str) for r in rows):
            raise self._not_understood("/models", "data: expected a list of models with an id", document)
        return [row["id"] for row in rows]

    def only_model(self) -> str:
        """The server's model, when it has only one.

        Raises:
            EndpointError: as of `models`; or the server has no model or several.
        """
        names = self.models()
        if names is None:
            raise EndpointError(f"{self.url}: lists no models; name one with --parser-model")
        if len(names) != 1:
            listed = ", ".join(f"{name!r:.80}" for name in names[:NAMED_MODELS])
            more = ", …" if len(names) > NAMED_MODELS else ""
            raise EndpointError(
                f"{self.url}: has {len(names)} models ({listed or 'none'}{more}); name one with --parser-model"
            )
        return names[0]

    def reply(self, model: str, messages: Sequence[dict[str, str]]) -> str:
        """What a model replies, at temperature 0.

        Args:
            model: its name.
            messages: the conversation: `role` ("system", "user" or "assistant") and `content` each.

        Raises:
            EndpointError: the server is not there, fails, takes too long, does not have the model, or its reply is too large or
                is not understood.
            QuestionError: the reply is cut off.
        """
        body = {"model": model, "messages": list(messages), "temperature": 0, "stream": False}
        try:
            document = self._request("/chat/completions", body)
        except _NoSuchPath as e:
            raise EndpointError(
                f"{e}; is the address right (it mostly ends in /v1), and does the server have the model {model!r:.80}?"
            ) from e
        choices = document.get("choices")
        choice = choices[0] if isinstance(choices, list) and choices else None
        if isinstance(choice, dict) and choice.get("finish_reason") == "length":
            raise QuestionError(
                f"{self.url}: the reply of {model!r:.80} is cut off; let the server write longer replies"
            )
        message = choice.get("message") if isinstance(choice, dict) else None
        text = message.get("content") if isinstance(message, dict) else None
        if not isinstance(text, str):
            reason = "choices[0].message.content: expected a text"
            raise self._not_understood("/chat/completions", reason, document)
        return text

    def _request(self, path: str, body: dict[str, Any] | None) -> dict[str, Any]:
        """The JSON object that the server replies; `body` is posted, None is a GET."""
        deadline = time.monotonic() + self.timeout_s
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            self.url + path, data, {"Content-Type": "application/json", **_authorization()}
        )
        try:
            with self._opener.open(request, timeout=self.timeout_s) as response:
                content = self._read(response, deadline)
        except urllib.error.HTTPError as e:
            with e:
                raise self._refused(e, path, deadline) from e
        except EndpointError:
            raise
        except (OSError, http.client.HTTPException, ValueError) as e:
            raise self._failed(e) from e
        if not content.lstrip().startswith(b"{"):
            raise self._not_understood(path, "expected a JSON object", content.decode(errors="replace"))
        document: dict[str, Any] = parse_json(content, self.url + path, EndpointError)
        return document

    def _read(self, response: Any, deadline: float) -> bytes:
        content = bytearray()
        while chunk := response.read1(CHUNK_BYTES):
            content += chunk
            try:
                check_limit(len(content), "reply_bytes", f"{self.url}: the reply")
            except DataError as e:
                raise EndpointError(str(e)) from e
            if time.monotonic() > deadline:
                raise TimeoutError
        return bytes(content)

    def _refused(self, error: urllib.error.HTTPError, path: str, deadline: float) -> EndpointError:
        """The error of a status that is not 2xx, with what the server says about it."""
        try:
            said = _message(self._read(error, deadline))
        except (OSError, http.client.HTTPException):
            said = ""
        quoted = f": {said!r:.{QUOTED_CHARACTERS}}" if said else ""
        text = f"{self.url}: the server answers {error.code} to {path}{quoted}"
        if error.code in (HTTPStatus.NOT_FOUND, HTTPStatus.METHOD_NOT_ALLOWED):
            return _NoSuchPath(text)
        if error.code in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
            return EndpointError(f"{text}; set {KEY_VARIABLE} to a key that it takes")
        if HTTPStatus.MULTIPLE_CHOICES <= error.code < HTTPStatus.BAD_REQUEST:
            return EndpointError(f"{text}, a redirect; give the address that it leads to")
        return EndpointError(f"{text}; see the server's log, {LEAVE_OUT}")

    def _failed(self, error: Exception) -> EndpointError:
        """The error of a request without an answer."""
        reason = error.reason if isinstance(error, urllib.error.URLError) else error
        if isinstance(reason, TimeoutError):
            return EndpointError(f"{self.url}: no reply within {self.timeout_s:g} s; use a faster model, {LEAVE_OUT}")
        text = getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
        return EndpointError(f"{self.url}: no server answers ({text!r:.{QUOTED_CHARACTERS}}); start it, {LEAVE_OUT}")

    def _not_understood(self, path: str, why: str, found: Any) -> EndpointError:
        return EndpointError(
            f"{self.url}{path}: not the reply of an OpenAI-compatible server ({why}; found {found!r:.{QUOTED_CHARACTERS}}); "
            f"is the address right (it mostly ends in /v1)?"
        )


class _NoSuchPath(EndpointError):
    """The server answers 404 or 405."""


def _checked_url(url: str) -> str:
    expected = "expected an address such as http://localhost:8000/v1"
    try:
        parts = urlsplit(url)
        has_port = parts.port != 0
    except ValueError as e:
        raise QuestionError(f"parser is {url!r:.200} ({e}); {expected}") from e
    if parts.scheme not in ("http", "https") or not parts.hostname or not has_port or not re.fullmatch(r"[!-~]+", url):
        raise QuestionError(f"parser is {url!r:.200}; {expected}")
    if "@" in parts.netloc:
        raise QuestionError(
            f"parser: the address of {parts.hostname!r} holds a password; set {KEY_VARIABLE} in its place"
        )
    if parts.query or parts.fragment:
        raise QuestionError(f"parser is {url!r:.200}: has a ? or #; {expected}")
    return url.rstrip("/")


def _authorization() -> dict[str, str]:
    key = os.environ.get(KEY_VARIABLE, "")
    if not key:
        return {}
    if not re.fullmatch(r"[!-~]+", key):
        raise EndpointError(f"{KEY_VARIABLE}: has spaces or characters that no key has; set it again, or unset it")
    return {"Authorization": f"Bearer {key}"}


def _message(content: bytes) -> str:
    """What the body of an error says: `error.message` of JSON, or the text itself."""
    text = content.decode(errors="replace")
    try:
        error = json.loads(text)["error"]
        said = error["message"] if isinstance(error, dict) else error
    except (ValueError, KeyError, TypeError, RecursionError):
        said = text
    return " ".join(str(said).split())

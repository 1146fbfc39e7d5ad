"""The one place where JSON, gzip, NPZ and YAML files are read: every failure is an error that names the file.

Nothing is allocated before its size is checked against `nsdr.io.limits`, and nothing is unpickled.
"""

import codecs
import io
import json
import lzma
import math
import os
import stat
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.io.limits import check_limit, limits
from nsdr.validation import convert

__all__ = [
    "UNZIP_ERRORS",
    "parse_json",
    "parse_json_lines",
    "parse_typed",
    "read_bytes",
    "read_json",
    "read_json_bytes",
    "read_npz",
    "read_text",
    "read_typed",
    "read_yaml",
]

GZIP_MAGIC = b"\x1f\x8b"
"""First bytes of every gzip file."""
MAX_YAML_DEPTH = 50
"""Nesting of a YAML file: its parser takes minutes for thousands of levels."""
UNZIP_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    RuntimeError,
    LookupError,
    ValueError,
)
"""What damaged or encrypted zip archives raise, beside OSError."""
HEADER_ERRORS = (SyntaxError, TypeError, tokenize.TokenError)
"""What damaged headers of arrays raise."""
MAX_YAML_ALIASES = 20
"""Aliases in a YAML file: nested ones can stand for exponentially much."""

ErrorKind = Callable[[str], Exception]


@contextmanager
def _named(name: str, kind: str, error: ErrorKind) -> Iterator[None]:
    """Turn every way in which reading fails into one error that names the file."""
    try:
        yield
    except DataError as e:
        raise error(str(e)) from e
    except FileNotFoundError as e:
        raise error(f"{name}: no such file") from e
    except UnicodeDecodeError as e:
        raise error(f"{name}: not a readable {kind} (not UTF-8 text at byte {e.start})") from e
    except RecursionError as e:
        raise error(f"{name}: not a readable {kind} (nested too deeply)") from e
    except (*UNZIP_ERRORS, *HEADER_ERRORS, OSError, ArithmeticError, MemoryError) as e:
        reason = getattr(e, "strerror", None) or str(e) or type(e).__name__
        raise error(f"{name}: not a readable {kind} ({reason.splitlines()[0]})") from e


def read_bytes(path: str | Path, limit: str = "json_bytes", error: ErrorKind = DataError, kind: str = "file") -> bytes:
    """The content of a file.

    Args:
        path: the file.
        limit: the field of `nsdr.io.limits.Limits` that its size is checked against.
        error: makes the exception from a message that names the file.
        kind: what is expected, for the message.

    Raises:
        DataError: the file is missing, no regular file, unreadable or too large; with `error` given, what that returns.
    """
    with _named(str(path), kind, error):
        _check_regular(path, limit)
        return Path(path).read_bytes()


def _check_regular(path: str | Path, limit: str) -> None:
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        raise DataError(f"{path}: is a folder or a device; expected a file")
    check_limit(status.st_size, limit, str(path))


def read_text(
    path: str | Path, limit: str = "json_bytes", error: ErrorKind = DataError, kind: str = "text file"
) -> str:
    """The content of a UTF-8 text file; arguments and errors are those of `read_bytes`."""
    with _named(str(path), kind, error):
        return read_bytes(path, limit, error, kind).decode("utf-8-sig")


def read_json(path: str | Path, error: ErrorKind = DataError) -> Any:
    """The content of a JSON file, which may be gzipped.

    Args:
        path: the file.
        error: makes the exception from a message that names the file.

    Raises:
        DataError: the file is missing or not JSON; with `error` given, what that returns.
    """
    return parse_json(read_bytes(path, "json_bytes", error, "JSON file"), str(path), error)


def read_json_bytes(path: str | Path) -> bytes:
    """The bytes of a JSON file, decompressed and without a byte order mark; raises `DataError` as `read_bytes`."""
    data = read_bytes(path, "json_bytes", DataError, "JSON file")
    with _named(str(path), "JSON file", DataError):
        content = _gunzipped(data, str(path)) if data.startswith(GZIP_MAGIC) else data
    return content.removeprefix(codecs.BOM_UTF8)


def parse_json(data: bytes, name: str, error: ErrorKind = DataError, unique: bool = False) -> Any:
    """Parse JSON from bytes, which may be gzipped.

    Args:
        data: the bytes.
        name: where they come from, for the error message.
        error: makes the exception from a message that names the file.
        unique: refuse objects that have a key twice, which takes longer.

    Raises:
        DataError: not JSON, or it holds NaN, Infinity or characters that are not Unicode; names `name`.
    """
    with _named(name, "JSON file", error):
        return _parsed(_gunzipped(data, name) if data.startswith(GZIP_MAGIC) else data, unique)


def _parsed(data: bytes, unique: bool = False) -> Any:
    text = data.decode("utf-8-sig")
    value = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_refuse_twice if unique else None)
    if "\\ud" in text or "\\uD" in text:
        json.dumps(value, ensure_ascii=False).encode()  # lone surrogates cannot be encoded
    return value


def parse_json_lines(data: bytes, name: str) -> Iterator[tuple[int, Any]]:
    """(line number from 1, value) of each line of a JSON Lines file; empty lines are passed over.

    Raises:
        DataError: a line is not JSON, or has a key twice; names `name` and the line.
    """
    for number, line in enumerate(data.splitlines(), 1):
        if line.strip():
            yield number, parse_json(line, f"{name}, line {number}", unique=True)


def read_typed(path: str | Path, kind: Any) -> Any:
    """The content of a JSON file, which may be gzipped, as a value of a type (`nsdr.validation.convert`).

    Raises:
        DataError: the file is missing, not JSON, or does not fit; names the file, the place, what was expected and found.
    """
    return parse_typed(read_bytes(path, "json_bytes", DataError, "JSON file"), str(path), kind)


def parse_typed(data: bytes, name: str, kind: Any) -> Any:
    """As `read_typed`, from bytes; `name` says where they come from."""
    with _named(name, "JSON file", DataError):
        content = _gunzipped(data, name) if data.startswith(GZIP_MAGIC) else data
        content.decode()  # msgspec does not look at what no type asks for
    try:
        return _decoder(kind).decode(content.removeprefix(codecs.BOM_UTF8))
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, OverflowError):
        with _named(name, "JSON file", DataError):
            value = _parsed(content)
        return convert(value, kind, f"{name}: ")  # says what is wrong, and where


@lru_cache(maxsize=32)
def _decoder(kind: Any) -> msgspec.json.Decoder[Any]:
    return msgspec.json.Decoder(kind)


def read_npz(path: str | Path, error: ErrorKind = DataError) -> dict[str, NDArray[Any]]:
    """All arrays of an NPZ file, read-only.

    Raises:
        DataError: the file is missing or damaged, holds Python objects, or an array's header asks for more than is stored or
            than `Limits.array_bytes`; names the file and the array. With `error` given, what that returns.
    """
    data = io.BytesIO(read_bytes(path, "array_bytes", error, "NPZ file"))
    with _named(str(path), "NPZ file", error), zipfile.ZipFile(data) as archive:
        members = archive.infolist()
        check_limit(sum(m.file_size for m in members), "array_bytes", str(path))
        return {m.filename.removesuffix(".npy"): _read_array(archive, m, str(path)) for m in members}


def read_yaml(path: str | Path) -> Any:
    """The content of a YAML file.

    Raises:
        DataError: the file is missing, too large, not YAML, or uses more than a few aliases; names the file.
    """
    import yaml

    text = read_text(path, "yaml_bytes", kind="YAML file")
    with _named(str(path), "YAML file", DataError):
        try:
            aliases = depth = 0
            for event in yaml.parse(text, yaml.SafeLoader):
                aliases += isinstance(event, yaml.AliasEvent)
                depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
                if aliases > MAX_YAML_ALIASES:
                    raise DataError(f"{path}: more than {MAX_YAML_ALIASES} aliases; write the values out")
                if depth > MAX_YAML_DEPTH:
                    raise DataError(f"{path}: nested more than {MAX_YAML_DEPTH} deep")
            return yaml.safe_load(text)
        except yaml.YAMLError as e:
            raise ValueError(" ".join(str(e).split())) from e


def _gunzipped(data: bytes, name: str) -> bytes:
    stream = zlib.decompressobj(wbits=31)
    content = stream.decompress(data, limits().json_bytes + 1)
    check_limit(len(content), "json_bytes", f"{name}, decompressed")
    if stream.unused_data:
        raise ValueError("data after the end of the compressed data")
    if not stream.eof:
        raise EOFError("compressed data end too early")
    return content


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> NDArray[Any]:
    with _named(f"{name}: {member.filename}", "array", DataError), archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in read_header:
            raise ValueError(f"version {version} of the NPY format")
        shape, fortran_order, dtype = read_header[version](file)
        needed, stored = math.prod(shape) * dtype.itemsize, member.file_size - file.tell()
        if dtype.hasobject or min(shape, default=0) < 0 or needed != stored:
            raise ValueError(f"shape {shape} of {dtype} does not fit the {stored} stored bytes")
        array = np.frombuffer(file.read(), dtype, math.prod(shape))
    return array.reshape(shape[::-1]).T if fortran_order else array.reshape(shape)


def _refuse_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object with these keys and values."""
    made = dict(pairs)
    if len(made) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key {next(key for key in keys if keys.count(key) > 1)!r:.60} is there twice")
    return made


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")

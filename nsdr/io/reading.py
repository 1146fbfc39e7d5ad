"""The one place where JSON, gzip, NPZ and YAML files are read: every failure is an error that names the file.

Nothing is allocated before its size is checked against `nsdr.io.limits`, and nothing is unpickled.
"""

import codecs
import io
import json
import os
import stat
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError, MachineError, machine_error
from nsdr.io.files import check_name
from nsdr.io.limits import check_limit, limits
from nsdr.validation import said

GZIP_MAGIC = b"\x1f\x8b"
"""First bytes of every gzip file."""
MAX_YAML_DEPTH = 50
"""Nesting of a YAML file: its parser takes minutes for thousands of levels."""
MAX_YAML_ALIASES = 20
"""Aliases in a YAML file: nested ones can stand for exponentially much."""


@contextmanager
def _named(name: str, kind: str) -> Iterator[None]:
    """Turn every way in which libraries fail to read a damaged file, some undocumented, into one error that names it."""
    try:
        yield
    except (DataError, MachineError):
        raise
    except FileNotFoundError as e:
        raise DataError(f"{name}: no such file") from e
    except UnicodeDecodeError as e:
        raise DataError(f"{name}: not a readable {kind} (not UTF-8 text at byte {e.start})") from e
    except RecursionError as e:
        raise DataError(f"{name}: not a readable {kind} (nested too deeply)") from e
    except Exception as e:
        if failure := machine_error(e, name):
            raise failure from e
        reason = getattr(e, "strerror", None) or str(e) or type(e).__name__
        raise DataError(f"{name}: not a readable {kind} ({reason.splitlines()[0]})") from e


def read_bytes(path: str | Path, limit: str = "json_bytes", kind: str = "file") -> bytes:
    """The content of a file.

    Args:
        path: the file.
        limit: the field of `nsdr.io.limits.Limits` that its size is checked against.
        kind: what is expected, for the message.

    Raises:
        DataError: the file is missing, no regular file, unreadable or too large.
    """
    check_name(path)
    with _named(str(path), kind):
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            raise DataError(f"{path}: is a folder or a device; expected a file")
        check_limit(status.st_size, limit, str(path))
        return Path(path).read_bytes()


def read_text(path: str | Path, limit: str = "json_bytes", kind: str = "text file") -> str:
    """The content of a UTF-8 text file; arguments and errors are those of `read_bytes`."""
    with _named(str(path), kind):
        return read_bytes(path, limit, kind).decode("utf-8-sig")


def read_json(path: str | Path, kind: Any = Any) -> Any:
    """The content of a JSON file; arguments and errors are those of `parse_json`, or the file is missing or too large."""
    return parse_json(read_bytes(path, kind="JSON file"), str(path), kind)


def read_json_bytes(path: str | Path) -> bytes:
    """The bytes of a JSON file, decompressed and without a byte order mark. The errors are those of `read_bytes`."""
    with _named(str(path), "JSON file"):
        return _text(read_bytes(path, kind="JSON file"), str(path))


def parse_json(data: bytes, name: str, kind: Any = Any) -> Any:
    """Parse JSON from bytes, which may be gzipped.

    Args:
        data: the bytes.
        name: where they come from, for the error message.
        kind: type of the content: a msgspec structure, a `TypedDict`, or a type made of them.

    Raises:
        DataError: not JSON (NaN and Infinity are not), or the content is of another type: names `name`, what was expected, and
            the place.
    """
    with _named(name, "JSON file"):
        text = _text(data, name)
        try:
            return msgspec.json.decode(text, type=kind)
        except msgspec.ValidationError as e:
            raise DataError(f"{name}: {said(e)}") from e


def parse_json_lines(data: bytes, name: str) -> Iterator[tuple[int, Any]]:
    """(line number from 1, value) of each line of a JSON Lines file; empty lines are skipped.

    Raises:
        DataError: a line is not JSON, or has a key twice; names `name` and the line.
    """
    for number, line in enumerate(data.splitlines(), 1):
        if line.strip():
            place = f"{name}, line {number}"
            value = parse_json(line, place)
            with _named(place, "JSON file"):
                json.loads(line, object_pairs_hook=_refuse_twice)
            yield number, value


def is_json_lines(data: bytes) -> bool:
    """Whether the first line of a JSON text is an object, and more lines follow."""
    first, _, rest = data.lstrip().partition(b"\n")
    if not (first.startswith(b"{") and rest.strip()):
        return False
    try:
        msgspec.json.decode(first, type=dict[str, msgspec.Raw])
    except msgspec.DecodeError:
        return False
    return True


def _refuse_twice(pairs: list[tuple[str, Any]]) -> None:
    for key, times in Counter(key for key, _ in pairs).items():
        if times > 1:
            raise ValueError(f"the key {key!r:.60} is there twice")


def _text(data: bytes, name: str) -> bytes:
    """JSON text in UTF-8, decompressed and without a byte order mark."""
    if data.startswith(GZIP_MAGIC):
        stream = zlib.decompressobj(wbits=31)
        data = stream.decompress(data, limits().json_bytes + 1)
        check_limit(len(data), "json_bytes", f"{name}, decompressed")
        if stream.unused_data:
            raise ValueError("data after the end of the compressed data")
        if not stream.eof:
            raise EOFError("compressed data end too early")
    data.decode()  # msgspec does not look at what no type asks for
    return data.removeprefix(codecs.BOM_UTF8)


def read_npz(path: str | Path) -> dict[str, NDArray[Any]]:
    """All arrays of an NPZ file.

    Raises:
        DataError: the file is missing or damaged, holds Python objects, or more than `Limits.array_bytes`; names the file and
            the array.
    """
    data, arrays = io.BytesIO(read_bytes(path, "array_bytes", kind="NPZ file")), {}
    with _named(str(path), "NPZ file"), zipfile.ZipFile(data) as archive:
        check_limit(sum(m.file_size for m in archive.infolist()), "array_bytes", str(path))
        for name in archive.namelist():
            with _named(f"{path}: {name}", "array"), archive.open(name) as file:
                arrays[name.removesuffix(".npy")] = np.lib.format.read_array(file, allow_pickle=False)
    return arrays


def read_yaml(path: str | Path) -> Any:
    """The content of a YAML file.

    Raises:
        DataError: the file is missing, too large, not YAML, or uses more than a few aliases; names the file.
    """
    import yaml

    text = read_text(path, "yaml_bytes", kind="YAML file")
    with _named(str(path), "YAML file"):
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

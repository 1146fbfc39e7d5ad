"""Wrong arrays in NPZ files."""

import gzip
import io
import pickle
import struct
import zipfile
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tests.robustness.case import Case, text_writer
from tests.robustness.files import Damage, flipped, from_good
from tests.robustness.good import COMMANDS, compact_arrays


def _npz_bytes(arrays: dict[str, Any]) -> bytes:
    """An NPZ file with these arrays; bytes are written as a member's raw content."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            if isinstance(array, bytes):
                member.write(array)
            else:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=True)
            archive.writestr(f"{name}.npy", member.getvalue())
    return buffer.getvalue()


def _npy_header(shape: str, dtype: str = "<f8") -> bytes:
    """An NPY member that promises more than it holds."""
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + b"\x00" * 64


ARRAY_CHANGES: dict[str, Callable[[Any], Any]] = {
    "text": lambda a: a.astype(str),
    "objects": lambda a: a.astype(object),
    "fractions": lambda a: a.astype(float) + 0.5,
    "NaN": lambda a: np.full(a.shape, np.nan),
    "complex": lambda a: a.astype(complex),
    "times": lambda a: a.astype("datetime64[s]"),
    "one row missing": lambda a: a[:-1],
    "one axis more": lambda a: a[..., None],
    "single number": lambda a: a.ravel()[0],
    "empty": lambda a: a[:0],
    "negative": lambda a: -a.astype(np.int64) - 1,
    "huge": lambda a: a.astype(np.int64) + 2**40,
    "header of 10^11 numbers": lambda a: _npy_header("(100000000000,)"),
    "header of negative shape": lambda a: _npy_header("(-8,)"),
    "header of words": lambda a: _npy_header("('a',)"),
    "header of objects": lambda a: _npy_header("(8,)", "|O"),
    "header of an unknown type": lambda a: _npy_header("(8,)", "zebra"),
    "header without end": lambda a: b"\x93NUMPY\x01\x00\xff\xff{",
    "member is no array": lambda a: b"zebra",
    "member is empty": lambda a: b"",
}
"""Ways to make an array wrong."""
ROW_CHANGES: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "unsorted frames": ("frame", lambda a: a[::-1]),
    "unsorted videos": ("video", lambda a: np.r_[a[:-1], a[-1] - 1]),
    "frame beyond the limit": ("frame", lambda a: np.r_[a[:-1], 65_000]),
    "unknown attributes": ("attr", lambda a: np.full(len(a), 200)),
    "score above 255": ("score", lambda a: np.full(len(a), 300)),
    "box inverted": ("box", lambda a: a[:, [2, 3, 0, 1]]),
    "box outside the image": ("box", lambda a: a + 5000),
    "box of three sides": ("box", lambda a: a[:, :3]),
    "centroid outside the image": ("cx64", lambda a: np.full(len(a), 65_000)),
    "area of zero": ("area", lambda a: a * 0),
    "area larger than the image": ("area", lambda a: np.full(len(a), 4_000_000_000, np.uint32)),
}


def archive_cases() -> Iterator[Case]:
    """All wrong arrays."""
    argv, file = COMMANDS["compact"], "proposals.npz"
    good = compact_arrays()
    for array in good:
        rest = {k: v for k, v in good.items() if k != array}
        yield Case("compact, remove", array, argv, text_writer(file, _npz_bytes(rest)), file, array)
        for name, change in ARRAY_CHANGES.items():
            place = "" if name in ("one row missing", "empty") else array  # the others do not fit either
            data = _npz_bytes({**good, array: change(good[array])})
            yield Case("compact, array", f"{array}: {name}", argv, text_writer(file, data), file, place)
    for name, (array, change) in ROW_CHANGES.items():
        data = _npz_bytes({**good, array: change(good[array])})
        yield Case("compact, value", name, argv, text_writer(file, data), file)
    many = {k: np.concatenate([v[:1]] * 240 + [v]) for k, v in good.items()}
    yield Case("compact, value", "240 objects in a frame", argv, text_writer(file, _npz_bytes(many)), file)
    for name, damage in NPZ_DAMAGES.items():
        yield Case("compact, file", name, argv, from_good(file, damage), file)


def _with_field(data: bytes, local: int, central: int, value: int) -> bytes:
    """Sets a field of two bytes in the header of every member, at these offsets of its two copies."""
    changed = bytearray(data)
    for signature, offset in ((b"PK\x03\x04", local), (b"PK\x01\x02", central)):
        start = changed.find(signature)
        while start >= 0:
            changed[start + offset : start + offset + 2] = struct.pack("<H", value)
            start = changed.find(signature, start + 4)
    return bytes(changed)


def _encrypted(data: bytes) -> bytes:
    return _with_field(data, 6, 8, 1)


def _unknown_method(data: bytes) -> bytes:
    return _with_field(data, 8, 10, 99)


NPZ_DAMAGES: dict[str, Damage] = {
    "empty": lambda data: b"",
    "half": lambda data: data[: len(data) // 2],
    "last byte missing": lambda data: data[:-1],
    "byte flipped": flipped,
    "zero bytes": lambda data: b"\x00" * len(data),
    "text": lambda data: b"zebra",
    "JSON": lambda data: b"{}",
    "single array": lambda data: _npy_header("(8,)"),
    "pickle": lambda data: pickle.dumps([1]),
    "empty archive": lambda data: _npz_bytes({}),
    "encrypted": _encrypted,
    "unknown method": _unknown_method,
    "compressed": gzip.compress,
}
"""Ways to damage an NPZ file."""

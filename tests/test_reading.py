"""Damaged and hostile files: each is an error that names the file, and none takes much memory."""

import gzip
import io
import json
import re
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from nsdr.errors import DataError
from nsdr.io.limits import VARIABLE, Limits, check_limit, limits
from nsdr.io.reading import parse_json, parse_json_lines, read_bytes, read_json, read_npz, read_text, read_yaml

GOOD = json.dumps({"scenes": [{"index": 1, "text": "é"}], "values": [0.5, -3]}).encode()
GZIPPED = gzip.compress(GOOD, mtime=0)


def npy(shape: str, dtype: str = "<f8", data: bytes = b"") -> bytes:
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + data


def npz(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "truncated"),
        (b"[" * 100_000 + b"]" * 100_000, "nested too deeply"),
        (b'{"a": ' + b"9" * 5_000 + b"}", "out of range"),
        (GOOD.decode().encode("utf-16"), "not UTF-8 text at byte 0"),
        (GOOD[:-4], "truncated"),
        (GOOD + b"garbage", "trailing characters"),
        (b'{"a": NaN}', "invalid character"),
        (b'{"a": -Infinity}', "invalid character"),
        (b'{"a": "\\ud800"}', "truncated"),
        (GZIPPED[:-9], "end too early"),
        (GZIPPED + b"more", "data after the end"),
        (GZIPPED[:20] + b"\x00" + GZIPPED[21:], ""),
    ],
    ids=range(12),
)
def test_bad_json_is_refused_by_name(content, reason, tmp_path) -> None:
    path = tmp_path / "bad.json"
    path.write_bytes(content)
    with pytest.raises(DataError, match=rf"bad\.json: .*{re.escape(reason)}"):
        read_json(path)


def test_json_may_be_gzipped_and_have_a_byte_order_mark() -> None:
    assert parse_json(GZIPPED, "x") == parse_json(b"\xef\xbb\xbf" + GOOD, "x") == json.loads(GOOD)


def test_json_lines_name_the_line() -> None:
    assert list(parse_json_lines(b'{"a": 1}\n\n[2]\n', "x")) == [(1, {"a": 1}), (3, [2])]
    with pytest.raises(DataError, match="x, line 2: not a readable JSON file"):
        list(parse_json_lines(b"1\n{\n", "x"))


def test_files_that_are_not_there_or_no_files(tmp_path) -> None:
    with pytest.raises(DataError, match=r"gone\.json: no such file"):
        read_json(tmp_path / "gone.json")
    with pytest.raises(DataError, match="is a folder or a device; expected a file"):
        read_bytes(tmp_path)
    with pytest.raises(DataError, match="is a folder or a device; expected a file"):
        read_bytes("/dev/zero")
    with pytest.raises(DataError, match="not a readable"):
        read_text("null\0character")


def test_compressed_files_are_limited_before_they_fill_the_memory(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "json_bytes=1e6,array_bytes=1e6")
    bomb = gzip.compress(b" " * 50_000_000)
    assert len(bomb) < 100_000
    with pytest.raises(
        DataError, match=r"bomb, decompressed: 1,000,001 json_bytes, more than 1,000,000; .*NSDR_LIMITS"
    ):
        parse_json(bomb, "bomb")
    path = npz(tmp_path / "bomb.npz", a=npy("(6250000,)", data=bytes(50_000_000)))
    with pytest.raises(DataError, match=r"bomb\.npz: 50,000,128 array_bytes"):
        read_npz(path)


@pytest.mark.parametrize(
    ("member", "reason"),
    [
        (npy("(300000000,)", data=bytes(80)), "reading array data"),
        (npy("(-1,)"), "negative dimensions"),
        (npy("(2,)", "|O", bytes(16)), "Object arrays"),
        (b"\x93NUMPY\x09\x00", "version"),
        (b"nothing", "magic"),
    ],
)
def test_arrays_whose_header_lies_are_refused(member, reason, tmp_path) -> None:
    with pytest.raises(DataError, match=rf"bad\.npz: a\.npy: not a readable array \(.*{reason}"):
        read_npz(npz(tmp_path / "bad.npz", a=member))


def test_arrays_come_back_as_they_were_saved(tmp_path) -> None:
    arrays = {
        "a": np.arange(6).reshape(2, 3),
        "f": np.asfortranarray(np.ones((3, 2))),
        "s": np.array("text"),
        "e": np.zeros(0),
    }
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    read = read_npz(tmp_path / "a.npz")
    assert read.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(read[name], array)
        assert read[name].dtype == array.dtype


@pytest.mark.parametrize(
    "content", [b"a: [1", b"\x00\x01\x02", b"\xff\xfe", b"a: &x [1]\n" + b"b: [" + b"*x, " * 30 + b"]"]
)
def test_bad_yaml_is_refused_by_name(content, tmp_path) -> None:
    (tmp_path / "bad.yaml").write_bytes(content)
    with pytest.raises(DataError, match=r"bad\.yaml"):
        read_yaml(tmp_path / "bad.yaml")


def test_limits_can_be_changed_and_are_checked(monkeypatch) -> None:
    assert limits() == Limits()
    monkeypatch.setenv(VARIABLE, "frames=20000, events=5")
    assert (limits().frames, limits().events) == (20_000, 5)
    check_limit(5, "events", "x")
    with pytest.raises(DataError, match="x: 6 events, more than 5; if this is right, set NSDR_LIMITS=events=…"):
        check_limit(6, "events", "x")
    for text in ("frame=3", "frames=many", "frames=0", "frames=inf"):
        monkeypatch.setenv(VARIABLE, text)
        with pytest.raises(DataError, match=r"limit 'frame.*expected NAME=NUMBER, with a name of array_bytes,"):
            limits()


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_changed_bytes_never_crash_a_reader(data, tmp_path) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, a=np.arange(30), b=np.ones((2, 2)))
    sources = {
        "a.json": GOOD,
        "a.json.gz": gzip.compress(GOOD, mtime=0),
        "a.npz": buffer.getvalue(),
        "a.yaml": b"a: 1\nb: [2, x]\n",
    }
    name = data.draw(st.sampled_from(sorted(sources)))
    content = bytearray(sources[name])
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))]
    path = tmp_path / name
    path.write_bytes(content)
    reader = {".npz": read_npz, ".yaml": read_yaml}.get(path.suffix, read_json)
    with suppress(DataError):
        reader(path)

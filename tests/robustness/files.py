"""Damaged files of every format, and videos: cut off, flipped, in another encoding, compressed without end, or none."""

import gzip
import os
import pickle
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from nsdr.clevrer.example import VIDEO
from tests.robustness.case import Case, Write, text_writer
from tests.robustness.documents import document_writer, put_beside
from tests.robustness.good import COMMANDS, DOCUMENTS, gray_video

BOMB_BYTES = 4_300_000_000
"""What a gzip bomb becomes."""
Damage = Callable[[bytes], bytes]


def flipped(data: bytes) -> bytes:
    """The byte in the middle inverted."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 0xFF]) + data[middle + 1 :]


def gzip_bomb() -> bytes:
    """A small file that becomes `BOMB_BYTES` of spaces; the same compressed megabyte over and over."""
    packer = zlib.compressobj(9, wbits=-15)
    block = packer.compress(b" " * (1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    header = b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\x03"
    return header + block * (BOMB_BYTES >> 20) + b"\x03\x00" + struct.pack("<II", 0, BOMB_BYTES % (1 << 32))


def _not_gzipped(damage: Damage) -> Damage:
    return lambda data: damage(gzip.decompress(data) if data.startswith(b"\x1f\x8b") else data)


DAMAGES: dict[str, Damage] = {
    "empty": lambda data: b"",
    "blanks": lambda data: b" \n\n ",
    "third": _not_gzipped(lambda data: data[: len(data) // 3]),
    "two thirds": _not_gzipped(lambda data: data[: 2 * len(data) // 3]),
    "last byte missing": _not_gzipped(lambda data: data[:-1]),
    "byte flipped": _not_gzipped(flipped),
    "UTF-16": _not_gzipped(lambda data: data.decode().encode("utf-16")),
    "UTF-32": _not_gzipped(lambda data: data.decode().encode("utf-32")),
    "Latin-1": _not_gzipped(lambda data: data.replace(b"red", "r\xe9d".encode("latin-1"), 1) + b"\xe9"),
    "zero bytes": _not_gzipped(lambda data: b"\x00" * len(data)),
    "random bytes": lambda data: np.random.default_rng(0).bytes(1000),
    "100,000 brackets": lambda data: b"[" * 100_000,
    "100,000 pairs of brackets": lambda data: b"[" * 100_000 + b"]" * 100_000,
    "100,000 braces": lambda data: b'{"objects":' * 100_000,
    "trailing bracket": _not_gzipped(lambda data: data + b"]"),
    "trailing text": _not_gzipped(lambda data: data + b" zebra"),
    "two documents": _not_gzipped(lambda data: data + data),
    "number": lambda data: b"5",
    "text": lambda data: b'"zebra"',
    "null": lambda data: b"null",
    "empty list": lambda data: b"[]",
    "empty object": lambda data: b"{}",
    "list of null": lambda data: b"[null]",
    "no JSON": lambda data: b"scene_index,video\n10000,video_10000.mp4\n",
    "single quotes": _not_gzipped(lambda data: data.replace(b'"', b"'")),
    "pickle": lambda data: pickle.dumps({"objects": [1, 2]}),
    "video": lambda data: VIDEO.read_bytes()[:10_000],
    "compressed, cut off": _not_gzipped(lambda data: gzip.compress(data)[:-20]),
    "compressed, header only": lambda data: b"\x1f\x8b\x08",
    "compressed, byte flipped": _not_gzipped(lambda data: flipped(gzip.compress(data))),
    "compressed, trailing text": _not_gzipped(lambda data: gzip.compress(data) + b"zebra"),
    "compressed twice": _not_gzipped(lambda data: gzip.compress(gzip.compress(data))),
    "compressed without end": lambda data: gzip_bomb(),
}  # fmt: skip
"""Ways to damage a JSON file."""


def _place(kind: str, write: Write) -> Write:
    def beside(folder: Path, good: Path) -> None:
        put_beside(kind, folder, good)
        write(folder, good)

    return beside


def _damaged(kind: str, damage: Damage) -> Write:
    file = DOCUMENTS[kind][0]

    def write(folder: Path, good: Path) -> None:
        document_writer(kind)(lambda document: None)(folder, good)
        (folder / file).write_bytes(damage((folder / file).read_bytes()))

    return write


def _json_file_cases() -> Iterator[Case]:
    for kind, (file, *_) in DOCUMENTS.items():
        argv = COMMANDS[kind]
        rule = f"{kind}, file"
        for name, damage in DAMAGES.items():
            if (name, DOCUMENTS[kind][2]) not in (("empty list", "list"), ("empty object", "object")):
                yield Case(rule, name, argv, _damaged(kind, damage), file)
        yield Case(rule, "folder", argv, _place(kind, lambda folder, _, file=file: (folder / file).mkdir()), file)
        yield Case(rule, "pipe", argv, _place(kind, lambda folder, _, file=file: os.mkfifo(folder / file)), file)
        link = lambda folder, _, file=file: (folder / file).symlink_to("nowhere")  # noqa: E731
        yield Case(rule, "link to nowhere", argv, _place(kind, link), file)
        loop = lambda folder, _, file=file: (folder / file).symlink_to(file)  # noqa: E731
        yield Case(rule, "link to itself", argv, _place(kind, loop), file)
        if kind != "manifest":
            yield Case(rule, "missing", argv, lambda folder, _: None, file)


def from_good(file: str, damage: Damage) -> Write:
    """Writes a damaged copy of a good file."""
    return lambda folder, good: (folder / file).write_bytes(damage((good / file).read_bytes()))


VIDEO_DAMAGES: dict[str, Damage] = {
    "empty": lambda data: b"",
    "text": lambda data: b"zebra",
    "half": lambda data: data[: len(data) // 2],
    "header only": lambda data: data[:40],
    "random bytes": lambda data: np.random.default_rng(0).bytes(10_000),
    "zero bytes": lambda data: b"\x00" * 10_000,
    "no index": lambda data: data.replace(b"moov", b"zzzz"),
    "no frames": lambda data: data.replace(b"stsz", b"free"),
    "JSON": lambda data: b"{}",
    "list of files": lambda data: b"#EXTM3U\n#EXTINF:10,\nfile:///etc/passwd\n",
    "script": lambda data: b"ffconcat version 1.0\nfile '/etc/passwd'\n",
}
"""Ways to damage a video."""


MADE: dict[str, tuple[int, tuple[int, int], float]] = {
    "one frame": (1, (480, 320), 25.0),
    "nothing to see": (12, (480, 320), 25.0),
    "frames too large": (2, (5000, 4000), 25.0),
    "frames of 2 px": (12, (2, 2), 25.0),
    "0.1 frames per second": (60, (480, 320), 0.1),
    "10,000 frames per second": (30, (480, 320), 10_000.0),
}
"""Videos of gray frames: number, width and height (px), and rate (1/s)."""


def _video_cases() -> Iterator[Case]:
    commands = {
        "answer": ("answer", "video.mp4", "How many collisions happen?"),
        "parse": ("parse", "video.mp4", "-o", "scene.json"),
        "visualize": ("visualize", "video.mp4", "-o", "image.png"),
    }
    for command, argv in commands.items():
        for name, damage in VIDEO_DAMAGES.items():
            if command != "answer" and name not in ("empty", "half", "text"):
                continue  # all commands read videos in one place
            yield Case(f"video, {command}", name, argv, from_good("video.mp4", damage), "video.mp4")
        for name, made in MADE.items() if command == "answer" else ():
            yield Case(
                f"video, {command}", name, argv, lambda f, _, made=made: gray_video(f / "video.mp4", *made), "video.mp4"
            )
        yield Case(f"video, {command}", "folder", argv, lambda folder, _: (folder / "video.mp4").mkdir(), "video.mp4")
        yield Case(f"video, {command}", "pipe", argv, lambda folder, _: os.mkfifo(folder / "video.mp4"), "video.mp4")
        yield Case(f"video, {command}", "missing", argv, named="video.mp4")
    folder = ("parse", "videos", "-o", "out", "--workers", "1")
    yield Case("video, folder", "missing", folder, named="videos")
    yield Case("video, folder", "empty", folder, lambda f, _: (f / "videos").mkdir(), "videos")
    yield Case("video, folder", "without videos", folder, text_writer("videos/a.txt", "zebra"), "videos")
    yield Case("video, folder", "file", folder, text_writer("videos", "zebra"), "videos")


def file_cases() -> Iterator[Case]:
    """All damaged files but for arrays."""
    yield from _json_file_cases()
    yield from _video_cases()

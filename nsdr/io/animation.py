"""How long each frame of an animated GIF, WebP or PNG is shown, from the headers of the file's blocks. Nothing is decoded."""

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import BinaryIO

from nsdr.errors import VideoError
from nsdr.io.limits import check_limit

MAX_EXTENSION_BYTES = 1_000_000
"""Comments and other extensions of a GIF (bytes). Pillow copies a comment once for each of its blocks of 255 bytes: one of 2 MB
costs it 8 GB of copying."""
MAX_BLOCKS = 1_000_000
"""Blocks of a GIF, with those of its images and extensions, or chunks of a PNG or WebP. Even empty ones cost time."""
REMEDY = "convert it, such as by: ffmpeg -i IN OUT.mp4"
"""What to do about a file with too much of something."""
Blocks = Iterator[float | None]
"""For each block that begins a frame, how long this frame is shown (milliseconds); None for other blocks."""


def frame_durations_ms(path: Path) -> list[float]:
    """How long each frame is shown (milliseconds; 0 if the file does not say). The list is empty for any other kind of file.

    Raises:
        VideoError: more frames than `Limits.frames` or blocks than `MAX_BLOCKS`, a header that is cut off, or a GIF with
            more than `MAX_EXTENSION_BYTES`.
    """
    durations: list[float] = []
    with path.open("rb") as file:
        head = file.read(12)
        file.seek(0)
        if head.startswith(b"GIF8"):
            found = _of_gif(file, path)
        elif head.startswith(b"\x89PNG"):
            found = _of_png(file)
        elif head.startswith(b"RIFF") and head[8:] == b"WEBP":
            found = _of_webp(file)
        else:
            return []
        try:
            for n_blocks, duration in enumerate(found, 1):
                if n_blocks > MAX_BLOCKS:
                    raise VideoError(f"{path}: more than {MAX_BLOCKS:,} blocks; {REMEDY}")
                if duration is not None:
                    durations.append(duration)
                    check_limit(len(durations), "frames", path, VideoError)
        except EOFError as e:
            raise VideoError(f"{path}: a damaged image, or cut off") from e
    return durations


def _of_gif(file: BinaryIO, path: Path) -> Blocks:
    _skip_colors(file, _exactly(file, 13)[10])
    duration, extension_bytes = 0.0, 0
    while (kind := file.read(1)) not in (b"", b";"):
        yield None
        if kind == b"!":
            label, first = _exactly(file, 1), file.read(_size(file))
            if label == b"\xf9":  # the graphic control extension, about the next frame
                duration = 10.0 * int.from_bytes(first[1:3], "little")
            extension_bytes += len(first) + ((yield from _skipped(file)) if first else 0)
            if extension_bytes > MAX_EXTENSION_BYTES:
                raise VideoError(
                    f"{path}: comments and extensions of more than {MAX_EXTENSION_BYTES:,} bytes; {REMEDY}"
                )
        elif kind == b",":
            _skip_colors(file, _exactly(file, 9)[8])
            _exactly(file, 1)
            yield from _skipped(file)
            yield duration
            duration = 0.0


def _of_png(file: BinaryIO) -> Blocks:
    file.seek(8)
    started = False
    while header := file.read(8):
        yield None
        size, kind = int.from_bytes(header[:4]), header[4:]
        if kind == b"fcTL":
            control = _exactly(file, size)
            delay, per_second = int.from_bytes(control[20:22]), int.from_bytes(control[22:24])
            yield delay / (per_second or 100) * 1000
            size, started = 0, True
        elif kind == b"IDAT" and not started:
            yield 0.0  # an image that is not part of the animation comes first
            started = True
        file.seek(size + 4, 1)  # with the checksum


def _of_webp(file: BinaryIO) -> Blocks:
    file.seek(12)
    while header := file.read(8):
        yield None
        size = int.from_bytes(header[4:], "little")
        if header[:4] == b"ANMF":
            yield float(int.from_bytes(_exactly(file, 16)[12:15], "little"))
            size -= 16
        file.seek(max(size + size % 2, 0), 1)


def _skip_colors(file: BinaryIO, flags: int) -> None:
    if flags & 128:
        _exactly(file, 3 << (flags & 7) + 1)


def _skipped(file: BinaryIO) -> Generator[None, None, int]:
    """Skip the blocks of an image or extension; returns their size (bytes)."""
    skipped = 0
    while size := _size(file):
        yield
        file.seek(size, 1)
        skipped += size
    return skipped


def _size(file: BinaryIO) -> int:
    """The size of the next block of a GIF; 0 at the end of the blocks or of the file."""
    return int.from_bytes(file.read(1))


def _exactly(file: BinaryIO, size: int) -> bytes:
    if len(data := file.read(size)) < size:
        raise EOFError
    return data

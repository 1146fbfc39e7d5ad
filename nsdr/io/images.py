"""Videos that are images: frames in memory, animated GIF, WebP and PNG, and folders with one image a frame."""

import re
import statistics
import struct
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from nsdr.errors import DataError, VideoError, machine_error
from nsdr.io.animation import frame_durations_ms
from nsdr.io.files import is_hidden
from nsdr.io.limits import check_limit
from nsdr.world.vocabulary import indefinite

FORMATS = ("GIF", "JPEG", "PNG", "WEBP")
"""Formats that are read."""
FRAME_SUFFIXES = (".png", ".jpg", ".jpeg")
"""Endings of the names of files that are frames of a folder."""
MIN_SECONDS = 0.02
"""Shortest duration of a frame that says something about the rate of an animated image (s): each player replaces shorter ones
by a duration of its own."""


UNREADABLE = (
    OSError, EOFError, SyntaxError, ValueError, IndexError, struct.error, Image.DecompressionBombError
)  # fmt: skip
"""What Pillow raises about damaged files."""


@dataclass(frozen=True, eq=False, repr=False)
class Frames:
    """A video in memory. As a text it is what messages call it.

    Attributes:
        images: (height, width, 3) uint8 RGB each, all of one size.
    """

    images: tuple[NDArray[np.uint8], ...]

    def __repr__(self) -> str:
        return f"{len(self.images)} frames in memory"


Video = Path | Frames
"""A video: a file or a folder of images, or frames in memory."""
VideoSource = str | Path | Frames | Iterable[Any]
"""What `video_of` makes a video of."""


def video_of(source: VideoSource) -> Video:
    """A video from its path, or from its frames.

    Args:
        source: a path, or (F, height, width, 3) uint8 RGB: an array, or images such as those of Pillow or arrays.

    Raises:
        DataError: there are no frames, or one is of another shape or dtype.
    """
    if isinstance(source, str | Path):
        return Path(source)
    if isinstance(source, Frames):
        return source
    if not isinstance(source, Iterable):
        raise DataError(f"expected a video's path or its frames, got {indefinite(type(source).__name__)}")
    images: list[NDArray[np.uint8]] = []
    last, is_stream = None, isinstance(source, Iterator)
    for number, image in enumerate(source):
        if image is last and not is_stream:  # a repeated frame stays one array
            images.append(images[-1])
            continue
        last = image
        array = np.array(image.convert("RGB") if isinstance(image, Image.Image) else image, copy=is_stream or None)
        if array.dtype != np.uint8 or array.ndim != 3 or array.shape[-1] != 3 or not array.size:
            expected = "an image or an array (height, width, 3) of uint8, RGB from 0 to 255"
            raise DataError(f"frame {number}: expected {expected}, got {array.shape} {array.dtype}")
        if images and array.shape != images[0].shape:
            raise DataError(f"frame {number}: expected {images[0].shape} as the first frame, got {array.shape}")
        images.append(array)
        check_limit(len(images), "frames", "the frames")
    if not images:
        raise DataError("no frames to parse: expected at least 1")
    return Frames(tuple(images))


@dataclass(frozen=True)
class Images:
    """An opened video that consists of images.

    Attributes:
        path: the animated image, or the folder.
        files: the files of a folder, one for each frame; or the animated image alone.
        n_frames: number of frames.
        seconds: when each frame of an animated image is shown, followed by the end of the last one; empty if unknown.
    """

    path: Path
    files: tuple[Path, ...]
    n_frames: int
    seconds: tuple[float, ...]

    @property
    def rate(self) -> float:
        """Frames per second, from the usual duration of a frame; 0 if the file does not say."""
        return 1 / statistics.median_low(b - a for a, b in pairwise(self.seconds)) if self.seconds else 0.0

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """(height, width, 3) uint8 RGB, all of one size.

        Raises:
            VideoError: a frame that cannot be read, or has another size than the first, or more pixels, by itself or together
                with those before it, than `nsdr.io.limits` allows.
        """
        first, total = None, 0
        for file in self.files:
            with _opened(file) as image:
                for shown in ImageSequence.Iterator(image):
                    first = first or shown.size
                    if shown.size != first:
                        sizes = f"{shown.width}x{shown.height} px, the first frame {first[0]}x{first[1]}"
                        raise VideoError(f"{file}: {sizes}; all need one size")
                    total += shown.width * shown.height
                    check_limit(total, "video_pixels", self.path, VideoError)
                    yield np.asarray(shown.convert("RGB"))
                    if len(self.files) > 1:
                        break


def is_animated(path: Path) -> bool:
    """Whether a file is an image with several frames, of a format that is read.

    Raises:
        VideoError: it is damaged.
    """
    return len(frame_durations_ms(path)) > 1


def has_images(folder: Path) -> bool:
    """Whether there is such a folder, and it holds images that may be frames."""
    return folder.is_dir() and bool(_images_in(folder))


def open_images(path: Path) -> Images | None:
    """An animated image, or a folder of PNG or JPEG files; None where `path` is neither. Decodes nothing.

    Raises:
        VideoError: a damaged file, a folder whose files' names do not say which frame each is, or an animated image of more
            frames or pixels than `nsdr.io.limits` allows.
    """
    if path.is_dir():
        return _folder(path)
    durations = [ms / 1000 for ms in frame_durations_ms(path)]
    if len(durations) < 2:
        return None
    with _opened(path) as image:
        check_limit(len(durations) * image.width * image.height, "video_pixels", path, VideoError)
    # The last frame is often held for long, which is no part of what is shown.
    durations[-1] = statistics.median_low(durations[:-1])
    known = min(durations) >= MIN_SECONDS
    return Images(path, (path,), len(durations), tuple(accumulate(durations, initial=0.0)) if known else ())


def _images_in(folder: Path) -> list[Path]:
    return [p for p in folder.iterdir() if p.suffix.lower() in FRAME_SUFFIXES and not is_hidden(p.relative_to(folder))]


def _folder(path: Path) -> Images:
    found = _images_in(path)
    check_limit(len(found), "frames", path, VideoError)
    numbered = {}
    for file in found:
        name = re.fullmatch(r"(.*?)(\d{1,18})", file.stem)
        if name is None:
            raise VideoError(f"{file}: expected a frame's number at the end of its name, such as frame_0001.png")
        numbered[int(name[2])] = file, name[1]
    files = [numbered[n][0] for n in sorted(numbered)]
    if len(files) < len(found) or len({prefix for _, prefix in numbered.values()}) > 1:
        raise VideoError(f"{path}: holds the frames of several videos; expected one name with a number for each frame")
    steps = [b - a for a, b in pairwise(sorted(numbered))]
    for step, file in zip(steps, files, strict=False):
        if step > min(steps):
            raise VideoError(f"{path}: frames are missing after {file.name}; expected numbers at equal steps")
    return Images(path, tuple(files), len(files), ())


@contextmanager
def _opened(file: Path) -> Iterator[Any]:
    """An image file, whose pixels are not read yet."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # our own limit follows
            image = Image.open(file, formats=FORMATS)
        with image:
            check_limit(image.width * image.height, "image_pixels", file, VideoError)
            yield image
    except VideoError:
        raise
    except UNREADABLE as e:
        if failure := machine_error(e, file):
            raise failure from e
        raise VideoError(f"{file}: a damaged image, or cut off ({' '.join(str(e).split()) or type(e).__name__})") from e

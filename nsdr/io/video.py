"""Video files: decoding to 480x320 RGB frames at 25 frames per second, and encoding as H.264."""

import math
import os
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import count, repeat
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError, VideoError
from nsdr.io.files import atomic_path, check_installed
from nsdr.io.limits import check_limit, limits
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.physics_constants import FPS, VIDEO_FRAMES

__all__ = [
    "Layout",
    "VideoSample",
    "check_is_video",
    "even_frames",
    "frame_rate",
    "read_frames",
    "read_video",
    "sample_frames",
    "spaced",
    "video_seconds",
    "write_video",
]

RATES = (1.0, 1000.0)
"""Lowest and highest frame rate that is read (frames per second); others are errors of the file."""
RATE_TOLERANCE = 0.1
"""Frame rates that differ by less from CLEVRER's are taken as the same (frames per second)."""
UNEVEN = 1.0
"""Frames that are shown so much earlier or later than at an even rate make a variable frame rate (frames of CLEVRER)."""
REPRODUCIBLE = {"threads": "1", "mbtree": "0"}
"""Options without which x264 encodes the same frames differently from run to run, or from one number of cores to another."""
HEAD_BYTES = 4096
"""Bytes at a file's start that tell its kind."""


@dataclass(frozen=True)
class Layout:
    """Where in a video's frames CLEVRER's image is.

    Attributes:
        box_xyxy_px: left, top, right and bottom of the part that is used; None for all.
        stretched: the part is scaled to 480x320 whatever its sides are; else its shape is kept and the rest filled.
    """

    box_xyxy_px: tuple[int, int, int, int] | None = None
    stretched: bool = False


@dataclass(frozen=True)
class VideoSample:
    """Some early frames of a video, and what is known of it without decoding it all.

    Attributes:
        frames: (F, height, width, 3) uint8 RGB, of at most 480x320 pixels, in the shape of the video's frames.
        size_px: width and height of the video's frames (pixels).
    """

    frames: NDArray[np.uint8]
    size_px: tuple[int, int]


def read_video(path: str | Path) -> NDArray[np.uint8]:
    """All frames of a video as (F, 320, 480, 3) uint8 RGB, at 25 frames a second.

    Another image size is scaled to fit, the rest filled with the mean colour, so that shapes keep their aspect;
    another frame rate is resampled: of a fast video the nearest frame in time is taken, the frames of a slow one are repeated
    (the same array). Both warn, and so does a video of another length than CLEVRER's 128 frames.

    Raises:
        VideoError: no such file, not a video, no frames, or more or larger ones than `nsdr.io.limits` allows.
    """
    frames = []
    for frame in read_frames(path):
        frames.append(frame)
        check_limit(len(frames) * frame.nbytes, "array_bytes", path, VideoError)
    return np.stack(frames)


def read_frames(path: str | Path, layout: Layout | None = None) -> Iterator[NDArray[np.uint8]]:
    """Frames of `read_video` one by one, (320, 480, 3) each; the same warnings and errors.

    Args:
        path: a video file.
        layout: which part of the frames to use; None for all.
    """
    path = Path(path)
    layout = layout or Layout()
    with _opened(path) as (capture, rate):
        if abs(rate - FPS) > RATE_TOLERANCE:
            warnings.warn(f"{path}: {rate:g} frames per second, resampled to {FPS}", stacklevel=2)
        n = 0
        for frame in _at_rate(_decoded(capture, path, rate), rate):
            check_limit(n + 1, "frames", path, VideoError)
            height, width = frame.shape[:2]
            if n == 0 and (height, width) != (HEIGHT_PX, WIDTH_PX):
                warnings.warn(f"{path}: {width}x{height} px, resized to {WIDTH_PX}x{HEIGHT_PX}", stacklevel=2)
            if (height, width) != (HEIGHT_PX, WIDTH_PX) or layout.box_xyxy_px is not None:
                frame = _fitted(frame, layout)
            n += 1
            yield frame
        if n == 0:
            raise _undecodable(path)
        if n != VIDEO_FRAMES:
            warnings.warn(f"{path}: {n} frames, CLEVRER's videos have {VIDEO_FRAMES}", stacklevel=2)


def sample_frames(path: str | Path, seconds: float, spacing: int) -> VideoSample:
    """Every `spacing`-th frame, at 25 frames a second, of the first seconds of a video; warns of nothing.

    Raises:
        VideoError: as of `read_video`.
    """
    path = Path(path)
    frames: list[NDArray[np.uint8]] = []
    size = (0, 0)
    with _opened(path) as (capture, rate), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for index, frame in enumerate(_at_rate(_decoded(capture, path, rate), rate)):
            if index >= seconds * FPS:
                break
            if index % spacing == 0:
                size = (frame.shape[1], frame.shape[0])
                frames.append(_scaled(frame, most=1.0))
        if not frames:
            raise _undecodable(path)
    return VideoSample(np.stack([frame for frame in frames if frame.shape == frames[0].shape]), size)


def video_seconds(path: str | Path) -> float:
    """How long a video lasts by its header (seconds); 0 where that does not say. Decodes nothing.

    Raises:
        VideoError: as of `read_video`.
    """
    with _opened(Path(path)) as (capture, rate):
        return max(float(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0.0) / rate


def frame_rate(path: str | Path) -> float:
    """A video's frames per second by its header.

    Raises:
        VideoError: as of `read_video`.
    """
    with _opened(Path(path)) as (_, rate):
        return rate


@contextmanager
def _opened(path: Path) -> Iterator[tuple[cv2.VideoCapture, float]]:
    """An opened video and its frame rate (1/s)."""
    check_is_video(path)
    # OpenCV and FFmpeg print their own complaints about broken files; ours follow.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.setLogLevel(0)
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise _undecodable(path)
        check_limit(capture.get(cv2.CAP_PROP_FRAME_COUNT), "frames", path, VideoError)
        pixels = capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
        check_limit(pixels, "image_pixels", path, VideoError)
        rate = float(capture.get(cv2.CAP_PROP_FPS)) or float(FPS)
        if not RATES[0] <= rate <= RATES[1]:
            raise VideoError(f"{path}: {rate:g} frames per second, expected {RATES[0]:g} to {RATES[1]:g}; convert it")
        yield capture, rate
    finally:
        capture.release()
        cv2.utils.logging.setLogLevel(level)


def _decoded(capture: cv2.VideoCapture, path: Path, rate: float) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """(time, RGB frame); the time since the first frame counts frames of CLEVRER.

    Frames are taken as evenly spaced unless the file says clearly otherwise; then a warning is given once.
    """
    even_step = 1.0 if abs(rate - FPS) <= RATE_TOLERANCE else FPS / rate
    start, before, warned = 0.0, -1.0, False
    for index in count():
        try:
            ok, frame = capture.read()
        except (cv2.error, MemoryError) as e:
            raise VideoError(f"{path}: cannot be decoded ({str(e).splitlines()[0]})") from e
        if not ok:
            return
        check_limit(frame.shape[0] * frame.shape[1], "image_pixels", path, VideoError)
        shown = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000 * FPS
        if index == 0:
            start = shown
        time = index * even_step
        if shown > before and abs(shown - start - time) > UNEVEN:
            time = shown - start
            if not warned:
                warnings.warn(f"{path}: variable frame rate, resampled to {FPS} frames per second", stacklevel=2)
            warned = True
        before = shown
        yield time, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)  # type: ignore[misc]


def _at_rate(frames: Iterator[tuple[float, NDArray[np.uint8]]], rate: float) -> Iterator[NDArray[np.uint8]]:
    """Frames at every 25th of a second: the nearest in time of a fast video; each frame of a slow one until the next."""
    held: NDArray[np.uint8] | None = None
    slot, following, distance, time = 0, 0, 0.0, 0.0
    for time, frame in frames:
        nearest = math.ceil(time - 0.5)
        if held is not None and nearest > slot:
            yield from repeat(held, nearest - following)
            following = nearest
        if held is None or nearest > slot or abs(time - nearest) < distance:
            held, slot, distance = frame, max(nearest, slot), abs(time - nearest)
    if held is not None:
        yield from repeat(held, max(round(time + FPS / rate), 1) - following)


def _fitted(frame: NDArray[np.uint8], layout: Layout) -> NDArray[np.uint8]:
    """CLEVRER's image in a frame, scaled to 480x320."""
    if layout.box_xyxy_px is not None:
        left, top, right, bottom = layout.box_xyxy_px
        frame = frame[top:bottom, left:right]
    small = _scaled(frame, stretched=layout.stretched)
    height, width = small.shape[:2]
    if (height, width) == (HEIGHT_PX, WIDTH_PX):
        return small
    canvas = np.full((HEIGHT_PX, WIDTH_PX, 3), small.reshape(-1, 3).mean(0), np.uint8)
    top, left = (HEIGHT_PX - height) // 2, (WIDTH_PX - width) // 2
    canvas[top : top + height, left : left + width] = small
    return canvas


def _scaled(frame: NDArray[np.uint8], most: float = math.inf, stretched: bool = False) -> NDArray[np.uint8]:
    """The frame scaled so that it just fits into 480x320 pixels, by a factor of at most `most`; or stretched to that size."""
    height, width = frame.shape[:2]
    scale = min(WIDTH_PX / width, HEIGHT_PX / height, most)
    size = (WIDTH_PX, HEIGHT_PX) if stretched else (max(round(width * scale), 1), max(round(height * scale), 1))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(frame, size, interpolation=how), np.uint8)


def spaced(n_frames: int, count: int) -> NDArray[np.intp]:
    """Frame indices (count,), evenly spaced from the first to the last one; of a shorter video, some repeatedly."""
    return np.linspace(0, n_frames - 1, count).round().astype(np.intp)


def even_frames(path: str | Path) -> NDArray[np.uint8]:
    """All frames of a video to be encoded again: (F, H, W, 3) uint8 RGB, at most 480x320, of even sides, as H.264 wants.

    Raises:
        VideoError: as `sample_frames`.
    """
    frames = sample_frames(path, limits().frames / FPS, 1).frames
    height, width = (side // 2 * 2 for side in frames.shape[1:3])
    return frames[:, :height, :width]


def write_video(
    path: str | Path, frames: Iterable[NDArray[np.uint8]], fps: int = 25, crf: int = 20, preset: str = "slow"
) -> None:
    """Write frames (H, W, 3) uint8 RGB as an H.264 mp4, atomically.

    Args:
        path: file to write.
        frames: the frames.
        fps: frame rate (1/s).
        crf: constant rate factor; lower is better quality.
        preset: x264's trade of time for size. "veryfast" takes a quarter of the time of "slow" on previews, with files of the
            same size and 0.2 to 0.3 dB less.

    Raises:
        DataError: PyAV is missing, or there are no frames.
    """
    check_installed("av", "writing videos needs PyAV", "visualize")
    import av

    with atomic_path(path) as temporary:
        container = av.open(str(temporary), "w", format="mp4")
        with container:
            stream: Any = None
            for frame in frames:
                if stream is None:
                    stream = container.add_stream("libx264", rate=Fraction(fps))
                    stream.height, stream.width, stream.pix_fmt = *frame.shape[:2], "yuv420p"
                    stream.options = {"crf": str(crf), "preset": preset, **REPRODUCIBLE}
                container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
            if stream is None:
                raise DataError(f"{path}: no frames to write")
            container.mux(stream.encode())


def check_is_video(path: Path) -> None:
    """Refuse what is certainly no video, by the file's first bytes.

    Raises:
        VideoError: no such file, a folder or device, an empty file, an image or a text; says which.
    """
    if path.is_dir():
        raise VideoError(f"{path}: is a folder; expected a video (`nsdr parse-videos` takes folders)")
    if not path.is_file():
        raise VideoError(f"{path}: {'is a device or a pipe; expected a video' if path.exists() else 'no such file'}")
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise VideoError(f"{path}: is empty (0 bytes); expected a video")
    # OpenCV would read both as videos.
    if cv2.haveImageReader(str(path)):
        raise VideoError(f"{path}: is an image; expected a video")
    if _is_text(head):
        raise VideoError(f"{path}: is a text file; expected a video")


def _is_text(head: bytes) -> bool:
    """Whether these first bytes of a file are text; the last character may be cut off."""
    try:
        text = head.decode() if len(head) < HEAD_BYTES else head[:-4].decode("utf-8", "ignore")
    except UnicodeDecodeError:
        return False
    return all(c.isprintable() or c in "\n\r\t\f" for c in text)


def _undecodable(path: Path) -> VideoError:
    remedy = "if it is one, convert it to H.264: ffmpeg -i IN -c:v libx264 -pix_fmt yuv420p OUT.mp4"
    return VideoError(f"{path}: not a video that OpenCV can read, or damaged or cut off; {remedy}")

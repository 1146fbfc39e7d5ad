"""Video files: decoding to 480x320 RGB frames at 25 frames per second, and encoding as H.264."""

import os
import warnings
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError, VideoError
from nsdr.io.files import atomic_path
from nsdr.io.limits import check_limit
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.timeline import FPS, VIDEO_FRAMES

__all__ = ["read_frames", "read_video", "write_video"]

RATES = (1.0, 1000.0)
"""Lowest and highest frame rate that is read (frames per second); others are errors of the file."""
RATE_TOLERANCE = 0.1
"""Frame rates that differ by less from CLEVRER's are taken as the same (frames per second)."""
REPRODUCIBLE = {"threads": "1", "mbtree": "0"}
"""Options without which x264 encodes the same frames differently from run to run, or from one number of cores to another."""


def read_video(path: str | Path) -> NDArray[np.uint8]:
    """All frames of a video as (F, 320, 480, 3) uint8 RGB, at 25 frames a second.

    Another image size is scaled to fit, the rest filled with the mean colour, so that shapes keep their aspect;
    another frame rate is resampled: of a fast video the nearest frame in time is taken, the frames of a slow one are repeated
    (the same array). Both warn, and so does a video shorter than CLEVRER's 128 frames.

    Raises:
        VideoError: no such file, not a video, no frames, or more or larger ones than `nsdr.io.limits` allows.
    """
    frames = []
    for frame in read_frames(path):
        frames.append(frame)
        _check(len(frames) * frame.nbytes, "array_bytes", path)
    return np.stack(frames)


def read_frames(path: str | Path) -> Iterator[NDArray[np.uint8]]:
    """Frames of `read_video` one by one, (320, 480, 3) each; the same warnings and errors."""
    path = Path(path)
    if not path.is_file():
        raise VideoError(f"{path}: {'is a folder or a device; expected a video' if path.exists() else 'no such file'}")
    # OpenCV and FFmpeg print their own complaints about broken files; ours follow.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel() if hasattr(cv2, "utils") else None
    if level is not None:
        cv2.utils.logging.setLogLevel(0)
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise VideoError(
                f"{path}: not a video that OpenCV can read; convert it to H.264 mp4, for example with ffmpeg"
            )
        _check(capture.get(cv2.CAP_PROP_FRAME_COUNT), "frames", path)
        _check(capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT), "image_pixels", path)
        rate = float(capture.get(cv2.CAP_PROP_FPS)) or float(FPS)
        if not RATES[0] <= rate <= RATES[1]:
            raise VideoError(f"{path}: {rate:g} frames per second, expected {RATES[0]:g} to {RATES[1]:g}; convert it")
        if abs(rate - FPS) > RATE_TOLERANCE:
            warnings.warn(f"{path}: {rate:g} frames per second, resampled to {FPS}", stacklevel=2)
        count = 0
        for frame in _at_rate(_decoded(capture, path), rate):
            _check(count + 1, "frames", path)
            height, width = frame.shape[:2]
            if (height, width) != (HEIGHT_PX, WIDTH_PX):
                if count == 0:
                    warnings.warn(f"{path}: {width}x{height} px, resized to {WIDTH_PX}x{HEIGHT_PX}", stacklevel=2)
                frame = _fitted(frame)
            count += 1
            yield frame
        if count == 0:
            raise VideoError(f"{path}: holds no frames; the file may be cut off")
        if count < VIDEO_FRAMES:
            warnings.warn(f"{path}: {count} frames, CLEVRER's videos have {VIDEO_FRAMES}", stacklevel=2)
    finally:
        capture.release()
        if level is not None:
            cv2.utils.logging.setLogLevel(level)


def _check(value: float, limit: str, path: str | Path) -> None:
    try:
        check_limit(value, limit, str(path))
    except DataError as e:
        raise VideoError(str(e)) from e


def _decoded(capture: cv2.VideoCapture, path: Path) -> Iterator[NDArray[np.uint8]]:
    while True:
        try:
            ok, frame = capture.read()
        except (cv2.error, MemoryError) as e:
            raise VideoError(f"{path}: cannot be decoded ({str(e).splitlines()[0]})") from e
        if not ok:
            return
        _check(frame.shape[0] * frame.shape[1], "image_pixels", path)
        yield cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)  # type: ignore[misc]


def _at_rate(frames: Iterator[NDArray[np.uint8]], rate: float) -> Iterator[NDArray[np.uint8]]:
    """Frames at every 25th of a second: the nearest in time of a fast video; each frame of a slow one until the next."""
    if abs(rate - FPS) <= RATE_TOLERANCE:
        yield from frames
        return
    shown = 0
    for index, frame in enumerate(frames):
        nearest = index == round(shown * rate / FPS)
        until = shown + nearest if rate > FPS else round((index + 1) * FPS / rate)
        while shown < until:
            yield frame
            shown += 1


def _fitted(frame: NDArray[Any]) -> NDArray[np.uint8]:
    height, width = frame.shape[:2]
    scale = min(WIDTH_PX / width, HEIGHT_PX / height)
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    small = cv2.resize(frame, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    canvas = np.full((HEIGHT_PX, WIDTH_PX, 3), small.reshape(-1, 3).mean(0), np.uint8)
    top, left = (HEIGHT_PX - size[1]) // 2, (WIDTH_PX - size[0]) // 2
    canvas[top : top + size[1], left : left + size[0]] = small
    return canvas


def write_video(path: str | Path, frames: Iterable[NDArray[np.uint8]], fps: int = 25, crf: int = 20) -> None:
    """Write frames (H, W, 3) uint8 RGB as an H.264 mp4, atomically.

    Raises:
        DataError: PyAV is missing, or there are no frames.
    """
    try:
        import av
    except ImportError as e:
        raise DataError("writing videos needs PyAV: pip install 'nsdr[visualize]'") from e
    with atomic_path(path) as temporary:
        container = av.open(str(temporary), "w", format="mp4")
        with container:
            stream: Any = None
            for frame in frames:
                if stream is None:
                    stream = container.add_stream("libx264", rate=Fraction(fps))
                    stream.height, stream.width, stream.pix_fmt = *frame.shape[:2], "yuv420p"
                    stream.options = {"crf": str(crf), "preset": "slow", **REPRODUCIBLE}
                container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
            if stream is None:
                raise DataError(f"{path}: no frames to write")
            container.mux(stream.encode())

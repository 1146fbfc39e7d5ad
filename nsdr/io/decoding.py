"""Opening a video: a file that OpenCV decodes (MP4 and others), an animated image, or a folder of images; and finding them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import VideoError, machine_error
from nsdr.io.files import check_name, find_files
from nsdr.io.images import FRAME_SUFFIXES, Frames, Video, has_images, is_animated, open_images
from nsdr.io.limits import check_limit
from nsdr.io.notes import Note

RATES = (1.0, 1000.0)
"""Lowest and highest frame rate that is read (frames per second); others are errors of the file."""
SUFFIXES = (".mp4", ".gif", ".webp")
"""Endings of the names of videos that are looked for in folders."""
RATE_TOLERANCE = 0.1
"""Frame rates that differ by less from CLEVRER's are taken as the same (frames per second)."""
UNEVEN = 1.0
"""The frame rate is variable if a frame is shown so much earlier or later than at an even rate (frames of CLEVRER)."""
UNEVEN_SHARE = 0.1
"""It is also variable if the duration of an animated image's frame is so far from a multiple of the usual one (share of it)."""
TimedFrames = Iterator[tuple[float, NDArray[np.uint8]]]
"""Frames (height, width, 3) uint8 RGB, and when each is shown after the first one (frames of CLEVRER)."""
HEAD_BYTES = 4096
"""Bytes at a file's start that tell its kind."""
BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
"""Kinds of the first box of an MP4 or MOV file."""
SIGNATURES = (
    *(((4, box),) for box in BOXES),
    ((0, b"\x1aE\xdf\xa3"),),  # Matroska, WebM
    ((0, b"RIFF"), (8, b"AVI ")),
    ((0, b"\0\0\x01\xba"),),  # MPEG program stream
    ((0, b"\0\0\x01\xb3"),),  # MPEG-1 or -2 video
    ((0, b"OggS"),),
    ((0, b"DKIF"),),  # IVF
    ((0, b"YUV4MPEG2 "),),
    ((0, b"FLV\x01"),),
    ((0, b"0&\xb2u\x8ef\xcf\x11"),),  # ASF: WMV
)
"""Signatures of the containers that are read: bytes that must all be there, and where they stand (bytes from the start)."""
TEXTS = (b"#EXTM3U", b"ffconcat", b"v=0", b"<")
"""How playlists, scripts, session descriptions and manifests begin.

FFmpeg, which OpenCV calls, takes them for videos, and opens whatever other file of this machine they name. They are refused
even where bytes that follow look like those of a container.
"""
TRANSPORT_PACKETS = ((0, 188), (4, 192))
"""Places of the first byte "G" and sizes of the packets of MPEG transport streams: .ts and .m2ts."""


CONVERT = "if it is one, convert it to H.264: ffmpeg -i IN -c:v libx264 -pix_fmt yuv420p OUT.mp4"
"""What to do about a video that is not read."""


@dataclass(frozen=True)
class OpenedVideo:
    """An opened video.

    Attributes:
        rate: frames per second.
        seconds: how long it lasts; 0 if its header does not say.
        frames: (height, width, 3) each, as they are decoded.
    """

    rate: float
    seconds: float
    frames: TimedFrames


@contextmanager
def opened(path: Video, fps: float, wanted: int, note: Note) -> Iterator[OpenedVideo]:
    """Open a video.

    Args:
        path: the video.
        fps: replaces the stated frame rate, unless it is 0.
        wanted: the frame rate in whose frames times are counted.
        note: called with an uncertain or uneven rate.
    """
    if isinstance(path, Frames):
        rate = _checked_rate(path, fps or wanted, wanted, note)
        timed = ((0.0, image) for image in path.images)
        yield OpenedVideo(rate, len(path.images) / rate, _evenly(timed, rate, wanted))
        return
    check_is_video(path)
    images = open_images(path)
    if images is None:
        with _captured(path) as capture:
            said = float(capture.get(cv2.CAP_PROP_FPS))
            rate = _checked_rate(path, fps or said, wanted, note)
            n = max(float(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0.0)
            frames = _decoded(capture, path, wanted)
            yield OpenedVideo(
                rate, n / rate, _evenly(frames, rate, wanted) if fps else _at_times(frames, rate, wanted, note)
            )
        return
    said = 0.0 if fps else images.rate
    rate = _checked_rate(path, fps or said, wanted, note)
    if said:
        frames_each = np.diff(images.seconds) * rate  # writers join frames that are the same
        if np.abs(frames_each - frames_each.round()).max() > UNEVEN_SHARE:
            note(f"variable frame rate, resampled to {wanted} frames per second")
        times = [round(wanted * seconds, 6) for seconds in images.seconds]
        yield OpenedVideo(rate, images.seconds[-1], zip(times, images.frames(), strict=False))
    else:
        frames = ((0.0, frame) for frame in images.frames())
        yield OpenedVideo(rate, images.n_frames / rate, _evenly(frames, rate, wanted))


def _checked_rate(path: Video, rate: float, wanted: int, note: Note) -> float:
    """A video's frame rate (1/s); the wanted one, with a note, if the file states none."""
    if not rate:
        remedy = "--fps gives the right one (in Python, VideoConfig.fps)"
        note(f"does not say its frame rate; taken as {wanted} per second; {remedy}")
        return float(wanted)
    if not RATES[0] <= rate <= RATES[1]:
        expected = f"expected {RATES[0]:g} to {RATES[1]:g}"
        raise VideoError(f"{path}: {rate:g} frames per second, {expected}; convert it, or give the right rate (--fps)")
    return rate


@contextmanager
def _captured(path: Path) -> Iterator[cv2.VideoCapture]:
    """A video file that OpenCV opened."""
    # OpenCV and FFmpeg print their own complaints about broken files; ours follow.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.setLogLevel(0)
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise undecodable(path)
        check_limit(n := capture.get(cv2.CAP_PROP_FRAME_COUNT), "frames", path, VideoError)
        pixels = capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
        check_limit(pixels, "image_pixels", path, VideoError)
        check_limit(n * pixels, "video_pixels", path, VideoError)
        yield capture
    finally:
        capture.release()
        cv2.utils.logging.setLogLevel(level)


def _decoded(capture: cv2.VideoCapture, path: Path, wanted: int) -> TimedFrames:
    """The frames with the times that the file says, from its own zero, in frames at the wanted rate."""
    total = 0
    while True:
        try:
            ok, frame = capture.read()
        except (cv2.error, MemoryError) as e:
            if failure := machine_error(e, path):
                raise failure from e
            raise VideoError(f"{path}: cannot be decoded ({str(e).splitlines()[0]})") from e
        if not ok:
            return
        pixels = frame.shape[0] * frame.shape[1]
        total += pixels
        check_limit(pixels, "image_pixels", path, VideoError)
        check_limit(total, "video_pixels", path, VideoError)  # the file's header may say less than it holds
        shown = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000 * wanted
        yield shown, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)  # type: ignore[misc]


def _step(rate: float, wanted: int) -> float:
    """From one frame to the next, in frames at the wanted rate."""
    return 1.0 if abs(rate - wanted) <= RATE_TOLERANCE else wanted / rate


def _evenly(frames: TimedFrames, rate: float, wanted: int) -> TimedFrames:
    """The frames at even times, whatever their own are."""
    return ((index * _step(rate, wanted), frame) for index, (_, frame) in enumerate(frames))


def _at_times(frames: TimedFrames, rate: float, wanted: int, note: Note) -> TimedFrames:
    """The frames at even times, unless the file says clearly otherwise, which is noted once."""
    start, before, noted = 0.0, -1.0, False
    for index, (shown, frame) in enumerate(frames):
        if index == 0:
            start = shown
        time = index * _step(rate, wanted)
        if shown > before and abs(shown - start - time) > UNEVEN:
            time = shown - start
            if not noted:
                note(f"variable frame rate, resampled to {wanted} frames per second")
            noted = True
        before = shown
        yield time, frame


def read_window(path: Path, start: int, stop: int, wanted: int) -> list[NDArray[np.uint8]]:
    """Frames `start` to `stop - 1` (height, width, 3) uint8 RGB of a video file, numbered as they are stored.

    Decoding begins at the last keyframe before them. The list is shorter where the video ends before `stop`.

    Raises:
        VideoError: the file cannot be read.
    """
    check_is_video(path)
    with _captured(path) as capture:
        capture.set(cv2.CAP_PROP_POS_FRAMES, start)
        if capture.get(cv2.CAP_PROP_POS_FRAMES) != start:  # the file does not say where its frames are
            capture.set(cv2.CAP_PROP_POS_FRAMES, 0)
            for _ in range(start):
                capture.grab()
        return [frame for _, frame in islice(_decoded(capture, path, wanted), stop - start)]


def find_videos(folder: str | Path) -> list[Path]:
    """The MP4, GIF and WebP files below a folder, sorted; without hidden ones."""
    return [path for path in find_files(folder, "*") if path.suffix.lower() in SUFFIXES]


def find_frame_folders(folder: str | Path) -> list[Path]:
    """The folders below a folder that hold PNG or JPEG files, sorted: each may be a video, with one file a frame."""
    images = (path for path in find_files(folder, "*") if path.suffix.lower() in FRAME_SUFFIXES)
    return sorted({path.parent for path in images} - {Path(folder)})


def check_is_video(path: Video) -> None:
    """Refuse what is no folder of images, no animated image, and no file of a known container, by its first bytes.

    Raises:
        VideoError: no such file, or a folder without images, a device, an empty file, an image, a text or another kind of file;
            says which.
        DataError: a name that is not UTF-8.
    """
    if isinstance(path, Frames):
        return
    check_name(path)
    if path.is_dir():
        if not has_images(path):
            what = "a video, or a folder of PNG or JPEG files (`nsdr parse` takes folders of either)"
            raise VideoError(f"{path}: is a folder without images; expected {what}")
        return
    if not path.is_file():
        raise VideoError(f"{path}: {'is a device or a pipe; expected a video' if path.exists() else 'no such file'}")
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise VideoError(f"{path}: is empty (0 bytes); expected a video")
    if is_animated(path) or _is_container(head):
        return
    if cv2.haveImageReader(str(path)):
        raise VideoError(f"{path}: is an image; expected a video, or an animated GIF, WebP or PNG")
    if head.startswith(b"PK"):
        raise VideoError(f"{path}: is an archive (ZIP or NPZ); expected a video")
    if path.suffix == ".json":
        remedy = "questions can be asked about a saved scene, and nsdr.load(path) reads it"
        raise VideoError(f"{path}: is a JSON file; expected a video ({remedy})")
    if _is_text(head):
        raise VideoError(f"{path}: is a text file; expected a video")
    kinds = "MP4, MOV, MKV, WebM, AVI, MPEG, Ogg, FLV, WMV, IVF or Y4M file"
    raise VideoError(f"{path}: does not begin as an {kinds}, or an animated image; {CONVERT}")


def _is_container(head: bytes) -> bool:
    """Whether these first bytes of a file are those of a container of `SIGNATURES`, or of an MPEG transport stream."""
    if head.startswith(TEXTS):
        return False
    if any(all(head.startswith(mark, at) for at, mark in signature) for signature in SIGNATURES):
        return True
    return any(head[at::size][:3] == b"GGG" for at, size in TRANSPORT_PACKETS)


def _is_text(head: bytes) -> bool:
    """Whether these first bytes of a file are text; the last character may be cut off."""
    try:
        text = head.decode() if len(head) < HEAD_BYTES else head[:-4].decode("utf-8", "ignore")
    except UnicodeDecodeError:
        return False
    return all(c.isprintable() or c in "\n\r\t\f" for c in text)


def undecodable(path: Video) -> VideoError:
    """The error of a file that nothing can be read from."""
    return VideoError(f"{path}: not a video that OpenCV can read, or damaged or cut off; {CONVERT}")

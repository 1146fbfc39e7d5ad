"""Videos: decoding to RGB frames in the size and at the rate of a world's, and encoding as H.264.

`nsdr.io.decoding` says what a video may be.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import repeat
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError, VideoError
from nsdr.io.decoding import RATE_TOLERANCE, TimedFrames, opened, read_window, undecodable
from nsdr.io.files import atomic_path, check_installed
from nsdr.io.images import VideoSource, video_of
from nsdr.io.limits import check_limit, limits
from nsdr.io.notes import Note, as_warnings, unsaid
from nsdr.world.camera import Camera
from nsdr.world.world import CLEVRER_WORLD, World

__all__ = [
    "Layout",
    "VideoSample",
    "even_frames",
    "frame_rate",
    "read_frames",
    "read_video",
    "sample_frames",
    "spaced",
    "video_seconds",
    "write_video",
]

REPRODUCIBLE = {"threads": "1", "mbtree": "0"}
"""Options without which x264 encodes the same frames differently from run to run, or from one number of cores to another."""


@dataclass(frozen=True)
class Layout:
    """Where in a video's frames the image is.

    Attributes:
        box_xyxy_px: left, top, right and bottom of the part that is used; None for all.
        stretched: whether the part is scaled to the world's image size whatever its shape; otherwise its shape is kept and the
            rest is filled.
    """

    box_xyxy_px: tuple[int, int, int, int] | None = None
    stretched: bool = False


@dataclass(frozen=True)
class VideoSample:
    """Some early frames of a video, and what is known of it without decoding it all.

    Attributes:
        frames: (F, height, width, 3) uint8 RGB, of at most the world's image size, in the shape of the video's frames.
        size_px: width and height of the video's frames (pixels).
    """

    frames: NDArray[np.uint8]
    size_px: tuple[int, int]


def read_video(path: VideoSource, fps: float = 0.0, world: World = CLEVRER_WORLD) -> NDArray[np.uint8]:
    """All frames of a video as (F, height, width, 3) uint8 RGB: 320, 480, and 25 frames a second in CLEVRER's world.

    Another image size is scaled to fit, the rest filled with the mean colour, so that shapes keep their aspect;
    another frame rate is resampled: of a fast video the nearest frame in time is taken, the frames of a slow one are repeated
    (the same array). Both give Python warnings, as does a video without the world's number of frames, CLEVRER's 128.

    Args:
        path: a video file, an animated image, or a folder of PNG or JPEG files whose names end with the frame's number; or
            frames in memory, as `nsdr.io.images.video_of` takes them.
        fps: frames per second; 0 for what the file states, or the world's, with a warning, if it states nothing.
        world: has the image size, the frame rate and the number of frames.

    Raises:
        VideoError: no such file, not a video, no frames, or more or larger ones than `nsdr.io.limits` allows.
    """
    frames, path = [], video_of(path)
    for frame in read_frames(path, fps=fps, world=world):
        frames.append(frame)
        check_limit(len(frames) * frame.nbytes, "array_bytes", path, VideoError)
    return np.stack(frames)


def read_frames(
    path: VideoSource,
    layout: Layout | None = None,
    fps: float = 0.0,
    late: list[float] | None = None,
    note: Note | None = None,
    world: World = CLEVRER_WORLD,
) -> Iterator[NDArray[np.uint8]]:
    """Frames of `read_video` one by one, (height, width, 3) each, with its errors.

    Args:
        path, fps, world: see `read_video`.
        layout: which part of the frames to use; None for all.
        late: a list to which is appended, for each frame, how much later it was taken than at the world's rate (frames).
        note: called with what is unusual about the video, until the last frame has been read; None gives Python warnings.
    """
    path, wanted = video_of(path), world.timeline.fps
    layout, note = layout or Layout(), note or as_warnings(path)
    with opened(path, fps, wanted, note) as video:
        if abs(video.rate - wanted) > RATE_TOLERANCE:
            note(f"{video.rate:g} frames per second, resampled to {wanted}")
        n = 0
        for time, frame in _at_rate(_in_size(video.frames, layout, world.camera, note), wanted / video.rate):
            check_limit(n + 1, "frames", path, VideoError)
            if late is not None:
                late.append(time - n)
            n += 1
            yield frame
        if n == 0:
            raise undecodable(path)
        if n != world.timeline.frames:
            note(f"{n} frames, {world.name}'s videos have {world.timeline.frames}")


def sample_frames(
    path: VideoSource, seconds: float, spacing: int, fps: float = 0.0, world: World = CLEVRER_WORLD
) -> VideoSample:
    """Every `spacing`-th frame, at the world's frame rate, of the first seconds of a video; notes nothing.

    Raises:
        VideoError: see `read_video`.
    """
    path, wanted = video_of(path), world.timeline.fps
    frames: list[NDArray[np.uint8]] = []
    size = (0, 0)
    with opened(path, fps, wanted, unsaid) as video:
        for index, (_, frame) in enumerate(_at_rate(video.frames, wanted / video.rate)):
            if index >= seconds * wanted:
                break
            if index % spacing == 0:
                size = (frame.shape[1], frame.shape[0])
                frames.append(_scaled(frame, world.camera, most=1.0))
                check_limit(len(frames) * frames[0].nbytes, "array_bytes", path, VideoError)
        if not frames:
            raise undecodable(path)
    return VideoSample(np.stack([frame for frame in frames if frame.shape == frames[0].shape]), size)


def window_frames(path: Path, start: int, stop: int, world: World) -> Sequence[NDArray[np.uint8]]:
    """Frames `start` to `stop - 1` of a video at the world's frame rate, (height, width, 3) uint8 RGB, at most of its size.

    A video file of that rate is decoded from the last keyframe before them, any other video from its beginning. There are fewer
    frames where the video ends before `stop`. There are no warnings.

    Raises:
        VideoError: see `read_video`.
    """
    wanted = world.timeline.fps
    if not path.is_file() or abs(frame_rate(path) - wanted) > RATE_TOLERANCE:
        return list(sample_frames(path, stop / wanted, 1, world=world).frames[start:stop])
    return [_scaled(frame, world.camera, most=1.0) for frame in read_window(path, start, stop, wanted)]


def video_seconds(path: str | Path, fps: float = 0.0) -> float:
    """How long a video lasts according to its header (seconds); 0 if the header does not say. No frame is decoded.

    Raises:
        VideoError: see `read_video`.
    """
    with opened(Path(path), fps, CLEVRER_WORLD.timeline.fps, unsaid) as video:
        return video.seconds


def frame_rate(path: str | Path) -> float:
    """A video's frames per second according to its header.

    Raises:
        VideoError: see `read_video`.
    """
    with opened(Path(path), 0.0, CLEVRER_WORLD.timeline.fps, unsaid) as video:
        return video.rate


def _at_rate(frames: TimedFrames, last: float) -> TimedFrames:
    """Frames at whole times: the nearest in time of a fast video; each frame of a slow one until the next.

    The last frame lasts for the time `last`.
    """
    held: tuple[float, NDArray[np.uint8]] | None = None
    slot, following, distance, time = 0, 0, 0.0, 0.0
    for time, frame in frames:
        nearest = math.ceil(time - 0.5)
        if held is not None and nearest > slot:
            yield from repeat(held, nearest - following)
            following = nearest
        if held is None or nearest > slot or abs(time - nearest) < distance:
            held, slot, distance = (time, frame), max(nearest, slot), abs(time - nearest)
    if held is not None:
        yield from repeat(held, max(round(time + last), 1) - following)


def _in_size(frames: TimedFrames, layout: Layout, camera: Camera, note: Note) -> TimedFrames:
    """The frames in the size of the camera's image; another size is noted."""
    noted, size = False, (camera.height, camera.width)
    for time, frame in frames:
        height, width = frame.shape[:2]
        if (height, width) != size and not noted:
            note(f"{width}x{height} px, resized to {camera.width}x{camera.height}")
            noted = True
        is_right = (height, width) == size and layout.box_xyxy_px is None
        yield time, frame if is_right else _fitted(frame, layout, camera)


def _fitted(frame: NDArray[np.uint8], layout: Layout, camera: Camera) -> NDArray[np.uint8]:
    """The image in a frame, scaled to the size of the camera's."""
    if layout.box_xyxy_px is not None:
        left, top, right, bottom = layout.box_xyxy_px
        frame = frame[top:bottom, left:right]
    small = _scaled(frame, camera, stretched=layout.stretched)
    height, width = small.shape[:2]
    if (height, width) == (camera.height, camera.width):
        return small
    canvas = np.full((camera.height, camera.width, 3), small.reshape(-1, 3).mean(0), np.uint8)
    top, left = (camera.height - height) // 2, (camera.width - width) // 2
    canvas[top : top + height, left : left + width] = small
    return canvas


def _scaled(
    frame: NDArray[np.uint8], camera: Camera, most: float = math.inf, stretched: bool = False
) -> NDArray[np.uint8]:
    """The frame scaled so that it just fits into the camera's image, by a factor of at most `most`; or stretched to it."""
    height, width = frame.shape[:2]
    scale = min(camera.width / width, camera.height / height, most)
    size = (camera.width, camera.height) if stretched else (max(round(width * scale), 1), max(round(height * scale), 1))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(frame, size, interpolation=how), np.uint8)


def spaced(n_frames: int, count: int) -> NDArray[np.intp]:
    """Frame indices (count,), evenly spaced from the first to the last one; of a shorter video, some repeatedly."""
    return np.linspace(0, n_frames - 1, count).round().astype(np.intp)


def even_frames(path: str | Path, world: World = CLEVRER_WORLD) -> NDArray[np.uint8]:
    """All frames of a video to be encoded again: (F, H, W, 3) uint8 RGB, at most of the world's size, of even sides.

    Raises:
        VideoError: as `sample_frames`.
    """
    frames = sample_frames(path, limits().frames / world.timeline.fps, 1, world=world).frames
    height, width = (side // 2 * 2 for side in frames.shape[1:3])
    return frames[:, :height, :width]


def write_video(
    path: str | Path,
    frames: Iterable[NDArray[np.uint8]],
    fps: int | Fraction = CLEVRER_WORLD.timeline.fps,
    crf: int = 20,
    preset: str = "slow",
) -> None:
    """Write frames (H, W, 3) uint8 RGB as an H.264 mp4, atomically.

    Args:
        path: file to write.
        frames: the frames.
        fps: frame rate (1/s); CLEVRER's by default.
        crf: constant rate factor; lower is better quality.
        preset: x264's trade of time for size. "veryfast" takes a quarter of the time of "slow" on previews, with files of the
            same size and 0.2 to 0.3 dB less.

    Raises:
        DataError: PyAV is missing, there are no frames, or their sides are odd.
    """
    check_installed("av", "writing videos needs PyAV", "visualize")
    import av

    with atomic_path(path) as temporary:
        container = av.open(str(temporary), "w", format="mp4")
        with container:
            stream: Any = None
            for frame in frames:
                if stream is None:
                    if any(side % 2 for side in frame.shape[:2]):
                        raise DataError(f"{path}: expected frames of even sides, as H.264 wants, got {frame.shape}")
                    stream = container.add_stream("libx264", rate=Fraction(fps))
                    stream.height, stream.width, stream.pix_fmt = *frame.shape[:2], "yuv420p"
                    stream.options = {"crf": str(crf), "preset": preset, **REPRODUCIBLE}
                container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
            if stream is None:
                raise DataError(f"{path}: no frames to write")
            container.mux(stream.encode())

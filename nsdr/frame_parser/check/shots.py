"""Where a video jumps: cuts, and the jump back of a clip that is repeated."""

from collections.abc import Iterator
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.io.notes import Note

GRAY_SIZE = (120, 80)
"""Width and height of the images that are compared (pixels)."""
CHANGED_LEVELS = 15
"""Difference of brightness above which a pixel of the small images has changed (levels of 255)."""
SAME_SHARE = 0.0005
"""Two frames show the same if a smaller share of their pixels differs: videos converted to another rate repeat frames."""
MIN_CHANGE = 0.02
"""Share of pixels that change at a cut at least. Where a clip of CLEVRER's begins again, 0.04 to 0.2 change."""
JUMP = 5.0
"""At a cut, at least so many times as many pixels change as between the frames before and between those after it.
`python -m benchmarks.videos cuts CLIPS` prints the largest such ratio within clips: 1.3 at 25 frames a second, up to 3.9
where frames were left out or repeated unevenly."""


def small_gray(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A frame (height, width, 3) RGB as the small grey image (80, 120) that `change` compares."""
    small = cv2.resize(frame, GRAY_SIZE, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.uint8)


def change(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Share of pixels (0-1) that differ between two frames, given as the (H, W) images of `small_gray`."""
    return np.count_nonzero(cv2.absdiff(first, second) > CHANGED_LEVELS) / first.size


def is_cut(before: float, now: float, after: float) -> bool:
    """Whether a frame begins a new shot, by the change to it, and those between the two frames before and from it on."""
    return now > max(MIN_CHANGE, JUMP * before, JUMP * after)


def until_cut(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The frames (F, height, width, 3) of a sample before its first cut."""
    changes = [0.0, *(change(a, b) for a, b in pairwise(map(small_gray, frames)))]
    for k in range(1, len(frames) - 1):
        if is_cut(changes[k - 1], changes[k], changes[k + 1]):
            return frames[:k]
    return frames


def first_shot(
    frames: Iterator[NDArray[np.uint8]], max_frames: int, fps: int, note: Note
) -> Iterator[NDArray[np.uint8]]:
    """The frames (height, width, 3), `fps` a second, before the first cut, at most `max_frames`; what is left out is noted.

    Frames that are repeated count as one for the changes.
    """
    before, now = 0.0, 0.0
    last: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None  # a frame and its small image
    held: list[NDArray[np.uint8]] = []
    n = 0
    for frame in frames:
        following = last if last is not None and frame is last[0] else (frame, small_gray(frame))
        after = 0.0 if last is None else change(last[1], following[1])
        if after > SAME_SHARE:
            if n and is_cut(before, now, after):
                note(f"a cut after {n} frames ({n / fps:.1f} s); only what is before it is used")
                return
            yield from held
            n += len(held)
            held, before, now, last = [], now, after, following
        if n + len(held) == max_frames:
            yield from held
            note(too_long(max_frames, fps))
            return
        held.append(frame)
        last = following if last is None else last
    yield from held


def first_frames(
    frames: Iterator[NDArray[np.uint8]], max_frames: int, fps: int, note: Note
) -> Iterator[NDArray[np.uint8]]:
    """The first `max_frames` frames (H, W, 3), also those after a cut; that there are more is noted."""
    for index, frame in enumerate(frames):
        if index == max_frames:
            note(too_long(max_frames, fps))
            return
        yield frame


def too_long(max_frames: int, fps: int) -> str:
    """The note about a video with more frames than are processed."""
    seconds = max_frames / fps
    return f"longer than {max_frames} frames ({seconds:.1f} s); the rest is left out (setting video.max_frames)"

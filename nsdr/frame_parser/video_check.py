"""Is a video one of CLEVRER's scenes? A look at its first seconds, before the expensive work."""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError, VideoError
from nsdr.frame_parser.empty_scene import TURNS, FloatArray, GroundFit, fit_ground, read_background, references, turned
from nsdr.frame_parser.padding import ASPECT, ASPECT_TOLERANCE, content_box, middle_of
from nsdr.frame_parser.shots import change, first_shot, is_cut
from nsdr.io.validation import MANY, check_ranges
from nsdr.io.video import Layout, VideoSample, read_frames, sample_frames
from nsdr.io.video_kinds import check_is_video
from nsdr.world.timeline import FPS

__all__ = ["CHECKS", "VideoCheck", "VideoConfig", "check_video", "clip_frames", "look"]

CHECKS = ("refuse", "warn", "off")
SAMPLED_SECONDS, SPACING_FRAMES = 2.56, 2
"""The check looks at every second frame of this time."""
MEDIAN_SPACING, NOISE_SPACING_PX = 2, 3
"""Of these, every second one makes the median frame; every third row and column is looked at for noise. Both save time."""

# The following values lie between the kinds of video that `python benchmarks/video_check.py CLIPS` prints with their figures.
MAX_GROUND_DISTANCE, FOREIGN_GROUND_DISTANCE = 0.48, 1.0
"""`GroundFit.distance` up to which the ground is CLEVRER's, and above which it certainly is not."""
TURNED_SHARE = 0.5
"""A turned image fits if it leaves at most this share of the distance."""
MIN_COLOR, FOREIGN_COLOR = 0.75, 0.5
"""`GroundFit.color` down to which colours are CLEVRER's, and below which they certainly are not."""
MIN_SATURATION = 8
"""Largest difference between the channels of a pixel, below which a video is grey (levels of 255, sharp quantile)."""
SATURATION_QUANTILE = 0.999
MAX_TINT = 6.0
"""`GroundFit.tint` up to which white is white (levels of 255)."""
MAX_BRIGHTNESS, FOREIGN_BRIGHTNESS = 15.0, 112.0
"""`GroundFit.brightness` up to which a video is as bright as CLEVRER's, and above which nothing is to be seen."""
MIN_GAIN, MAX_GAIN = 0.8, 1.25
"""`GroundFit.gain` of videos with CLEVRER's contrast."""
MAX_NOISE, FOREIGN_NOISE = 4.0, 18.0
"""Change of an unmoved pixel between sampled frames, up to which it is compression, and above which objects drown (levels)."""
MIN_MOTION = 0.0005
"""Share of pixels that changes at least between some sampled frames, if anything moves."""
MIN_RANGE = 4.0
"""Range of brightness of the median frame below which it shows nothing (levels of 255)."""
DARK, WHITE = 25.0, 230.0
"""Brightness below which a flat background is called black, and above which white (levels of 255)."""


@dataclass(frozen=True)
class VideoConfig:
    """What is expected of videos.

    Attributes:
        check: "refuse" raises an error for videos that are not of CLEVRER's scene, "warn" only warns of them, "off" does not
            look. Padding is found unless it is "off".
        background: image file of the scene without objects, for another camera or other lamps; "" for CLEVRER's.
        max_frames: frames that are processed at most (at 25 per second).
    """

    check: str = "refuse"
    background: str = ""
    max_frames: int = 512

    def __post_init__(self) -> None:
        if self.check not in CHECKS:
            raise DataError(f"check is {self.check!r}; expected one of {', '.join(CHECKS)}")
        check_ranges(self, max_frames=MANY)


@dataclass(frozen=True)
class VideoCheck:
    """What was found out about a video before it is processed.

    Attributes:
        refusals: why it certainly is not of CLEVRER's scene.
        doubts: what else differs from CLEVRER's videos.
        layout: where in the frames the image is.
        ground: how the ground compares with the scene without objects; None where nothing is to be seen.
    """

    refusals: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    layout: Layout = field(default_factory=Layout)
    ground: GroundFit | None = None

    @property
    def kind(self) -> str:
        """Class of the video: "in" (as CLEVRER's), "doubtful" or "out"."""
        return "out" if self.refusals else "doubtful" if self.doubts else "in"


def check_video(path: str | Path, config: VideoConfig | None = None) -> VideoCheck:
    """Look at a video's first seconds.

    Raises:
        VideoError: the file cannot be read, or the video is "out" and the configuration refuses such.
        DataError: the background of the configuration cannot be read.
    """
    path, config = Path(path), config or VideoConfig()
    if config.check == "off":
        return VideoCheck()
    check_is_video(path)
    status = path.stat()
    found = _looked_at(path, status.st_mtime_ns, status.st_size, config.background)
    if found.kind == "out" and config.check == "refuse":
        raise VideoError(
            f"{path}: not a video of CLEVRER's scene: {'; '.join(found.refusals)}. Expected: its grey ground, lamps and "
            f"camera, upright, in colour, 480x320. --force goes on all the same (in Python, VideoConfig(check='warn')); "
            "docs/other_cameras.md is about other scenes"
        )
    return found


def clip_frames(path: str | Path, config: VideoConfig | None = None) -> Iterator[NDArray[np.uint8]]:
    """The frames of `nsdr.io.video.read_frames` that are processed: checked, without padding, up to the first cut.

    Warns of everything that is doubtful.

    Raises:
        VideoError, DataError: as of `check_video`; before the first frame.
    """
    config = config or VideoConfig()
    check = check_video(path, config)
    for reason in (*check.refusals, *check.doubts):
        warnings.warn(f"{path}: {reason}", stacklevel=2)
    frames = read_frames(path, check.layout)
    yield from frames if config.check == "off" else first_shot(frames, path, config.max_frames)


@lru_cache(maxsize=64)
def _looked_at(path: Path, _modified_ns: int, _size: int, background: str) -> VideoCheck:
    """The check of a file; kept while it is the same."""
    known = [read_background(background)] if background else list(references().values())
    return look(sample_frames(path, SAMPLED_SECONDS, SPACING_FRAMES), known)


def look(sample: VideoSample, known: Sequence[FloatArray]) -> VideoCheck:
    """Compare a video's sample with images (32, 48, 3) of the scene without objects, of which one has to fit."""
    frames = _until_cut(sample.frames)
    median = np.asarray(np.median(frames[::MEDIAN_SPACING], 0), np.float32)
    low, high = np.quantile(median.mean(2), [0.01, 0.99])
    if high - low < MIN_RANGE:
        name = "black" if high < DARK else "white" if low > WHITE else "one flat colour"
        when = "" if len(frames) == len(sample.frames) else f" in the first {len(frames) * SPACING_FRAMES / FPS:.1f} s"
        return VideoCheck((f"the background is {name}{when}",))
    layout, image, expected, doubts = _layout(median, sample.size_px, known)
    ground = _best_fit(image, expected)
    refusals: list[str] = []
    if ground.distance > MAX_GROUND_DISTANCE:
        turn, after = _turn(image, known)
        if after.distance <= min(MAX_GROUND_DISTANCE, TURNED_SHARE * ground.distance):
            (doubts if turn == "mirrored" else refusals).append(f"it is {turn}")
            ground = after
    for found, text in (*_ground_reasons(ground), *_color_reasons(ground, frames), *_motion_reasons(frames)):
        (refusals if found == "out" else doubts).append(text)
    return VideoCheck(tuple(refusals), tuple(doubts), layout, ground)


def _until_cut(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    changes = [0.0, *(change(a, b) for a, b in pairwise(frames))]
    for k in range(1, len(frames) - 1):
        if is_cut(changes[k - 1], changes[k], changes[k + 1]):
            return frames[:k]
    return frames


def _best_fit(image: FloatArray, expected: Sequence[FloatArray]) -> GroundFit:
    return min((fit_ground(image, reference) for reference in expected), key=lambda fit: fit.distance)


def _turn(image: FloatArray, expected: Sequence[FloatArray]) -> tuple[str, GroundFit]:
    """How the image is turned most likely, and its fit when it is turned back."""
    fits = {turn: _best_fit(turned(image, turn), expected) for turn in TURNS}
    turn = min(fits, key=lambda t: fits[t].distance)
    return turn, fits[turn]


def _layout(
    median: FloatArray, size_px: tuple[int, int], known: Sequence[FloatArray]
) -> tuple[Layout, FloatArray, Sequence[FloatArray], list[str]]:
    """Where the image is, the image, the references that it is to be compared with, and what is doubtful about it."""
    left, top, right, bottom = content_box(median)
    image = median[top:bottom, left:right]
    doubts, box = [], None
    if image.shape != median.shape:
        scale = np.array(size_px)[[0, 1, 0, 1]] / np.array(median.shape)[[1, 0, 1, 0]]
        x0, y0, x1, y1 = (int(v) for v in np.round(scale * [left, top, right, bottom]))
        box = (x0, y0, x1, y1)
        doubts.append(
            f"bars around the image are cut off: {x1 - x0}x{y1 - y0} of {size_px[0]}x{size_px[1]} px are left"
        )
    aspect = (right - left) / (bottom - top) * (size_px[0] / median.shape[1]) / (size_px[1] / median.shape[0])
    if abs(aspect / ASPECT - 1) < ASPECT_TOLERANCE:
        return Layout(box, stretched=True), image, known, doubts
    middle = [middle_of(reference, aspect) for reference in known]
    shape = f"an image of {aspect:.2f}:1, not {ASPECT:g}:1"
    if _best_fit(image, known).distance <= _best_fit(image, middle).distance:
        doubts.append(f"{shape}: taken as stretched, and stretched back")
        return Layout(box, stretched=True), image, known, doubts
    doubts.append(f"{shape}: taken as the middle of one; what was cut off is not seen")
    return Layout(box), image, middle, doubts


def _ground_reasons(ground: GroundFit) -> Iterator[tuple[str, str]]:
    way = "darker" if ground.brightness < 0 else "brighter"
    exposure = f"{way} than CLEVRER's videos by {abs(ground.brightness):.0f} of 255 levels"
    if abs(ground.brightness) > FOREIGN_BRIGHTNESS:
        yield "out", exposure
        return
    if ground.distance > FOREIGN_GROUND_DISTANCE:
        figure = f"{ground.distance:.1f} levels" if np.isfinite(ground.distance) else "no such pattern"
        yield "out", f"the background is not the empty scene ({figure}; at most {FOREIGN_GROUND_DISTANCE})"
        return
    if ground.distance > MAX_GROUND_DISTANCE:
        why = "cropped, zoomed, tilted, or another camera or other lamps; positions and sizes may be wrong"
        yield "doubtful", f"the background differs from the empty scene ({ground.distance:.1f} levels): {why}"
    if abs(ground.brightness) > MAX_BRIGHTNESS:
        yield "doubtful", exposure
    elif not MIN_GAIN < ground.gain < MAX_GAIN:
        yield (
            "doubtful",
            f"the background has {ground.gain:.0%} of the contrast of the empty scene: cropped, or other levels",
        )


def _color_reasons(ground: GroundFit, frames: NDArray[np.uint8]) -> Iterator[tuple[str, str]]:
    if ground.distance > FOREIGN_GROUND_DISTANCE:
        return
    spread = frames.max(3) - frames.min(3)
    if ground.color < FOREIGN_COLOR and np.quantile(spread, SATURATION_QUANTILE) < MIN_SATURATION:
        yield "out", "it is in shades of grey"
    elif ground.color < -FOREIGN_COLOR:
        yield "out", "its colours are exchanged, such as red and blue"
    elif ground.color < MIN_COLOR:
        found = "out" if ground.color < FOREIGN_COLOR else "doubtful"
        yield found, "the colours of the background are not those of the empty scene; colours may be wrong"
    elif abs(ground.tint) > MAX_TINT:
        yield "doubtful", f"it is tinted {'red' if ground.tint > 0 else 'blue'}; colours may be wrong"


def _motion_reasons(frames: NDArray[np.uint8]) -> Iterator[tuple[str, str]]:
    if len(frames) < 2:
        return
    sparse = frames[:, ::NOISE_SPACING_PX, ::NOISE_SPACING_PX]
    noise = float(np.median([np.median(cv2.absdiff(a, b)) for a, b in pairwise(sparse)]))
    if noise > MAX_NOISE:
        yield (
            ("out" if noise > FOREIGN_NOISE else "doubtful"),
            f"it is noisy: still pixels change by {noise:.0f} of 255 levels",
        )
    elif max(change(frames[0], frame) for frame in frames[1:]) < MIN_MOTION:
        yield "doubtful", f"nothing moves in the first {len(frames) * SPACING_FRAMES / FPS:.1f} s"

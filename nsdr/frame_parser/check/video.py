"""Is a video one of CLEVRER's scenes? A look at its first seconds, before the expensive work."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from nsdr.errors import VideoError
from nsdr.frame_parser.check.ground import GroundFit, best_fit, read_background, references
from nsdr.frame_parser.check.layout import find_layout, part_of
from nsdr.frame_parser.check.reasons import (
    MAX_EDGE_PX,
    MAX_GROUND_DISTANCE,
    SPACING_FRAMES,
    edge_width_px,
    needed_levels,
    reasons,
)
from nsdr.frame_parser.check.shots import first_frames, first_shot, until_cut
from nsdr.io.decoding import RATES, check_is_video
from nsdr.io.images import Frames, Video, VideoSource, video_of
from nsdr.io.notes import Note, as_warnings
from nsdr.io.video import Layout, VideoSample, read_frames, sample_frames
from nsdr.io.worlds import known_world_beside
from nsdr.validation import FloatArray, PositiveCount, Settings
from nsdr.world.world import CLEVRER_WORLD, World

SAMPLED_SECONDS = 2.56
"""The check looks at this time of a video."""
MEDIAN_SPACING = 2
"""Every second one of the frames that are looked at makes the median frame, which saves time."""
MIRRORED_SHARE = 0.5
"""A video is mirrored if mirroring its image leaves at most this share of the distance."""
MIN_RANGE = 4.0
"""Range of brightness of a frame below which it shows nothing (levels of 255)."""
DARK, WHITE = 25.0, 230.0
"""Brightness below which a flat background is called black, and above which white (levels of 255)."""


@dataclass(frozen=True)
class VideoConfig(Settings):
    """What is expected of videos.

    Attributes:
        check: "refuse" raises an error for videos that are not of CLEVRER's scene, "warn" only warns of them, "off" does not
            look. Padding is found unless it is "off".
        background: image file of the scene without objects, for another camera or other lamps; "" for CLEVRER's. A world with
            another look is not checked without one.
        max_frames: frames that are processed at most.
        fps: frames per second in place of what the videos say; 0 for that.
    """

    check: Literal["refuse", "warn", "off"] = "refuse"
    background: str = ""
    max_frames: PositiveCount = 512
    fps: Annotated[float, Meta(ge=0, le=RATES[1])] = 0.0


@dataclass(frozen=True)
class VideoCheck:
    """What was found out about a video before it is processed.

    Attributes:
        refused: why it certainly is not of CLEVRER's scene.
        warned: what else differs from CLEVRER's videos.
        layout: where in the frames the image is.
        levels: what each level of the image has to become, (256,) uint8; None where they are right.
        ground: how the ground compares with the scene without objects; None where nothing is to be seen.
        unfit: why it cannot be judged: places that are wrong or not seen, words that may be misread.
    """

    refused: tuple[str, ...] = ()
    warned: tuple[str, ...] = ()
    layout: Layout = field(default_factory=Layout)
    levels: NDArray[np.uint8] | None = None
    ground: GroundFit | None = None
    unfit: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Class of the video: "in" (as CLEVRER's), "warned" or "refused"."""
        return "refused" if self.refused else "warned" if self.warned else "in"


def check_video(path: VideoSource, config: VideoConfig | None = None, world: World = CLEVRER_WORLD) -> VideoCheck:
    """Look at the first seconds of a video: a file, or frames as `nsdr.io.images.video_of` takes them.

    Args:
        path: the video.
        config: what is expected; None for the defaults.
        world: what the video should be of.

    Raises:
        VideoError: the file cannot be read; or the configuration wants an error, and the video is "refused", or in a data set
            that was generated in another world.
        DataError: the background of the configuration cannot be read.
    """
    path, config = video_of(path), config or VideoConfig()
    if isinstance(path, Path) and config.check == "refuse":
        _check_data_set(path, world)
    if config.check == "off" or (world.look != CLEVRER_WORLD.look and not config.background):
        return VideoCheck()
    found = _found_in(path, config, world)
    if found.kind == "refused" and config.check == "refuse":
        size = f"{world.camera.width}x{world.camera.height}"
        raise VideoError(
            f"{path}: not a video of {world.name}'s scene: {'; '.join(found.refused)}. Expected: its ground, lamps and "
            f"camera, upright, in colour, {size}. --force goes on all the same (in Python, VideoConfig(check='warn')); "
            "the documentation's page 'Make your own benchmark' is about other scenes"
        )
    return found


def _check_data_set(path: Path, world: World) -> None:
    """Raise `VideoError` if a video is in a data set that was generated in another world."""
    theirs = known_world_beside(path, levels=4)
    if theirs is not None and (differing := theirs.differences(world)):
        raise VideoError(
            f"{path}: is of a data set of the world {theirs.name}, and not of {world.name}, which has other "
            f"{', '.join(differing)}; give --checkpoint with weights for {theirs.name}, its values (--set world.…), or "
            "--force (in Python, VideoConfig(check='warn'))"
        )


def _found_in(path: Video, config: VideoConfig, world: World) -> VideoCheck:
    """The check of a video; that of a file is kept while it is the same."""
    if isinstance(path, Frames):
        return _look_at(path, config.background, config.fps, world)
    check_is_video(path)
    files = [path, *(sorted(path.iterdir()) if path.is_dir() else ())]
    if Path(config.background).is_file():
        files.append(Path(config.background))
    state = tuple((file, file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    return _looked_at(path, state, config.background, config.fps, world)


def clip_frames(
    path: VideoSource,
    config: VideoConfig | None = None,
    beyond_cuts: bool = False,
    late: list[float] | None = None,
    note: Note | None = None,
    world: World = CLEVRER_WORLD,
) -> Iterator[NDArray[np.uint8]]:
    """The frames (H, W, 3) of `nsdr.io.video.read_frames` that are processed: checked, without padding, up to the first cut.

    Args:
        path: a video file, or frames as `nsdr.io.images.video_of` takes them.
        config: what is expected; None for the defaults.
        beyond_cuts: whether frames after a cut are processed, too: where objects jump, a video may seem to have one.
        late: see `nsdr.io.video.read_frames`.
        note: gets all that is unusual, until the last frame was read; None gives Python warnings.
        world: what the video should be of.

    Raises:
        VideoError, DataError: as in `check_video`, or no frame shows anything; before the first frame.
    """
    path, config = video_of(path), config or VideoConfig()
    note = note or as_warnings(path)
    check = check_video(path, config, world)
    for reason in (*check.refused, *check.warned):
        note(reason)
    frames = read_frames(path, check.layout, config.fps, late, note, world)
    if config.check == "off":
        yield from frames
        return
    used = first_frames if beyond_cuts else first_shot
    shot = used(_without_empty_start(frames, path, late, note), config.max_frames, world.timeline.fps, note)
    yield from shot if check.levels is None else _corrected(shot, check.levels)


def _corrected(frames: Iterator[NDArray[np.uint8]], levels: NDArray[np.uint8]) -> Iterator[NDArray[np.uint8]]:
    """The frames with other levels; one that is repeated stays the same array."""
    last: NDArray[np.uint8] | None = None
    for frame in frames:
        if frame is not last:
            last, right = frame, levels[frame]
        yield right


def _without_empty_start(
    frames: Iterator[NDArray[np.uint8]], path: Video, late: list[float] | None, note: Note
) -> Iterator[NDArray[np.uint8]]:
    empty = 0
    for frame in frames:
        if not _is_empty(frame):
            break
        empty += 1
    else:
        raise VideoError(f"{path}: shows nothing; each of its {empty} frames is of one colour")
    if empty:
        note(f"the first {empty} frames show nothing; they are left out, and frames counted from there")
    if late is not None:
        del late[:empty]
    yield frame
    yield from frames


def _is_empty(frame: NDArray[Any]) -> bool:
    """Whether an image (height, width, 3) is of one colour."""
    low, high = np.quantile(frame[::8, ::8].mean(2), [0.01, 0.99])
    return bool(high - low < MIN_RANGE)


@lru_cache(maxsize=64)
def _looked_at(
    path: Path, _state: tuple[tuple[Path, int, int], ...], background: str, fps: float, world: World
) -> VideoCheck:
    """`_look_at` a file; kept while its files are the same."""
    return _look_at(path, background, fps, world)


def _look_at(path: Video, background: str, fps: float, world: World) -> VideoCheck:
    known = [read_background(background)] if background else list(references().values())
    return look(sample_frames(path, SAMPLED_SECONDS, SPACING_FRAMES, fps, world), known, world)


def look(sample: VideoSample, known: Sequence[FloatArray], world: World) -> VideoCheck:
    """Compare a video's sample with images (32, 48, 3) of the scene without objects, of which one has to fit."""
    start = next((k for k, frame in enumerate(sample.frames) if not _is_empty(frame)), None)
    if start is None:
        brightness = float(sample.frames[0].mean())
        color = "black" if brightness < DARK else "white" if brightness > WHITE else "one flat colour"
        return VideoCheck((f"the background is {color}",))
    frames = until_cut(sample.frames[start:])
    median = np.asarray(np.median(frames[::MEDIAN_SPACING], 0), np.float32)
    box, layout, expected, warned = find_layout(median, sample.size_px, known, world.camera.width / world.camera.height)
    unfit = [] if layout.stretched else warned[-1:]  # what is cut off is not seen
    image, frames = part_of(median, box), part_of(frames, box)
    ground, reference = best_fit(image, expected)
    refused: list[str] = []
    if ground.distance > MAX_GROUND_DISTANCE:
        mirrored = np.ascontiguousarray(image[:, ::-1])
        after, fitting = best_fit(mirrored, expected)
        if after.distance <= min(MAX_GROUND_DISTANCE, MIRRORED_SHARE * ground.distance):
            warned.append("it is mirrored (left and right are exchanged)")
            image, ground, reference = mirrored, after, fitting
    if (width := edge_width_px(frames)) > MAX_EDGE_PX:
        what = "it is blurred, very small or strongly compressed"
        unfit.append(f"{what} (edges of {width:.1f} pixels, at most {MAX_EDGE_PX}); words of objects may be misread")
    levels = needed_levels(frames, ground)
    for reason in reasons(frames, image, reference, ground, levels is not None, world.timeline.fps):
        (refused if reason.is_certain else warned).append(reason.text)
        if reason.unfit and not reason.is_certain:
            unfit.append(reason.text)
    return VideoCheck(tuple(refused), tuple(warned), layout, levels, ground, tuple(unfit))

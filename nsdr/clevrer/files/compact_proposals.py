"""Compact NPZ files: the mask proposals of many videos of one world in numbers, without the masks."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.files.annotations import IRREGULAR_VIDEOS
from nsdr.clevrer.files.masks import PIXEL_CENTRE_PX
from nsdr.clevrer.files.schema import LARGEST_ID
from nsdr.errors import DataError
from nsdr.io.limits import check_limit, limits
from nsdr.io.reading import parse_json, read_npz
from nsdr.io.worlds import stored_world, world_in
from nsdr.types import VideoProposals
from nsdr.validation import Array, IntArray, Settings, expect
from nsdr.world.world import World

__all__ = ["compact_rows", "read_compact_proposals"]

WORLD = "world"
"""Name of the JSON text in a compact file that says its world; without it, the file is of CLEVRER's."""
COMPACT_SCORE_STEPS = 255
"""Steps per unit of score in compact files, which store scores as bytes."""
COMPACT_CENTROID_STEPS_PER_PX = 64
"""Steps per pixel of centroids in compact files."""


@dataclass(frozen=True)
class _Compact(Settings):
    """The arrays of a compact file, and the world of its videos."""

    video: Annotated[IntArray, Array("n", low=0, high=LARGEST_ID)]
    frame: Annotated[IntArray, Array("n", low=0)]
    attr: Annotated[IntArray, Array("n", low=0)]
    score: Annotated[IntArray, Array("n", low=0)]
    cx64: Annotated[IntArray, Array("n", low=0)]
    cy64: Annotated[IntArray, Array("n", low=0)]
    area: Annotated[IntArray, Array("n", low=1)]
    box: Annotated[IntArray, Array("n", 4, low=0)]
    world: World

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, most in _largest(self.world).items():
            highest = int(getattr(self, name).max())
            expect(highest <= most, name, f"up to {most}", highest)
        check_limit(int(self.frame.max()) + 1, "frames", "frame")
        left, top, right, bottom = self.box.T
        width, height = self.world.camera.width, self.world.camera.height
        fits = (left < right) & (top < bottom) & (right <= width) & (bottom <= height)
        row = int(fits.argmin())
        expected = f"left < right, top < bottom, right up to {width}, bottom up to {height}"
        expect(bool(fits.all()), f"box: row {row}", expected, self.box[row].tolist())
        place = self.video.astype(np.int64) * limits().frames + self.frame
        ascending = np.diff(place, prepend=0) >= 0
        row = int(ascending.argmin())
        after, found = (f"video {self.video[r]}, frame {self.frame[r]}" for r in (row - 1, row))
        expect(bool(ascending.all()), f"row {row}", "ascending videos and frames", f"{found} after {after}")
        per_frame = np.diff(np.flatnonzero(np.diff(place, prepend=-1, append=-1)))
        check_limit(int(per_frame.max()), "frame_objects", "detections in a frame")


COMPACT_ARRAYS = tuple(field.name for field in fields(_Compact) if field.name != WORLD)
"""Arrays of a compact file with one row per detection."""


def _largest(world: World) -> dict[str, int]:
    """The largest values of arrays, which are stored in the smallest type that holds them."""
    width, height, steps = world.camera.width, world.camera.height, COMPACT_CENTROID_STEPS_PER_PX
    pixels = {"cx64": width * steps, "cy64": height * steps, "area": width * height, "box": max(width, height)}
    return {"attr": world.vocabulary.n_triples - 1, "score": COMPACT_SCORE_STEPS, **pixels}


def compact_rows(video: int, proposals: VideoProposals) -> dict[str, NDArray[Any]]:
    """The arrays of a compact file for one video; inverse of `read_compact_proposals`, but for masks and rounding.

    Args:
        video: index of the video.
        proposals: its N detections.

    Returns:
        The `COMPACT_ARRAYS` by name: (N,) integers, `box` (N, 4); and `world`, a JSON text, if it is another than CLEVRER's.
    """
    centroid = np.rint((proposals.centroid_px - PIXEL_CENTRE_PX) * COMPACT_CENTROID_STEPS_PER_PX)
    values = {
        "attr": proposals.attribute,
        "score": np.rint(proposals.score * COMPACT_SCORE_STEPS),
        "cx64": centroid[:, 0],
        "cy64": centroid[:, 1],
        "area": proposals.area_px,
        "box": proposals.box_xyxy_px,
    }
    stored = stored_world(proposals.world)
    return {
        "video": np.full(len(proposals), video, np.uint32),
        "frame": proposals.frame_index.astype(np.uint16),
        **{name: values[name].astype(np.min_scalar_type(most)) for name, most in _largest(proposals.world).items()},
        **({WORLD: np.array(json.dumps(stored))} if stored else {}),
    }


def read_compact_proposals(
    path: str | Path, n_frames: Mapping[int, int] | None = None
) -> Iterator[tuple[int, VideoProposals]]:
    """Read a compact NPZ file: proposals of many videos without masks, one row per detection.

    Arrays: `video`, `frame`, `attr` (attribute index), `score` (0-255), `cx64` and `cy64` (mean pixel index in 1/64 px),
    `area`, and `box` (left, top, right, bottom); rows are sorted by video and frame. `world` is a JSON text if the videos are
    of another world than CLEVRER's.

    Args:
        path: the NPZ file.
        n_frames: number of frames by video index; others have as many as their world's videos, in CLEVRER 128, or more if rows
            show more.

    Yields:
        (video index, proposals without masks).

    Raises:
        DataError: a missing or malformed file, or values out of range; names the file, the array and the first wrong row.
    """
    a = _compact_arrays(path)
    starts = np.flatnonzero(np.diff(a.video.astype(np.int64), prepend=-1))
    for start, stop in zip(starts, [*starts[1:], len(a.video)], strict=True):
        rows = slice(int(start), int(stop))
        video = int(a.video[start])
        frame = a.frame[rows].astype(np.int64)
        shown_frames = max(a.world.timeline.frames, int(frame[-1]) + 1)
        length = (n_frames or {}).get(video, shown_frames)
        if int(frame[-1]) >= length:
            # The rows of an irregular video go beyond the frames that its truth counts.
            if video not in IRREGULAR_VIDEOS:
                raise DataError(
                    f"{path}: frame: video {video} has {length} frames, row {int(stop) - 1} frame {frame[-1]}"
                )
            length = shown_frames
        yield (
            video,
            VideoProposals(
                length,
                frame,
                a.attr[rows].astype(np.int64),
                a.score[rows] / COMPACT_SCORE_STEPS,
                np.stack([a.cx64[rows], a.cy64[rows]], 1) / COMPACT_CENTROID_STEPS_PER_PX + PIXEL_CENTRE_PX,
                a.area[rows].astype(np.int64),
                a.box[rows].astype(np.int64),
                world=a.world,
            ),
        )


def _compact_arrays(path: str | Path) -> _Compact:
    stored = read_npz(path)
    missing = [name for name in COMPACT_ARRAYS if name not in stored]
    if missing:
        raise DataError(f"{path}: not a compact proposal file: it has no {', '.join(missing)}")
    expect(stored["video"].size > 0, str(path), "at least 1 row", "none")
    text = str(stored.get(WORLD, "{}"))
    world = world_in(parse_json(text.encode(), f"{path}: {WORLD}", dict[str, Any]), f"{path}: ")
    try:
        return _Compact(**{name: stored[name] for name in COMPACT_ARRAYS}, world=world)
    except DataError as e:
        raise DataError(f"{path}: {e}") from e

"""Compact NPZ files: the mask proposals of many videos in numbers, without the masks."""

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
from nsdr.io.reading import read_npz
from nsdr.types import VideoProposals
from nsdr.validation import Array, IntArray, Settings, expect
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.physics_constants import VIDEO_FRAMES
from nsdr.world.vocabulary import N_ATTRIBUTE_TRIPLES

__all__ = ["compact_rows", "read_compact_proposals"]

COMPACT_SCORE_STEPS = 255.0
"""Steps per unit of score in compact files, which store scores as bytes."""
COMPACT_CENTROID_STEPS_PER_PX = 64.0
"""Steps per pixel of centroids in compact files."""


@dataclass(frozen=True)
class _Compact(Settings):
    """The arrays of a compact file."""

    video: Annotated[IntArray, Array("n", low=0, high=LARGEST_ID)]
    frame: Annotated[IntArray, Array("n", low=0)]
    attr: Annotated[IntArray, Array("n", low=0, high=N_ATTRIBUTE_TRIPLES - 1)]
    score: Annotated[IntArray, Array("n", low=0, high=COMPACT_SCORE_STEPS)]
    cx64: Annotated[IntArray, Array("n", low=0, high=WIDTH_PX * COMPACT_CENTROID_STEPS_PER_PX)]
    cy64: Annotated[IntArray, Array("n", low=0, high=HEIGHT_PX * COMPACT_CENTROID_STEPS_PER_PX)]
    area: Annotated[IntArray, Array("n", low=1, high=HEIGHT_PX * WIDTH_PX)]
    box: Annotated[IntArray, Array("n", 4, low=0, high=WIDTH_PX)]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_limit(int(self.frame.max()) + 1, "frames", "frame")
        left, top, right, bottom = self.box.T
        fits = (left < right) & (top < bottom) & (bottom <= HEIGHT_PX)
        row = int(fits.argmin())
        expected = f"left < right, top < bottom, bottom up to {HEIGHT_PX}"
        expect(bool(fits.all()), f"box: row {row}", expected, self.box[row].tolist())
        place = self.video.astype(np.int64) * limits().frames + self.frame
        ascending = np.diff(place, prepend=0) >= 0
        row = int(ascending.argmin())
        after, found = (f"video {self.video[r]}, frame {self.frame[r]}" for r in (row - 1, row))
        expect(bool(ascending.all()), f"row {row}", "ascending videos and frames", f"{found} after {after}")
        per_frame = np.diff(np.flatnonzero(np.diff(place, prepend=-1, append=-1)))
        check_limit(int(per_frame.max()), "frame_objects", "detections in a frame")


COMPACT_ARRAYS = tuple(field.name for field in fields(_Compact))
"""Arrays of a compact file."""


def compact_rows(video: int, proposals: VideoProposals) -> dict[str, NDArray[Any]]:
    """The arrays of a compact file for one video; inverse of `read_compact_proposals`, but for masks and rounding.

    Args:
        video: index of the video.
        proposals: its N detections.

    Returns:
        The `COMPACT_ARRAYS` by name: (N,) integers, `box` (N, 4).
    """
    centroid = np.rint((proposals.centroid_px - PIXEL_CENTRE_PX) * COMPACT_CENTROID_STEPS_PER_PX)
    return {
        "video": np.full(len(proposals), video, np.uint32),
        "frame": proposals.frame_index.astype(np.uint16),
        "attr": proposals.attribute.astype(np.uint8),
        "score": np.rint(proposals.score * COMPACT_SCORE_STEPS).astype(np.uint8),
        "cx64": centroid[:, 0].astype(np.uint16),
        "cy64": centroid[:, 1].astype(np.uint16),
        "area": proposals.area_px.astype(np.uint32),
        "box": proposals.box_xyxy_px.astype(np.uint16),
    }


def read_compact_proposals(
    path: str | Path, n_frames: Mapping[int, int] | None = None
) -> Iterator[tuple[int, VideoProposals]]:
    """Read a compact NPZ file: proposals of many videos without masks, one row per detection.

    Arrays: `video`, `frame`, `attr` (attribute index), `score` (0-255), `cx64` and `cy64` (mean pixel index in 1/64 px),
    `area`, and `box` (left, top, right, bottom); rows are sorted by video and frame.

    Args:
        path: the NPZ file.
        n_frames: number of frames by video index; others have 128, or more if rows show more.

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
        shown_frames = max(VIDEO_FRAMES, int(frame[-1]) + 1)
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
            ),
        )


def _compact_arrays(path: str | Path) -> _Compact:
    stored = read_npz(path)
    missing = [name for name in COMPACT_ARRAYS if name not in stored]
    if missing:
        raise DataError(f"{path}: not a compact proposal file: it has no {', '.join(missing)}")
    expect(stored["video"].size > 0, str(path), "at least 1 row", "none")
    try:
        return _Compact(**{name: stored[name] for name in COMPACT_ARRAYS})
    except DataError as e:
        raise DataError(f"{path}: {e}") from e

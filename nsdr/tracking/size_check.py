"""Whether objects look as large as the camera makes them: other cameras, zoom and stretching show here."""

import numpy as np
from numpy.typing import NDArray

from nsdr.tracking.localization import expected_size
from nsdr.tracking.visibility import cut_sides
from nsdr.types import VideoTracks

__all__ = ["size_doubt", "size_ratio"]

QUANTILE = 0.75
"""Of the ratios in an object's frames, and of those of the objects: objects that others hide in part look smaller."""
MIN_FRAMES, MIN_OBJECTS = 5, 2
"""Frames in which an object is seen whole, and objects, that a ratio needs at least."""
TYPICAL_RATIO = np.array([1.02, 0.99])
"""Ratios of width and height of official proposals, see `MAX_RATIO`."""
MAX_RATIO = 1.08
"""Largest ratio, relative to the typical one, and inverse of the smallest. `python benchmarks/video_sizes.py PROPOSALS.npz`
prints the typical ones and the largest deviation: below 1.06 in 300 training videos."""


def size_ratio(tracks: VideoTracks) -> NDArray[np.float64] | None:
    """Width and height (2,) of objects relative to what is expected at their places; None if too little is seen whole."""
    ratios = []
    for track in tracks.tracks:
        whole = ~cut_sides(track.box_xyxy_px).any(1)
        if whole.sum() >= MIN_FRAMES:
            box = track.box_xyxy_px[whole].astype(float)
            expected = expected_size(track.object.shape, track.location_world[whole], tracks.camera)
            ratios.append(np.quantile((box[:, 2:] - box[:, :2]) / expected, QUANTILE, axis=0))
    return np.asarray(np.quantile(ratios, QUANTILE, axis=0)) if len(ratios) >= MIN_OBJECTS else None


def size_doubt(tracks: VideoTracks) -> str:
    """What is doubtful about the sizes of a video's objects; "" if nothing is."""
    ratio = size_ratio(tracks)
    if ratio is None:
        return ""
    width, height = ratio / TYPICAL_RATIO
    if max(width, height, 1 / width, 1 / height) <= MAX_RATIO:
        return ""
    return (
        f"objects look {width:.2f} times as wide and {height:.2f} times as high as they should at their places: cropped, "
        "zoomed, stretched, or another camera; positions and collisions may be wrong"
    )

"""Tracks of frames that were taken at other times than a video at its world's frame rate says.

A slot is a frame of a video at that rate, in CLEVRER 25 frames per second.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from nsdr.types import Track
from nsdr.validation import FloatArray, IntArray


def first_of(t: Track, slot: IntArray) -> Track:
    """A track with slots as frames and the first detection in each slot; `slot` (N,) has the slots of its detections."""
    slots, rows = np.unique(slot, return_index=True)
    names = ("location_world", "centroid_px", "box_xyxy_px", "score")
    arrays: dict[str, Any] = {name: getattr(t, name)[rows] for name in names}
    return replace(t, frame_index=slots, **arrays)


def on_time(t: Track, late: FloatArray) -> Track:
    """A track with positions interpolated from delayed frames to their slots; `late` (F,) has the delay in each slot."""
    frames, location = t.frame_index, t.location_world
    if len(frames) < 2 or not late[frames].any():
        return t
    taken = frames + late[frames]
    moved = np.stack([np.interp(frames, taken, along) for along in location.T], 1)
    for end, beside in ((0, 1), (-1, -2)):
        velocity = (location[beside] - location[end]) / (taken[beside] - taken[end])
        moved[end] = location[end] + (frames[end] - taken[end]) * velocity
    return replace(t, location_world=moved)

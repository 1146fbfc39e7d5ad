"""Tracks as dense arrays: a position for every object and frame, with what is known of its reliability."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.camera import HEIGHT_PX, WIDTH_PX
from nsdr.clevrer.vocab import MATERIALS, SHAPES
from nsdr.types import SceneObject, VideoTracks

__all__ = ["MotionStates", "extended", "object_features", "states_from_tracks", "visible_frames"]

FloatArray = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]
BORDER_PX = 3
SEEN_LATE_FRAMES, LOST_EARLY_FRAMES = 1, 2
FIT_SAMPLES = 8
"""Samples at a track's ends whose straight line is continued where the object was not seen."""


@dataclass(frozen=True)
class MotionStates:
    """Ground-plane motion of a video's objects.

    Attributes:
        objects: identities.
        location_world: (n, F, 2) float, detected or interpolated; continued in a straight line beyond the track's ends.
        detected: (n, F) bool, the object was detected in that frame.
        reliable: (n, F) bool, detected, not cut by the picture's border and not overlapped by a nearer object.
        present: (n, F) bool, between the first and the last detection.
        box_px: (n, F, 4) float, (column, row, width, height) of the box, its middle first; interpolated between detections.
    """

    objects: tuple[SceneObject, ...]
    location_world: FloatArray
    detected: BoolArray
    reliable: BoolArray
    present: BoolArray
    box_px: FloatArray


def states_from_tracks(video: VideoTracks) -> MotionStates:
    """Dense states of all tracks of a video."""
    n, frames = len(video.tracks), video.n_frames
    location = np.zeros((n, frames, 2))
    detected, reliable, present = (np.zeros((n, frames), bool) for _ in range(3))
    box = np.full((n, frames, 4), np.nan)
    every = np.arange(frames)
    for i, t in enumerate(video.tracks):
        seen = t.frame_index
        detected[i, seen] = True
        present[i, seen[0] : seen[-1] + 1] = True
        box[i, seen] = t.box_xyxy_px
        touches = (t.box_xyxy_px[:, :2] < BORDER_PX).any(1)
        touches |= (t.box_xyxy_px[:, 2:] > np.array([WIDTH_PX, HEIGHT_PX]) - BORDER_PX).any(1)
        reliable[i, seen] = ~touches
    for i in range(n):
        reliable[i] &= ~_overlapped(box, i)
    middle = np.zeros((n, frames, 4))
    for i, t in enumerate(video.tracks):
        seen = t.frame_index
        for axis in range(2):
            location[i, :, axis] = np.interp(every, seen, t.location_world[:, axis])
        sides = t.box_xyxy_px.astype(float)
        shown = np.concatenate([(sides[:, :2] + sides[:, 2:]) / 2, sides[:, 2:] - sides[:, :2]], 1)
        middle[i] = np.stack([np.interp(every, seen, part) for part in shown.T], 1)
        first, last = _ends(seen, reliable[i, seen])
        before, after = every < seen[0], every > seen[-1]
        location[i, before] = _line(seen[first], t.location_world[first], every[before])
        location[i, after] = _line(seen[last], t.location_world[last], every[after])
    return MotionStates(tuple(t.object for t in video.tracks), location, detected, reliable, present, middle)


def visible_frames(states: MotionStates) -> BoolArray:
    """(n, F) bool: in the picture, as CLEVRER's annotations count it.

    An object counts as visible while its centre is a little outside, so a detector first sees it about a frame later and
    loses it about two frames earlier (medians over 300 real scenes). Objects seen from the first two frames on were
    there from the start, and those seen until the last three are there at the end.
    """
    visible = states.present.copy()
    frames = visible.shape[1]
    for row in visible:
        seen = np.flatnonzero(row)
        if not len(seen):
            continue
        start = seen[0] - SEEN_LATE_FRAMES if seen[0] > SEEN_LATE_FRAMES else 0
        end = seen[-1] + LOST_EARLY_FRAMES if seen[-1] < frames - LOST_EARLY_FRAMES - 1 else frames - 1
        row[start : end + 1] = True
    return visible


def _overlapped(box: FloatArray, i: int) -> BoolArray:
    """Frames in which a nearer object's box (its lower edge is lower) reaches into object i's box."""
    with np.errstate(invalid="ignore"):
        others = np.delete(box, i, axis=0)
        width = np.minimum(box[i, :, 2], others[:, :, 2]) - np.maximum(box[i, :, 0], others[:, :, 0])
        height = np.minimum(box[i, :, 3], others[:, :, 3]) - np.maximum(box[i, :, 1], others[:, :, 1])
        nearer = others[:, :, 3] > box[i, :, 3]
        return np.asarray(((width > 1) & (height > 1) & nearer).any(0))


def extended(location_world: FloatArray, frames: int) -> FloatArray:
    """(..., F, 2) places continued in straight lines by a number of frames on both sides: (..., F + 2 frames, 2)."""
    reach = min(FIT_SAMPLES, location_world.shape[-2] - 1)
    if reach < 1:
        return np.repeat(location_world, 2 * frames + 1, axis=-2)
    ahead = np.arange(1, frames + 1)[:, None] / reach
    first, last = location_world[..., :1, :], location_world[..., -1:, :]
    before = first - (location_world[..., reach : reach + 1, :] - first) * ahead[::-1]
    after = last + (last - location_world[..., -1 - reach : -reach, :]) * ahead
    return np.concatenate([before, location_world, after], axis=-2)


def _ends(seen: NDArray[Any], good: BoolArray) -> tuple[NDArray[Any], NDArray[Any]]:
    """Samples at a track's start and end to draw a straight line through; reliable ones where they are near the end."""
    reliable, every = np.flatnonzero(good), np.arange(len(seen))
    near_start = len(reliable) >= 3 and seen[reliable[2]] - seen[0] <= 2 * FIT_SAMPLES
    near_end = len(reliable) >= 3 and seen[-1] - seen[reliable[-3]] <= 2 * FIT_SAMPLES
    return (reliable if near_start else every)[:FIT_SAMPLES], (reliable if near_end else every)[-FIT_SAMPLES:]


def _line(frame_index: NDArray[Any], place: FloatArray, wanted: NDArray[Any]) -> FloatArray:
    """Straight line through (frame, place) samples at other frames."""
    if len(frame_index) < 2:
        return np.repeat(place[:1], len(wanted), axis=0)
    terms = np.stack([np.ones(len(frame_index)), frame_index - frame_index.mean()], 1)
    coefficients = np.linalg.lstsq(terms, place, rcond=None)[0]
    return np.stack([np.ones(len(wanted)), wanted - frame_index.mean()], 1) @ coefficients


def object_features(objects: tuple[SceneObject, ...]) -> FloatArray:
    """(n, 5): one-hot shape (3) and material (2)."""
    features = np.zeros((len(objects), len(SHAPES) + len(MATERIALS)), np.float32)
    for row, o in zip(features, objects, strict=True):
        row[SHAPES.index(o.shape)] = 1
        row[len(SHAPES) + MATERIALS.index(o.material)] = 1
    return features

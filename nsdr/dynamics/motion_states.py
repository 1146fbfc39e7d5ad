"""Tracks as dense arrays: the position of every object in every frame, and how reliable it is."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nsdr.tracking.visibility import hidden_sides
from nsdr.types import SceneObject, VideoProposals, VideoTracks
from nsdr.validation import BoolArray, FloatArray, IntArray
from nsdr.world.camera import Camera
from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import CLEVRER_WORLD, World

UNRELIABLE_WEIGHT = 0.03
"""Weight of the position of an object that is partly hidden or cut by the image border. Chosen, like `REST_SPEED_WORLD_PER_S`
and `COLLISION_MARGIN_FRAMES`, by the accuracy of answers on `dev` scenes."""
REST_SPEED_WORLD_PER_S = 0.4
"""An object whose fitted initial speed is below this is treated as at rest (world units/s in CLEVRER,
whose objects start at 2.7 or more)."""
COLLISION_MARGIN_FRAMES = 1
"""Positions this close to a collision are ambiguous and are not fitted (frames)."""
LINE_FRAMES = 8
"""A track is continued beyond each end by the straight line through its detections in this many frames there."""
MIN_LINE_FRAMES = 3
"""The straight line beyond a track's end goes through reliable detections only if they span at least this many frames;
otherwise through all detections."""


@dataclass(frozen=True, eq=False)
class VideoPixels:
    """The images of a video, for networks that read images in addition to tracks.

    Attributes:
        frames: (height, width, 3) uint8 RGB, the frames of the video in order; they are read at most once.
        proposals: detections that the tracks were made from, with masks.
        tracks: tracks of the objects.
    """

    frames: Iterable[NDArray[np.uint8]]
    proposals: VideoProposals
    tracks: VideoTracks


@dataclass(frozen=True)
class MotionStates:
    """Motion of the objects of a video on the ground plane.

    Attributes:
        objects: identities of the objects.
        location_world: (n, F, 2) float, positions (world units): detected, interpolated between detections, and continued in a
            straight line beyond the ends of the track.
        detected: (n, F) bool, whether the object was detected in the frame.
        reliable: (n, F) bool, whether it was detected, not cut by the image border and not hidden by a nearer object.
        present: (n, F) bool, whether the frame is between the first and the last detection.
        box_px: (n, F, 4) float, centre (column, row), width and height of the box; interpolated between detections.
        patches: (n, F, 4, cells, cells) uint8, image and mask around each object (`nsdr.dynamics.propnet.patches`); None
            for backends that read no images.
        pixels: images of the video, from which patches can be made; None if there are only tracks.
        world: the world that the video is of.
    """

    objects: tuple[SceneObject, ...]
    location_world: FloatArray
    detected: BoolArray
    reliable: BoolArray
    present: BoolArray
    box_px: FloatArray
    patches: NDArray[np.uint8] | None = None
    pixels: VideoPixels | None = None
    world: World = CLEVRER_WORLD

    @property
    def camera(self) -> Camera:
        """The camera that took the video."""
        return self.world.camera

    @property
    def n_frames(self) -> int:
        """Number of frames of the video."""
        return self.present.shape[1]

    @property
    def weight(self) -> FloatArray:
        """(n, F) weight of each position in fits: 1 if reliable, `UNRELIABLE_WEIGHT` if only detected, otherwise 0."""
        return np.where(self.reliable, 1.0, np.where(self.detected, UNRELIABLE_WEIGHT, 0.0))

    @property
    def spacing_frames(self) -> float:
        """Median number of frames from one frame with detections to the next."""
        frames = np.flatnonzero(self.detected.any(0))
        return float(np.median(np.diff(frames))) if len(frames) > 1 else 1.0

    @property
    def box_xyxy_px(self) -> FloatArray:
        """(n, F, 4) left, top, right and bottom of the boxes (pixels)."""
        centre, half = self.box_px[..., :2], self.box_px[..., 2:] / 2
        return np.concatenate([centre - half, centre + half], -1)


def detections_in(frames: int, spacing_frames: float) -> int:
    """Number of detections that span this many frames; equal to `frames` if every frame was processed."""
    return 1 + math.ceil((frames - 1) / spacing_frames)


def states_from_tracks(video: VideoTracks, pixels: VideoPixels | None = None) -> MotionStates:
    """Make dense motion states from the tracks of a video.

    Args:
        video: tracks of the video.
        pixels: images of the video, for networks that read images.
    """
    n, frames = len(video.tracks), video.n_frames
    location, detected = np.zeros((n, frames, 2)), np.zeros((n, frames), bool)
    box = np.full((n, frames, 4), np.nan)
    for i, t in enumerate(video.tracks):
        detected[i, t.frame_index] = True
        location[i, t.frame_index] = t.location_world
        box[i, t.frame_index] = t.box_xyxy_px
    reliable = detected & ~hidden_sides(box.transpose(1, 0, 2), video.camera).any(-1).T
    centre_and_size = np.concatenate([(box[..., :2] + box[..., 2:]) / 2, box[..., 2:] - box[..., :2]], -1)
    objects = tuple(t.object for t in video.tracks)
    measured = MotionStates(
        objects, location, detected, reliable, detected, centre_and_size, pixels=pixels, world=video.world
    )
    return _filled(measured)


def first_frames(states: MotionStates, n_frames: int) -> MotionStates:
    """The motion states that would be known if only the first `n_frames` frames had been seen.

    Objects that were not detected in the first frames are left out. Positions, boxes and patches in frames without a detection
    are filled from the first frames only. An object without a reliable detection in them has black patches.
    """
    seen = np.flatnonzero(states.detected[:, :n_frames].any(1))
    names = ("location_world", "detected", "reliable", "present", "box_px")
    arrays = {name: getattr(states, name)[seen, :n_frames] for name in names}
    objects = tuple(replace(states.objects[i], id=k) for k, i in enumerate(seen.tolist()))
    patches = None
    if states.patches is not None:
        patches = states.patches[seen, :n_frames].copy()
        for i, whole in enumerate(arrays["reliable"]):
            frames = np.flatnonzero(whole)
            nearest = np.abs(frames - np.arange(n_frames)[:, None]).argmin(1) if len(frames) else frames
            patches[i] = patches[i, frames[nearest]] if len(frames) else 0
    return _filled(replace(states, objects=objects, patches=patches, pixels=None, **arrays))


def _filled(measured: MotionStates) -> MotionStates:
    """Fill in positions and boxes in frames without a detection, and set `present` from the first detection to the last."""
    location, box = measured.location_world.astype(float), np.zeros(measured.box_px.shape)
    present = np.zeros_like(measured.detected)
    every = np.arange(measured.detected.shape[1])
    for i, detected in enumerate(measured.detected):
        seen = np.flatnonzero(detected)
        place = measured.location_world[i, seen]
        location[i] = np.stack([np.interp(every, seen, column) for column in place.T], 1)
        box[i] = np.stack([np.interp(every, seen, column) for column in measured.box_px[i, seen].T], 1)
        present[i, seen[0] : seen[-1] + 1] = True
        first, last = _line_samples(seen, measured.reliable[i, seen], measured.spacing_frames)
        before, after = every < seen[0], every > seen[-1]
        location[i, before] = _line(seen[first], place[first], every[before])
        location[i, after] = _line(seen[last], place[last], every[after])
    return replace(measured, location_world=location, box_px=box, present=present)


def extrapolate(location_world: FloatArray, frames: int) -> FloatArray:
    """Continue positions (..., F, 2) in straight lines by `frames` frames at both ends: (..., F + 2 frames, 2)."""
    reach = min(LINE_FRAMES, location_world.shape[-2] - 1)
    if reach < 1:
        return np.repeat(location_world, 2 * frames + 1, axis=-2)
    ahead = np.arange(1, frames + 1)[:, None] / reach
    first, last = location_world[..., :1, :], location_world[..., -1:, :]
    before = first - (location_world[..., reach : reach + 1, :] - first) * ahead[::-1]
    after = last + (last - location_world[..., -1 - reach : -reach, :]) * ahead
    return np.concatenate([before, location_world, after], axis=-2)


def _line_samples(seen: IntArray, is_reliable: BoolArray, spacing: float) -> tuple[IntArray, IntArray]:
    """Indices of the detections that the lines beyond a track's start and end go through.

    They are reliable detections if enough of them are near the end, and otherwise any.
    """
    reliable, every = np.flatnonzero(is_reliable), np.arange(len(seen))
    k, count, near = detections_in(MIN_LINE_FRAMES, spacing), detections_in(LINE_FRAMES, spacing), 2 * LINE_FRAMES
    at_start = len(reliable) >= k and seen[reliable[k - 1]] - seen[0] <= near
    at_end = len(reliable) >= k and seen[-1] - seen[reliable[-k]] <= near
    return (reliable if at_start else every)[:count], (reliable if at_end else every)[-count:]


def _line(frame_index: IntArray, location_world: FloatArray, wanted: IntArray) -> FloatArray:
    """Positions (W, 2) in the wanted frames on the least-squares line through positions (N, 2)."""
    if len(frame_index) < 2:
        return np.repeat(location_world[:1], len(wanted), axis=0)
    terms = np.stack([np.ones(len(frame_index)), frame_index - frame_index.mean()], 1)
    coefficients = np.linalg.lstsq(terms, location_world, rcond=None)[0]
    return np.stack([np.ones(len(wanted)), wanted - frame_index.mean()], 1) @ coefficients


def feature_count(vocabulary: Vocabulary) -> int:
    """Number of features of an object that do not change over time, see `object_features`: 5 in CLEVRER."""
    return len(vocabulary.shapes) + len(vocabulary.materials)


def object_features(objects: tuple[SceneObject, ...], vocabulary: Vocabulary) -> FloatArray:
    """Features (n, `feature_count`) of the objects: one-hot shape, then one-hot material."""
    words, features = vocabulary.words, np.zeros((len(objects), feature_count(vocabulary)), np.float32)
    for row, o in zip(features, objects, strict=True):
        row[words["shape"].index(o.shape)] = 1
        row[len(words["shape"]) + words["material"].index(o.material)] = 1
    return features

"""Tracks smoothed by physics: speeds, and entrance and exit frames, once the collisions are known.

Between its collisions every object slides freely, so each stretch of a track is fitted by the law of
`nsdr.dynamics.sliding`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.image_borders import frames_in_image
from nsdr.dynamics.motion_states import (
    COLLISION_MARGIN_FRAMES,
    REST_SPEED_WORLD_PER_S,
    UNRELIABLE_WEIGHT,
    MotionStates,
    detections_in,
)
from nsdr.dynamics.sliding import fit_sliding, slide
from nsdr.tracking.visibility import in_image
from nsdr.types import Event, Rollout
from nsdr.world.camera import Camera, on_ground
from nsdr.world.physics_constants import FRAME_SECONDS

__all__ = ["SmoothedTracks", "rollout_in_image", "smooth_tracks", "with_smoothed_tracks"]

FloatArray = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]
Motion = Callable[[int, int], tuple[FloatArray, FloatArray]]
"""(start, end) -> positions and velocities (end - start, 2) of the frames between."""
MIN_STRETCH_FRAMES = 4
"""Stretches whose detections reach over less than this get no speed (frames). Like the next, set on left-out scenes of
`train`."""
MAX_RESIDUAL_WORLD = 0.04
"""Stretches whose median residual is larger hide a collision and are not fitted (world units)."""
UNKNOWN_CUBE_YAW = 0.4
"""Yaw (radians) assumed for cubes whose yaw is not known: it gives about their mean width."""
OUTSIDE_WORLD = -99.0
"""Coordinate given to objects whose position is not known: behind the camera, so in no image."""


@dataclass(frozen=True)
class SmoothedTracks:
    """Fitted motion during the video.

    Attributes:
        location_world: (n, F, 2) fitted positions, also before and after an object was detected; NaN where nothing fits.
        velocity_world_per_s: (n, F, 2), NaN where nothing fits.
        visible: (n, F) bool, in the image as CLEVRER's annotations count it.
    """

    location_world: FloatArray
    velocity_world_per_s: FloatArray
    visible: BoolArray


def smooth_tracks(states: MotionStates, collisions: Sequence[Event]) -> SmoothedTracks:
    """Fit all stretches of the tracks between the collisions during the video."""
    n, frames = states.present.shape
    location, velocity = np.full((n, frames, 2), np.nan), np.full((n, frames, 2), np.nan)
    visible = np.zeros((n, frames), bool)
    box = states.box_xyxy_px
    for i, o in enumerate(states.objects):
        hits = sorted(e.frame for e in collisions if i in e.objects and e.frame < frames)
        for k, (start, end) in enumerate(pairwise([0, *hits, frames])):
            after_collision = start if k == 0 else start + COLLISION_MARGIN_FRAMES
            fitted = _stretch(states, i, after_collision, end, before_first_collision=k == 0)
            if fitted is not None:
                location[i, start:end], velocity[i, start:end] = fitted(start, end)
        visible[i] = frames_in_image(o.shape, location[i], states.detected[i], box[i], states.camera)
    return SmoothedTracks(location, velocity, visible)


def with_smoothed_tracks(rollout: Rollout, smoothed: SmoothedTracks) -> Rollout:
    """The observed rollout with the fitted speeds and visibility of the video's frames."""
    n_frames = smoothed.visible.shape[1]
    visible = np.concatenate([smoothed.visible, rollout.visible[:, n_frames:]], 1)
    speed = np.full(visible.shape, np.nan)
    speed[:, :n_frames] = np.linalg.norm(smoothed.velocity_world_per_s, axis=-1)
    return replace(rollout, visible=visible, speed_world_per_s=speed)


def rollout_in_image(shapes: Sequence[str], location_world: FloatArray, camera: Camera) -> BoolArray:
    """(n, F) bool: in which frames objects at positions (n, F, 2) are in the image; NaN is not."""
    yaw = np.full(location_world.shape[1], UNKNOWN_CUBE_YAW)
    known = np.nan_to_num(location_world, nan=OUTSIDE_WORLD)
    if not len(shapes):
        return np.zeros(location_world.shape[:2], bool)
    return np.stack([in_image(shape, on_ground(row), yaw, camera) for shape, row in zip(shapes, known, strict=True)])


def _stretch(states: MotionStates, i: int, start: int, end: int, before_first_collision: bool) -> Motion | None:
    """The motion that fits a stretch of an object's track, or None where no fit is good."""
    shape = states.objects[i].shape
    last = end if end == states.present.shape[1] else end - COLLISION_MARGIN_FRAMES
    detected = np.flatnonzero(states.detected[i, start:last]) + start
    if len(detected) < detections_in(MIN_STRETCH_FRAMES, states.spacing_frames):
        return None
    positions = states.location_world[i, detected]
    weight = np.where(states.reliable[i, detected], 1.0, UNRELIABLE_WEIGHT)
    reference = float(detected[0])
    position, velocity, residual = fit_sliding(shape, detected, positions, weight, reference)
    if residual > MAX_RESIDUAL_WORLD:
        return None
    speed = float(np.hypot(*velocity))
    if before_first_collision and speed < REST_SPEED_WORLD_PER_S:
        rest = np.average(positions, axis=0, weights=weight)
        return lambda a, b: (np.tile(rest, (b - a, 1)), np.zeros((b - a, 2)))
    direction = velocity / max(speed, 1e-9)

    def sliding(a: int, b: int) -> tuple[FloatArray, FloatArray]:
        seconds = (np.arange(a, b) - reference) * FRAME_SECONDS
        distance, speeds = slide(shape, np.array(speed), seconds)
        return position + distance[:, None] * direction, speeds[:, None] * direction

    return sliding

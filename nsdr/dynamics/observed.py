"""What is known of the observed motion once the collisions are known: speeds, and when objects are in the picture.

Between its collisions every object flies undisturbed, so each stretch of a track is fitted by the law of `flight`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.camera import FRAME_SECONDS, OBJECT_RADIUS_WORLD
from nsdr.clevrer.view import View
from nsdr.dynamics.flight import fit_flight, fly
from nsdr.dynamics.states import MotionStates
from nsdr.types import Event, Rollout

__all__ = ["ObservedMotion", "observed_motion", "with_observed_motion"]

FloatArray = NDArray[np.floating[Any]]
COLLISION_MARGIN_FRAMES = 1
"""So close to a collision a place may belong to either side of it."""
LEAST_FRAMES = 4
"""Shorter stretches give no speed."""
MOST_RESIDUAL_WORLD = 0.04
"""Stretches that fit worse hide a collision."""
LEAST_FIRST_SPEED = 0.4
"""Objects start with 2.7 to 3.0 world units per second or at rest: before its first collision a slower one rests."""
CUBE_YAW = 0.4
"""Cubes' turns are not known; this one has about the mean width."""
UNRELIABLE_WEIGHT = 0.02


@dataclass(frozen=True)
class ObservedMotion:
    """Fitted motion during the video.

    Attributes:
        location_world: (n, F, 2), the fitted places, also before and after an object was seen; NaN where nothing fits.
        velocity_world_per_s: (n, F, 2), NaN where nothing fits.
        visible: (n, F) bool, in the picture as CLEVRER's annotations count it.
    """

    location_world: FloatArray
    velocity_world_per_s: FloatArray
    visible: NDArray[np.bool_]


def observed_motion(states: MotionStates, collisions: Sequence[Event]) -> ObservedMotion:
    """Fit all stretches between collisions.

    Args:
        states: measured places.
        collisions: during the video.
    """
    n, frames = states.present.shape
    location, velocity = np.full((n, frames, 2), np.nan), np.full((n, frames, 2), np.nan)
    visible = np.zeros((n, frames), bool)
    for i, o in enumerate(states.objects):
        hits = sorted(e.frame for e in collisions if i in e.objects and e.frame < frames)
        bounds = [0, *hits, frames]
        for k, (start, end) in enumerate(pairwise(bounds)):
            fitted = _stretch(states, i, start if k == 0 else start + COLLISION_MARGIN_FRAMES, end, at_first=k == 0)
            if fitted is not None:
                location[i, start:end], velocity[i, start:end] = fitted(start, end)
        visible[i] = _visible(o.shape, np.flatnonzero(states.present[i]), location[i])
    return ObservedMotion(location, velocity, visible)


def with_observed_motion(rollout: Rollout, motion: ObservedMotion) -> Rollout:
    """The observed course with the fitted speeds and visibility of the video's frames."""
    n_frames = motion.visible.shape[1]
    visible = np.concatenate([motion.visible, rollout.visible[:, n_frames:]], 1)
    speed = np.full(visible.shape, np.nan)
    speed[:, :n_frames] = np.linalg.norm(motion.velocity_world_per_s, axis=-1)
    return replace(rollout, visible=visible, speed_world_per_s=speed)


def _stretch(states: MotionStates, i: int, start: int, end: int, at_first: bool) -> Any:
    """A function (start, end) -> places and velocities of the frames between, or None where there is no good fit."""
    shape = states.objects[i].shape
    last = end if end == states.present.shape[1] else end - COLLISION_MARGIN_FRAMES
    detected = np.flatnonzero(states.detected[i, start:last]) + start
    if len(detected) < LEAST_FRAMES:
        return None
    places = states.location_world[i, detected]
    weight = np.where(states.reliable[i, detected], 1.0, UNRELIABLE_WEIGHT)
    reference = float(detected[0])
    place, velocity, residual = fit_flight(shape, detected, places, weight, reference)
    if residual > MOST_RESIDUAL_WORLD:
        return None
    speed = float(np.hypot(*velocity))
    if at_first and speed < LEAST_FIRST_SPEED:
        rest = np.average(places, axis=0, weights=weight)
        return lambda a, b: (np.tile(rest, (b - a, 1)), np.zeros((b - a, 2)))
    direction = velocity / max(speed, 1e-9)

    def flown(a: int, b: int) -> tuple[FloatArray, FloatArray]:
        way, then = fly(shape, np.array(speed), (np.arange(a, b) - reference) * FRAME_SECONDS)
        return place + way[:, None] * direction, then[:, None] * direction

    return flown


def _visible(shape: str, seen: NDArray[Any], location: FloatArray) -> NDArray[np.bool_]:
    """From the first to the last frame in which the outline touches the picture, around those in which it was seen."""
    visible = np.zeros(len(location), bool)
    if not len(seen):
        return visible
    first, last = int(seen[0]), int(seen[-1])
    visible[first : last + 1] = True
    height = np.full((len(location), 1), OBJECT_RADIUS_WORLD)
    places = np.concatenate([np.nan_to_num(location, nan=-99.0), height], 1)
    yaw = np.full(len(location), CUBE_YAW)
    outside = np.r_[0:first, last + 1 : len(location)]
    shown = np.zeros(len(location), bool)
    shown[outside] = View().shows(shape, places[outside], yaw[outside])
    for f in range(first - 1, -1, -1):
        if not shown[f]:
            break
        visible[f] = True
    for f in range(last + 1, len(location)):
        if not shown[f]:
            break
        visible[f] = True
    return visible

"""Smoothing of tracks by physics, which gives speeds, and the frames of entrances and exits, once the collisions are known.

Between its collisions every object slides freely, so the law of `nsdr.dynamics.sliding` is fitted to each stretch of a track.
An object enters when the first part of its outline crosses the image border, some frames before it is detected. These frames
follow from the fitted motion. At the left, right and bottom borders the fitted outline is shifted to the measured leading side
of the box, because the yaw of a box is not known and fits are off by some pixels where objects are near. At the top border,
objects are far away and fits are better than masks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.motion_states import COLLISION_MARGIN_FRAMES, REST_SPEED_WORLD_PER_S, MotionStates, detections_in
from nsdr.dynamics.sliding import law_of
from nsdr.dynamics.stretch import Stretch, fit_stretch
from nsdr.tracking.visibility import in_image
from nsdr.types import Event, Rollout
from nsdr.validation import BoolArray, FloatArray
from nsdr.world.camera import Camera, on_ground
from nsdr.world.shapes import surface_points
from nsdr.world.vocabulary import Shape

MIN_STRETCH_FRAMES = 4
"""Stretches whose detections span fewer frames than this are not fitted. Set, like `MAX_RESIDUAL_WORLD`, on left-out scenes of
`train`."""
MAX_RESIDUAL_WORLD = 0.04
"""A stretch with a larger median residual contains an unknown collision, and its fit is not used (world units in
CLEVRER)."""
LEFT, TOP, RIGHT, BOTTOM = range(4)
"""Indices of the sides of a box."""
SIDE_SHIFT_PX = (0.45, -0.4, -0.47)
"""Corrections of the depth of a measured side inside the left, right and bottom borders (pixels): the difference between the
sides of the true outline and of the mask. Measured on `train` by `python -m benchmarks.objects --shifts --every 5 --first 1
--scenes 800`."""
TOP_SHIFT_PX = {"box": 0.64, "cylinder": 1.47, "sphere": 0.42}
"""Corrections of the depth of the fitted outline inside the top border (pixels), measured by the same command."""
LEVEL_SAMPLES, TREND_SAMPLES, MAX_SAMPLE_FRAMES = 2, 10, 30
"""The difference between a measured and a fitted side is extrapolated from its mean over the `LEVEL_SAMPLES` detections nearest
to the end of a track and its trend over the nearest `TREND_SAMPLES`, all at most `MAX_SAMPLE_FRAMES` frames from the end."""
TREND_RIDGE_FRAMES2 = 50.0
"""Ridge of the regression for the trend (frames²), which shrinks a trend that is based on few detections."""
BOX_YAW = 0.4
"""Yaw assumed for boxes whose yaw is not known (radians): at this angle to the line of sight, they have about their mean
width."""
MARGIN_RADII = 3.0
"""An object whose centre is further outside the image than this, or nearer to the camera, is not in the image (halves of
its largest size)."""


@dataclass(frozen=True)
class SmoothedTracks:
    """Fitted motion during the video, with the stretches it consists of.

    Attributes:
        location_world: (n, F, 2) fitted positions, also before and after an object was detected (world units); NaN where no fit
            is good.
        velocity_world_per_s: (n, F, 2) fitted velocities; NaN where no fit is good.
        visible: (n, F) bool, whether the object is in the image by the definition of CLEVRER's annotations.
        stretches: the fitted stretches of each object as tuples (first frame, frame after the last, stretch).
    """

    location_world: FloatArray
    velocity_world_per_s: FloatArray
    visible: BoolArray
    stretches: tuple[tuple[tuple[int, int, Stretch], ...], ...]


def smooth_tracks(states: MotionStates, collisions: Sequence[Event]) -> SmoothedTracks:
    """Fit free sliding to each track between its collisions during the video."""
    n, frames = states.present.shape
    location, velocity = np.full((n, frames, 2), np.nan), np.full((n, frames, 2), np.nan)
    visible = np.zeros((n, frames), bool)
    stretches: list[list[tuple[int, int, Stretch]]] = [[] for _ in range(n)]
    box = states.box_xyxy_px
    for i, o in enumerate(states.objects):
        hits = sorted(e.frame for e in collisions if i in e.objects and e.frame < frames)
        for k, (start, end) in enumerate(pairwise([0, *hits, frames])):
            after_collision = start if k == 0 else start + COLLISION_MARGIN_FRAMES
            stretch = _stretch(states, i, after_collision, end, before_first_collision=k == 0)
            if stretch is not None:
                every = np.arange(start, end)
                location[i, start:end], velocity[i, start:end] = stretch.position_at(every), stretch.velocity_at(every)
                stretches[i].append((start, end, stretch))
        shape = states.world.vocabulary.shape(o.shape)
        visible[i] = frames_in_image(shape, location[i], states.detected[i], box[i], states.camera)
    return SmoothedTracks(location, velocity, visible, tuple(tuple(one) for one in stretches))


def with_smoothed_tracks(rollout: Rollout, smoothed: SmoothedTracks) -> Rollout:
    """The rollout of the video with fitted speeds and visibility in the frames of the video."""
    n_frames = smoothed.visible.shape[1]
    visible = np.concatenate([smoothed.visible, rollout.visible[:, n_frames:]], 1)
    speed = np.full(visible.shape, np.nan)
    speed[:, :n_frames] = np.linalg.norm(smoothed.velocity_world_per_s, axis=-1)
    return replace(rollout, visible=visible, speed_world_per_s=speed)


def rollout_in_image(shapes: Sequence[Shape], location_world: FloatArray, camera: Camera) -> BoolArray:
    """(n, F) bool, whether objects at positions (n, F, 2) are in the image; False where a position is NaN."""
    visible = np.zeros(location_world.shape[:2], bool)
    for row, shape, places in zip(visible, shapes, location_world, strict=True):
        row[:] = in_image(shape, on_ground(places, shape.height_world), np.array([BOX_YAW]), camera)
    return visible


def _stretch(states: MotionStates, i: int, start: int, end: int, before_first_collision: bool) -> Stretch | None:
    """The stretch of object i from frame `start` up to, not including, `end`; None if no fit is good."""
    last = end if end == states.n_frames else end - COLLISION_MARGIN_FRAMES
    detected = np.flatnonzero(states.detected[i, start:last]) + start
    if len(detected) < detections_in(MIN_STRETCH_FRAMES, states.spacing_frames):
        return None
    positions, weight, scales = states.location_world[i, detected], states.weight[i, detected], states.world.scales
    stretch = fit_stretch(law_of(states.objects[i], states.world), detected, positions, weight)
    if stretch.median_residual > MAX_RESIDUAL_WORLD * scales.size:
        return None
    if before_first_collision and stretch.speed < REST_SPEED_WORLD_PER_S * scales.speed:
        rest = np.array([*np.average(positions, axis=0, weights=weight), 0.0, 0.0])
        residual = np.linalg.norm(positions - rest[:2], axis=1)
        return replace(stretch, motion=rest, residual=residual, at_rest=True)
    return stretch


def frames_in_image(
    shape: Shape,
    location_world: FloatArray,
    detected: BoolArray,
    box_xyxy_px: FloatArray,
    camera: Camera,
) -> BoolArray:
    """Frames in which an object is in the image: those of its track, and those around it with the fitted outline in the image.

    Args:
        shape: its shape.
        location_world: (F, 2) fitted positions (world units); NaN where no fit is good.
        detected: (F,) bool, whether the object was detected.
        box_xyxy_px: (F, 4) boxes of the detections.
        camera: the camera that took the video.

    Returns:
        (F,) bool, whether the object is in the image.
    """
    visible = np.zeros(len(detected), bool)
    seen = np.flatnonzero(detected)
    if not len(seen):
        return visible
    first, last = int(seen[0]), int(seen[-1])
    visible[first : last + 1] = True
    shift = np.array([SIDE_SHIFT_PX[0], TOP_SHIFT_PX[shape.solid], *SIDE_SHIFT_PX[1:]])
    for end, outside in ((first, np.arange(first)[::-1]), (last, np.arange(last + 1, len(detected)))):
        if len(outside):
            depths = border_depths(shape, location_world, outside, detected, end, box_xyxy_px, camera)
            inside = (depths + shift > 0).all(1)
            visible[outside[: len(inside) if inside.all() else int(inside.argmin())]] = True
    return visible


def border_depths(
    shape: Shape,
    location_world: FloatArray,
    wanted: NDArray[np.integer[Any]],
    detected: BoolArray,
    end: int,
    box_xyxy_px: FloatArray,
    camera: Camera,
) -> FloatArray:
    """Depth of the leading side of the outline inside each border, without `SIDE_SHIFT_PX` and `TOP_SHIFT_PX`.

    Args:
        shape: its shape.
        location_world: (F, 2) fitted positions (world units); NaN where no fit is good.
        wanted: (W,) frames for which the depths are computed.
        detected: (F,) bool, whether the object was detected.
        end: first or last detected frame; the leading sides are measured in the detections nearest to it.
        box_xyxy_px: (F, 4) boxes of the detections.
        camera: the camera that took the video.

    Returns:
        (W, 4) depths inside the left, top, right and bottom borders (pixels); NaN where a position is not known or is far
        outside the image.
    """
    near = np.flatnonzero(detected)
    near = near[np.abs(near - end) <= MAX_SAMPLE_FRAMES]
    near = near[np.argsort(np.abs(near - end), kind="stable")][:TREND_SAMPLES]
    after = near - end
    sides, seen = (_outline_sides(shape, location_world[frames], camera) for frames in (wanted, near))
    # Sides that another object may hide are used, too: without them, fits of objects that are always cut go far astray.
    for side in (LEFT, TOP, RIGHT):  # BOTTOM leads at the top border, where masks are worse than fits
        lack = box_xyxy_px[near, side] - seen[:, side]
        usable = np.isfinite(lack)
        sides[:, side] += _continued(after[usable], lack[usable], wanted - end)
    return np.stack(
        [sides[:, RIGHT], sides[:, BOTTOM], camera.width - sides[:, LEFT], camera.height - sides[:, TOP]], 1
    )


def _continued(after: NDArray[np.integer[Any]], lack: FloatArray, wanted_after: NDArray[np.integer[Any]]) -> FloatArray:
    """Extrapolate the difference between a measured and a fitted side (pixels).

    Args:
        after: (N,) frames of the detections relative to the end of the track, the nearest first.
        lack: (N,) measured minus fitted side in these frames (pixels).
        wanted_after: (W,) frames relative to the end of the track.

    Returns:
        (W,) differences in the wanted frames (pixels).
    """
    if not len(lack):
        return np.zeros(len(wanted_after))
    centred = after - after.mean()
    trend = (centred * lack).sum() / ((centred**2).sum() + TREND_RIDGE_FRAMES2)
    return np.asarray(lack[:LEVEL_SAMPLES].mean() + trend * (wanted_after - after[:LEVEL_SAMPLES].mean()))


def _outline_sides(shape: Shape, location_world: FloatArray, camera: Camera) -> FloatArray:
    """Left, top, right and bottom (N, 4) of the outlines of an object at positions (N, 2) (pixels).

    They are NaN where a position is not known or is far from the image.
    """
    centre, margin_world = on_ground(location_world, shape.height_world), MARGIN_RADII * max(shape.size_world) / 2
    sides = np.full((len(centre), 4), np.nan)
    with np.errstate(invalid="ignore"):
        depth, pixel = camera.depth(centre), camera.pixels(centre)
        margin = camera.focal_px * margin_world / depth[:, None]
        near = ((pixel > -margin) & (pixel < np.array([camera.width, camera.height]) + margin)).all(1)
        known = np.flatnonzero(near & (depth > margin_world))
    if not len(known):
        return sides
    points = np.repeat(surface_points(shape, BOX_YAW)[None], len(known) if shape.solid == "box" else 1, axis=0)
    if shape.solid == "box":
        x, y = (centre[known, :2] - camera.eye_world[:2]).T
        cos, sin = x / np.hypot(x, y), y / np.hypot(x, y)
        turn = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], 1)
        points[..., :2] = points[..., :2] @ turn
    outline = camera.pixels(points + centre[known, None])
    sides[known] = np.concatenate([outline.min(1), outline.max(1)], 1)
    return sides

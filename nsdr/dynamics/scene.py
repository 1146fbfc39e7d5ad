"""Conversion of rollouts to the symbolic scene."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.types import DynamicsPrediction, Event, Rollout, Scene, UncertainEvent, VideoTracks
from nsdr.types.events import collisions_in_view, enter_exit_events, in_order
from nsdr.world.camera import Camera, on_ground
from nsdr.world.world import World

PREDICTED_MOVING_SPEED_WORLD_PER_S = 0.05
"""Where no speed was fitted, an object counts as moving above this speed, multiplied by `Scales.speed` (world units/s). It is
higher than `Physics.moving_speed_world_per_s` because noisy positions make resting objects seem to creep. Set on ten annotation
files."""
SPEED_WINDOW_FRAMES = 11
"""Number of frames of the line whose slope is the speed where no speed was fitted (frames of CLEVRER; in other worlds as long).
Set on ten annotation files."""


def scene_from_prediction(
    prediction: DynamicsPrediction,
    existence: NDArray[np.floating[Any]] | None = None,
) -> Scene:
    """Make the scene of a prediction: observed, predicted and counterfactual events, and motion.

    Entrances and exits after the video, and with an object removed, are those of the rollouts.

    An object moves when its speed exceeds the world's `Physics.moving_speed_world_per_s`. Where the prediction has no speed, an
    object moves when it is faster than `PREDICTED_MOVING_SPEED_WORLD_PER_S` both in the frames before the current one and in
    the frames after it. So it is at rest until it is hit, and again as soon as it has stopped.

    Args:
        prediction: output of a dynamics backend.
        existence: (n,) probability that each object exists, if the video was perceived (`Scene.existence`).
    """
    n_frames, world = prediction.n_frames, prediction.world
    visible = prediction.observed.visible[:, :n_frames]
    speed = _speed(prediction.observed.location_world[:, :n_frames], world)
    moving = speed > PREDICTED_MOVING_SPEED_WORLD_PER_S * world.scales.speed
    if prediction.observed.speed_world_per_s is not None:
        speed = prediction.observed.speed_world_per_s[:, :n_frames]
        moving = np.where(np.isnan(speed), moving, np.nan_to_num(speed) > world.physics.moving_speed_world_per_s)
    collisions = prediction.observed.collisions
    borders = borders_of(prediction.observed)
    events = [e for e in borders if e.frame < n_frames] + collisions_in_view(collisions, visible)
    predicted = tuple(e for e in (*borders, *collisions) if n_frames <= e.frame)
    counterfactual = {removed: events_of(rollout) for removed, rollout in prediction.counterfactual.items()}
    scores = prediction.observed.predicted_scores
    uncertain = _uncertain(prediction, visible)
    heights = [world.vocabulary.shape(o.shape).height_world for o in prediction.objects]
    centres = on_ground(prediction.observed.location_world, np.array(heights)[:, None])
    return Scene(
        prediction.objects,
        n_frames,
        visible,
        moving,
        tuple(events),
        predicted,
        counterfactual,
        scores,
        uncertain=uncertain,
        physics=prediction.physics,
        existence=existence,
        motion_px=motion_px(centres, visible, world.camera),
        world=world,
        collisions_only=False,
    )


def events_of(rollout: Rollout) -> tuple[Event, ...]:
    """Entrances, exits and collisions of a rollout, in order of time."""
    return in_order([*borders_of(rollout), *rollout.collisions])


def borders_of(rollout: Rollout) -> list[Event]:
    """Entrances and exits of a rollout: those of `visible`, but of the uncertain ones those that are more probable than not."""
    likely = {u.event: u.probability > 0.5 for u in rollout.uncertain or ()}
    found = enter_exit_events(rollout.visible)
    added = [e for e, is_likely in likely.items() if is_likely and e.kind != "collision" and e not in found]
    return [e for e in found if likely.get(e, True)] + added


def motion_px(location_world: NDArray[np.floating[Any]], visible: NDArray[np.bool_], camera: Camera) -> NDArray[Any]:
    """Displacement of each object in the image from its first visible frame to its last (`Scene.motion_px`).

    Args:
        location_world: (n, F or more, 3) centres of the objects (world units).
        visible: (n, F) whether each object is in the image.
        camera: the camera that took the video.

    Returns:
        (n, 2) displacement to the right and down (pixels); NaN for objects that are never visible.
    """
    motion = np.full((len(visible), 2), np.nan)
    for i, frames in enumerate(map(np.flatnonzero, visible)):
        if len(frames):
            first, last = camera.pixels(location_world[i, frames[[0, -1]]])
            motion[i] = last - first
    return motion


def _uncertain(prediction: DynamicsPrediction, visible: NDArray[np.bool_]) -> tuple[UncertainEvent, ...] | None:
    """Uncertain events of all rollouts; collisions of the video only in view. None if a rollout does not know its own."""
    found: list[UncertainEvent] = []
    for removed, rollout in ((None, prediction.observed), *prediction.counterfactual.items()):
        if rollout.uncertain is None:
            return None
        for one in rollout.uncertain:
            events = [one.event]
            if removed is None and one.event.kind == "collision" and one.event.frame < prediction.n_frames:
                events = collisions_in_view(events, visible)
            found += [UncertainEvent(event, one.probability, removed) for event in events]
    return tuple(found)


def _speed(location_world: NDArray[np.floating[Any]], world: World) -> NDArray[np.floating[Any]]:
    """Speed (n, F) in world units per second: the smaller of the speeds just before and just after each frame.

    Each of the two is the slope of the least-squares line through the frames of the window (`SPEED_WINDOW_FRAMES`) that ends or
    starts at the frame.
    """
    n, frames = location_world.shape[:2]
    window = min(max(round(SPEED_WINDOW_FRAMES * world.scales.rate), 2), frames)
    if window < 2:
        return np.zeros((n, frames))
    time = (np.arange(window) - (window - 1) / 2) * world.physics.frame_seconds
    windows = np.lib.stride_tricks.sliding_window_view(location_world, window, axis=1)  # (n, F - window + 1, 2, window)
    slope = np.linalg.norm(windows @ (time / (time @ time)), axis=-1)
    missing = np.full((n, window - 1), np.inf)
    speed = np.minimum(np.concatenate([missing, slope], 1), np.concatenate([slope, missing], 1))
    # In a short video, some frames have neither window and take the first one.
    return np.where(np.isinf(speed), slope[:, :1], speed)


def collisions_of(scene: Scene, tracks: VideoTracks) -> list[Event]:
    """Collisions of a scene during the video, with the ids of the tracks. Objects are matched by name.

    Collisions of objects without a track are left out.
    """
    ids = {t.object.name: t.object.id for t in tracks.tracks}
    events = []
    for event in scene.events:
        names = [scene.objects[i].name for i in event.objects]
        if event.kind == "collision" and all(name in ids for name in names):
            events.append(Event("collision", event.frame, tuple(sorted(ids[name] for name in names))))
    return events

"""Scenes from CLEVRER's own truth: annotations, ground-truth blocks and the generator's truth files.

The rules (what counts as visible, entering, moving, colliding) are those that make CLEVRER's answers come out.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nsdr.clevrer.camera import FRAME_SECONDS
from nsdr.errors import DataError
from nsdr.types import DynamicsPrediction, Event, Scene, SceneObject

__all__ = [
    "MOVING_SPEED_WORLD_PER_S",
    "collisions_in_view",
    "enter_exit_events",
    "scene_from_annotation",
    "scene_from_ground_truth",
    "scene_from_prediction",
    "scene_from_truth",
    "speed_world_per_s",
]

MOVING_SPEED_WORLD_PER_S = 0.02
"""An object moves when its speed on the ground exceeds this (annotation's unit)."""

PREDICTED_MOVING_SPEED_WORLD_PER_S = 0.05
SPEED_WINDOW_FRAMES = 11
"""The same for measured positions, whose noise makes resting objects seem to creep; both fitted on ten real annotations."""


def enter_exit_events(visible: NDArray[np.bool_]) -> list[Event]:
    """Events from visibility (n_objects, n_frames): enter = first visible frame after an invisible one, exit = the reverse."""
    events = []
    change = np.diff(visible.astype(np.int8), axis=1)
    for i, frame in np.argwhere(change != 0):
        events.append(Event("in" if change[i, frame] > 0 else "out", int(frame) + 1, (int(i),)))
    return events


def collisions_in_view(collisions: Iterable[Event], visible: NDArray[np.bool_]) -> list[Event]:
    """Observed collisions as the ground truth counts them.

    A collision with neither object visible at its frame is dropped; with one of them invisible it counts at the first
    later frame in which both are visible, or never.
    """
    kept = []
    for event in collisions:
        both = visible[event.objects[0]] & visible[event.objects[1]]
        either = visible[event.objects[0]] | visible[event.objects[1]]
        if event.frame >= len(both) or not either[event.frame]:
            continue
        frames = np.flatnonzero(both[event.frame :])
        if len(frames):
            kept.append(Event("collision", event.frame + int(frames[0]), event.objects))
    return kept


def scene_from_annotation(annotation: Mapping[str, Any]) -> Scene:
    """Scene of an annotation file's content: observed events and motion.

    Raises:
        DataError: a missing key or unknown attribute.
    """
    try:
        objects = _objects(annotation["object_property"], "object_id")
        frames = annotation["motion_trajectory"]
        visible, moving = _visible_and_moving(frames, len(objects))
        collisions = _collisions(annotation["collision"])
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not an annotation: {e!r}") from e
    events = enter_exit_events(visible) + collisions_in_view(collisions, visible)
    return Scene(objects, len(frames), visible, moving, tuple(events))


def scene_from_truth(truth: Mapping[str, Any], n_frames: int | None = None) -> Scene:
    """Scene of a generator's `truth_S.json`: observed, unseen and counterfactual events, all known.

    Args:
        truth: `objects`, `frames` (all 7/5 of the video), `collisions` and `counterfactual`.
        n_frames: how many of the frames the video shows; None takes the file's own `n_frames`, or else 128.

    Raises:
        DataError: a missing key or unknown attribute.
    """
    try:
        objects = _objects(truth["objects"], "object_id")
        n_frames = n_frames or truth.get("n_frames", 128)
        visible, moving = _visible_and_moving(truth["frames"][:n_frames], len(objects))
        collisions = _collisions(truth["collisions"])
        counterfactual = {int(removed): tuple(_collisions(rows)) for removed, rows in truth["counterfactual"].items()}
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not a truth file: {e!r}") from e
    events = enter_exit_events(visible) + collisions_in_view(collisions, visible)
    unseen = tuple(e for e in collisions if e.frame >= n_frames)
    return Scene(objects, n_frames, visible, moving, tuple(events), unseen, counterfactual)


def scene_from_prediction(prediction: DynamicsPrediction) -> Scene:
    """Scene of the dynamics predictor's output: observed, unseen and counterfactual events, and motion.

    An object moves when its speed exceeds `MOVING_SPEED_WORLD_PER_S`. Where the prediction has no speed, it moves when it is
    faster than `PREDICTED_MOVING_SPEED_WORLD_PER_S` both in the frames up to the one asked about and in those from it on: so
    it rests until it is hit, and rests as soon as it has stopped.
    """
    n_frames = prediction.n_frames
    visible = prediction.observed.visible[:, :n_frames]
    moving = _speed(prediction.observed.location_world[:, :n_frames]) > PREDICTED_MOVING_SPEED_WORLD_PER_S
    if prediction.observed.speed_world_per_s is not None:
        speed = prediction.observed.speed_world_per_s[:, :n_frames]
        moving = np.where(np.isnan(speed), moving, np.nan_to_num(speed) > MOVING_SPEED_WORLD_PER_S)
    collisions = prediction.observed.collisions
    events = enter_exit_events(visible) + collisions_in_view(collisions, visible)
    unseen = tuple(e for e in collisions if n_frames <= e.frame)
    counterfactual = {removed: rollout.collisions for removed, rollout in prediction.counterfactual.items()}
    scores = prediction.observed.unseen_scores
    return Scene(prediction.objects, n_frames, visible, moving, tuple(events), unseen, counterfactual, scores)


def speed_world_per_s(step_world: NDArray[Any], frames: ArrayLike) -> NDArray[Any]:
    """Speed in world units per second of steps (..., 2) on the ground that take a number of frames (broadcast)."""
    return np.asarray(np.linalg.norm(step_world / (np.asarray(frames) * FRAME_SECONDS), axis=-1))


def _speed(location_world: NDArray[np.floating[Any]], window: int = SPEED_WINDOW_FRAMES) -> NDArray[np.floating[Any]]:
    """Speed (n, F) in world units per second: the smaller one of the frames before and the frames after.

    Each is the slope of the least-squares line through `window` frames that end or start at the frame.
    """
    n, frames = location_world.shape[:2]
    window = min(window, frames)
    if window < 2:
        return np.zeros((n, frames))
    time = (np.arange(window) - (window - 1) / 2) * FRAME_SECONDS
    pieces = np.lib.stride_tricks.sliding_window_view(location_world, window, axis=1)  # (n, F - window + 1, 2, window)
    slope = np.linalg.norm(pieces @ (time / (time @ time)), axis=-1)
    missing = np.full((n, window - 1), np.inf)
    speed = np.minimum(np.concatenate([missing, slope], 1), np.concatenate([slope, missing], 1))
    # Where a short video has neither window, the nearest one will do.
    return np.where(np.isinf(speed), slope[:, :1], speed)


def scene_from_ground_truth(block: Mapping[str, Any], n_frames: int = 128) -> Scene:
    """Scene of a `ground_truth` block (or a row of the compact truth): observed events; motion is not known.

    Raises:
        DataError: a missing key or unknown attribute.
    """
    try:
        objects = _objects(block["objects"], "id")
        events = [Event(e["type"], e["frame"], (e["object"],)) for e in block["in_outs"]]
        events += [Event("collision", e["frame"], tuple(sorted(e["object"]))) for e in block["collisions"]]
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not a ground-truth block: {e!r}") from e
    visible = np.ones((len(objects), n_frames), bool)
    for i in range(len(objects)):
        changes = sorted((e for e in events if e.kind != "collision" and e.objects == (i,)), key=lambda e: e.frame)
        if changes:
            visible[i, : changes[0].frame] = changes[0].kind == "out"
        for event in changes:
            visible[i, event.frame :] = event.kind == "in"
    return Scene(objects, n_frames, visible, None, tuple(events))


def _objects(rows: Sequence[Mapping[str, Any]], key: str) -> tuple[SceneObject, ...]:
    return tuple(SceneObject(o[key], o["color"], o["material"], o["shape"]) for o in rows)


def _collisions(rows: Iterable[Mapping[str, Any]]) -> list[Event]:
    return [Event("collision", c["frame_id"], tuple(sorted(c["object_ids"]))) for c in rows]


def _visible_and_moving(frames: Sequence[Mapping[str, Any]], n: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    visible, moving = np.zeros((n, len(frames)), bool), np.zeros((n, len(frames)), bool)
    for f, frame in enumerate(frames):
        for o in frame["objects"]:
            vx, vy, _ = o["velocity"]
            visible[o["object_id"], f] = o["inside_camera_view"]
            moving[o["object_id"], f] = vx * vx + vy * vy > MOVING_SPEED_WORLD_PER_S**2
    return visible, moving

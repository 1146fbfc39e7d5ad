"""The released code's prediction files (`sim_N.json`), which its executor reads from its dynamics predictor.

`objects` is a list of `{id, color, material, shape}`. `predictions[0]` has `what_if: -1`; each further prediction has
`what_if: k`, the id of the removed object. A prediction has `trajectory: [{frame_index, objects: [{x, y, color, material,
shape}]}]`, sampled every 5th frame, 12 samples beyond the video (185 for 128 frames), with x the row (0-100) and y the column
(0-150) of the grid, and `collisions: [{frame, objects: [attributes, attributes]}]` with the frames of samples.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nsdr.clevrer.scenes import collisions_in_view, enter_exit_events, speed_world_per_s
from nsdr.clevrer.schema import (
    LARGEST_COORDINATE,
    check_new,
    check_objects,
    get,
    get_frame,
    get_number,
    read_checked,
    scene_object,
    shown,
)
from nsdr.errors import DataError
from nsdr.io.limits import check_limit, limits
from nsdr.types import DynamicsPrediction, Event, Rollout, Scene, SceneObject
from nsdr.world.camera import (
    HEIGHT_PX,
    WIDTH_PX,
    grid_from_pixels,
    ground_from_pixels,
    on_ground,
    pixels_from_grid,
    pixels_from_world,
)
from nsdr.world.physics_constants import MOVING_SPEED_WORLD_PER_S
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["SAMPLE_FRAMES", "check_predictions", "predictions_document", "read_predictions", "scene_from_predictions"]

SAMPLE_FRAMES = 5
"""Frames from one sample of a trajectory to the next."""
PREDICTED_SAMPLES = 12
"""Samples of the released files after the video."""
NOTHING_REMOVED = -1
"""`what_if` of the prediction in which no object is removed."""
SAMPLED_MOVING_SPEED_WORLD_PER_S = 5 * MOVING_SPEED_WORLD_PER_S
"""Speed between samples above which an object counts as moving (world units/s): 5 times the threshold for true velocities,
because sampled positions are rounded and come from masks."""

Triple = tuple[str, str, str]
"""Color, material and shape."""


def read_predictions(path: str | Path) -> dict[str, Any]:
    """Read and check a prediction file, plain or gzipped.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    return read_checked(path, check_predictions)


def check_predictions(document: Any) -> None:
    """Check the form of a prediction file's content.

    Raises:
        DataError: names the location in the file and what was expected there.
    """
    n_objects = len(check_objects(get(document, "objects", list, "file"), "id", "objects", fewest=0))
    predictions = get(document, "predictions", list, "file")
    if not predictions:
        raise DataError("predictions: expected at least 1, got none")
    removed: set[int] = set()
    for p, prediction in enumerate(predictions):
        where = f"predictions[{p}]"
        what_if = get(prediction, "what_if", int, where)
        if (p == 0) != (what_if == NOTHING_REMOVED) or not NOTHING_REMOVED <= what_if < n_objects:
            expected = f"{NOTHING_REMOVED} (nothing removed)" if p == 0 else f"0 to {n_objects - 1}"
            raise DataError(f"{where}.what_if: expected {expected}, got {shown(what_if)}")
        check_new(what_if, removed, f"{where}.what_if")
        removed.add(what_if)
        _check_trajectory(get(prediction, "trajectory", list, where), f"{where}.trajectory")
        collisions = get(prediction, "collisions", list, where)
        check_limit(len(collisions), "events", f"{where}.collisions")
        for c, collision in enumerate(collisions):
            collision_where = f"{where}.collisions[{c}]"
            get_frame(collision, "frame", collision_where, limits().frames)
            pair = get(collision, "objects", list, collision_where)
            if len(pair) != 2:
                raise DataError(f"{collision_where}.objects: expected 2 objects, got {len(pair)}")
            first, second = (scene_object(o, 0, f"{collision_where}.objects[{i}]") for i, o in enumerate(pair))
            if first == second:
                raise DataError(f"{collision_where}.objects: expected two different objects, got {first.name} twice")


def _check_trajectory(samples: list[Any], where: str) -> None:
    last = -1
    for s, sample in enumerate(samples):
        sample_where = f"{where}[{s}]"
        frame = get_frame(sample, "frame_index", sample_where, limits().frames)
        if frame <= last:
            raise DataError(f"{sample_where}.frame_index: expected more than {last}, got {frame}")
        last = frame
        rows = get(sample, "objects", list, sample_where)
        seen: set[SceneObject] = set()
        check_limit(len(rows), "scene_objects", f"{sample_where}.objects")
        for i, row in enumerate(rows):
            object_where = f"{sample_where}.objects[{i}]"
            o = scene_object(row, 0, object_where)
            check_new(o, seen, object_where)
            seen.add(o)
            for axis in ("x", "y"):
                get_number(row, axis, object_where, -LARGEST_COORDINATE, LARGEST_COORDINATE)


def scene_from_predictions(document: Mapping[str, Any], n_frames: int = VIDEO_FRAMES) -> Scene:
    """The scene of a prediction file with the paper's semantics.

    Each frame takes visibility and motion from the latest sample, motion is measured on the ground, only the first collision
    of each pair counts, and collisions of unlisted objects are dropped. For the released executor's reading of the same file
    see `nsdr.symbolic.official`.

    Args:
        document: content of a prediction file.
        n_frames: number of frames of the video.

    Raises:
        DataError: a missing key or unknown attribute word.
    """
    try:
        objects = tuple(scene_object(o, i, f"objects[{i}]") for i, o in enumerate(document["objects"]))
        ids = {(o.color, o.material, o.shape): o.id for o in objects}
        observed, *others = document["predictions"]
        samples = observed["trajectory"]
        seen = np.zeros((len(objects), len(samples)), bool)
        grid = np.zeros((len(objects), len(samples), 2))
        for s, sample in enumerate(samples):
            for o in sample["objects"]:
                i = ids.get((o["color"], o["material"], o["shape"]), -1)
                if i >= 0:
                    seen[i, s] = True
                    grid[i, s] = o["x"], o["y"]
        times = np.array([s["frame_index"] for s in samples])
        collisions = _first_collisions(observed["collisions"], ids)
        counterfactual = {p["what_if"]: tuple(_first_collisions(p["collisions"], ids)) for p in others}
    except (KeyError, TypeError, IndexError, ValueError) as e:
        raise e if isinstance(e, DataError) else DataError(f"not a prediction file: {e!r}") from e
    held = np.clip(np.searchsorted(times, np.arange(n_frames), side="right") - 1, 0, max(len(times) - 1, 0))
    visible = seen[:, held] if len(times) else np.zeros((len(objects), n_frames), bool)
    moving = _moving(grid, seen, times)[:, held] if len(times) > 1 else np.zeros_like(visible)
    events = enter_exit_events(visible) + collisions_in_view((e for e in collisions if e.frame < n_frames), visible)
    unseen = tuple(e for e in collisions if e.frame >= n_frames)
    return Scene(objects, n_frames, visible, moving & visible, tuple(events), unseen, counterfactual)


def _moving(grid: Any, seen: Any, times: Any) -> Any:
    """(n, S) bool, whether an object moves at a sample: the lower of its speeds from the previous and to the next sample,
    where it was seen in both, exceeds the threshold."""
    world = ground_from_pixels(pixels_from_grid(grid))
    speed = speed_world_per_s(world[:, 1:] - world[:, :-1], np.diff(times)[:, None])
    speed = np.where(seen[:, 1:] & seen[:, :-1], speed, np.inf)
    missing = np.full((len(grid), 1), np.inf)
    slower = np.minimum(np.concatenate([missing, speed], 1), np.concatenate([speed, missing], 1))
    return np.isfinite(slower) & (slower > SAMPLED_MOVING_SPEED_WORLD_PER_S)


def _first_collisions(rows: list[Mapping[str, Any]], ids: Mapping[Triple, int]) -> list[Event]:
    """The first collision of each pair, in order of time."""
    first: dict[tuple[int, int], int] = {}
    for row in rows:
        a, b = (ids.get((o["color"], o["material"], o["shape"]), -1) for o in row["objects"])
        if min(a, b) >= 0 and a != b:
            pair = (min(a, b), max(a, b))
            first[pair] = min(row["frame"], first.get(pair, row["frame"]))
    return sorted((Event("collision", frame, pair) for pair, frame in first.items()), key=lambda e: e.frame)


def predictions_document(prediction: DynamicsPrediction) -> dict[str, Any]:
    """The content of a prediction file, which the released executor can read, from a dynamics prediction.

    Samples after the end of a rollout continue its last step at constant velocity, as far as the image reaches. Collisions
    take the nearest sample on their side of the video's end.
    """
    words = [{"color": o.color, "material": o.material, "shape": o.shape} for o in prediction.objects]
    n_frames = prediction.n_frames

    def rows(rollout: Rollout, what_if: int) -> dict[str, Any]:
        n_rollout = rollout.visible.shape[1]
        n_samples = max(math.ceil(n_frames / SAMPLE_FRAMES) + PREDICTED_SAMPLES, math.ceil(n_rollout / SAMPLE_FRAMES))
        frames = np.arange(n_samples) * SAMPLE_FRAMES
        held = np.minimum(frames, n_rollout - 1)
        last_step = rollout.location_world[:, -1:] - rollout.location_world[:, -2:][:, :1]
        world = rollout.location_world[:, held] + last_step * (frames - held)[:, None]
        pixels = pixels_from_world(on_ground(world))
        grid = grid_from_pixels(pixels)
        inside = ((pixels >= 0) & (pixels <= (WIDTH_PX, HEIGHT_PX))).all(-1) | (frames == held)
        shown = rollout.visible[:, held] & inside & np.isfinite(grid).all(-1)
        trajectory = [
            {
                "frame_index": int(frame),
                "objects": [
                    {"x": float(grid[i, s, 0]), "y": float(grid[i, s, 1]), **words[i]}
                    for i in np.flatnonzero(shown[:, s])
                ],
            }
            for s, frame in enumerate(frames)
        ]
        collisions = [
            {"frame": _sample_frame(e.frame, n_frames), "objects": [words[i] for i in e.objects]}
            for e in rollout.collisions
        ]
        return {"what_if": what_if, "trajectory": trajectory, "collisions": collisions}

    others = [rows(rollout, removed) for removed, rollout in sorted(prediction.counterfactual.items())]
    objects = [{"id": o.id, **w} for o, w in zip(prediction.objects, words, strict=True)]
    return {"objects": objects, "predictions": [rows(prediction.observed, NOTHING_REMOVED), *others]}


def _sample_frame(frame: int, n_frames: int) -> int:
    """Frame of the sample nearest to a frame, among those of the video or among those after it."""
    nearest = round(frame / SAMPLE_FRAMES) * SAMPLE_FRAMES
    first_unseen = math.ceil(n_frames / SAMPLE_FRAMES) * SAMPLE_FRAMES
    return min(nearest, first_unseen - SAMPLE_FRAMES) if frame < n_frames else max(nearest, first_unseen)

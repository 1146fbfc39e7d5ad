"""The research code's dynamics prediction files (`sim_N.json`): its interchange between dynamics and executor.

`objects: [{id, color, material, shape}]`; `predictions[0]` has `what_if: -1`, each other one `what_if: k`, the removed object;
a prediction has `trajectory: [{frame_index, objects: [{x, y, color, material, shape}]}]`, sampled every 5 frames, with x the
row (0-100) and y the column (0-150) of the grid, and `collisions: [{frame, objects: [attributes, attributes]}]`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nsdr.clevrer.scenes import collisions_in_view, enter_exit_events, speed_world_per_s
from nsdr.clevrer.schema import get, scene_object
from nsdr.errors import DataError
from nsdr.io.files import read_json
from nsdr.types import DynamicsPrediction, Event, Rollout, Scene
from nsdr.world.camera import grid_from_pixels, ground_from_pixels, pixels_from_grid, pixels_from_world
from nsdr.world.physics_constants import MOVING_SPEED_WORLD_PER_S, OBJECT_RADIUS_WORLD

__all__ = ["SAMPLE_FRAMES", "predictions_document", "read_predictions", "scene_from_predictions"]

SAMPLE_FRAMES = 5
"""Frames between two samples of a trajectory."""

Triple = tuple[str, str, str]


def read_predictions(path: str | Path) -> dict[str, Any]:
    """The content of a prediction file, checked.

    Raises:
        DataError: names the file, the position inside the JSON and what was expected there.
    """
    document = read_json(path)
    try:
        check_predictions(document)
    except DataError as e:
        raise DataError(f"{path}: {e}") from e
    return dict(document)


def check_predictions(document: Any) -> None:
    """Demand the form of a prediction file.

    Raises:
        DataError: names the position inside and what was expected there.
    """
    objects = get(document, "objects", list, "file")
    for i, o in enumerate(objects):
        scene_object(o, i, f"objects[{i}]")
    for p, prediction in enumerate(get(document, "predictions", list, "file")):
        where = f"predictions[{p}]"
        what_if = get(prediction, "what_if", int, where)
        if (p == 0) != (what_if == -1) or not -1 <= what_if < len(objects):
            expected = "-1, nothing removed" if p == 0 else f"0 to {len(objects) - 1}"
            raise DataError(f"{where}.what_if: expected {expected}, got {what_if}")
        for s, sample in enumerate(get(prediction, "trajectory", list, where)):
            for i, o in enumerate(get(sample, "objects", list, f"{where}.trajectory[{s}]")):
                position = f"{where}.trajectory[{s}].objects[{i}]"
                scene_object(o, i, position)
                get(o, "x", (int, float), position), get(o, "y", (int, float), position)
        for c, collision in enumerate(get(prediction, "collisions", list, where)):
            pair = get(collision, "objects", list, f"{where}.collisions[{c}]")
            if len(pair) != 2:
                raise DataError(f"{where}.collisions[{c}].objects: expected 2 objects, got {len(pair)}")
            for i, o in enumerate(pair):
                scene_object(o, i, f"{where}.collisions[{c}].objects[{i}]")


def scene_from_predictions(document: Mapping[str, Any], n_frames: int = 128) -> Scene:
    """Scene of a prediction file by the paper's semantics: dense frames, each pair collides once, motion on the ground.

    Collisions of objects that are not listed are left out. For the released executor's own reading of the same file see
    `nsdr.symbolic.official`.

    Raises:
        DataError: a missing key or unknown attribute.
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
    """(n, S) whether an object moves at a sample: both neighbouring samples must show motion on the ground."""
    world = ground_from_pixels(pixels_from_grid(grid))
    speed = speed_world_per_s(world[:, 1:] - world[:, :-1], np.diff(times)[:, None])
    speed = np.where(seen[:, 1:] & seen[:, :-1], speed, np.inf)
    missing = np.full((len(grid), 1), np.inf)
    slower = np.minimum(np.concatenate([missing, speed], 1), np.concatenate([speed, missing], 1))
    # 5 times the truth's threshold: positions are rounded and come from masks.
    return np.isfinite(slower) & (slower > 5 * MOVING_SPEED_WORLD_PER_S)


def _first_collisions(rows: list[Mapping[str, Any]], ids: Mapping[Triple, int]) -> list[Event]:
    """Each pair's first collision, in order of time."""
    first: dict[tuple[int, int], int] = {}
    for row in rows:
        a, b = (ids.get((o["color"], o["material"], o["shape"]), -1) for o in row["objects"])
        if min(a, b) >= 0 and a != b:
            pair = (min(a, b), max(a, b))
            first[pair] = min(row["frame"], first.get(pair, row["frame"]))
    return sorted((Event("collision", frame, pair) for pair, frame in first.items()), key=lambda e: e.frame)


def predictions_document(prediction: DynamicsPrediction) -> dict[str, Any]:
    """The dynamics predictor's output in the form of a prediction file, readable by the released executor."""
    words = [{"color": o.color, "material": o.material, "shape": o.shape} for o in prediction.objects]

    def rows(rollout: Rollout, what_if: int) -> dict[str, Any]:
        world = rollout.location_world[:, ::SAMPLE_FRAMES]
        height = np.full((*world.shape[:2], 1), OBJECT_RADIUS_WORLD)
        grid = grid_from_pixels(pixels_from_world(np.concatenate([world, height], -1)))
        trajectory = []
        for s in range(world.shape[1]):
            shown = [
                i for i in range(len(words)) if rollout.visible[i, s * SAMPLE_FRAMES] and np.isfinite(grid[i, s]).all()
            ]
            listed = [{"x": float(grid[i, s, 0]), "y": float(grid[i, s, 1]), **words[i]} for i in shown]
            trajectory.append({"frame_index": s * SAMPLE_FRAMES, "objects": listed})
        collisions = [{"frame": e.frame, "objects": [words[i] for i in e.objects]} for e in rollout.collisions]
        return {"what_if": what_if, "trajectory": trajectory, "collisions": collisions}

    others = [rows(rollout, removed) for removed, rollout in sorted(prediction.counterfactual.items())]
    objects = [{"id": o.id, **w} for o, w in zip(prediction.objects, words, strict=True)]
    return {"objects": objects, "predictions": [rows(prediction.observed, -1), *others]}

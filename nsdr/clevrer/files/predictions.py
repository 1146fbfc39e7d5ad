"""The released code's prediction files (`sim_N.json`), which its executor reads from its dynamics predictor.

`objects` is a list of `{id, color, material, shape}`. `predictions[0]` has `what_if: -1`; each further prediction has
`what_if: k`, the id of the removed object. A prediction has `trajectory: [{frame_index, objects: [{x, y, color, material,
shape}]}]`, sampled every 5th frame, 12 samples beyond the video (185 for 128 frames), with x the row (0-100) and y the column
(0-150) of the grid, and `collisions: [{frame, objects: [attributes, attributes]}]` with the frames of samples.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from nsdr.clevrer.files.schema import Coordinate, check_frame, check_unique
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.types import DynamicsPrediction, Event, Rollout, Scene, SceneObject
from nsdr.types.events import collisions_in_view, enter_exit_events
from nsdr.validation import expect, one_of
from nsdr.world.camera import (
    CLEVRER_CAMERA,
    HEIGHT_PX,
    WIDTH_PX,
    grid_from_pixels,
    on_ground,
    pixels_from_grid,
)
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

__all__ = [
    "SAMPLE_FRAMES",
    "PredictionFile",
    "predictions_document",
    "read_predictions",
    "scene_from_predictions",
]

SAMPLE_FRAMES = 5
"""Frames from one sample of a trajectory to the next."""
PREDICTED_SAMPLES = 12
"""Samples of the released files after the video."""
NOTHING_REMOVED = -1
"""`what_if` of the prediction in which no object is removed."""
SAMPLED_MOVING_SPEED_WORLD_PER_S = 5 * CLEVRER_WORLD.physics.moving_speed_world_per_s
"""Speed between samples above which an object counts as moving (world units/s): 5 times the threshold for true velocities,
because sampled positions are rounded and come from masks."""

Triple = tuple[str, str, str]
"""Color, material and shape."""


class Described(msgspec.Struct):
    """What is described by attribute words."""

    color: Annotated[str, one_of(CLEVRER.words["color"])]
    material: Annotated[str, one_of(CLEVRER.words["material"])]
    shape: Annotated[str, one_of(CLEVRER.words["shape"])]

    @property
    def triple(self) -> Triple:
        return self.color, self.material, self.shape


class ListedObject(Described, kw_only=True):
    """An object of the video."""

    id: int


class PlacedObject(Described, kw_only=True):
    """An object at a sample: row `x` (0-100) and column `y` (0-150) of the grid."""

    x: Coordinate
    y: Coordinate


class PredictedSample(msgspec.Struct):
    """The visible objects at a frame."""

    frame_index: int
    objects: list[PlacedObject]


class PredictedCollision(msgspec.Struct):
    """A collision of two objects."""

    frame: int
    objects: tuple[Described, Described]

    def __post_init__(self) -> None:
        check_frame(self.frame, "frame")
        first, second = (" ".join(o.triple) for o in self.objects)
        expect(first != second, "objects", "two different objects", f"{first} twice")


class Prediction(msgspec.Struct):
    """A rollout; `what_if` is the id of the removed object, or -1."""

    what_if: int
    trajectory: list[PredictedSample]
    collisions: list[PredictedCollision]

    def __post_init__(self) -> None:
        check_limit(len(self.collisions), "events", "collisions")
        before = -1
        for s, sample in enumerate(self.trajectory):
            place = f"trajectory[{s}]"
            check_frame(sample.frame_index, f"{place}.frame_index")
            expect(sample.frame_index > before, f"{place}.frame_index", f"more than {before}", sample.frame_index)
            before = sample.frame_index
            check_limit(len(sample.objects), "scene_objects", f"{place}.objects")
            if len({o.triple for o in sample.objects}) < len(sample.objects):
                check_unique([" ".join(o.triple) for o in sample.objects], f"{place}.objects")


class PredictionFile(msgspec.Struct):
    """The content of a prediction file, by its keys."""

    objects: list[ListedObject]
    predictions: list[Prediction]

    def __post_init__(self) -> None:
        n = len(self.objects)
        check_limit(n, "scene_objects", "objects")
        for i, o in enumerate(self.objects):
            expect(o.id == i, f"objects[{i}].id", str(i), o.id)
        check_unique([" ".join(o.triple) for o in self.objects], "objects")
        expect(len(self.predictions) > 0, "predictions", "at least 1", "none")
        for p, prediction in enumerate(self.predictions):
            fits = prediction.what_if == NOTHING_REMOVED if p == 0 else 0 <= prediction.what_if < n
            expected = f"{NOTHING_REMOVED} (nothing removed)" if p == 0 else f"0 to {n - 1}"
            expect(fits, f"predictions[{p}].what_if", expected, prediction.what_if)
        check_unique([p.what_if for p in self.predictions], "predictions", ".what_if")


def read_predictions(path: str | Path) -> PredictionFile:
    """Read and check a prediction file, plain or gzipped.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    content: PredictionFile = read_json(path, PredictionFile)
    return content


def scene_from_predictions(content: PredictionFile, n_frames: int = CLEVRER_WORLD.timeline.frames) -> Scene:
    """The scene of a prediction file with the paper's semantics.

    Each frame takes visibility and motion from the latest sample, motion is measured on the ground, only the first collision
    of each pair counts, and collisions of unlisted objects are dropped. For the released executor's reading of the same file
    see `nsdr.symbolic.official`.

    Args:
        content: of a prediction file.
        n_frames: number of frames of the video.
    """
    objects = tuple(SceneObject(o.id, *o.triple) for o in content.objects)
    ids = {o.triple: o.id for o in content.objects}
    observed, *others = content.predictions
    samples = observed.trajectory
    rows = [o for sample in samples for o in sample.objects]
    row_ids = np.array([ids.get(o.triple, len(objects)) for o in rows], int)
    at = row_ids, np.repeat(np.arange(len(samples)), [len(sample.objects) for sample in samples])
    seen = np.zeros((len(objects) + 1, len(samples)), bool)  # the last row is that of unlisted objects
    grid = np.zeros((len(objects) + 1, len(samples), 2))
    seen[at], grid[at] = True, np.array([(o.x, o.y) for o in rows], float).reshape(-1, 2)
    seen, grid = seen[:-1], grid[:-1]
    times = np.array([s.frame_index for s in samples])
    collisions = _first_collisions(observed.collisions, ids)
    counterfactual = {p.what_if: tuple(_first_collisions(p.collisions, ids)) for p in others}
    held = np.maximum(np.searchsorted(times, np.arange(n_frames), side="right") - 1, 0)
    visible = seen[:, held] if len(times) else np.zeros((len(objects), n_frames), bool)
    moving = _moving(grid, seen, times)[:, held] if len(times) > 1 else np.zeros_like(visible)
    events = enter_exit_events(visible) + collisions_in_view((e for e in collisions if e.frame < n_frames), visible)
    predicted = tuple(e for e in collisions if e.frame >= n_frames)
    return Scene(objects, n_frames, visible, moving & visible, tuple(events), predicted, counterfactual)


def _moving(grid: Any, seen: Any, times: Any) -> Any:
    """(n, S) bool, whether an object moves at a sample: the lower of its speeds from the previous and to the next sample,
    where it was seen in both, exceeds the threshold."""
    location = CLEVRER_CAMERA.ground(pixels_from_grid(grid))
    seconds = np.diff(times)[:, None] * CLEVRER_WORLD.physics.frame_seconds
    speed = np.linalg.norm((location[:, 1:] - location[:, :-1]) / seconds, axis=-1)
    speed = np.where(seen[:, 1:] & seen[:, :-1], speed, np.inf)
    missing = np.full((len(grid), 1), np.inf)
    slower = np.minimum(np.concatenate([missing, speed], 1), np.concatenate([speed, missing], 1))
    return np.isfinite(slower) & (slower > SAMPLED_MOVING_SPEED_WORLD_PER_S)


def _first_collisions(rows: list[PredictedCollision], ids: Mapping[Triple, int]) -> list[Event]:
    """The first collision of each pair, in order of time."""
    first: dict[tuple[int, int], int] = {}
    for row in rows:
        one, other = row.objects
        a, b = ids.get(one.triple, -1), ids.get(other.triple, -1)
        if a >= 0 and b >= 0:
            pair = (a, b) if a < b else (b, a)
            first[pair] = min(row.frame, first.get(pair, row.frame))
    return [Event("collision", frame, pair) for pair, frame in sorted(first.items(), key=lambda item: item[1])]


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
        location = rollout.location_world[:, held] + last_step * (frames - held)[:, None]
        pixels = CLEVRER_CAMERA.pixels(on_ground(location))
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

"""Real and simulated tracks with their true collisions, as training data for the dynamics predictor."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from nsdr.clevrer.proposals import read_compact_proposals
from nsdr.clevrer.truth_blocks import read_truth
from nsdr.dynamics.motion_states import MotionStates, object_features, states_from_tracks
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, read_json
from nsdr.tracking.tracker import track
from nsdr.tracking.truth_tracks import tracks_from_motion
from nsdr.types import Event, SceneObject
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["MotionDataset", "read_motion_dataset"]

MAX_OBJECTS = 7
NO_COLLISION = -1000
FRAMES = VIDEO_FRAMES
SIMULATED_NOISE_WORLD = 0.005
"""Of simulated positions, about that of tracks of official proposals."""


@dataclass(frozen=True)
class MotionDataset:
    """States of many scenes, padded to `MAX_OBJECTS`.

    Attributes:
        scene: (S,) int, video index; -1 for simulated ones.
        location_world: (S, N, F, 2) float32.
        reliable, present: (S, N, F) bool.
        static: (S, N, 5) float32, one-hot shape and material.
        exists: (S, N) bool.
        box_px: (S, N, F, 4) float32, as in `MotionStates`.
        collision_frame: (S, N, N) int, symmetric; `NO_COLLISION` where a pair does not collide.
    """

    scene: NDArray[Any]
    location_world: NDArray[Any]
    reliable: NDArray[Any]
    present: NDArray[Any]
    static: NDArray[Any]
    exists: NDArray[Any]
    box_px: NDArray[Any]
    collision_frame: NDArray[Any]

    def __len__(self) -> int:
        return len(self.scene)

    def part(self, picked: NDArray[Any]) -> "MotionDataset":
        """The scenes at these indices (or where a mask is true)."""
        return MotionDataset(*(getattr(self, name)[picked] for name in self.__dataclass_fields__))

    def states(self, index: int) -> tuple[MotionStates, list[Event]]:
        """One scene unpadded, with its true collisions (colours are not stored and all gray)."""
        n = int(self.exists[index].sum())
        shape = self.static[index, :n, :3].argmax(1)
        material = self.static[index, :n, 3:].argmax(1)
        objects = tuple(
            SceneObject(i, "gray", ("metal", "rubber")[material[i]], ("cube", "sphere", "cylinder")[shape[i]])
            for i in range(n)
        )
        reliable = self.reliable[index, :n]
        frames = self.collision_frame[index]
        events = [
            Event("collision", int(frames[i, j]), (i, j))
            for i in range(n)
            for j in range(i + 1, n)
            if frames[i, j] >= 0
        ]
        location = self.location_world[index, :n].astype(float)
        box = self.box_px[index, :n].astype(float)
        return MotionStates(objects, location, reliable, reliable, self.present[index, :n], box), events


def read_motion_dataset(
    proposals: str | Path,
    truth: str | Path,
    cache: str | Path | None = None,
    limit: int | None = None,
    simulated: str | Path | None = None,
) -> MotionDataset:
    """Track the compact proposals of every video of normal length and join them with the true collisions.

    Args:
        proposals: compact NPZ (`nsdr.clevrer.proposals.read_compact_proposals`).
        truth: ground-truth blocks.
        cache: an NPZ that is read when it exists, and written otherwise.
        limit: stop after this many scenes.
        simulated: folder of a data set of `nsdr generate dataset`; its scenes come last, each as its first and its last 128 of
            179 frames, with noise.

    Raises:
        DataError: an unreadable file.
    """
    if cache is not None and Path(cache).exists():
        with np.load(cache) as arrays:
            return MotionDataset(**{name: arrays[name] for name in MotionDataset.__dataclass_fields__})
    files = sorted(Path(simulated).rglob("truth_*.json")) if simulated else []
    if simulated and not files:
        raise DataError(f"{simulated}: has no truth files (truth_N.json); make some with nsdr generate dataset")
    blocks = read_truth(truth)
    rows: dict[str, list[Any]] = {name: [] for name in MotionDataset.__dataclass_fields__}
    for video, found in tqdm(
        read_compact_proposals(proposals), total=limit or len(blocks), desc="tracks", unit="video"
    ):
        if limit is not None and len(rows["scene"]) >= limit:
            break
        block = blocks[video]
        if block["n_frames"] != FRAMES:
            continue
        states = states_from_tracks(track(found))
        if 2 <= len(states.objects) <= MAX_OBJECTS:
            for name, value in _row(video, states, block).items():
                rows[name].append(value)
    for video, states, block in _simulated(files):
        for name, value in _row(video, states, block).items():
            rows[name].append(value)
    data = MotionDataset(**{name: np.stack(values) for name, values in rows.items()})
    if cache is not None:
        with atomic_path(cache) as temporary:
            np.savez(temporary, **{name: getattr(data, name) for name in MotionDataset.__dataclass_fields__})
    return data


def _simulated(files: Sequence[Path]) -> Iterator[tuple[int, MotionStates, dict[str, Any]]]:
    """What `_row` needs of every truth file."""
    rng = np.random.default_rng(0)
    for file in tqdm(files, desc="simulated", unit="scene", disable=not files):
        truth = read_json(file)
        try:
            for first in (0, len(truth["frames"]) - FRAMES):
                tracks = tracks_from_motion(truth["objects"], truth["frames"][first : first + FRAMES])
                states = states_from_tracks(tracks)
                if not 2 <= len(states.objects) <= MAX_OBJECTS:
                    continue
                noise = rng.normal(size=states.location_world.shape) * SIMULATED_NOISE_WORLD
                collisions = [
                    {"object": c["object_ids"], "frame": c["frame_id"] - first}
                    for c in truth["collisions"]
                    if first < c["frame_id"] < first + FRAMES
                ]
                objects = [{**o, "id": o["object_id"]} for o in truth["objects"]]
                states = replace(states, location_world=states.location_world + noise)
                yield -1, states, {"objects": objects, "collisions": collisions}
        except (KeyError, TypeError, IndexError) as e:
            raise DataError(f"{file}: not a truth file of nsdr generate dataset ({e!r})") from e


def _row(video: int, states: MotionStates, block: dict[str, Any]) -> dict[str, Any]:
    n = len(states.objects)
    pad = MAX_OBJECTS - n

    def padded(a: NDArray[Any]) -> NDArray[Any]:
        return np.pad(a, [(0, pad)] + [(0, 0)] * (a.ndim - 1))

    track_of = {o.name: o.id for o in states.objects}
    names = {o["id"]: f"{o['color']} {o['material']} {o['shape']}" for o in block["objects"]}
    collision = np.full((MAX_OBJECTS, MAX_OBJECTS), NO_COLLISION, np.int16)
    for event in block["collisions"]:
        pair = [track_of.get(names[i], -1) for i in event["object"]]
        if min(pair) >= 0:
            collision[pair[0], pair[1]] = collision[pair[1], pair[0]] = event["frame"]
    return {
        "scene": np.int32(video),
        "location_world": padded(states.location_world.astype(np.float32)),
        "reliable": padded(states.reliable),
        "present": padded(states.present),
        "static": padded(object_features(states.objects)),
        "exists": padded(np.ones(n, bool)),
        "box_px": padded(states.box_px.astype(np.float32)),
        "collision_frame": collision,
    }

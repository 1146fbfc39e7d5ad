"""Training data of the propagation networks: tracks with their true collisions."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from nsdr import tracking
from nsdr.clevrer.files.proposals import read_compact_proposals
from nsdr.clevrer.files.truth_blocks import read_truth
from nsdr.dynamics.motion_states import MotionStates, object_features, states_from_tracks
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import fingerprint
from nsdr.io.reading import read_npz
from nsdr.tracking.tracker import track
from nsdr.types import Event, SceneObject
from nsdr.world.timeline import VIDEO_FRAMES
from nsdr.world.vocabulary import COLORS, MATERIALS, SHAPES

__all__ = ["MotionDataset", "motion_row", "read_motion_dataset"]

VERSION = 1
"""Of the rows of a `MotionDataset`, which are kept: raised when they change."""
MIN_OBJECTS = 2
"""Scenes with fewer tracked objects are skipped: they hold no pair."""
MAX_OBJECTS = 7
"""Scenes with more tracked objects are skipped; the arrays are padded to this number."""
NO_COLLISION = -1000
"""Entry of `MotionDataset.collision_frame` for pairs that do not collide, further from the video than any window (frames)."""


@dataclass(frozen=True)
class MotionDataset:
    """Motion of S scenes over F frames, padded to N = `MAX_OBJECTS` objects.

    Attributes:
        scene: (S,) int, video index.
        location_world: (S, N, F, 2) float32, positions on the ground as in `MotionStates` (world units).
        detected: (S, N, F) bool, detected in that frame.
        reliable: (S, N, F) bool, detected, not cut by the image's border and not hidden.
        present: (S, N, F) bool, between the object's first and last detection.
        static: (S, N, 5) float32, one-hot shape (3) and material (2).
        exists: (S, N) bool, False for padding.
        box_px: (S, N, F, 4) float32, centre (column, row), width and height of the box (px).
        collision_frame: (S, N, N) int, symmetric; `NO_COLLISION` where a pair does not collide.
    """

    scene: NDArray[Any]
    location_world: NDArray[Any]
    detected: NDArray[Any]
    reliable: NDArray[Any]
    present: NDArray[Any]
    static: NDArray[Any]
    exists: NDArray[Any]
    box_px: NDArray[Any]
    collision_frame: NDArray[Any]

    def __len__(self) -> int:
        return len(self.scene)

    def subset(self, picked: NDArray[Any]) -> "MotionDataset":
        """The scenes at the given indices (K,), or where a mask (S,) is true."""
        return MotionDataset(*(getattr(self, name)[picked] for name in self.__dataclass_fields__))

    def states(self, index: int) -> tuple[MotionStates, list[Event]]:
        """One scene without padding, and its true collisions. Colours are not stored: every object is gray."""
        n = int(self.exists[index].sum())
        shape = self.static[index, :n, : len(SHAPES)].argmax(1)
        material = self.static[index, :n, len(SHAPES) :].argmax(1)
        objects = tuple(SceneObject(i, COLORS[0], MATERIALS[material[i]], SHAPES[shape[i]]) for i in range(n))
        detected, reliable = self.detected[index, :n], self.reliable[index, :n]
        frames = self.collision_frame[index]
        events = [
            Event("collision", int(frames[i, j]), (i, j))
            for i in range(n)
            for j in range(i + 1, n)
            if frames[i, j] >= 0
        ]
        location = self.location_world[index, :n].astype(float)
        box = self.box_px[index, :n].astype(float)
        return MotionStates(objects, location, detected, reliable, self.present[index, :n], box), events


def read_motion_dataset(
    proposals: str | Path,
    truth: str | Path,
    cache: str | Path | None = None,
    limit: int | None = None,
) -> MotionDataset:
    """Track the compact proposals of every video of the normal length and join the tracks with the true collisions.

    Args:
        proposals: compact proposals (NPZ), see `nsdr.clevrer.files.proposals.read_compact_proposals`.
        truth: ground-truth blocks (gzipped JSON), see `nsdr.clevrer.files.truth_blocks.read_truth`.
        cache: an NPZ file that keeps the result. It is read where it was made from the same files and `limit` by the same code,
            and written otherwise.
        limit: maximum number of scenes; None for all.

    Raises:
        DataError: a missing or unreadable file, a video without truth, or no scene that fits.
    """
    made_from = fingerprint(inputs=[Path(proposals), Path(truth)], config=[VERSION, tracking.VERSION, limit])
    kept = _read_cache(Path(cache), made_from) if cache is not None else None
    if kept is not None:
        return kept
    blocks = read_truth(truth)
    lengths = {video: block["n_frames"] for video, block in blocks.items()}
    rows: dict[str, list[Any]] = {name: [] for name in MotionDataset.__dataclass_fields__}
    for video, video_proposals in tqdm(
        read_compact_proposals(proposals, lengths), total=limit or len(blocks), desc="tracks", unit="video"
    ):
        if limit is not None and len(rows["scene"]) >= limit:
            break
        if video not in blocks:
            raise DataError(
                f"{truth}: has no video {video}, which {proposals} has; make both by one `nsdr data motion`"
            )
        block = blocks[video]
        if block["n_frames"] != VIDEO_FRAMES:
            continue
        states = states_from_tracks(track(video_proposals))
        if MIN_OBJECTS <= len(states.objects) <= MAX_OBJECTS:
            for name, value in motion_row(video, states, block).items():
                rows[name].append(value)
    if not rows["scene"]:
        raise DataError(
            f"{proposals}: holds no video of {VIDEO_FRAMES} frames with {MIN_OBJECTS} to {MAX_OBJECTS} objects"
        )
    data = MotionDataset(**{name: np.stack(values) for name, values in rows.items()})
    if cache is not None:
        arrays = {name: getattr(data, name) for name in MotionDataset.__dataclass_fields__}
        with atomic_path(cache) as temporary:
            np.savez(temporary, **arrays, fingerprint=np.array(made_from))
    return data


def _read_cache(path: Path, made_from: str) -> MotionDataset | None:
    """The kept data; None if they are missing, broken or of other inputs."""
    try:
        arrays = read_npz(path)
    except DataError:
        return None
    if str(arrays.pop("fingerprint", "")) != made_from or arrays.keys() != MotionDataset.__dataclass_fields__.keys():
        return None
    return MotionDataset(**arrays)


def motion_row(video: int, states: MotionStates, block: dict[str, Any]) -> dict[str, Any]:
    """One scene's entries of `MotionDataset`, padded; true objects are matched to tracks by their attributes."""
    n = len(states.objects)
    pad = MAX_OBJECTS - n

    def padded(values: NDArray[Any]) -> NDArray[Any]:
        return np.pad(values, [(0, pad)] + [(0, 0)] * (values.ndim - 1))

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
        "detected": padded(states.detected),
        "reliable": padded(states.reliable),
        "present": padded(states.present),
        "static": padded(object_features(states.objects)),
        "exists": padded(np.ones(n, bool)),
        "box_px": padded(states.box_px.astype(np.float32)),
        "collision_frame": collision,
    }

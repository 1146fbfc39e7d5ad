"""Training data of the propagation networks: tracks or patches of videos, with the true collisions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from nsdr import tracking
from nsdr.clevrer.dataset import CLEVRER, Split
from nsdr.clevrer.files.annotations import read_truth, truth_block
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.scenes import scene_from_annotation
from nsdr.dynamics.motion_states import MotionStates, VideoPixels, object_features, states_from_tracks
from nsdr.dynamics.propnet.patch_model import PatchPropNetConfig
from nsdr.dynamics.propnet.patches import object_patches
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import fingerprint
from nsdr.io.reading import read_npz
from nsdr.io.video import read_frames
from nsdr.io.worlds import world_in
from nsdr.tracking.tracker import track
from nsdr.types import Event, SceneObject
from nsdr.world.world import World

Row = dict[str, NDArray[Any]]
"""Entries of one scene in a `MotionDataset`, by the names of its attributes."""

DATA_VERSION = 1
"""Version of the cached rows of a `MotionDataset`. It is raised when they change."""
MIN_OBJECTS = 2
"""Scenes with fewer tracked objects are skipped, because they have no pairs."""
MAX_OBJECTS = 7
"""Scenes with more tracked objects are skipped, unless the world has scenes with more. Arrays are padded to this number."""
NO_COLLISION = -1000
"""Entry of `MotionDataset.collision_frame` for pairs that do not collide: a frame that no window reaches."""


@dataclass(frozen=True)
class MotionDataset:
    """Motion of S scenes of one world over F frames, padded to N objects: `MAX_OBJECTS`, or the world's most objects.

    Attributes:
        scene: (S,) int, index of the video.
        location_world: (S, N, F, 2) float32, positions on the ground as in `MotionStates` (world units).
        detected: (S, N, F) bool, whether the object was detected in the frame.
        reliable: (S, N, F) bool, whether it was detected, not cut by the image border and not hidden.
        present: (S, N, F) bool, whether the frame is between the first and the last detection of the object.
        static: (S, N, `feature_count`) float32, one-hot shape and material.
        exists: (S, N) bool, whether the entry is an object; False for padding.
        box_px: (S, N, F, 4) float32, centre (column, row), width and height of the box (pixels).
        collision_frame: (S, N, N) int, frame of the collision of each pair, symmetric; `NO_COLLISION` if it does not collide.
        world: the world that the scenes are of.
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
    world: World

    @classmethod
    def of(cls, rows: Sequence[Row], world: World) -> "MotionDataset":
        """A data set of the scenes with these rows, which `_row` makes."""
        return cls(**{name: np.stack([row[name] for row in rows]) for name in ARRAYS}, world=world)

    def __len__(self) -> int:
        return len(self.scene)

    def subset(self, picked: NDArray[Any]) -> "MotionDataset":
        """The scenes at the indices `picked` (K,), or where the mask `picked` (S,) is true."""
        return replace(self, **{name: getattr(self, name)[picked] for name in ARRAYS})

    @property
    def last_frame(self) -> int:
        """Index of a video's last frame."""
        return self.present.shape[2] - 1

    def states(self, index: int) -> tuple[MotionStates, list[Event]]:
        """The motion states of one scene without padding, and its true collisions.

        As colours are not stored, all are the world's first: gray in CLEVRER.
        """
        n = int(self.exists[index].sum())
        colors, materials, shapes = self.world.vocabulary.words.values()
        shape = self.static[index, :n, : len(shapes)].argmax(1)
        material = self.static[index, :n, len(shapes) :].argmax(1)
        objects = tuple(SceneObject(i, colors[0], materials[material[i]], shapes[shape[i]]) for i in range(n))
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
        states = MotionStates(objects, location, detected, reliable, self.present[index, :n], box, world=self.world)
        return states, events

    def heights(self) -> NDArray[Any]:
        """(S, N) heights of the objects' centres (world units); 0 for padding."""
        shapes = self.world.vocabulary.shapes
        return np.asarray(self.static[..., : len(shapes)] @ np.array([shape.height_world for shape in shapes]))


ARRAYS = tuple(name for name in MotionDataset.__dataclass_fields__ if name != "world")
"""The arrays of a `MotionDataset`."""


def read_motion_dataset(
    proposals: str | Path, truth: str | Path, cache: str | Path | None = None, limit: int | None = None
) -> MotionDataset:
    """Track the compact proposals of every video of the normal length and join the tracks with the true collisions.

    Args:
        proposals: compact proposals (NPZ), see `nsdr.clevrer.files.compact_proposals.read_compact_proposals`.
        truth: ground-truth blocks (gzipped JSON), see `nsdr.clevrer.files.annotations.read_truth`.
        cache: NPZ file that keeps the result. It is read if it was made from the same files with the same `limit` and versions,
            and written otherwise.
        limit: maximum number of scenes; None for all.

    Raises:
        DataError: a file is missing or unreadable, a video has no ground truth, or no scene fits.
    """
    made_from = fingerprint(inputs=[Path(proposals), Path(truth)], config=[DATA_VERSION, tracking.VERSION, limit])
    kept = None if cache is None else _kept(Path(cache), made_from)
    blocks, rows = read_truth(truth), list[Row]()
    world = world_in(next(iter(blocks.values())), f"{truth}: ")
    if kept is not None and kept.keys() == set(ARRAYS):
        return MotionDataset(**kept, world=world)
    lengths = {video: block["n_frames"] for video, block in blocks.items()}
    for video, video_proposals in tqdm(
        read_compact_proposals(proposals, lengths), total=limit or len(blocks), desc="tracks", unit="video"
    ):
        if limit is not None and len(rows) >= limit:
            break
        if video not in blocks:
            raise DataError(
                f"{truth}: has no video {video}, which {proposals} has; make both by one `nsdr data motion`"
            )
        if blocks[video]["n_frames"] == world.timeline.frames:
            states = states_from_tracks(track(video_proposals))
            if MIN_OBJECTS <= len(states.objects) <= most_objects(world):
                rows.append(_row(video, states, blocks[video]))
    if not rows:
        raise DataError(f"{proposals}: holds no video {_usable(world)}")
    data = MotionDataset.of(rows, world)
    if cache is not None:
        _keep(Path(cache), made_from, {name: getattr(data, name) for name in ARRAYS})
    return data


def most_objects(world: World) -> int:
    """Number of objects to which the arrays of a world's scenes are padded; scenes with more are skipped."""
    return max(MAX_OBJECTS, world.layout.most_objects)


def _usable(world: World) -> str:
    return f"of {world.timeline.frames} frames with {MIN_OBJECTS} to {most_objects(world)} objects"


def read_image_dataset(
    root: str | Path, cache: str | Path, config: PatchPropNetConfig, limit: int | None = None
) -> tuple[MotionDataset, list[Path]]:
    """Track the mask proposals of every `train` video and cut patches from its frames.

    The tracks and patches of a video are kept in `cache` (about 2 MB), and made again only if its files, the sizes of patches
    or the versions have changed. Training reads the patches from `cache` without decoding videos.

    Args:
        root: data set in the official layout, with videos, mask proposals and annotations.
        cache: folder in which tracks and patches are kept.
        config: sizes of the patches.
        limit: maximum number of scenes; None for all.

    Returns:
        The motion of S scenes, and the paths of S files with patches (n, F, 4, cells, cells) uint8 as in `object_patches`.

    Raises:
        DataError: a file is missing or unreadable, or no scene fits.
    """
    split, rows, files = CLEVRER(root).split("train"), list[Row](), list[Path]()
    for index in tqdm(sorted(split.entries("videos")), desc="patches", unit="video"):
        if limit is not None and len(rows) >= limit:
            break
        patch_file = Path(cache) / f"patches_{index:05d}.npy"
        row = _image_row(split, index, Path(cache) / f"motion_{index:05d}.npz", patch_file, config)
        if row:
            rows.append(row)
            files.append(patch_file)
    if not rows:
        raise DataError(
            f"{root}: holds no train video {_usable(split.world)}; make some with `nsdr generate dataset --config preview`"
        )
    return MotionDataset.of(rows, split.world), files


def _image_row(split: Split, index: int, path: Path, patch_file: Path, config: PatchPropNetConfig) -> Row:
    """The row of a video, read from `path` or made together with its patches; empty for a video that does not fit."""
    video, annotation = split.video(index), split.annotation(index)
    settings = [DATA_VERSION, tracking.VERSION, [config.patch_cells, config.cell_px], annotation]
    made_from = fingerprint(inputs=[video, split.path("proposals", index)], config=settings)
    kept = _kept(path, made_from)
    if kept is not None:
        return kept
    proposals, row = split.proposals(index), {}
    tracks = track(proposals)
    states = states_from_tracks(tracks)
    fits = MIN_OBJECTS <= len(states.objects) <= most_objects(states.world)
    if fits and proposals.n_frames == states.world.timeline.frames:
        patches = object_patches(VideoPixels(read_frames(video, world=states.world), proposals, tracks), states, config)
        with atomic_path(patch_file) as temporary, open(temporary, "wb") as file:
            np.save(file, patches)
        row = _row(index, states, truth_block(scene_from_annotation(annotation)))
    _keep(path, made_from, row)
    return row


def _kept(path: Path, made_from: str) -> Row | None:
    """The row that `_keep` wrote; None if it is missing, broken or made from other inputs."""
    try:
        arrays = read_npz(path)
    except DataError:
        return None
    return arrays if str(arrays.pop("fingerprint", "")) == made_from else None


def _keep(path: Path, made_from: str, arrays: Row) -> None:
    """Write a row with the fingerprint of its inputs."""
    with atomic_path(path) as temporary:
        np.savez(temporary, fingerprint=np.array(made_from), **arrays)  # type: ignore[arg-type]


def _row(video: int, states: MotionStates, block: dict[str, Any]) -> Row:
    """The padded entries of one scene in a `MotionDataset`. True objects are matched to tracks by their attributes."""
    n, most = len(states.objects), most_objects(states.world)

    def padded(values: NDArray[Any]) -> NDArray[Any]:
        """Values (n, ...) padded to `most` rows."""
        return np.pad(values, [(0, most - n)] + [(0, 0)] * (values.ndim - 1))

    track_of = {o.name: o.id for o in states.objects}
    names = {o["id"]: f"{o['color']} {o['material']} {o['shape']}" for o in block["objects"]}
    collision = np.full((most, most), NO_COLLISION, np.int16)
    for event in block["collisions"]:
        pair = [track_of.get(names[i], -1) for i in event["object"]]
        if min(pair) >= 0:
            collision[pair[0], pair[1]] = collision[pair[1], pair[0]] = event["frame"]
    return {
        "scene": np.array(video, np.int32),
        "location_world": padded(states.location_world.astype(np.float32)),
        "detected": padded(states.detected),
        "reliable": padded(states.reliable),
        "present": padded(states.present),
        "static": padded(object_features(states.objects, states.world.vocabulary)),
        "exists": padded(np.ones(n, bool)),
        "box_px": padded(states.box_px.astype(np.float32)),
        "collision_frame": collision,
    }

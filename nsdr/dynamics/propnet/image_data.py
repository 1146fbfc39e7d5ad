"""Training data of the network on images: tracks, patches and true collisions of a data set with videos."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from nsdr import tracking
from nsdr.clevrer.dataset import CLEVRER, Split
from nsdr.clevrer.files.scenes import scene_from_annotation
from nsdr.clevrer.files.truth_blocks import truth_block
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.propnet.data import MAX_OBJECTS, MIN_OBJECTS, VERSION, MotionDataset, motion_row
from nsdr.dynamics.propnet.image_patches import object_patches
from nsdr.dynamics.propnet.patch_model import PatchModelConfig
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import fingerprint
from nsdr.io.reading import read_npz
from nsdr.io.video import read_frames
from nsdr.tracking.tracker import track
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["read_image_dataset"]

Rows = dict[str, NDArray[Any]]


def read_image_dataset(
    root: str | Path, cache: str | Path, config: PatchModelConfig, limit: int | None = None
) -> tuple[MotionDataset, list[Path]]:
    """Track the mask proposals of every `train` video and cut patches of its frames.

    A video's tracks and patches are kept in `cache` (about 2 MB), and made again only where its files, the sizes of patches or
    the code have changed. Training reads the patches from there without decoding videos.

    Args:
        root: data set in the official layout, with videos, mask proposals and annotations.
        cache: folder to keep tracks and patches in.
        config: sizes of patches.
        limit: maximum number of scenes; None for all.

    Returns:
        The motion of S scenes, and S files with patches (n, F, 4, cells, cells) uint8 as of `object_patches`.

    Raises:
        DataError: a missing or unreadable file, or no scene that fits.
    """
    split = CLEVRER(root).split("train")
    rows: list[Rows] = []
    files: list[Path] = []
    for index in tqdm(sorted(split.entries("videos")), desc="patches", unit="video"):
        if limit is not None and len(rows) >= limit:
            break
        row = _kept(split, index, Path(cache), config)
        if row:
            rows.append(row)
            files.append(_patch_file(Path(cache), index))
    if not rows:
        raise DataError(
            f"{root}: holds no train video of {VIDEO_FRAMES} frames with {MIN_OBJECTS} to {MAX_OBJECTS} objects; make some "
            "with `nsdr generate dataset --config configs/generate/preview.yaml`"
        )
    names = MotionDataset.__dataclass_fields__
    return MotionDataset(**{name: np.stack([row[name] for row in rows]) for name in names}), files


def _patch_file(cache: Path, index: int) -> Path:
    return cache / f"patches_{index:05d}.npy"


def _kept(split: Split, index: int, cache: Path, config: PatchModelConfig) -> Rows:
    """A video's row of the data set, made where it is not kept; nothing for a video that does not fit."""
    video, path = Path(split.video(index)), cache / f"motion_{index:05d}.npz"
    annotation, masks = split.annotation(index), split.raw_proposals(index)
    sizes = [config.patch_cells, config.cell_px]
    made_from = fingerprint(inputs=[video, masks], config=[VERSION, tracking.VERSION, sizes, annotation])
    try:
        arrays = read_npz(path)
        if str(arrays.pop("fingerprint", "")) == made_from:
            return arrays
    except DataError:
        pass
    row = _made(split, index, video, annotation, _patch_file(cache, index), config)
    with atomic_path(path) as temporary:
        np.savez(temporary, **row, fingerprint=np.array(made_from))  # type: ignore[arg-type]
    return row


def _made(
    split: Split, index: int, video: Path, annotation: dict[str, Any], patch_file: Path, config: PatchModelConfig
) -> Rows:
    proposals = split.proposals(index)
    tracks = track(proposals)
    states = states_from_tracks(tracks)
    if proposals.n_frames != VIDEO_FRAMES or not MIN_OBJECTS <= len(states.objects) <= MAX_OBJECTS:
        return {}
    patches = object_patches(read_frames(video), proposals, tracks, states, config)
    with atomic_path(patch_file) as temporary, open(temporary, "wb") as file:
        np.save(file, patches)
    return motion_row(index, states, truth_block(scene_from_annotation(annotation)))

"""Compact files of many videos, on which the dynamics networks are trained: proposals in numbers, and ground-truth blocks."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.files.annotations import IRREGULAR_VIDEOS, check_annotation, check_truth, truth_block, write_truth
from nsdr.clevrer.files.compact_proposals import COMPACT_ARRAYS, WORLD, compact_rows
from nsdr.clevrer.files.proposals import ground_truth_of, parse_proposals
from nsdr.clevrer.files.scenes import scene_from_annotation, scene_from_truth
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, locked
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.reading import parse_json, read_bytes, read_json, read_npz
from nsdr.io.worlds import world_in
from nsdr.validation import expect

__all__ = ["write_compact_files"]

PROPOSALS_FILE, TRUTH_FILE = "proposals.npz", "truth.json.gz"

VERSION = 1
"""Version of the files' content. It is raised when the content changes."""


def write_compact_files(
    root: str | Path,
    output: str | Path,
    split: str = "train",
    engine: str = "processes",
    workers: int = 0,
    keep_going: bool = False,
) -> int:
    """Write `proposals.npz` and `truth.json.gz` of all videos of a split that have mask proposals.

    The truth is the `ground_truth` block of the proposal file, as in the released code's `processed_proposals`; without one,
    the annotation; without that, the truth file of a data set made by `nsdr generate dataset`.

    Args:
        root: folder in the official layout (see `CLEVRER`), or of a generated data set.
        output: folder to write to. Its `videos/` keeps each video's part, so that a killed run goes on where it stopped.
        split: "train", "validation" or "test".
        engine: "processes" or "ray".
        workers: number of processes; 0 is one per CPU core.
        keep_going: leave out videos that fail.

    Returns:
        Number of videos.

    Raises:
        DataError: there are no proposals, a file is broken or without truth, or the folder has the videos of another data set,
            whose files differ; names the first such file.
    """
    folder, files = Path(output), CLEVRER(root).split(split)
    proposals, annotations = files.entries("proposals"), files.entries("annotations")
    if not proposals:
        raise DataError(f"{root}: has no mask proposals (proposal_N.json or sim_N.json) of {split}")
    jobs = []
    for index, path in tqdm(proposals.items(), unit="file", desc="files read"):
        truth = annotations.get(index)
        generated = Path(root) / "truth" / split / f"truth_{index:05d}.json"
        if truth is None and generated.is_file():
            truth = generated
        value = fingerprint(inputs=[p for p in (path, truth) if p is not None], config=[VERSION])
        output_file = folder / "videos" / f"{index:05d}.npz"
        jobs.append(Job(f"video {index}", (index, path, truth), output_file, value, path))
    with locked(folder):
        summary = run_jobs(_write_video, jobs, folder, engine, workers)
        jobs = summary.succeeded(jobs, output, keep_going)
        _join([job.output for job in jobs], folder)
    return len(jobs)


def _write_video(video: tuple[int, Path, Path | None], output: Path) -> None:
    """Write the rows of one video, and its ground-truth block as JSON text."""
    index, path, truth = video
    name = str(path)
    data = read_bytes(path)
    content, proposals = parse_json(data, name), parse_proposals(data, name)
    if "ground_truth" in content:
        block = ground_truth_of(content, name)
    elif truth is not None:
        block = _block(truth, proposals.n_frames)
    else:
        raise DataError(f"{name}: has no ground_truth, and there is no annotation_{index:05d}.json of the split")
    same = "that of the proposals; make the data set anew, in one world"
    expect(world_in(block) == proposals.world, f"video {index}: the world of its truth", same, world_in(block).name)
    block = {"video": index, "n_frames": proposals.n_frames, **block}
    arrays: dict[str, Any] = compact_rows(index, proposals)
    with atomic_path(output) as temporary:
        np.savez(temporary, **arrays, truth=np.array(json.dumps(block)))


def _block(path: Path, n_frames: int) -> dict[str, Any]:
    """The ground-truth block of an annotation, or of a generated video's truth file."""
    content = read_json(path)
    if isinstance(content, dict) and "motion_trajectory" not in content:
        check_truth(content, f"{path}: ")
        return truth_block(scene_from_truth(content))
    check_annotation(content, f"{path}: ")
    n, video = len(content["motion_trajectory"]), content["scene_index"]
    fits = n == n_frames or video in IRREGULAR_VIDEOS
    expect(fits, f"{path}: motion_trajectory", f"{n_frames} frames, as the proposals of video {video} have", n)
    return truth_block(scene_from_annotation(content))


def _join(parts: Sequence[Path], folder: Path) -> None:
    arrays: dict[str, list[Any]] = {name: [] for name in COMPACT_ARRAYS}
    blocks, worlds = [], {}
    for part in parts:
        content = read_npz(part)
        worlds[str(content.get(WORLD, ""))] = part
        for name, rows in arrays.items():
            rows.append(content[name])
        blocks.append(parse_json(str(content["truth"]).encode(), str(part)))
    same = "one and the same world in all videos; make the data set anew, in one world"
    expect(len(worlds) == 1, str(folder), same, f"different ones in {' and '.join(map(str, worlds.values()))}")
    joined: dict[str, Any] = {name: np.concatenate(rows) for name, rows in arrays.items()}
    if text := next(iter(worlds)):
        joined[WORLD] = np.array(text)
    with atomic_path(folder / PROPOSALS_FILE) as temporary:
        np.savez_compressed(temporary, **joined)
    write_truth(folder / TRUTH_FILE, blocks)

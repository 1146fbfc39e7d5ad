"""Training frames for the frame parser from videos with mask proposals."""

import re
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nsdr.clevrer.files.proposals import read_proposals
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, find_files, json_text, write_file
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.video import read_frames
from nsdr.io.worlds import store_world
from nsdr.tracking.tracker import PROPOSAL_SCORE
from nsdr.types import VideoProposals
from nsdr.world.world import World

VERSION = 1
"""Version of the frames that are written. It is raised when they change."""
JPEG_QUALITY = 95
"""Quality of the written images (0-100)."""
_PROPOSAL_FILE = re.compile(r"(?:proposal|sim)_0*(\d+)\.json(?:\.gz)?$")


def write_frames(
    videos: str | Path, proposals: str | Path, output: str | Path, every: int = 8, keep_going: bool = False
) -> int:
    """Write images and annotations for `FrameDataset` from videos and their mask proposals.

    Args:
        videos: folder with `video_N.mp4`, searched recursively.
        proposals: folder with `proposal_N.json` or `sim_N.json`, also gzipped, searched recursively.
        output: folder to write to; what an earlier run wrote is kept under its fingerprint.
        every: write every n-th frame.
        keep_going: leave out videos that fail.

    Returns:
        Number of frames in `output`, those of kept videos included.

    Raises:
        DataError: `every` is below 1, no video has proposals, the proposals are of several worlds, or a file is broken.
    """
    if every < 1:
        raise DataError(f"every is {every}; expected 1 or more")
    found = {int(m[1]): path for path in find_files(proposals, "*.json*") if (m := _PROPOSAL_FILE.match(path.name))}
    folder, settings, jobs = Path(output), fingerprint(config=[VERSION, every]).encode(), []
    for video in find_files(videos, "video_*.mp4"):
        index = int(video.stem.removeprefix("video_"))
        if index in found:
            item, value = (index, video, found[index]), fingerprint(inputs=[video, found[index], settings])
            jobs.append(Job(video.name, item, folder / f"annotations_{index:05d}.jsonl", value, video))
    if not jobs:
        raise DataError(f"{videos}: holds no video_N.mp4 with a proposal_N.json or sim_N.json in {proposals}")
    world = read_proposals(jobs[0].item[2]).world
    store_world(folder, world)
    summary = run_jobs(partial(_write_video_frames, every, world), jobs, folder, workers=1)
    done = summary.succeeded(jobs, output, keep_going)
    return sum(len(job.output.read_text().splitlines()) for job in done)


def _write_video_frames(every: int, world: World, item: tuple[int, Path, Path], lines: Path) -> None:
    index, video, path = item
    proposals, rows = read_proposals(path), []
    if proposals.world != world:
        raise DataError(f"{path}: is of another world than the other proposals; give those of one world")
    for frame, image in enumerate(read_frames(video, world=world)):
        if frame % every or frame >= proposals.n_frames:
            continue
        name = f"{index:05d}_{frame:03d}.jpg"
        with atomic_path(lines.parent / "images" / name) as temporary:
            _, encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            temporary.write_bytes(encoded.tobytes())  # OpenCV's own writing is silent on a full disk
        is_shown = (proposals.frame_index == frame) & (proposals.score > PROPOSAL_SCORE)
        objects = [_object(proposals, row) for row in np.flatnonzero(is_shown).tolist()]
        rows.append({"file_name": name, "scene": index, "frame": frame, "objects": objects})
    write_file(lines, "".join(json_text(row, lines) + "\n" for row in rows))


def _object(proposals: VideoProposals, row: int) -> dict[str, Any]:
    """An object of a frame, as in the annotations of `FrameDataset`."""
    assert proposals.masks is not None  # JSON files have them
    vocabulary, camera = proposals.world.vocabulary, proposals.world.camera
    words = dict(zip(vocabulary.words, vocabulary.triple(int(proposals.attribute[row])), strict=True))
    return {**words, "segmentation": {"size": [camera.height, camera.width], "counts": proposals.masks[row]}}

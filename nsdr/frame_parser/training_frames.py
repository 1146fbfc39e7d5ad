"""Videos with mask proposals -> frames to train the frame parser on."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
from tqdm import tqdm

from nsdr.clevrer.proposals import read_proposals
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.video import read_frames
from nsdr.types import VideoProposals
from nsdr.world.vocabulary import ATTRIBUTES, attributes_of

__all__ = ["frame_records", "write_frames"]

JPEG_QUALITY = 95
_PROPOSAL_FILE = re.compile(r"(?:proposal|sim)_0*(\d+)\.json(?:\.gz)?$")


def write_frames(
    videos: str | Path, proposals: str | Path, output: str | Path, every: int = 8, score: float = 0.9
) -> int:
    """Write images and annotations for `FrameDataset` from videos and their mask proposals; returns how many frames.

    Args:
        videos: folder with `video_N.mp4`, searched below, too.
        proposals: folder with `proposal_N.json` or `sim_N.json`, also gzipped.
        output: folder to write; videos that are there already are kept.
        every: take every so-manieth frame.
        score: proposals above it count as true.

    Raises:
        DataError: no video has proposals, or a file is broken.
    """
    output = Path(output)
    found = {int(m[1]): path for path in Path(proposals).rglob("*") if (m := _PROPOSAL_FILE.search(path.name))}
    pairs = [
        (index, path, found[index])
        for path in sorted(Path(videos).rglob("video_*.mp4"))
        if (index := int(path.stem.removeprefix("video_"))) in found
    ]
    if not pairs:
        raise DataError(f"{videos}: holds no video_N.mp4 with a proposal_N.json or sim_N.json in {proposals}")
    written = 0
    (output / "images").mkdir(parents=True, exist_ok=True)
    for index, video, proposal in tqdm(pairs, unit="video", desc="frames"):
        lines = output / f"annotations_{index:05d}.jsonl"
        if lines.exists():
            written += len(lines.read_text().splitlines())
            continue
        records = dict(frame_records(read_proposals(proposal), score))
        rows = []
        for frame, image in enumerate(read_frames(video)):
            if frame % every or frame not in records:
                continue
            name = f"{index:05d}_{frame:03d}.jpg"
            with atomic_path(output / "images" / name) as temporary:
                cv2.imwrite(str(temporary), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            rows.append({"file_name": name, "scene": index, "frame": frame, "objects": records[frame]})
        with atomic_path(lines) as temporary:
            temporary.write_text("".join(json.dumps(row) + "\n" for row in rows))
        written += len(rows)
    return written


def frame_records(proposals: VideoProposals, score: float = 0.9) -> Iterator[tuple[int, list[dict[str, Any]]]]:
    """(frame index, objects as in `FrameDataset`'s annotations) of every frame; `proposals` need their masks.

    Raises:
        DataError: the proposals are compact ones, without masks.
    """
    if proposals.masks is None:
        raise DataError("these proposals have no masks; take the official JSON files")
    objects: list[list[dict[str, Any]]] = [[] for _ in range(proposals.n_frames)]
    for row in range(len(proposals)):
        if proposals.score[row] > score:
            words = dict(zip(ATTRIBUTES, attributes_of(int(proposals.attribute[row])), strict=True))
            mask = {"size": [320, 480], "counts": proposals.masks[row]}
            objects[int(proposals.frame_index[row])].append({**words, "segmentation": mask})
    yield from enumerate(objects)

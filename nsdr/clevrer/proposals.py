"""CLEVRER's mask proposals: official JSON files (plain or gzipped), and the same reduced to numbers in one NPZ file."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.clevrer.annotations import check_ground_truth
from nsdr.clevrer.schema import get, scene_object
from nsdr.errors import DataError
from nsdr.io.files import parse_json
from nsdr.types import VideoProposals
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.vocabulary import attribute_index, attributes_of

__all__ = [
    "mask_numbers",
    "parse_proposals",
    "proposals_document",
    "proposals_from_rows",
    "read_compact_proposals",
    "read_ground_truth",
    "read_proposals",
]


def read_proposals(path: str | Path) -> VideoProposals:
    """Read `proposal_N.json` or the research code's `sim_N.json`, also gzipped.

    Raises:
        DataError: not a proposal file; names the file, the position inside and what was expected.
    """
    return parse_proposals(_bytes(path), str(path))


def read_ground_truth(path: str | Path) -> tuple[dict[str, Any], int]:
    """The `ground_truth` block of a `processed_proposals` file, checked, and the video's number of frames.

    Raises:
        DataError: there is no such block, or it is broken.
    """
    content = parse_json(_bytes(path), str(path))
    block = get(content, "ground_truth", dict, str(path))
    check_ground_truth(block, f"{path}: ground_truth")
    indices = _frame_indices(get(content, "frames", list, str(path)), str(path))
    return block, max(indices, default=-1) + 1


def _bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except FileNotFoundError as e:
        raise DataError(f"{path}: no such file") from e
    except OSError as e:
        raise DataError(f"{path}: cannot be read ({e})") from e


def parse_proposals(data: bytes, name: str) -> VideoProposals:
    """Proposals from a file's bytes; raises as `read_proposals`, with `name` for the file."""
    content = parse_json(data, name)
    frames = get(content, "frames", list, name)
    indices = _frame_indices(frames, name)
    rows = []
    for f, frame in zip(indices, frames, strict=True):
        for i, o in enumerate(get(frame, "objects", list, f"{name}: frames[{f}]")):
            where = f"{name}: frames[{f}].objects[{i}]"
            found = scene_object(o, 0, where)
            mask = get(o, "mask", dict, where)
            size, counts = get(mask, "size", list, f"{where}.mask"), get(mask, "counts", str, f"{where}.mask")
            if size != [HEIGHT_PX, WIDTH_PX]:
                raise DataError(f"{where}.mask.size: expected [{HEIGHT_PX}, {WIDTH_PX}], got {size}")
            score = float(get(o, "score", (float, int), where))
            rows.append((f, attribute_index(found.color, found.material, found.shape), score, counts))
    return proposals_from_rows(max(indices, default=-1) + 1, rows)


def _frame_indices(frames: Sequence[Any], name: str) -> list[int]:
    """`frame_index` of every frame, ascending; the irregular video 7648 leaves some out."""
    indices = [get(frame, "frame_index", int, f"{name}: frames[{f}]") for f, frame in enumerate(frames)]
    if any(b <= a for a, b in pairwise(indices)):
        raise DataError(f"{name}: frames: frame_index must ascend")
    return indices


def proposals_from_rows(n_frames: int, rows: Sequence[tuple[int, int, float, str]]) -> VideoProposals:
    """Proposals from (frame, attribute index, score, COCO run-length string) rows; empty masks are left out."""
    kept, centroids, areas, boxes = [], [], [], []
    for row in sorted(rows, key=lambda r: r[0]):
        centroid, area, box = mask_numbers(rle.decode({"size": [HEIGHT_PX, WIDTH_PX], "counts": row[3].encode()}))
        if area:
            kept.append(row)
            centroids.append(centroid)
            areas.append(area)
            boxes.append(box)
    return VideoProposals(
        n_frames,
        np.array([r[0] for r in kept], np.int64),
        np.array([r[1] for r in kept], np.int64),
        np.array([r[2] for r in kept], np.float64),
        np.array(centroids, np.float64).reshape(-1, 2),
        np.array(areas, np.int64),
        np.array(boxes, np.int64).reshape(-1, 4),
        tuple(r[3] for r in kept),
    )


def mask_numbers(mask: NDArray[np.uint8]) -> tuple[tuple[float, float], int, tuple[int, int, int, int]]:
    """Centroid (column, row) of the pixel centres, area, and box (x0, y0, x1, y1), end exclusive, of a mask (H, W)."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return (0.0, 0.0), 0, (0, 0, 0, 0)
    box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
    return (float(columns.mean()) + 0.5, float(rows.mean()) + 0.5), len(rows), box


def proposals_document(proposals: VideoProposals, video_index: int, video_filename: str) -> dict[str, Any]:
    """The official JSON document; inverse of `read_proposals`.

    Raises:
        DataError: the proposals carry no masks.
    """
    if proposals.masks is None:
        raise DataError("these proposals carry no masks; the official format needs them")
    frames: list[dict[str, Any]] = [{"frame_index": f, "objects": []} for f in range(proposals.n_frames)]
    for i, mask in enumerate(proposals.masks):
        frame = int(proposals.frame_index[i])
        color, material, shape = attributes_of(int(proposals.attribute[i]))
        frames[frame]["objects"].append(
            {
                "mask": {"size": [HEIGHT_PX, WIDTH_PX], "counts": mask},
                "color": color,
                "material": material,
                "shape": shape,
                "score": round(float(proposals.score[i]), 6),
                "video_index": video_index,
                "frame_index": frame,
            }
        )
    return {"video_index": video_index, "video_filename": video_filename, "frames": frames}


def read_compact_proposals(
    path: str | Path, n_frames: Mapping[int, int] | None = None
) -> Iterator[tuple[int, VideoProposals]]:
    """Read proposals of many videos reduced to numbers: one row a detection, in one NPZ.

    Arrays: `video`, `frame`, `attr` (attribute index), `score` (0-255), `cx64`, `cy64` (mean pixel index in 1/64 px), `area`,
    `box` (x0, y0, x1, y1); rows sorted by video and frame.

    Args:
        path: the NPZ file.
        n_frames: frames of the videos that do not have 128.

    Yields:
        (video index, proposals without masks).

    Raises:
        DataError: a missing file or array.
    """
    try:
        with np.load(path) as arrays:
            a = {name: arrays[name] for name in ("video", "frame", "attr", "score", "cx64", "cy64", "area", "box")}
    except (OSError, KeyError, ValueError) as e:
        raise DataError(f"{path}: not a compact proposal file ({e})") from e
    starts = np.flatnonzero(np.diff(a["video"].astype(np.int64), prepend=-1))
    for start, stop in zip(starts, [*starts[1:], len(a["video"])], strict=True):
        rows = slice(int(start), int(stop))
        video = int(a["video"][start])
        yield (
            video,
            VideoProposals(
                (n_frames or {}).get(video, 128),
                a["frame"][rows].astype(np.int64),
                a["attr"][rows].astype(np.int64),
                a["score"][rows] / 255.0,
                np.stack([a["cx64"][rows], a["cy64"][rows]], 1) / 64.0 + 0.5,
                a["area"][rows].astype(np.int64),
                a["box"][rows].astype(np.int64),
            ),
        )

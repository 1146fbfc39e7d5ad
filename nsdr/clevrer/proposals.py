"""CLEVRER's mask proposals: official JSON files (plain or gzipped), and compact NPZ files of many videos without masks."""

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
from nsdr.world.timeline import VIDEO_FRAMES
from nsdr.world.vocabulary import attribute_index, attributes_of

__all__ = [
    "compact_rows",
    "mask_numbers",
    "parse_proposals",
    "proposals_document",
    "proposals_from_rows",
    "read_compact_proposals",
    "read_ground_truth",
    "read_proposals",
]

PIXEL_CENTRE_PX = 0.5
"""Offset from the index of a pixel to its centre (pixels)."""
SCORE_DECIMALS = 6
"""Decimal places of scores in written files."""
COMPACT_SCORE_STEPS = 255.0
"""Steps per unit of score in compact files, which store scores as bytes."""
COMPACT_CENTROID_STEPS_PER_PX = 64.0
"""Steps per pixel of centroids in compact files."""
COMPACT_ARRAYS = ("video", "frame", "attr", "score", "cx64", "cy64", "area", "box")
"""Arrays of a compact file."""


def read_proposals(path: str | Path) -> VideoProposals:
    """Read CLEVRER's `proposal_N.json` or the released code's `sim_N.json`, plain or gzipped.

    Raises:
        DataError: not a proposal file; names the file, the location in the file and what was expected there.
    """
    return parse_proposals(_bytes(path), str(path))


def read_ground_truth(path: str | Path) -> tuple[dict[str, Any], int]:
    """Read and check the `ground_truth` block of a file of `processed_proposals`.

    Returns:
        The block, and the number of frames of the video.

    Raises:
        DataError: there is no such block, or it is malformed; names the file and the location in the file.
    """
    data = _bytes(path)
    content = parse_json(data, str(path))
    indices = _frame_indices(get(content, "frames", list, str(path)), str(path))
    return parse_ground_truth(data, str(path)), max(indices, default=-1) + 1


def parse_ground_truth(data: bytes, name: str) -> dict[str, Any]:
    """Parse and check the `ground_truth` block in the bytes of a file of `processed_proposals`.

    Args:
        data: JSON, plain or gzipped.
        name: name of the file, for error messages.

    Raises:
        DataError: there is no such block, or it is malformed; names `name` and the location in the file.
    """
    block = get(parse_json(data, name), "ground_truth", dict, name)
    check_ground_truth(block, f"{name}: ground_truth")
    return block


def _bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except FileNotFoundError as e:
        raise DataError(f"{path}: no such file") from e
    except OSError as e:
        raise DataError(f"{path}: cannot be read ({e})") from e


def parse_proposals(data: bytes, name: str) -> VideoProposals:
    """Parse the bytes of a proposal file.

    Args:
        data: JSON, plain or gzipped.
        name: name of the file, for error messages.

    Raises:
        DataError: not a proposal file; names `name`, the location in the file and what was expected there.
    """
    content = parse_json(data, name)
    frames = get(content, "frames", list, name)
    indices = _frame_indices(frames, name)
    rows = []
    for f, frame in zip(indices, frames, strict=True):
        for i, o in enumerate(get(frame, "objects", list, f"{name}: frames[{f}]")):
            where = f"{name}: frames[{f}].objects[{i}]"
            detected = scene_object(o, 0, where)
            mask = get(o, "mask", dict, where)
            size, counts = get(mask, "size", list, f"{where}.mask"), get(mask, "counts", str, f"{where}.mask")
            if size != [HEIGHT_PX, WIDTH_PX]:
                raise DataError(f"{where}.mask.size: expected [{HEIGHT_PX}, {WIDTH_PX}], got {size}")
            score = float(get(o, "score", (float, int), where))
            rows.append((f, attribute_index(detected.color, detected.material, detected.shape), score, counts))
    n_frames = max(get(content, "n_frames", int, name) if "n_frames" in content else 0, max(indices, default=-1) + 1)
    return proposals_from_rows(n_frames, rows, indices)


def _frame_indices(frames: Sequence[Any], name: str) -> list[int]:
    """`frame_index` of every frame, ascending. The irregular video 7648 skips some frames."""
    indices = [get(frame, "frame_index", int, f"{name}: frames[{f}]") for f, frame in enumerate(frames)]
    if any(b <= a for a, b in pairwise(indices)):
        raise DataError(f"{name}: frames: frame_index must ascend")
    return indices


def proposals_from_rows(
    n_frames: int, rows: Sequence[tuple[int, int, float, str]], processed: Sequence[int] | None = None
) -> VideoProposals:
    """Make proposals from rows; rows with empty masks are dropped.

    Args:
        n_frames: number of frames of the video.
        rows: (frame, attribute index, score, COCO run-length string), in any order.
        processed: ascending frames that were processed; None for all.
    """
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
        None if processed is None or len(processed) == n_frames else np.array(processed, np.int64),
    )


def mask_numbers(mask: NDArray[np.uint8]) -> tuple[tuple[float, float], int, tuple[int, int, int, int]]:
    """Centroid, area and bounding box of a mask; all zero for an empty mask.

    Args:
        mask: (H, W) uint8.

    Returns:
        Mean (column, row) of the pixel centres, number of pixels, and box (left, top, right, bottom) with exclusive end.
    """
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return (0.0, 0.0), 0, (0, 0, 0, 0)
    box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
    return (float(columns.mean()) + PIXEL_CENTRE_PX, float(rows.mean()) + PIXEL_CENTRE_PX), len(rows), box


def proposals_document(proposals: VideoProposals, video_index: int, video_filename: str) -> dict[str, Any]:
    """The official JSON document of a video's proposals; inverse of `read_proposals`.

    It lists the processed frames. Where the last frame is not one of them, `n_frames` is added to the official keys.

    Raises:
        DataError: the proposals have no masks.
    """
    if proposals.masks is None:
        raise DataError("the proposals have no masks, which the official format needs")
    indices = range(proposals.n_frames) if proposals.processed is None else proposals.processed.tolist()
    frames: dict[int, dict[str, Any]] = {f: {"frame_index": f, "objects": []} for f in indices}
    for i, mask in enumerate(proposals.masks):
        frame = int(proposals.frame_index[i])
        color, material, shape = attributes_of(int(proposals.attribute[i]))
        frames[frame]["objects"].append(
            {
                "mask": {"size": [HEIGHT_PX, WIDTH_PX], "counts": mask},
                "color": color,
                "material": material,
                "shape": shape,
                "score": round(float(proposals.score[i]), SCORE_DECIMALS),
                "video_index": video_index,
                "frame_index": frame,
            }
        )
    document = {"video_index": video_index, "video_filename": video_filename, "frames": list(frames.values())}
    return document if proposals.n_frames - 1 in frames else document | {"n_frames": proposals.n_frames}


def compact_rows(video: int, proposals: VideoProposals) -> dict[str, NDArray[Any]]:
    """The arrays of a compact file for one video; inverse of `read_compact_proposals`, but for masks and rounding.

    Args:
        video: index of the video.
        proposals: its N detections.

    Returns:
        The `COMPACT_ARRAYS` by name: (N,) integers, `box` (N, 4).
    """
    centroid = np.rint((proposals.centroid_px - PIXEL_CENTRE_PX) * COMPACT_CENTROID_STEPS_PER_PX)
    return {
        "video": np.full(len(proposals), video, np.uint32),
        "frame": proposals.frame_index.astype(np.uint16),
        "attr": proposals.attribute.astype(np.uint8),
        "score": np.rint(proposals.score * COMPACT_SCORE_STEPS).astype(np.uint8),
        "cx64": centroid[:, 0].astype(np.uint16),
        "cy64": centroid[:, 1].astype(np.uint16),
        "area": proposals.area_px.astype(np.uint32),
        "box": proposals.box_xyxy_px.astype(np.uint16),
    }


def read_compact_proposals(
    path: str | Path, n_frames: Mapping[int, int] | None = None
) -> Iterator[tuple[int, VideoProposals]]:
    """Read a compact NPZ file: proposals of many videos without masks, one row per detection.

    Arrays: `video`, `frame`, `attr` (attribute index), `score` (0-255), `cx64` and `cy64` (mean pixel index in 1/64 px),
    `area`, and `box` (left, top, right, bottom); rows are sorted by video and frame.

    Args:
        path: the NPZ file.
        n_frames: number of frames by video index; others have 128, or more if rows show more.

    Yields:
        (video index, proposals without masks).

    Raises:
        DataError: a missing file or array.
    """
    try:
        with np.load(path) as arrays:
            a = {name: arrays[name] for name in COMPACT_ARRAYS}
    except (OSError, KeyError, ValueError) as e:
        raise DataError(f"{path}: not a compact proposal file ({e})") from e
    starts = np.flatnonzero(np.diff(a["video"].astype(np.int64), prepend=-1))
    for start, stop in zip(starts, [*starts[1:], len(a["video"])], strict=True):
        rows = slice(int(start), int(stop))
        video = int(a["video"][start])
        frame = a["frame"][rows].astype(np.int64)
        yield (
            video,
            VideoProposals(
                (n_frames or {}).get(video, max(VIDEO_FRAMES, int(frame.max()) + 1)),
                frame,
                a["attr"][rows].astype(np.int64),
                a["score"][rows] / COMPACT_SCORE_STEPS,
                np.stack([a["cx64"][rows], a["cy64"][rows]], 1) / COMPACT_CENTROID_STEPS_PER_PX + PIXEL_CENTRE_PX,
                a["area"][rows].astype(np.int64),
                a["box"][rows].astype(np.int64),
            ),
        )

"""Mask proposals: JSON files as CLEVRER's (plain or gzipped), and the proposals of many videos from anywhere.

Files of another world say so under the key `world`."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.clevrer.files.annotations import IRREGULAR_VIDEOS, check_ground_truth
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.masks import ObjectRuns, numbers_of_runs, object_runs, runs_of_mask
from nsdr.clevrer.files.schema import check_frame
from nsdr.errors import DataError
from nsdr.io.files import by_number, find_files
from nsdr.io.limits import check_limit, limits
from nsdr.io.reading import parse_json, read_bytes, read_json
from nsdr.io.worlds import stored_world, world_in
from nsdr.types import VideoProposals
from nsdr.validation import FloatArray, IntArray, Share, convert, expect
from nsdr.world.vocabulary import Word
from nsdr.world.world import CLEVRER_WORLD, World

__all__ = [
    "find_proposals",
    "ground_truth_of",
    "parse_proposals",
    "proposals_document",
    "proposals_from_masks",
    "proposals_from_rows",
    "read_ground_truth",
    "read_proposals",
]

SCORE_DECIMALS = 6
"""Decimal places of scores in written files."""
MASK_PROBABILITY = 0.5
"""Probability from which a pixel of a soft mask belongs to the object: it is then the likelier of the two."""


class _Mask(msgspec.Struct):
    size: list[int]
    counts: str


class _Row(msgspec.Struct):
    mask: _Mask
    color: Word
    material: Word
    shape: Word
    score: Share


class _Frame(msgspec.Struct):
    frame_index: int
    objects: list[_Row]


class _File(msgspec.Struct):
    frames: list[_Frame]
    n_frames: int | None = None
    notes: list[str] = []
    world: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        world = self.of_world()
        words, image = world.vocabulary.words, [world.camera.height, world.camera.width]
        expect(len(self.frames) > 0, "frames", "at least 1", "none")
        first = self.frames[0].frame_index
        expect(first == 0, "frames[0].frame_index", "0, as frames are numbered from 0", first)
        before = -1
        for f, frame in enumerate(self.frames):  # the irregular video 7648 skips some
            place = f"frames[{f}]"
            check_frame(frame.frame_index, f"{place}.frame_index")
            expect(frame.frame_index > before, f"{place}.frame_index", "ascending frames", frame.frame_index)
            before = frame.frame_index
            check_limit(len(frame.objects), "frame_objects", f"{place}.objects")
            for i, row in enumerate(frame.objects):
                found = f"{place}.objects[{i}]"
                expect(row.mask.size == image, f"{found}.mask.size", f"{image}", row.mask.size)
                for kind, known in words.items():
                    word = getattr(row, kind)
                    expect(word in known, f"{found}.{kind}", f"one of {', '.join(known)}", word)
        n, most = self.n_frames, limits().frames
        expect(n is None or before < n <= most, "n_frames", f"{before + 1} to {most}", n)

    def of_world(self) -> World:
        """The world that the video is of."""
        return world_in({"world": self.world})


class _FileWithTruth(_File, kw_only=True):
    ground_truth: dict[str, Any]
    video_index: Any = None


def read_proposals(path: str | Path) -> VideoProposals:
    """Read a `proposal_N.json` as CLEVRER's, or the released code's `sim_N.json`, plain or gzipped.

    Raises:
        DataError: not a proposal file; names the file, the location in the file and what was expected there.
    """
    return parse_proposals(read_bytes(path), str(path))


def parse_proposals(data: bytes, name: str) -> VideoProposals:
    """As `read_proposals`, from the bytes of a file with that name."""
    content: _File = parse_json(data, name, _File)
    world = content.of_world()
    index = world.vocabulary.index
    rows, places = [], []
    for f, frame in enumerate(content.frames):
        for i, o in enumerate(frame.objects):
            rows.append((frame.frame_index, index(o.color, o.material, o.shape), o.score, o.mask.counts))
            places.append(f"{name}: frames[{f}].objects[{i}].mask")
    indices = [frame.frame_index for frame in content.frames]
    found = proposals_from_rows(content.n_frames or indices[-1] + 1, rows, indices, places, world)
    return replace(found, notes=tuple(content.notes))


def read_ground_truth(path: str | Path) -> tuple[dict[str, Any], int]:
    """Read and check the `ground_truth` block of a file of `processed_proposals`.

    Returns:
        The block, and the number of frames of the video.

    Raises:
        DataError: there is no such block, or it is malformed; names the file and the location in the file.
    """
    content = read_json(path)
    return ground_truth_of(content, str(path)), content["frames"][-1]["frame_index"] + 1


def ground_truth_of(content: Any, name: str) -> dict[str, Any]:
    """The checked `ground_truth` block of a file of `processed_proposals`.

    Args:
        content: the file's JSON document.
        name: name of the file, for error messages.

    Raises:
        DataError: there is no such block, or it is malformed; names `name` and the location in the file.
    """
    file: _FileWithTruth = convert(content, _FileWithTruth, f"{name}: ")
    n_frames, world = file.frames[-1].frame_index + 1, file.of_world()
    # Events of irregular videos may lie behind the frames that the file has.
    last = max(n_frames, world.timeline.frames) if file.video_index in IRREGULAR_VIDEOS else n_frames
    block = file.ground_truth | stored_world(world)
    check_ground_truth(block, f"{name}: ground_truth", last)
    return block


def proposals_from_rows(
    n_frames: int,
    rows: Sequence[tuple[int, int, float, str]],
    processed: Sequence[int] | None = None,
    places: Sequence[str] | None = None,
    world: World = CLEVRER_WORLD,
) -> VideoProposals:
    """Make proposals from rows; rows with empty masks are dropped.

    Args:
        n_frames: number of frames of the video.
        rows: (frame, attribute index, score, COCO run-length string), in any order.
        processed: ascending frames that were processed; None for all.
        places: where the masks of the rows are from, for error messages; None names frames and rows.
        world: the world that the video is of.

    Raises:
        DataError: a mask that is damaged or of another size.
    """
    order = sorted(range(len(rows)), key=lambda i: rows[i][0])
    found = [places[i] if places else f"frame {rows[i][0]}, row {i}: mask" for i in order]
    size = world.camera.height, world.camera.width
    lengths = [runs_of_mask(rows[i][3], *size, place) for i, place in zip(order, found, strict=True)]
    frame, attribute, score, masks = zip(*(rows[i] for i in order), strict=True) if rows else ((),) * 4
    return proposals_from_runs(
        n_frames,
        np.array(frame, np.int64),
        np.array(attribute, np.int64),
        np.array(score, np.float64),
        masks,
        object_runs(lengths),
        processed,
        world,
    )


def proposals_from_runs(
    n_frames: int,
    frame_index: IntArray,
    attribute: IntArray,
    score: FloatArray,
    masks: Sequence[str],
    runs: ObjectRuns,
    processed: Sequence[int] | None,
    world: World,
) -> VideoProposals:
    """Make proposals from N masks and their runs; those with empty masks are dropped.

    Args:
        n_frames: number of frames of the video.
        frame_index: (N,) ascending.
        attribute: (N,) attribute indices.
        score: (N,) in 0-1.
        masks: N COCO run-length strings.
        runs: the runs of the same masks.
        processed: ascending frames that were processed; None for all.
        world: the world that the video is of.
    """
    seen = np.unique(runs.mask)
    numbers = numbers_of_runs(runs._replace(mask=np.searchsorted(seen, runs.mask)), world.camera.height)
    return VideoProposals(
        n_frames,
        frame_index[seen],
        attribute[seen],
        score[seen],
        *numbers,
        tuple(masks[i] for i in seen),
        None if processed is None or len(processed) == n_frames else np.array(processed, np.int64),
        world=world,
    )


def proposals_from_masks(
    n_frames: int,
    detections: Iterable[tuple[int, tuple[str, str, str], float, NDArray[Any]]],
    processed: Sequence[int] | None = None,
    world: World = CLEVRER_WORLD,
) -> VideoProposals:
    """Make proposals from the masks that a detector found; empty ones are dropped.

    Args:
        n_frames: number of frames of the video.
        detections: (frame, (color, material, shape), score in 0-1, mask), in any order. A mask is (height, width) of the
            world's images, such as CLEVRER's (320, 480), true where the object is, or the probability that it is there, of
            which one half or more counts.
        processed: ascending frames that were processed; None for all.
        world: the world that the video is of.

    Raises:
        DataError: a mask of another size or with numbers that are no probabilities, words that no object of the world has, or
            a value out of its range.
    """
    rows, size = [], (world.camera.height, world.camera.width)
    for frame, words, score, mask in detections:
        for word, known in zip(words, world.vocabulary.words.values(), strict=True):
            expect(word in known, f"frame {frame}: words", f"one of {', '.join(known)}", word)
        expect(mask.shape == size, f"frame {frame}: mask", f"{size}", mask.shape)
        if mask.dtype.kind == "f":
            expected = "true or false, or probabilities from 0 to 1"
            expect(
                bool(((mask >= 0) & (mask <= 1)).all()),
                f"frame {frame}: mask",
                expected,
                "other numbers, such as logits",
            )
        counts = rle.encode(np.asfortranarray(mask >= MASK_PROBABILITY, np.uint8))["counts"].decode()
        rows.append((frame, world.vocabulary.index(*words), score, counts))
    return proposals_from_rows(n_frames, rows, processed, world=world)


def proposals_document(proposals: VideoProposals, video_filename: str) -> dict[str, Any]:
    """The JSON document of a video's proposals, in CLEVRER's format; inverse of `read_proposals`.

    The digits of the file's name are the video's index. The document lists the processed frames. Where the last frame is not
    one of them, `n_frames` is added to the official keys, where the proposals have notes, `notes`, and `world` where they are
    of another world than CLEVRER's.

    Raises:
        DataError: the proposals have no masks.
    """
    if proposals.masks is None:
        raise DataError("the proposals have no masks, which the official format needs")
    video_index = int("".join(filter(str.isdecimal, Path(video_filename).stem)) or 0)
    world = proposals.world
    indices = range(proposals.n_frames) if proposals.processed is None else proposals.processed.tolist()
    frames: dict[int, dict[str, Any]] = {f: {"frame_index": f, "objects": []} for f in indices}
    for i, mask in enumerate(proposals.masks):
        frame = int(proposals.frame_index[i])
        color, material, shape = world.vocabulary.triple(int(proposals.attribute[i]))
        frames[frame]["objects"].append(
            {
                "mask": {"size": [world.camera.height, world.camera.width], "counts": mask},
                "color": color,
                "material": material,
                "shape": shape,
                "score": round(float(proposals.score[i]), SCORE_DECIMALS),
                "video_index": video_index,
                "frame_index": frame,
            }
        )
    document = {"video_index": video_index, "video_filename": video_filename, "frames": list(frames.values())}
    document |= {} if proposals.n_frames - 1 in frames else {"n_frames": proposals.n_frames}
    return document | ({"notes": list(proposals.notes)} if proposals.notes else {}) | stored_world(world)


def find_proposals(source: str | Path) -> dict[str, tuple[str, Path | VideoProposals]]:
    """The proposals of many videos.

    Args:
        source: a folder with `proposal_N.json` or `sim_N.json` (plain or gzipped), one such file, or a compact NPZ file.

    Returns:
        By the video's number, such as "00012": a name for messages, and the file or, from a compact one, the proposals.

    Raises:
        DataError: there are none, two files have one number, or a compact file cannot be read; names it.
    """
    path = Path(source)
    if not path.exists():
        raise DataError(f"{path}: no such file or folder")
    if path.suffix == ".npz":
        return {f"{video:05d}": (f"{video:05d}", p) for video, p in read_compact_proposals(path)}
    if path.is_file():
        return {**by_number({path.name: path})}
    names = (f"{stem}_*.json{end}" for stem in ("proposal", "sim") for end in ("", ".gz"))
    found = by_number({str(p.relative_to(path)): p for name in names for p in find_files(path, name)})
    if not found:
        raise DataError(f"{source}: holds no proposal_N.json and no sim_N.json")
    return {**found}

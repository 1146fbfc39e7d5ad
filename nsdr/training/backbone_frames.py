"""Frames of a data set, decoded once, and the objects that they show: training data of the baselines' backbone."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.baselines.features.extraction import frames_of, spaced
from nsdr.clevrer.dataset import CLEVRER
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["DecodedVideo", "SeenObject", "decode_videos", "seen_objects"]


class SeenObject(NamedTuple):
    """An object whose centre is in a frame.

    Attributes:
        column: of its centre, as a share of the image's width (0-1).
        row: of its centre, as a share of the image's height (0-1).
        words: word index of each of `ATTRIBUTES`.
    """

    column: float
    row: float
    words: tuple[int, ...]


@dataclass(frozen=True)
class DecodedVideo:
    """Some frames of a video.

    Attributes:
        index: of the video.
        images: (F, H, W, 3) uint8 RGB, mapped from a file.
        objects: those of each frame, the nearest to the camera last.
    """

    index: int
    images: NDArray[np.uint8]
    objects: tuple[tuple[SeenObject, ...], ...]


def decode_videos(
    root: str | Path, folder: str | Path, image_size: tuple[int, int], frames: int, limit: int = 0
) -> list[DecodedVideo]:
    """The training videos of a data set that have annotations, by index. What an earlier call decoded is kept.

    Args:
        root: the data set, in the official layout.
        folder: where decoded frames are kept.
        image_size: height and width to which frames are scaled (pixels).
        frames: evenly spaced frames of each video.
        limit: maximum number of videos; 0 for all.

    Raises:
        DataError: the data set has no such videos, or one cannot be read.
    """
    split = CLEVRER(root).split("train")
    indices = sorted(set(split.entries("videos")) & set(split.entries("annotations")))[: limit or None]
    if not indices:
        raise DataError(f"{root}: has no training videos with annotations; make some with `nsdr generate dataset`")
    folder = Path(folder)
    jobs = []
    for index in indices:
        video = split.video(index)
        key = fingerprint(inputs=[video], config=[image_size, frames], code=False)
        jobs.append(Job(video.name, video, folder / f"{index:05d}.npy", key))
    summary = run_jobs(partial(_decode, image_size, frames), jobs, folder, wait=True)
    summary.succeeded(jobs, folder, keep_going=False)
    decoded = []
    for index, job in zip(indices, jobs, strict=True):
        annotation = split.annotation(index)
        picked = spaced(len(annotation["motion_trajectory"]), frames)
        objects = tuple(seen_objects(annotation, int(frame)) for frame in picked)
        decoded.append(DecodedVideo(index, np.load(job.output, mmap_mode="r"), objects))
    return decoded


def _decode(image_size: tuple[int, int], count: int, video: Path, output: Path) -> None:
    height, width = image_size
    frames = frames_of(video)
    scaled = [cv2.resize(frames[i], (width, height), interpolation=cv2.INTER_AREA) for i in spaced(len(frames), count)]
    with atomic_path(output) as temporary:
        np.save(temporary, np.stack(scaled))


def seen_objects(annotation: Mapping[str, Any], frame: int) -> tuple[SeenObject, ...]:
    """The objects whose centres are in a frame, the nearest to the camera last.

    Args:
        annotation: as `nsdr.clevrer.files.annotations.read_annotation` gives it.
        frame: index of the frame.
    """
    words = {
        row["object_id"]: tuple(known.index(row[name]) for name, known in ATTRIBUTES.items())
        for row in annotation["object_property"]
    }
    found = []
    for row in annotation["motion_trajectory"][frame]["objects"]:
        if not row["inside_camera_view"]:
            continue
        column, line = CLEVRER_CAMERA.pixels(row["location"])
        share = float(column) / CLEVRER_CAMERA.width, float(line) / CLEVRER_CAMERA.height
        if 0 <= share[0] < 1 and 0 <= share[1] < 1:
            found.append((float(CLEVRER_CAMERA.depth(row["location"])), SeenObject(*share, words[row["object_id"]])))
    return tuple(seen for _, seen in sorted(found, key=lambda item: -item[0]))

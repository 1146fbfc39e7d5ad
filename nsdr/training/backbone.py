"""Train the baselines' backbone: `nsdr train backbone --config configs/baselines/backbone.yaml --root DATA`."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import cv2
import numpy as np
import torch
from msgspec import Meta
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, cross_entropy

from nsdr.baselines.features.backbone import (
    CELL_STAGE,
    MAX_COUNT,
    STRIDES,
    BackboneConfig,
    FrameClassifier,
    FrameScores,
    image_batch,
)
from nsdr.baselines.features.extraction import frames_of, spaced
from nsdr.clevrer.dataset import CLEVRER
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.training.loop import LoopConfig, LossTerm, Task, held_out, train_part
from nsdr.training.run_folder import parse_training
from nsdr.validation import MAX_SIZE, Count, PathName, PositiveCount, Settings, Share, Size
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["BackboneTask", "BackboneTraining", "DecodedVideo", "SeenObject", "decode_videos", "frame_targets", "main"]

FOUND_PROBABILITY = 0.5
"""A centre is found in a cell with a higher probability (0-1)."""
EVALUATION_BATCH = 32
"""Frames that are evaluated at once."""


@dataclass(frozen=True)
class BackboneTraining(Settings):
    """Training of the backbone on frames of a data set: which objects have their centre where, and what the frame shows.

    Attributes:
        root: a data set in the official layout with videos and annotations, such as one of `nsdr generate dataset`; its
            training split is used.
        run_dir: folder of the run, which also keeps the decoded frames; an interrupted run is resumed.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        image_size: height and width to which frames are scaled (pixels); multiples of 16.
        frames_per_video: evenly spaced frames of each video.
        videos: maximum number of videos; 0 for all.
        held_out_every: videos whose index this number divides are held out for evaluation.
        evaluation_frames: maximum number of held-out frames to evaluate on.
        flip: probability of a horizontal flip (0-1). The camera lies in the plane y = 0, so that a flipped view is valid.
        model: the network.
        loop: the optimisation.
    """

    root: PathName
    run_dir: PathName
    output: str = ""
    image_size: tuple[Size, Size] = (160, 240)
    frames_per_video: Size = 8
    videos: Count = 0
    held_out_every: Annotated[int, Meta(ge=2, le=MAX_SIZE)] = 20
    evaluation_frames: PositiveCount = 400
    flip: Share = 0.5
    model: BackboneConfig = field(default_factory=BackboneConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        stride = STRIDES[CELL_STAGE]
        if any(side % stride for side in self.image_size):
            raise DataError(f"image_size is {list(self.image_size)}; expected multiples of {stride}")


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
        key = fingerprint(inputs=[video], config=[image_size, frames])
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
    """The objects of an annotation whose centres are in a frame, the nearest to the camera last."""
    words = {
        row["object_id"]: tuple(known.index(row[name]) for name, known in ATTRIBUTES.items())
        for row in annotation["object_property"]
    }
    found = []
    for row in annotation["motion_trajectory"][frame]["objects"]:
        column, line = CLEVRER_CAMERA.pixels(row["location"])
        share = float(column) / CLEVRER_CAMERA.width, float(line) / CLEVRER_CAMERA.height
        if row["inside_camera_view"] and 0 <= share[0] < 1 and 0 <= share[1] < 1:
            found.append((float(CLEVRER_CAMERA.depth(row["location"])), SeenObject(*share, words[row["object_id"]])))
    return tuple(seen for _, seen in sorted(found, key=lambda item: -item[0]))


def frame_targets(objects: Sequence[SeenObject], cells: tuple[int, int]) -> dict[str, Tensor]:
    """What a frame shows.

    Args:
        objects: whose centres are in the frame; of several in a cell, the last one counts there.
        cells: height and width of the map.

    Returns:
        centre: (h, w) bool, that an object's centre is in the cell.
        attributes: (3, h, w) int64, word index of its colour, material and shape; 0 in other cells.
        present: (13,) bool, that an object with the word is in the frame.
        number: () int64, number of objects, at most `MAX_COUNT`.
    """
    centre = torch.zeros(cells, dtype=torch.bool)
    attributes = torch.zeros(len(ATTRIBUTES), *cells, dtype=torch.int64)
    present = [torch.zeros(len(words), dtype=torch.bool) for words in ATTRIBUTES.values()]
    for seen in objects:
        row, column = int(seen.row * cells[0]), int(seen.column * cells[1])
        centre[row, column] = True
        attributes[:, row, column] = torch.tensor(seen.words)
        for flags, word in zip(present, seen.words, strict=True):
            flags[word] = True
    number = torch.tensor(min(len(objects), MAX_COUNT))
    return {"centre": centre, "attributes": attributes, "present": torch.cat(present), "number": number}


class BackboneTask(Task):
    """Cross-entropy of what is in each cell and in the whole frame.

    The trained network says where objects are and how they look (maps), and which words fit and how many objects there are
    (pooled features).
    """

    def __init__(self, config: BackboneTraining) -> None:
        self.config = config
        torch.manual_seed(config.loop.seed)
        self.model: nn.Module = FrameClassifier(config.model).to(memory_format=torch.channels_last)
        height, width = config.image_size
        self.cells = height // STRIDES[CELL_STAGE], width // STRIDES[CELL_STAGE]
        folder = Path(config.run_dir) / "frames"
        videos = decode_videos(config.root, folder, config.image_size, config.frames_per_video, config.videos)
        is_held_out = held_out(np.array([v.index for v in videos]), config.held_out_every, config.root)
        self.training = [video for video, held in zip(videos, is_held_out, strict=True) if not held]
        evaluated = [video for video, held in zip(videos, is_held_out, strict=True) if held]
        every = [(video, frame) for video in evaluated for frame in range(config.frames_per_video)]
        self.held_out = [every[i] for i in np.unique(spaced(len(every), config.evaluation_frames))]

    def draw(self, count: int, rng: np.random.Generator) -> list[tuple[int, int, bool]]:
        """The position of each example's video in `training`, its frame, and whether it is flipped."""
        videos = rng.integers(len(self.training), size=count)
        frames = rng.integers(self.config.frames_per_video, size=count)
        flipped = rng.random(count) < self.config.flip
        return list(zip(videos.tolist(), frames.tolist(), flipped.tolist(), strict=True))

    def collate(self, examples: Sequence[tuple[int, int, bool]]) -> dict[str, Tensor]:
        """B frames: `images` (B, 3, H, W), as of `image_batch`, and the targets of `frame_targets`, stacked."""
        return self._batch([(self.training[video], frame, flip) for video, frame, flip in examples])

    def _batch(self, frames: Sequence[tuple[DecodedVideo, int, bool]]) -> dict[str, Tensor]:
        images, targets = [], []
        for video, frame, flip in frames:
            image, objects = video.images[frame], video.objects[frame]
            if flip:
                image = image[:, ::-1]
                objects = tuple(seen._replace(column=np.nextafter(1, 0) - seen.column) for seen in objects)
            images.append(image)
            targets.append(frame_targets(objects, self.cells))
        joined = {name: torch.stack([t[name] for t in targets]) for name in targets[0]}
        return {"images": image_batch(images, self.config.image_size), **joined}

    def losses(self, model: nn.Module, batch: dict[str, Tensor]) -> dict[str, LossTerm]:
        """Means per frame of centres, words and number of objects, per object of attributes; `images` are (B, 3, H, W)."""
        scores: FrameScores = model(batch["images"])
        frames, centre = len(batch["images"]), batch["centre"]
        terms = {"centre": LossTerm(_binary(scores.centre, centre), frames)}
        for name, logits, target in _attributes(scores, batch):
            total = (cross_entropy(logits, target, reduction="none") * centre).sum()
            terms[name] = LossTerm(total, centre.sum())
        terms["present"] = LossTerm(_binary(scores.present, batch["present"]), frames)
        terms["count"] = LossTerm(cross_entropy(scores.number, batch["number"], reduction="sum"), frames)
        return terms

    @torch.no_grad()
    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Of held-out frames.

        Returns:
            found: share of the objects whose centre is found in its cell.
            right: share of the objects that are found with all three attributes right.
            false_centres: cells per frame where a centre is found and none is.
            present: share of the words of a frame that are rightly said to be present or not.
            count: share of the frames with the right number of objects.
        """
        model.eval()
        device = next(model.parameters()).device
        totals: Counter[str] = Counter()
        for start in range(0, len(self.held_out), EVALUATION_BATCH):
            frames = [(*example, False) for example in self.held_out[start : start + EVALUATION_BATCH]]
            batch = {k: v.to(device) for k, v in self._batch(frames).items()}
            scores: FrameScores = model(batch["images"])
            found, centre = scores.centre.sigmoid() > FOUND_PROBABILITY, batch["centre"]
            right = found & centre
            for _, logits, target in _attributes(scores, batch):
                right = right & (logits.argmax(1) == target)
            counted = {
                "objects": centre,
                "found": found & centre,
                "right": right,
                "false_centres": found & ~centre,
                "present": (scores.present > 0) == batch["present"],
                "count": scores.number.argmax(1) == batch["number"],
            }
            totals.update({name: int(flags.sum()) for name, flags in counted.items()})
        n, objects, words = len(self.held_out), max(totals["objects"], 1), sum(map(len, ATTRIBUTES.values()))
        per = {"found": objects, "right": objects, "false_centres": n, "present": n * words, "count": n}
        return {name: totals[name] / number for name, number in per.items()}


def _binary(logits: Tensor, target: Tensor) -> Tensor:
    """Summed binary cross-entropy."""
    return binary_cross_entropy_with_logits(logits, target.float(), reduction="sum")


def _attributes(scores: FrameScores, batch: dict[str, Tensor]) -> Iterator[tuple[str, Tensor, Tensor]]:
    """(attribute, scores (B, words, h, w), word indices (B, h, w))."""
    for number, (name, logits) in enumerate(scores.attributes.items()):
        yield name, logits, batch["attributes"][:, number]


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config: Any = parse_training(BackboneTraining, argv, "backbone")
    details = {"image_size": list(config.image_size)}
    return train_part("backbone", BackboneTask(config), config, config.model, details)

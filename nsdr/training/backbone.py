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
    MAX_COUNT,
    STRIDE,
    BackboneConfig,
    FrameClassifier,
    FrameScores,
    image_batch,
)
from nsdr.baselines.features.extraction import frames_of
from nsdr.clevrer.dataset import CLEVRER
from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.video import spaced
from nsdr.training.loop import LoopConfig, LossTerm, Task, held_out, train_part
from nsdr.training.run_folder import parse_training
from nsdr.validation import MAX_SIZE, Count, PathName, PositiveCount, Settings, Share, Size
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["BackboneTask", "BackboneTraining", "Frame", "decode_videos", "frame_targets", "main"]

FOUND_PROBABILITY = 0.5
"""A centre is found in a cell with a higher probability (0-1)."""
EVALUATION_BATCH = 32
"""Frames that are evaluated at once."""
MAPS = ("centre", "attributes")
"""Targets that have columns."""


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
        if any(side % STRIDE for side in self.image_size):
            raise DataError(f"image_size is {list(self.image_size)}; expected multiples of {STRIDE}")


class Frame(NamedTuple):
    """A frame and what it shows.

    Attributes:
        image: (H, W, 3) uint8 RGB, mapped from a file.
        targets: as of `frame_targets`.
    """

    image: NDArray[np.uint8]
    targets: dict[str, Tensor]

    def mirrored(self) -> "Frame":
        """The frame seen from the other side of the plane y = 0."""
        return Frame(self.image[:, ::-1], {k: v.flip(-1) if k in MAPS else v for k, v in self.targets.items()})


def decode_videos(
    root: str | Path, folder: str | Path, image_size: tuple[int, int], frames: int, limit: int = 0
) -> dict[int, list[Frame]]:
    """Frames of the training videos of a data set that have annotations, by index. What an earlier call decoded is kept.

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
    jobs = []
    for index in indices:
        video = split.video(index)
        key = fingerprint(inputs=[video], config=[image_size, frames])
        jobs.append(Job(video.name, video, Path(folder) / f"{index:05d}.npy", key))
    summary = run_jobs(partial(_decode, image_size, frames), jobs, folder, wait=True)
    summary.succeeded(jobs, folder, keep_going=False)
    cells = image_size[0] // STRIDE, image_size[1] // STRIDE
    decoded = {}
    for index, job in zip(indices, jobs, strict=True):
        annotation, images = split.annotation(index), np.load(job.output, mmap_mode="r")
        picked = spaced(len(annotation["motion_trajectory"]), frames)
        targets = [frame_targets(annotation, int(frame), cells) for frame in picked]
        decoded[index] = list(map(Frame, images, targets))
    return decoded


def _decode(image_size: tuple[int, int], count: int, video: Path, output: Path) -> None:
    height, width = image_size
    frames = frames_of(video)
    scaled = [cv2.resize(frames[i], (width, height), interpolation=cv2.INTER_AREA) for i in spaced(len(frames), count)]
    with atomic_path(output) as temporary:
        np.save(temporary, np.stack(scaled))


def frame_targets(annotation: Mapping[str, Any], frame: int, cells: tuple[int, int]) -> dict[str, Tensor]:
    """What a frame shows: the objects whose centres are in it; of several in a cell, the nearest to the camera counts there.

    Args:
        annotation: of the video.
        frame: index of the frame.
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
    names = {row["object_id"]: row for row in annotation["object_property"]}
    objects = [o for o in annotation["motion_trajectory"][frame]["objects"] if o["inside_camera_view"]]
    number = 0
    for seen in sorted(objects, key=lambda o: -float(CLEVRER_CAMERA.depth(o["location"]))):
        column, row = (float(value) for value in CLEVRER_CAMERA.pixels(seen["location"]))
        x, y = int(column / CLEVRER_CAMERA.width * cells[1] // 1), int(row / CLEVRER_CAMERA.height * cells[0] // 1)
        if 0 <= x < cells[1] and 0 <= y < cells[0]:
            number += 1
            centre[y, x] = True
            for k, (name, words) in enumerate(ATTRIBUTES.items()):
                attributes[k, y, x] = word = words.index(names[seen["object_id"]][name])
                present[k][word] = True
    counted = torch.tensor(min(number, MAX_COUNT))
    return {"centre": centre, "attributes": attributes, "present": torch.cat(present), "number": counted}


class BackboneTask(Task):
    """Cross-entropy of what is in each cell and in the whole frame.

    The trained network says where objects are and how they look (maps), and which words fit and how many objects there are
    (pooled features).
    """

    def __init__(self, config: BackboneTraining) -> None:
        self.config = config
        torch.manual_seed(config.loop.seed)
        self.model: nn.Module = FrameClassifier(config.model).to(memory_format=torch.channels_last)
        folder = Path(config.run_dir) / "frames"
        videos = decode_videos(config.root, folder, config.image_size, config.frames_per_video, config.videos)
        is_held_out = held_out(np.array(list(videos)), config.held_out_every, config.root)
        self.training = [frames for frames, held in zip(videos.values(), is_held_out, strict=True) if not held]
        every = [frame for frames, held in zip(videos.values(), is_held_out, strict=True) if held for frame in frames]
        self.held_out = [every[i] for i in np.unique(spaced(len(every), config.evaluation_frames))]

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[tuple[int, int, bool]]:
        """The position of each example's video in `training`, its frame, and whether it is flipped."""
        videos = rng.integers(len(self.training), size=count)
        frames = rng.integers(self.config.frames_per_video, size=count)
        flipped = rng.random(count) < self.config.flip
        return list(zip(videos.tolist(), frames.tolist(), flipped.tolist(), strict=True))

    def collate(self, examples: Sequence[tuple[int, int, bool]]) -> dict[str, Tensor]:
        """B frames: `images` (B, 3, H, W), as of `image_batch`, and the targets of `frame_targets`, stacked."""
        frames = [(self.training[video][frame], flip) for video, frame, flip in examples]
        return self._batch([frame.mirrored() if flip else frame for frame, flip in frames])

    def _batch(self, frames: Sequence[Frame]) -> dict[str, Tensor]:
        targets = {name: torch.stack([frame.targets[name] for frame in frames]) for name in frames[0].targets}
        return {"images": image_batch([frame.image for frame in frames], self.config.image_size), **targets}

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
            frames = self.held_out[start : start + EVALUATION_BATCH]
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

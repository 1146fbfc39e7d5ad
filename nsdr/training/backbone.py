"""Train the baselines' backbone: `nsdr train backbone --config configs/baselines/backbone.yaml --root DATA`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
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
    load_backbone,
)
from nsdr.baselines.features.extraction import spaced
from nsdr.errors import DataError
from nsdr.io.validation import COUNT, MANY, SHARE, SIZE, check_paths, check_ranges
from nsdr.training.backbone_frames import DecodedVideo, SeenObject, decode_videos
from nsdr.training.loop import LoopConfig, LossTerm, Task, train_part
from nsdr.training.run_folder import parse_training
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["BackboneTask", "BackboneTraining", "frame_targets", "main"]

FOUND_PROBABILITY = 0.5
"""A centre is found in a cell with a higher probability (0-1)."""
EVALUATION_BATCH = 32
"""Frames that are evaluated at once."""


@dataclass(frozen=True)
class BackboneTraining:
    """Training of the backbone on frames of a data set: which objects have their centre where, and what the frame shows.

    Attributes:
        root: a data set in the official layout with videos and annotations, such as one of `nsdr generate dataset`; its
            training split is used.
        run_dir: folder of the run, which also keeps the decoded frames; an interrupted run is resumed.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        initial: weights to start from, "imagenet" or a checkpoint of this training; "" starts from random weights.
        image_size: height and width to which frames are scaled (pixels); multiples of 16.
        frames_per_video: evenly spaced frames of each video.
        videos: maximum number of videos; 0 for all.
        held_out_every: videos whose index this number divides are held out for evaluation.
        evaluation_frames: maximum number of held-out frames to evaluate on.
        flip: probability of a horizontal flip (0-1). The camera lies in the plane y = 0, so that a flipped view is valid.
        model: the network.
        loop: the optimisation.
    """

    root: str
    run_dir: str
    output: str = ""
    initial: str = ""
    image_size: tuple[int, int] = (160, 240)
    frames_per_video: int = 8
    videos: int = 0
    held_out_every: int = 20
    evaluation_frames: int = 400
    flip: float = 0.5
    model: BackboneConfig = field(default_factory=BackboneConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)

    def __post_init__(self) -> None:
        check_paths(self, "root", "run_dir")
        check_ranges(self, image_size=SIZE, frames_per_video=SIZE, videos=COUNT, held_out_every=(2, SIZE[1]))
        check_ranges(self, evaluation_frames=MANY, flip=SHARE)
        stride = STRIDES[CELL_STAGE]
        if any(side % stride for side in self.image_size):
            raise DataError(f"image_size is {list(self.image_size)}; expected multiples of {stride}")


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
    sizes = [len(words) for words in ATTRIBUTES.values()]
    present = [torch.zeros(size, dtype=torch.bool) for size in sizes]
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
        model = FrameClassifier(config.model)
        if config.initial:
            model.backbone = load_backbone(config.model.name, config.initial)
        self.model: nn.Module = model.to(memory_format=torch.channels_last)
        height, width = config.image_size
        self.cells = height // STRIDES[CELL_STAGE], width // STRIDES[CELL_STAGE]
        folder = Path(config.run_dir) / "frames"
        videos = decode_videos(config.root, folder, config.image_size, config.frames_per_video, config.videos)
        self.training = [v for v in videos if v.index % config.held_out_every]
        held_out = [v for v in videos if v.index % config.held_out_every == 0]
        if not self.training or not held_out:
            expected = f"training videos whose index {config.held_out_every} divides, to evaluate on, and others"
            raise DataError(f"{config.root}: expected {expected}; got {len(held_out)} and {len(self.training)}")
        every = [(video, frame) for video in held_out for frame in range(config.frames_per_video)]
        picked = np.unique(spaced(len(every), config.evaluation_frames))
        self.held_out = [every[i] for i in picked]

    def draw(self, count: int, rng: np.random.Generator) -> list[tuple[int, int, bool]]:
        """The position of each example's video in `training`, its frame, and whether it is flipped."""
        videos = rng.integers(len(self.training), size=count)
        frames = rng.integers(self.config.frames_per_video, size=count)
        flipped = rng.random(count) < self.config.flip
        return list(zip(videos.tolist(), frames.tolist(), flipped.tolist(), strict=True))

    def collate(self, examples: Sequence[tuple[int, int, bool]]) -> dict[str, Tensor]:
        """B frames: `images` (B, 3, H, W), as of `image_batch`, and the targets of `frame_targets`, stacked."""
        return self._batch([(self.training[video], frame) for video, frame, _ in examples], [e[2] for e in examples])

    def _batch(self, frames: Sequence[tuple[DecodedVideo, int]], flipped: Sequence[bool]) -> dict[str, Tensor]:
        images, targets = [], []
        for (video, frame), flip in zip(frames, flipped, strict=True):
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
        objects = int(centre.sum())
        terms = {"centre": LossTerm(_binary(scores.centre, centre), frames)}
        for name, logits, target in _attributes(scores, batch):
            total = (cross_entropy(logits, target, reduction="none") * centre).sum()
            terms[name] = LossTerm(total, objects)
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
        totals: dict[str, float] = dict.fromkeys(("objects", "found", "right", "false", "words", "count"), 0.0)
        for start in range(0, len(self.held_out), EVALUATION_BATCH):
            frames = self.held_out[start : start + EVALUATION_BATCH]
            batch = {k: v.to(device) for k, v in self._batch(frames, [False] * len(frames)).items()}
            scores: FrameScores = model(batch["images"])
            found, centre = scores.centre.sigmoid() > FOUND_PROBABILITY, batch["centre"]
            right = found & centre
            totals["objects"] += int(centre.sum())
            totals["found"] += int(right.sum())
            totals["false"] += int((found & ~centre).sum())
            for _, logits, target in _attributes(scores, batch):
                right = right & (logits.argmax(1) == target)
            totals["right"] += int(right.sum())
            totals["words"] += float(((scores.present > 0) == batch["present"]).float().mean(1).sum())
            totals["count"] += int((scores.number.argmax(1) == batch["number"]).sum())
        n, objects = len(self.held_out), max(totals["objects"], 1.0)
        shares = {"found": totals["found"] / objects, "right": totals["right"] / objects}
        return {
            **shares,
            "false_centres": totals["false"] / n,
            "present": totals["words"] / n,
            "count": totals["count"] / n,
        }


def _binary(logits: Tensor, target: Tensor) -> Tensor:
    """Summed binary cross-entropy."""
    return binary_cross_entropy_with_logits(logits, target.float(), reduction="sum")


def _attributes(scores: FrameScores, batch: dict[str, Tensor]) -> Iterator[tuple[str, Tensor, Tensor]]:
    """(attribute, scores (B, words, h, w), word indices (B, h, w))."""
    for number, (name, logits) in enumerate(scores.attributes.items()):
        yield name, logits, batch["attributes"][:, number]


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint.

    Raises:
        DataError: no training videos with annotations.
    """
    config: Any = parse_training(BackboneTraining, argv, "backbone")
    task = BackboneTask(config)
    details = {"image_size": list(config.image_size)}
    return train_part("backbone", task, config, config.model, details)

"""Train the frame parser: `nsdr train frame-parser --config configs/frame_parser/default.yaml --run_dir runs/parser`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from nsdr.errors import DataError
from nsdr.frame_parser.dataset import AugmentConfig, FrameDataset, collate
from nsdr.frame_parser.metrics import average_precision, detection_scores
from nsdr.frame_parser.model import FrameParserConfig, build_frame_parser
from nsdr.io.checkpoint import load_checkpoint
from nsdr.training.coco_weights import load_coco_weights
from nsdr.training.loop import LoopConfig, LossTerm, Task, train_part
from nsdr.training.run_folder import parse_training
from nsdr.validation import PathName, PositiveCount, Settings
from nsdr.world.vocabulary import attributes_of

__all__ = ["FrameParserTask", "FrameParserTraining", "main"]

MAX_EXAMPLE_SEED = 2**62
"""Upper bound of the seed of an example's augmentation."""
SHOWN_FRAMES = 3
"""Held-out frames that are shown in TensorBoard with their detections."""
MIN_SHOWN_SCORE = 0.5
"""Detections with a lower score (0-1) are not drawn."""
DRAWING_RGB = (255, 255, 0)
"""Colour of the boxes and labels (RGB, 0-255)."""
LABEL_SCALE = 0.35
"""Size of the labels (OpenCV's font scale)."""
LABEL_GAP_PX = 3
"""Distance from a box up to the baseline of its label (px)."""


@dataclass(frozen=True)
class FrameParserTraining(Settings):
    """Training of the frame parser.

    Attributes:
        frames: folder with `annotations_*.jsonl` and `images/`; every 20th scene is held out for evaluation.
        run_dir: folder of the run; an interrupted run is resumed.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        initial: folder of a checkpoint to start from; "" starts from random weights, or from those of `pretrained`.
        pretrained: "coco" starts from torchvision's Mask R-CNN with ResNet-50 (paper), which is downloaded once; "" does not.
        evaluation_frames: maximum number of held-out frames to evaluate on.
        model: the network.
        augmentation: random changes to training images.
        loop: the optimisation.
    """

    frames: PathName
    run_dir: PathName
    output: str = ""
    initial: str = ""
    pretrained: Literal["", "coco"] = ""
    evaluation_frames: PositiveCount = 150
    model: FrameParserConfig = field(default_factory=FrameParserConfig)
    augmentation: AugmentConfig = field(default_factory=AugmentConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.initial and self.pretrained:
            raise DataError(
                f"initial: {self.initial} and pretrained: {self.pretrained} both start the weights; give one"
            )


class FrameParserTask(Task):
    """Mask R-CNN's losses on random training frames; detection scores and average precision on held-out scenes."""

    def __init__(self, config: FrameParserTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.config = config
        network = build_frame_parser(config.model)
        if config.pretrained:
            load_coco_weights(network)
        self.model: nn.Module = network.to(memory_format=torch.channels_last)
        if config.initial:
            self.model.load_state_dict(load_checkpoint(config.initial, "frame_parser")[0])
        self.training_frames = FrameDataset(config.frames, "train", config.augmentation)
        self.evaluation_frames = FrameDataset(config.frames, "evaluation")

    def draw(self, count: int, rng: np.random.Generator) -> list[tuple[int, int]]:
        """The index of each example's frame, and the seed of its augmentation."""
        indices = rng.integers(len(self.training_frames), size=count)
        return list(zip(indices.tolist(), rng.integers(MAX_EXAMPLE_SEED, size=count).tolist(), strict=True))

    def collate(self, examples: Sequence[tuple[int, int]]) -> tuple[list[Tensor], list[dict[str, Tensor]]]:
        """Augmented frames (3, H, W) in 0-1 and their targets, see `FrameDataset`."""
        return collate([self.training_frames.get(index, np.random.default_rng(seed)) for index, seed in examples])

    def losses(self, model: nn.Module, batch: tuple[list[Tensor], list[dict[str, Tensor]]]) -> dict[str, LossTerm]:
        """The network's loss terms for images (3, H, W), means over what torchvision samples in this process's images."""
        images, targets = batch
        return {name: LossTerm(loss * len(images), len(images)) for name, loss in model(images, targets).items()}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """`detection_scores` and `average_precision` on evenly spaced held-out frames."""
        count = min(self.config.evaluation_frames, len(self.evaluation_frames))
        picked = np.linspace(0, len(self.evaluation_frames) - 1, count).astype(int)
        frames = [self.evaluation_frames[int(i)] for i in picked]
        return detection_scores(model, frames) | average_precision(model, frames)

    @torch.no_grad()
    def images(self, model: nn.Module) -> Mapping[str, NDArray[np.uint8]]:
        """Held-out frames (H, W, 3) with the detections drawn in."""
        model.eval()
        device = next(model.parameters()).device
        shown = {}
        for number in range(min(SHOWN_FRAMES, len(self.evaluation_frames))):
            image, _ = self.evaluation_frames[number * len(self.evaluation_frames) // SHOWN_FRAMES]
            (detections,) = model([image.to(device)])
            canvas = np.ascontiguousarray((image.permute(1, 2, 0).numpy() * 255).astype(np.uint8))
            for i in torch.where(detections["scores"] > MIN_SHOWN_SCORE)[0].tolist():
                left, top, right, bottom = (int(side) for side in detections["boxes"][i].tolist())
                label = " ".join(attributes_of(int(detections["attribute"][i].argmax())))
                cv2.rectangle(canvas, (left, top), (right, bottom), DRAWING_RGB, 1)
                label_start = (left, top - LABEL_GAP_PX)
                cv2.putText(canvas, label, label_start, cv2.FONT_HERSHEY_SIMPLEX, LABEL_SCALE, DRAWING_RGB, 1)
            shown[f"evaluation/{number}"] = canvas
        return shown


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint.

    Raises:
        DataError: unreadable training data, or fewer training frames than a batch.
    """
    config = parse_training(FrameParserTraining, argv, "frame-parser")
    task = FrameParserTask(config)
    if len(task.training_frames) < config.loop.batch_size:
        raise DataError(f"{config.frames}: {len(task.training_frames)} training frames, fewer than one batch")
    return train_part("frame_parser", task, config, config.model)

"""Train the frame parser: `nsdr train frame-parser --config configs/frame_parser/default.yaml --run_dir runs/parser`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from nsdr.errors import DataError
from nsdr.frame_parser.dataset import AugmentConfig, FrameDataset
from nsdr.frame_parser.metrics import average_precision, detection_scores
from nsdr.frame_parser.model import FrameParserConfig, build_frame_parser
from nsdr.io.checkpoint import load_checkpoint, save_checkpoint
from nsdr.io.configuration import described, parse_config, resolved
from nsdr.training.loop import LoopConfig, Task, train
from nsdr.world.vocabulary import attributes_of

__all__ = ["FrameParserTraining", "main"]

SHOWN_FRAMES, SHOWN_SCORE = 3, 0.5


@dataclass(frozen=True)
class FrameParserTraining:
    """Training of the frame parser.

    Attributes:
        frames: folder with `annotations_*.jsonl` and `images/`; every 20th scene is kept for evaluation.
        run_dir: where the run lives; an interrupted one goes on.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        initial: folder of a checkpoint to start from; "" starts from random weights.
        evaluation_frames: at most this many frames are measured.
        model: the network.
        augmentation: changes to training images.
        loop: the optimisation.
    """

    frames: str
    run_dir: str
    output: str = ""
    initial: str = ""
    evaluation_frames: int = 150
    model: FrameParserConfig = field(default_factory=FrameParserConfig)
    augmentation: AugmentConfig = field(default_factory=AugmentConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)


class FrameParserTask(Task):
    """Mask R-CNN's losses on random training frames; attribute-exact F1 on held-out scenes."""

    def __init__(self, config: FrameParserTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.config = config
        self.model: nn.Module = build_frame_parser(config.model).to(memory_format=torch.channels_last)
        if config.initial:
            self.model.load_state_dict(load_checkpoint(config.initial, "frame_parser")[0])
        self.training_frames = FrameDataset(config.frames, "train", config.augmentation)
        self.evaluation_frames = FrameDataset(config.frames, "evaluation")

    def batch(self, size: int, rng: np.random.Generator) -> list[tuple[Tensor, dict[str, Tensor]]]:
        return [self.training_frames.get(int(i), rng) for i in rng.integers(len(self.training_frames), size=size)]

    def losses(self, model: nn.Module, batch: Sequence[tuple[Tensor, dict[str, Tensor]]]) -> Mapping[str, Tensor]:
        device = next(model.parameters()).device
        images = [image.to(device) for image, _ in batch]
        targets = [{name: value.to(device) for name, value in target.items()} for _, target in batch]
        losses: dict[str, Tensor] = model(images, targets)
        return losses

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        count = min(self.config.evaluation_frames, len(self.evaluation_frames))
        picked = np.linspace(0, len(self.evaluation_frames) - 1, count).astype(int)
        frames = [self.evaluation_frames[int(i)] for i in picked]
        return detection_scores(model, frames) | average_precision(model, frames)

    @torch.no_grad()
    def images(self, model: nn.Module) -> Mapping[str, NDArray[np.uint8]]:
        """Held-out frames with what is found in them."""
        model.eval()
        device = next(model.parameters()).device
        shown = {}
        for number in range(min(SHOWN_FRAMES, len(self.evaluation_frames))):
            image, _ = self.evaluation_frames[number * len(self.evaluation_frames) // SHOWN_FRAMES]
            (found,) = model([image.to(device)])
            canvas = np.ascontiguousarray((image.permute(1, 2, 0).numpy() * 255).astype(np.uint8))
            for i in torch.where(found["scores"] > SHOWN_SCORE)[0].tolist():
                left, top, right, bottom = (int(side) for side in found["boxes"][i].tolist())
                name = " ".join(attributes_of(int(found["attribute"][i].argmax())))
                cv2.rectangle(canvas, (left, top), (right, bottom), (255, 255, 0), 1)
                cv2.putText(canvas, name, (left, top - 3), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (255, 255, 0), 1)
            shown[f"evaluation/{number}"] = canvas
        return shown


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config = parse_config(FrameParserTraining, argv, "nsdr train frame-parser")
    task = FrameParserTask(config)
    if len(task.training_frames) < config.loop.batch_size:
        raise DataError(f"{config.frames}: {len(task.training_frames)} training frames, fewer than one batch")
    metrics = train(task, config.loop, config.run_dir, resolved(config))
    output = config.output or f"{config.run_dir}/checkpoint"
    details: dict[str, Any] = {"metrics": metrics, "training": described(config)}
    save_checkpoint(output, "frame_parser", task.model.state_dict(), config.model, details, half=True)
    return output

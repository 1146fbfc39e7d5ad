"""Train the frame parser: `nsdr train frame-parser --config default --run-dir runs/parser`."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal
from urllib.error import URLError

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.models.detection import MaskRCNN_ResNet50_FPN_Weights, maskrcnn_resnet50_fpn

from nsdr.errors import DataError, machine_error
from nsdr.frame_parser.dataset import AugmentConfig, FrameDataset, collate
from nsdr.frame_parser.metrics import average_precision, detection_scores
from nsdr.frame_parser.model import FrameParserConfig, FrameParserNetwork, build_frame_parser
from nsdr.io.checkpoint import find_checkpoint, start_from, trained_for
from nsdr.io.worlds import stored_world
from nsdr.training.loop import LoopConfig, LossTerm, Task, train_part
from nsdr.training.run_folder import parse_training
from nsdr.validation import PathName, PositiveCount, Settings
from nsdr.world.world import CLEVRER_WORLD

MAX_EXAMPLE_SEED = 2**62
"""Upper bound of the seed of an example's augmentation."""
COCO_NETWORK = ("resnet50", 256)
"""Backbone and channels of the pyramid of torchvision's network."""
MEASURED_FRAMES = 200
"""Frames on which the mean and the standard deviation of colour channels are measured."""
COLOR_DECIMALS = 3
"""Decimals of these."""
MIN_STD = 0.01
"""Least standard deviation that is taken: that of a plain table is near 0 (0-1)."""
MAX_REASON = 120
"""Characters of an error's reason that are shown."""


@dataclass(frozen=True)
class FrameParserTraining(Settings):
    """Training of the frame parser.

    Attributes:
        frames: folder with `annotations_*.jsonl` and `images/`; every 20th scene is held out for evaluation.
        run_dir: folder of the run; an interrupted run is resumed.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        initial: folder of a checkpoint to start from, or "default"; "" starts from random weights, or from those of
            `pretrained`. Heads whose words are others there start anew.
        pretrained: "coco" starts from torchvision's Mask R-CNN with ResNet-50 (paper), which is downloaded once; "" does not.
        evaluation_frames: maximum number of held-out frames to evaluate on.
        model: the network. In another world than CLEVRER's, mean and standard deviation of its channels are the frames'.
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
        self.training_frames = FrameDataset(config.frames, "train", config.augmentation)
        self.evaluation_frames = FrameDataset(config.frames, "evaluation")
        self.world = self.training_frames.world
        self.model_config = model_of(config.model, self.evaluation_frames)
        network = build_frame_parser(self.model_config, self.world)
        if config.pretrained:
            load_coco_weights(network)
        self.model: nn.Module = network.to(memory_format=torch.channels_last)
        if config.initial:
            start_from(self.model, find_checkpoint(config.initial), "frame_parser", self._new_heads(config.initial))

    def _new_heads(self, initial: str) -> list[str]:
        """Prefixes of the tensors that the checkpoint `initial` has for other words."""
        known = trained_for(find_checkpoint(initial), "frame_parser").vocabulary.words
        others = [name for name, words in self.world.vocabulary.words.items() if words != known[name]]
        joint = self.model_config.attributes == "joint"
        names = (
            ["attribute_predictor."] if joint and others else [f"attribute_predictor.heads.{name}." for name in others]
        )
        return [f"roi_heads.{name}" for name in names]

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[tuple[int, int]]:
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


def model_of(config: FrameParserConfig, frames: FrameDataset) -> FrameParserConfig:
    """The network for the world of frames: where it is not CLEVRER's, with the mean and standard deviation of their colours.

    These are measured on evenly spaced frames, which are without augmentation.
    """
    if frames.world == CLEVRER_WORLD:
        return config
    picked = np.linspace(0, len(frames) - 1, min(MEASURED_FRAMES, len(frames))).astype(int)
    images = [frames.get(int(i), np.random.default_rng(int(i)))[0] for i in picked]
    pixels = torch.cat([image.flatten(1) for image in images], 1)
    mean = [round(v, COLOR_DECIMALS) for v in pixels.mean(1).tolist()]
    std = [max(round(v, COLOR_DECIMALS), MIN_STD) for v in pixels.std(1).tolist()]
    return replace(config, image_mean=(mean[0], mean[1], mean[2]), image_std=(std[0], std[1], std[2]))


def load_coco_weights(model: FrameParserNetwork) -> list[str]:
    """Copy the weights of torchvision's Mask R-CNN of COCO, which the paper starts from.

    The outputs for COCO's classes have no counterpart and stay as they are. torchvision's file is downloaded once and its
    checksum verified.

    Returns:
        Names of the tensors that were copied.

    Raises:
        DataError: another architecture, or the file cannot be had; says where it is looked for.
    """
    c, (backbone, channels) = model.config, COCO_NETWORK
    if (c.backbone, c.fpn_channels) != COCO_NETWORK:
        raise DataError(
            f"pretrained is 'coco', which needs model.backbone {backbone} with {channels} fpn_channels; got {c.backbone} "
            f"with {c.fpn_channels}"
        )
    weights = MaskRCNN_ResNet50_FPN_Weights.COCO_V1
    try:
        trained = maskrcnn_resnet50_fpn(weights=weights, progress=False).state_dict()
    except (URLError, OSError, RuntimeError, ValueError) as e:
        if failure := machine_error(e, "pretrained"):
            raise failure from e
        raise DataError(
            f"pretrained: the COCO weights cannot be had from {weights.url} ({str(e)[:MAX_REASON]}); put that file into "
            f"{torch.hub.get_dir()}/checkpoints, or give --pretrained '' to start from random weights"
        ) from e
    ours = model.state_dict()
    renamed = {re.sub(r"^backbone\.", "backbone.pyramid.", name): value for name, value in trained.items()}
    fitting = {name: v for name, v in renamed.items() if name in ours and ours[name].shape == v.shape}
    model.load_state_dict(fitting, strict=False)
    return sorted(fitting)


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config = parse_training(FrameParserTraining, argv, "frame-parser")
    task = FrameParserTask(config)
    if len(task.training_frames) < config.loop.batch_size:
        raise DataError(f"{config.frames}: {len(task.training_frames)} training frames, fewer than one batch")
    return train_part("frame_parser", task, config, task.model_config, stored_world(task.world))

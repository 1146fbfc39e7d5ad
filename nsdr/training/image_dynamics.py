"""Training task of the paper's dynamics network on images (`network: paper_images`)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.propnet.data import MotionDataset
from nsdr.dynamics.propnet.image_data import read_image_dataset
from nsdr.dynamics.propnet.image_model import ImageModel
from nsdr.dynamics.propnet.image_patches import MAX_VALUE
from nsdr.dynamics.propnet.image_predictor import ImagePredictor
from nsdr.dynamics.propnet.patch_model import STEP_SCALE
from nsdr.training.loop import LossTerm
from nsdr.training.patch_dynamics import PatchModelTask
from nsdr.training.track_task import DynamicsTraining, joined, pair_loss
from nsdr.types import Event

__all__ = ["ImageModelTask"]


class ImageModelTask(PatchModelTask):
    """Squared errors of boxes and patches one step later, and cross-entropy of collisions; each step goes on from the last.

    Patches lie in `run_dir/patches` and are read from there, not held in memory.
    """

    def network(self, config: DynamicsTraining) -> nn.Module:
        """The network, with random weights."""
        return ImageModel(config.patches)

    def read(self) -> MotionDataset:
        """The scenes of the data set; their patches are kept beside them."""
        c = self.config
        data, files = read_image_dataset(c.data, f"{c.run_dir}/patches", c.patches, c.limit or None)
        self._files = dict(zip(data.scene.tolist(), files, strict=True))
        return data

    def states(self, index: int) -> tuple[MotionStates, list[Event]]:
        """A held-out scene with patches, and its true collisions."""
        states, events = super().states(index)
        return replace(states, patches=np.array(self._patches(self.held_out.scene[index]))), events

    def _patches(self, scene: int) -> NDArray[np.uint8]:
        """(n, F, 4, cells, cells) of a scene, mapped from its file."""
        return cast(NDArray[np.uint8], np.load(self._files[int(scene)], mmap_mode="r"))

    def collate(self, examples: Sequence[Any]) -> dict[str, Tensor]:
        """As of `PatchModelTask`, and `patches` (B, N, K, 4, cells, cells) float32 in 0-1."""
        batch = super().collate(examples)
        c, steps = self.config.patches, self.config.rollout_steps
        patches = []
        for example in examples:
            frames = example.frame + np.arange(-c.window + 1, steps + 1) * c.stride_frames
            cut = self._patches(self.data.scene[example.scene])[:, np.maximum(frames, 0)]
            patches.append(cut[..., ::-1] if example.mirror < 0 else cut)
        return {**batch, "patches": torch.from_numpy(np.stack(patches)).float() / MAX_VALUE}

    def losses(self, model: nn.Module, batch: Mapping[str, Tensor]) -> dict[str, LossTerm]:
        """`motion` and `image`, the squared errors of boxes (B, N, 4) and patches, and `collision` of pairs (B, N, N)."""
        exists, c = batch["exists"], self.config.patches
        boxes, patches = batch["boxes"][:, :, : c.window], batch["patches"][:, :, : c.window]
        motion, image, collision = [], [], []
        for step in range(self.config.rollout_steps):
            following, drawn, logits = model(boxes, patches, batch["static"], exists)
            weight = (batch["reliable"][:, :, c.window + step] & exists).float()
            error = ((following - batch["boxes"][:, :, c.window + step]) / STEP_SCALE).square().sum(-1)
            difference = (drawn - batch["patches"][:, :, c.window + step]).square().sum(2).mean((-1, -2))
            motion.append(LossTerm((error * weight).sum(), weight.sum()))
            image.append(LossTerm((difference * weight).sum(), weight.sum()))
            for k in range(c.window):
                until = batch["until"] + c.stride_frames * (k - step)
                collision.append(pair_loss(logits[..., k], (until >= 1) & (until <= c.stride_frames), exists))
            boxes = torch.cat([boxes[:, :, 1:], following[:, :, None].detach()], 2)
            patches = torch.cat([patches[:, :, 1:], drawn[:, :, None].detach()], 2)
        return {"motion": joined(motion), "image": joined(image), "collision": joined(collision)}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of observed collisions, and errors of rollouts, on the held-out scenes."""
        return self.measure(ImagePredictor(cast(ImageModel, model)))

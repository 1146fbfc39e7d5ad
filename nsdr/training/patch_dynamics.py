"""Training of the paper's patch network, by `nsdr train dynamics --config configs/dynamics/paper.yaml`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from nsdr.dynamics.propnet.patch_model import BOX_SCALE, STEP_SCALE, PatchModel
from nsdr.dynamics.propnet.patch_predictor import PatchPredictor, patch_boxes
from nsdr.training.dynamics import TrackTask, pair_loss

if TYPE_CHECKING:
    from nsdr.training.dynamics import DynamicsTraining

__all__ = ["PatchModelTask"]

NOISE_PX_PER_WORLD = 50.0


class PatchModelTask(TrackTask):
    """L2 loss of the boxes a step later, cross-entropy of the collisions on the way."""

    def __init__(self, config: "DynamicsTraining") -> None:
        torch.manual_seed(config.loop.seed)
        self.network = PatchModel(config.patches)
        super().__init__(config, self.network)
        self.margin = (config.patches.window - 1) * config.patches.stride_frames
        d = self.data
        self.boxes = patch_boxes(d.location_world, d.box_px, d.reliable, self.margin).astype(np.float32)
        self.count = d.exists.sum(1)

    def batch(self, size: int, rng: np.random.Generator) -> dict[str, Tensor]:
        """Boxes (B, N, K, 4), reliable (B, N, K), static (B, N, 5), exists (B, N), until (B, N, N)."""
        c, steps = self.config.patches, self.config.rollout_steps
        scenes, times = self.pick(16 * size, rng, before=2 * c.stride_frames, after=2 * c.stride_frames)
        n = self.count[scenes[0]]  # scenes of one size need no padding
        alike = np.flatnonzero(self.count[scenes] == n)[:size]
        scenes, times = scenes[alike], np.clip(times[alike], 0, 127 - c.stride_frames * steps)
        index = times[:, None] + np.arange(-c.window + 1, steps + 1) * c.stride_frames
        boxes = self.boxes[scenes[:, None], :n, index + self.margin].transpose(0, 2, 1, 3)
        noise = self.config.noise_world * NOISE_PX_PER_WORLD / np.array(BOX_SCALE)
        boxes += (rng.normal(size=boxes.shape) * noise).astype(np.float32)
        boxes[..., 0] *= rng.choice([-1.0, 1.0], len(scenes))[:, None, None]  # the camera looks along the x axis
        reliable = self.data.reliable[scenes[:, None], :n, np.maximum(index, 0)].transpose(0, 2, 1)
        exists = self.data.exists[scenes] & self.data.present[scenes, :, times]
        until = (self.data.collision_frame[scenes] - times[:, None, None]).astype(np.int64)
        return {
            "boxes": torch.from_numpy(np.ascontiguousarray(boxes)),
            "reliable": torch.from_numpy(reliable),
            "static": torch.from_numpy(self.data.static[scenes, :n]),
            "exists": torch.from_numpy(exists[:, :n]),
            "until": torch.from_numpy(until[:, :n, :n]),
        }

    def losses(self, model: nn.Module, batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Squared errors of boxes (B, N, 4) and cross-entropy of collisions (B, N, N), as scalars."""
        device = next(model.parameters()).device
        b = {k: v.to(device) for k, v in batch.items()}
        c = self.config.patches
        window, motion, collision = b["boxes"][:, :, : c.window], [], []
        for step in range(self.config.rollout_steps):
            following, logits = model(window, b["static"], b["exists"])
            weight = (b["reliable"][:, :, c.window + step] & b["exists"]).float()
            error = ((following - b["boxes"][:, :, c.window + step]) / STEP_SCALE).square().sum(-1)
            motion.append((error * weight).sum() / weight.sum().clamp(min=1))
            for k in range(c.window):
                until = b["until"] + c.stride_frames * (k - step)
                collision.append(pair_loss(logits[..., k], (until >= 1) & (until <= c.stride_frames), b["exists"]))
            window = torch.cat([window[:, :, 1:], following[:, :, None].detach()], 2)
        return {"motion": torch.stack(motion).mean(), "collision": torch.stack(collision).mean()}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        return self.measure(PatchPredictor(self.network.eval()))

"""Training task of the paper's dynamics network on patches (`network: paper`)."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor, nn

from nsdr.dynamics.propnet.patch_model import BOX_SCALE, STEP_SCALE, PatchModel
from nsdr.dynamics.propnet.patch_predictor import PatchPredictor
from nsdr.dynamics.propnet.patches import patch_boxes
from nsdr.training.loop import LossTerm
from nsdr.training.track_task import LAST_FRAME, DynamicsTraining, TrackTask, joined, pair_loss

__all__ = ["PatchModelTask"]

NOISE_PX_PER_WORLD = 50.0
"""Noise of boxes for a noise of one world unit in `DynamicsTraining.noise_world` (px per world unit)."""
STEPS_AROUND_COLLISION = 2
"""Near a collision, the present is at most this many steps of `stride_frames` before or after it."""


class _Window(NamedTuple):
    """What is drawn for one window: scene, present frame, noise (N, K, 4) in units of `BOX_SCALE` and mirroring (-1 or 1)."""

    scene: Any
    frame: Any
    noise: Any
    mirror: Any


class PatchModelTask(TrackTask):
    """Squared error of the boxes one step later, and cross-entropy of the collisions within each step.

    A batch holds scenes with the same number of objects, mirrored at random: the camera looks along the world's x axis.
    """

    def __init__(self, config: DynamicsTraining) -> None:
        torch.manual_seed(config.loop.seed)
        super().__init__(config, self.network(config))
        self.margin = (config.patches.window - 1) * config.patches.stride_frames
        d = self.data
        self.boxes = patch_boxes(d.location_world, d.box_px, d.reliable, self.margin).astype(np.float32)

    def network(self, config: DynamicsTraining) -> nn.Module:
        """The network, with random weights."""
        return PatchModel(config.patches)

    def draw(self, count: int, rng: np.random.Generator) -> list[_Window]:
        """Windows of scenes that have the same number of objects, as that of a random window."""
        c, steps = self.config.patches, self.config.rollout_steps
        near = STEPS_AROUND_COLLISION * c.stride_frames
        objects = int(self.object_count[self.draw_windows(1, rng, near, near)[0][0]])
        scenes, frames = self.draw_windows(count, rng, near, near, objects)
        frames = np.clip(frames, 0, LAST_FRAME - c.stride_frames * steps)
        noise_px = self.config.noise_world * NOISE_PX_PER_WORLD
        noise = rng.normal(size=(count, objects, c.window + steps, 4)) * noise_px / np.array(BOX_SCALE)
        mirror = rng.choice([-1.0, 1.0], count)
        return [_Window(*choices) for choices in zip(scenes, frames, noise, mirror, strict=True)]

    def collate(self, examples: Sequence[_Window]) -> dict[str, Tensor]:
        """Windows of B scenes with N objects each; K = window + rollout_steps samples.

        Returns:
            boxes: (B, N, K, 4) float32, noisy, in units of `BOX_SCALE`.
            reliable: (B, N, K) bool.
            static: (B, N, 5) float32, one-hot shape and material.
            exists: (B, N) bool, objects that are present.
            until: (B, N, N) int64, frames from the present to the pair's collision, negative after it.
        """
        c, steps = self.config.patches, self.config.rollout_steps
        scenes, frames, noise, mirror = map(np.stack, zip(*examples, strict=True))
        n = noise.shape[1]
        index = frames[:, None] + np.arange(-c.window + 1, steps + 1) * c.stride_frames
        boxes = self.boxes[scenes[:, None], :n, index + self.margin].transpose(0, 2, 1, 3) + noise.astype(np.float32)
        boxes[..., 0] *= mirror[:, None, None]
        reliable = self.data.reliable[scenes[:, None], :n, np.maximum(index, 0)].transpose(0, 2, 1)
        exists = self.data.exists[scenes] & self.data.present[scenes, :, frames]
        until = (self.data.collision_frame[scenes] - frames[:, None, None]).astype(np.int64)
        return {
            "boxes": torch.from_numpy(np.ascontiguousarray(boxes)),
            "reliable": torch.from_numpy(reliable),
            "static": torch.from_numpy(self.data.static[scenes, :n]),
            "exists": torch.from_numpy(exists[:, :n]),
            "until": torch.from_numpy(until[:, :n, :n]),
        }

    def losses(self, model: nn.Module, batch: Mapping[str, Tensor]) -> dict[str, LossTerm]:
        """`motion`, the squared error of boxes (B, N, 4), and `collision`, the cross-entropy of pairs (B, N, N)."""
        exists = batch["exists"]
        c = self.config.patches
        window, motion, collision = batch["boxes"][:, :, : c.window], [], []
        for step in range(self.config.rollout_steps):
            following, logits = model(window, batch["static"], exists)
            weight = (batch["reliable"][:, :, c.window + step] & exists).float()
            error = ((following - batch["boxes"][:, :, c.window + step]) / STEP_SCALE).square().sum(-1)
            motion.append(LossTerm((error * weight).sum(), weight.sum()))
            for k in range(c.window):
                until = batch["until"] + c.stride_frames * (k - step)
                collision.append(pair_loss(logits[..., k], (until >= 1) & (until <= c.stride_frames), exists))
            window = torch.cat([window[:, :, 1:], following[:, :, None].detach()], 2)
        return {"motion": joined(motion), "collision": joined(collision)}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of observed collisions, and errors of rollouts, on the held-out scenes."""
        return self.measure(PatchPredictor(cast(PatchModel, model), LAST_FRAME))

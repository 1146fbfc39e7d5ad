"""Training task of the paper's dynamics network on images (`network: paper_images`)."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.propnet.data import MotionDataset, read_image_dataset
from nsdr.dynamics.propnet.patch_model import STEP_SCALE, ImageModel
from nsdr.dynamics.propnet.patch_predictor import ImagePredictor
from nsdr.dynamics.propnet.patches import MAX_VALUE, patch_boxes
from nsdr.training.loop import LossTerm
from nsdr.training.patch_dynamics import PatchModelTask
from nsdr.training.track_task import LAST_FRAME, DynamicsTraining, joined, pair_loss
from nsdr.types import Event

__all__ = ["ImageModelTask"]

BOX_WEIGHTS = (5.0, 5.0, 0.25, 0.25)
"""Weights of the squared errors of column, row, width and height. With equal ones, whole pixels of the masks' bounds and
turning cubes make up most of the loss, and nothing but the next boxes depends on sizes."""
DRAWN_FROM_FRAME = 60
"""Frame after which the patches of held-out scenes are drawn and compared."""
DRAWN_STEPS = (1, 5)
"""Steps after which drawn patches are compared."""


class ImageModelTask(PatchModelTask):
    """Squared errors of boxes and patches one step later, and cross-entropy of collisions; each step goes on from the last.

    Patches lie in `run_dir/patches` and are read from there, not held in memory. Gradients do not pass from step to step.
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
        of_box = torch.tensor(BOX_WEIGHTS, device=boxes.device)
        motion, image, collision = [], [], []
        for step in range(self.config.rollout_steps):
            following, drawn, logits = model(boxes, patches, batch["static"], exists)
            weight = (batch["reliable"][:, :, c.window + step] & exists).float()
            error = (((following - batch["boxes"][:, :, c.window + step]) / STEP_SCALE).square() * of_box).sum(-1)
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
        """Scores of observed collisions, and errors of rollouts and of drawn patches, on the held-out scenes."""
        network = cast(ImageModel, model)
        return self.measure(ImagePredictor(network, LAST_FRAME)) | self._drawing_errors(network)

    @torch.no_grad()
    def _drawing_errors(self, model: ImageModel) -> dict[str, float]:
        """Mean absolute errors (0-1) of patches `DRAWN_STEPS` later: of those drawn, and of the last one seen (`_kept`)."""
        c, h, found = self.config.patches, self.held_out, defaultdict[str, list[float]](list)
        device = next(model.parameters()).device
        every = DRAWN_FROM_FRAME + np.arange(1 - c.window, 1 + max(DRAWN_STEPS)) * c.stride_frames
        all_boxes = patch_boxes(h.location_world, h.box_px, h.reliable, 0).astype(np.float32)
        for i in range(len(h)):
            here = np.flatnonzero(h.exists[i] & h.present[i, :, DRAWN_FROM_FRAME] & h.reliable[i][:, every].all(1))
            if not len(here):
                continue
            true = torch.from_numpy(self._patches(h.scene[i])[here][:, every]).to(device).float()[None] / MAX_VALUE
            boxes = torch.from_numpy(all_boxes[i, here][:, every[: c.window]]).to(device)[None]
            static = torch.from_numpy(h.static[i, here]).to(device)[None]
            patches, exists = true[:, :, : c.window], torch.ones(1, len(here), dtype=torch.bool, device=device)
            for step in range(1, 1 + max(DRAWN_STEPS)):
                following, drawn, _ = model(boxes, patches, static, exists)
                boxes = torch.cat([boxes[:, :, 1:], following[:, :, None]], 2)
                patches = torch.cat([patches[:, :, 1:], drawn[:, :, None]], 2)
                if step in DRAWN_STEPS:
                    target = true[:, :, c.window - 1 + step]
                    found[f"image_error_{step}"].append(float((drawn - target).abs().mean()))
                    found[f"image_error_{step}_kept"].append(float((true[:, :, c.window - 1] - target).abs().mean()))
        return {name: float(np.mean(values)) for name, values in found.items()}

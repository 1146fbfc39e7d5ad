"""The paper's dynamics network: PropNet over patches around each object (paper, section 4.2 and its supplement)."""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from nsdr.dynamics.propnet.layers import PropNet
from nsdr.validation import Positive, Settings, Share, Size
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

__all__ = ["BOX_SCALE", "PatchModel", "PatchModelConfig", "PatchNetwork"]

STATIC_FEATURES = 5
BOX_SCALE = (WIDTH_PX / 2, HEIGHT_PX / 2, 50.0, 50.0)
"""Units (pixels) of boxes (column, row, width, height), whose centres count from the image's centre: about -1 to 1."""
STEP_SCALE = 0.1
"""Unit of changes: about the displacement of a fast object in a step (in units of `BOX_SCALE`)."""
REACH = 0.3
"""Unit of the displacement from one object to a near one (in units of `BOX_SCALE`)."""
MAX_REACH = 5.0
"""Displacements between objects are clamped to this many `REACH`."""


@dataclass(frozen=True)
class PatchModelConfig(Settings):
    """Sizes and time steps; the defaults are the paper's.

    Attributes:
        hidden: D, width of the networks (paper: 512).
        propagation_steps: L (paper: 2).
        stride_frames: frames between two samples (the released files have one in 5).
        window: samples that the network sees, the current one included (paper: 3).
        patch_cells: side of a patch in cells.
        cell_px: side of a cell in pixels.
        channels: of the three convolutions.
        collision_threshold: probability above which a pair collides; 0.3 was set on left-out scenes of `train`.
    """

    hidden: Size = 512
    propagation_steps: Size = 2
    stride_frames: Size = 5
    window: Size = 3
    patch_cells: Size = 24
    cell_px: Positive = 4.0
    channels: tuple[Size, Size, Size] = (16, 32, 64)
    collision_threshold: Share = 0.3


class PatchEncoder(nn.Module):
    """Masks (..., samples, cells, cells) and features (..., F) -> (..., hidden)."""

    def __init__(self, samples: int, features: int, config: PatchModelConfig) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise((samples, *config.channels)):
            layers += [nn.Conv2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers)
        flat = config.channels[-1] * (config.patch_cells // 8) ** 2
        self.head = nn.Sequential(nn.Linear(flat + features, config.hidden), nn.ReLU())

    def forward(self, masks: Tensor, features: Tensor) -> Tensor:
        """Encode each object or pair."""
        maps = self.convolutions(masks.flatten(0, -4)).flatten(1).unflatten(0, masks.shape[:-3])
        encoded: Tensor = self.head(torch.cat([maps, features], -1))
        return encoded


class PatchNetwork(nn.Module):
    """A network on patches, which keeps the sizes that it was built from."""

    def __init__(self, config: PatchModelConfig) -> None:
        super().__init__()
        self.config = config


class PatchModel(PatchNetwork):
    """Predicts every object's box one step later, and the collisions of that step and of the steps of the window.

    Differs from the paper: patches hold the mask drawn as its filled box, but no image (the proposals that real training
    data consist of have no pixels); position, motion, material and shape join the convolutions' output instead of being
    constant channels; the change of the box is predicted, from which the next patch is drawn, instead of the patch's
    pixels; the relation predictor also predicts the collisions of the window's own steps, whose effect it sees.
    """

    def __init__(self, config: PatchModelConfig) -> None:
        super().__init__(config)
        own = 2 * config.window + 2 + 2 * (config.window - 1) + STATIC_FEATURES
        pair = 2 * config.window + 2 * (config.window - 1) + 2 * STATIC_FEATURES
        self.object_encoder = PatchEncoder(config.window, own, config)
        self.relation_encoder = PatchEncoder(2 * config.window, pair, config)
        steps = config.propagation_steps
        self.network = PropNet(nn.Identity(), nn.Identity(), 4, config.window, config.hidden, steps)

    def forward(self, boxes: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """One step.

        Args:
            boxes: (B, N, window, 4) in units of `BOX_SCALE`, the present last.
            static: (B, N, 5) one-hot shape and material.
            exists: (B, N) bool.

        Returns:
            Boxes (B, N, 4) `stride_frames` later; collision logits (B, N, N, window), symmetric: of the step to come, of
            the one that ended at present, and of the one before.
        """
        n = boxes.shape[1]
        centre = boxes[..., :2]
        motion = ((centre[:, :, 1:] - centre[:, :, :-1]) / STEP_SCALE).flatten(2)
        # Patches of a pair lie around the receiver, so that both masks show how near they are.
        around = centre[:, :, None, -1].expand(-1, -1, n, -1)
        own = self._masks(boxes, centre[:, :, -1])
        sent = self._masks(boxes[:, None].expand(-1, n, -1, -1, -1), around)
        masks = torch.cat([own[:, :, None].expand(-1, -1, n, -1, -1, -1), sent], 3)
        apart = ((centre[:, None] - centre[:, :, None]) / REACH).clamp(-MAX_REACH, MAX_REACH).flatten(3)
        kinds = [static[:, :, None].expand(-1, -1, n, -1), static[:, None].expand(-1, n, -1, -1)]
        objects = self.object_encoder(own, torch.cat([centre.flatten(2), boxes[:, :, -1, 2:], motion, static], -1))
        pairs = self.relation_encoder(masks, torch.cat([apart, motion[:, None] - motion[:, :, None], *kinds], -1))
        change, collision = self.network(objects, pairs, exists)
        inertia = boxes[:, :, -1] - boxes[:, :, -2]
        return boxes[:, :, -1] + inertia + change.float() * STEP_SCALE, (collision + collision.transpose(1, 2)) / 2

    def _masks(self, boxes: Tensor, around: Tensor) -> Tensor:
        """(..., window, cells, cells): how much of each cell of the patch around a position the box covers at each sample."""
        c = self.config
        scale = torch.tensor(BOX_SCALE, device=boxes.device)
        centre, half = boxes[..., :2] * scale[:2], boxes[..., 2:] * scale[2:] / 2
        edge = (torch.arange(c.patch_cells, device=boxes.device) - c.patch_cells / 2) * c.cell_px
        covered = []
        for axis in range(2):
            middle = (centre[..., axis] - around[..., None, axis] * scale[axis])[..., None]
            low = torch.maximum(edge, middle - half[..., axis, None])
            high = torch.minimum(edge + c.cell_px, middle + half[..., axis, None])
            covered.append((high - low).clamp(min=0) / c.cell_px)
        return covered[1][..., :, None] * covered[0][..., None, :]

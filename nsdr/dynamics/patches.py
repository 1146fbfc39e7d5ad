"""The paper's dynamics network: PropNet over patches around each object (paper, section 4.2 and its supplement)."""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from nsdr.clevrer.camera import HEIGHT_PX, WIDTH_PX
from nsdr.dynamics.propnet import PropNet

__all__ = ["BOX_SCALE", "PatchConfig", "PatchModel"]

STATIC_FEATURES = 5
BOX_SCALE = (WIDTH_PX / 2, HEIGHT_PX / 2, 50.0, 50.0)
"""Boxes are (column, row, width, height); centres from the picture's middle, all in these units: -1 to 1 or a little more."""
STEP_SCALE = 0.1
"""Unit of predicted changes: about a fast object's way in a step."""


@dataclass(frozen=True)
class PatchConfig:
    """Sizes and time steps; the defaults are the paper's.

    Attributes:
        hidden: D, width of the networks.
        propagation_steps: L.
        stride_frames: frames between two samples (the released files have one in 5).
        window: samples that the network sees, the present included.
        patch_cells: side of a patch in cells.
        cell_px: side of a cell in pixels.
        collision_threshold: probability above which a pair collides.
    """

    hidden: int = 512
    propagation_steps: int = 2
    stride_frames: int = 5
    window: int = 3
    patch_cells: int = 24
    cell_px: float = 4.0
    collision_threshold: float = 0.5


class PatchEncoder(nn.Module):
    """(..., channels, cells, cells) -> (..., hidden)."""

    def __init__(self, channels: int, cells: int, hidden: int) -> None:
        super().__init__()
        widths = (channels, 32, 64, 128)
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(widths):
            layers += [nn.Conv2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers)
        self.head = nn.Sequential(nn.Linear(widths[-1] * (cells // 8) ** 2, hidden), nn.ReLU())

    def forward(self, patches: Tensor) -> Tensor:
        """Encode each patch."""
        maps = self.convolutions(patches.flatten(0, -4))
        encoded: Tensor = self.head(maps.flatten(1))
        return encoded.unflatten(0, patches.shape[:-3])


class PatchModel(nn.Module):
    """Predicts every object's box one step later, and the collisions on the way.

    Differs from the paper: patches hold the mask drawn as its filled box, its position, and the object's material and shape,
    but no image (the proposals that real training data consist of have no pixels); what is predicted is the change of
    the box, from which the next patch is drawn, instead of the patch's pixels.
    """

    def __init__(self, config: PatchConfig) -> None:
        super().__init__()
        self.config = config
        own = 3 * config.window + STATIC_FEATURES
        cells, width = config.patch_cells, config.hidden
        encoders = PatchEncoder(own, cells, width), PatchEncoder(2 * own, cells, width)
        self.network = PropNet(*encoders, 4, 1, width, config.propagation_steps)

    def forward(self, boxes: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """One step.

        Args:
            boxes: (B, N, window, 4) in units of `BOX_SCALE`, the present last.
            static: (B, N, 5) one-hot shape and material.
            exists: (B, N) bool.

        Returns:
            Boxes (B, N, 4) `stride_frames` later; collision logits (B, N, N), symmetric.
        """
        n = boxes.shape[1]
        # Patches of a pair lie around the receiver, so that both masks show how near they are.
        around = boxes[:, :, None, -1, :2].expand(-1, -1, n, -1)
        seen_by_others = self._patch(
            boxes[:, None].expand(-1, n, -1, -1, -1), static[:, None].expand(-1, n, -1, -1), around
        )
        own = self._patch(boxes, static, boxes[:, :, -1, :2])
        pairs = torch.cat([own[:, :, None].expand(-1, -1, n, -1, -1, -1), seen_by_others], 3)
        change, collision = self.network(own, pairs, exists)
        inertia = boxes[:, :, -1] - boxes[:, :, -2]
        return boxes[:, :, -1] + inertia + change * STEP_SCALE, (collision + collision.transpose(1, 2))[..., 0] / 2

    def _patch(self, boxes: Tensor, static: Tensor, around: Tensor) -> Tensor:
        """(..., 3 window + 5, cells, cells): mask, column and row at each sample, and the object's features."""
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
        mask = covered[1][..., :, None] * covered[0][..., None, :]
        size = (c.patch_cells, c.patch_cells)
        flat = torch.cat([boxes[..., :2].flatten(-2), static], -1)[..., None, None].expand(*boxes.shape[:-2], -1, *size)
        return torch.cat([mask, flat], -3)

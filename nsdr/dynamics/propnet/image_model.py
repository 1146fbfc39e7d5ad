"""The paper's dynamics network with images: PropNet over image and mask patches, and a decoder of the next patches."""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.propnet.image_patches import PATCH_CHANNELS
from nsdr.dynamics.propnet.layers import PropNet
from nsdr.dynamics.propnet.patch_model import (
    BOX_SCALE,
    MAX_REACH,
    REACH,
    STATIC_FEATURES,
    STEP_SCALE,
    PatchEncoder,
    PatchModelConfig,
    PatchNetwork,
)
from nsdr.errors import DataError

__all__ = ["ImageModel", "PatchDecoder"]

HALVINGS = 8
"""The three convolutions make patches smaller by this factor, and the decoder's larger by it."""
DARKEST = 1 / 255
"""Values of the last patch are brought this far from 0 and 1, a step of 8-bit colours, before the decoder changes them."""


class PatchDecoder(nn.Module):
    """Hidden states and the last patches -> the next patches, by three transposed convolutions."""

    def __init__(self, config: PatchModelConfig) -> None:
        super().__init__()
        first, second, third = config.channels
        self.side, self.channels = config.patch_cells // HALVINGS, third
        self.start = nn.Sequential(nn.Linear(config.hidden, third * self.side**2), nn.ReLU())
        layers: list[nn.Module] = []
        for inputs, outputs in ((third, second), (second, first)):
            layers += [nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers, nn.ConvTranspose2d(first, PATCH_CHANNELS, 4, stride=2, padding=1))

    def forward(self, hidden: Tensor, last: Tensor) -> Tensor:
        """Decode each object: (..., hidden) and last patches (..., 4, cells, cells) in 0-1 -> next patches, alike."""
        maps = self.start(hidden).view(-1, self.channels, self.side, self.side)
        change = self.convolutions(maps).float().unflatten(0, hidden.shape[:-1])
        return (change + last.float().clamp(DARKEST, 1 - DARKEST).logit()).sigmoid()


class ImageModel(PatchNetwork):
    """Predicts every object's box, image and mask one step later, and the collisions of that step and of the window's steps.

    Relations carry a state over the propagation steps.

    Differs from the paper: images show the object alone (image times mask), so that a removed object leaves no pixels in the
    patches of others; a relation sees the receiver's patches, and the sender's as they lie around the receiver; position,
    motion, material and shape are constant channels, as in the paper, and join the convolutions' output as well; the decoder
    draws the change of the last patch; the change of the box is predicted beside the next patch; the relation predictor also
    predicts the collisions of the window's steps.
    """

    def __init__(self, config: PatchModelConfig) -> None:
        super().__init__(config)
        if config.patch_cells % HALVINGS:
            raise DataError(
                f"patch_cells: expected a multiple of {HALVINGS} for a network on images, got {config.patch_cells}"
            )
        seen, steps = PATCH_CHANNELS * config.window, 2 * (config.window - 1)
        own = 4 * config.window + steps + STATIC_FEATURES
        pair = 2 * config.window + steps + 2 * STATIC_FEATURES
        self.object_encoder = PatchEncoder(seen + own, own, config)
        self.relation_encoder = PatchEncoder(2 * seen + pair, pair, config)
        self.network = PropNet(
            nn.Identity(),
            nn.Identity(),
            4 + config.hidden,
            config.window,
            config.hidden,
            config.propagation_steps,
            edge_state=True,
        )
        self.decoder = PatchDecoder(config)

    def forward(self, boxes: Tensor, patches: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """One step.

        Args:
            boxes: (B, N, window, 4) in units of `BOX_SCALE`, the present last.
            patches: (B, N, window, 4, cells, cells) in 0-1, red, green, blue and mask around each box's centre.
            static: (B, N, 5) one-hot shape and material.
            exists: (B, N) bool.

        Returns:
            Boxes (B, N, 4) and patches (B, N, 4, cells, cells) `stride_frames` later; collision logits (B, N, N, window),
            symmetric: of the step to come, of the one that ended at present, and of the one before.
        """
        n = boxes.shape[1]
        centre = boxes[..., :2]
        motion = ((centre[:, :, 1:] - centre[:, :, :-1]) / STEP_SCALE).flatten(2)
        apart = ((centre[:, None] - centre[:, :, None]) / REACH).clamp(-MAX_REACH, MAX_REACH).flatten(3)
        kinds = [static[:, :, None].expand(-1, -1, n, -1), static[:, None].expand(-1, n, -1, -1)]
        own = patches.flatten(2, 3)
        both = torch.cat([own[:, :, None].expand(-1, -1, n, -1, -1, -1), self._around_receivers(centre, patches)], 3)
        of_object = torch.cat([boxes.flatten(2), motion, static], -1)
        of_pair = torch.cat([apart, motion[:, None] - motion[:, :, None], *kinds], -1)
        objects = self.object_encoder(_with_channels(own, of_object), of_object)
        pairs = self.relation_encoder(_with_channels(both, of_pair), of_pair)
        outputs, collision = self.network(objects, pairs, exists)
        inertia = F.pad(centre[:, :, -1] - centre[:, :, -2], (0, 2))  # sizes stay
        following = boxes[:, :, -1] + inertia + outputs[..., :4].float() * STEP_SCALE
        drawn = self.decoder(outputs[..., 4:].relu(), patches[:, :, -1])
        return following, drawn, (collision + collision.transpose(1, 2)) / 2

    def _around_receivers(self, centre: Tensor, patches: Tensor) -> Tensor:
        """(B, N, N, window * 4, cells, cells): the sender's patches as they lie in the receiver's of the same sample."""
        b, n, window = patches.shape[:3]
        cells, cell_px = self.config.patch_cells, self.config.cell_px
        scale = torch.tensor(BOX_SCALE[:2], device=centre.device)
        # Position of the receiver's patch in that of the sender, in halves of a patch.
        shift = (centre[:, :, None] - centre[:, None]) * scale / (cells * cell_px / 2)
        middles = (torch.arange(cells, device=centre.device) + 0.5) / cells * 2 - 1
        grid = torch.stack(torch.meshgrid(middles, middles, indexing="xy"), -1)
        places = grid + shift.flatten(0, 3)[:, None, None]
        sent = patches[:, None].expand(-1, n, -1, -1, -1, -1, -1).flatten(0, 3)
        moved = F.grid_sample(sent.float(), places.float(), padding_mode="zeros", align_corners=False)
        return moved.view(b, n, n, window * PATCH_CHANNELS, cells, cells)


def _with_channels(maps: Tensor, values: Tensor) -> Tensor:
    """Maps (..., C, cells, cells) and a channel of each value (..., K): (..., C + K, cells, cells)."""
    constant = values[..., None, None].expand(*values.shape, *maps.shape[-2:])
    return torch.cat([maps, constant.to(maps.dtype)], -3)

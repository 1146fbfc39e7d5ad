"""The paper's dynamics networks: PropNet over patches of masks, or of images and masks (section 4.2 and its supplement)."""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.propnet.layers import PropNet
from nsdr.errors import DataError
from nsdr.validation import Positive, Settings, Share, Size
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

STATIC_FEATURES = 5
PATCH_CHANNELS = 4
"""Red, green, blue and the mask."""
BOX_SCALE = (WIDTH_PX / 2, HEIGHT_PX / 2, 50.0, 50.0)
"""Units (pixels) of boxes (column, row, width, height), whose centres count from the image's centre: about -1 to 1."""
STEP_SCALE = 0.1
"""Unit of changes: about the displacement of a fast object in a step (in units of `BOX_SCALE`)."""
REACH = 0.3
"""Unit of the displacement from one object to a near one (in units of `BOX_SCALE`)."""
MAX_REACH = 5.0
"""Displacements between objects are clamped to this many `REACH`."""
HALVINGS = 8
"""The three convolutions make patches smaller by this factor, and the decoder's larger by it."""
DARKEST = 1 / 255
"""Values of the last patch are brought this far from 0 and 1, a step of 8-bit colours, before the decoder changes them."""


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
    """Maps (..., C, cells, cells) and features (..., F) -> (..., hidden)."""

    def __init__(self, maps: int, features: int, config: PatchModelConfig) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise((maps, *config.channels)):
            layers += [nn.Conv2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers)
        flat = config.channels[-1] * (config.patch_cells // HALVINGS) ** 2
        self.head = nn.Sequential(nn.Linear(flat + features, config.hidden), nn.ReLU())

    def forward(self, maps: Tensor, features: Tensor) -> Tensor:
        """Encode each object or pair: maps (..., C, cells, cells) and features (..., F) -> (..., hidden)."""
        convolved = self.convolutions(maps.flatten(0, -4)).flatten(1).unflatten(0, maps.shape[:-3])
        encoded: Tensor = self.head(torch.cat([convolved, features], -1))
        return encoded


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


class PatchNetwork(nn.Module):
    """What both networks on patches share: the sizes that they were built from, and how pairs move."""

    def __init__(self, config: PatchModelConfig) -> None:
        super().__init__()
        self.config = config
        self.motion_features = 2 * (config.window - 1)
        self.pair_features = 2 * config.window + self.motion_features + 2 * STATIC_FEATURES

    def _features(self, boxes: Tensor, static: Tensor) -> tuple[Tensor, Tensor]:
        """Displacements between samples (B, N, `motion_features`), and what is known of pairs (B, N, N, `pair_features`)."""
        n, centre = boxes.shape[1], boxes[..., :2]
        motion = ((centre[:, :, 1:] - centre[:, :, :-1]) / STEP_SCALE).flatten(2)
        apart = ((centre[:, None] - centre[:, :, None]) / REACH).clamp(-MAX_REACH, MAX_REACH).flatten(3)
        kinds = [static[:, :, None].expand(-1, -1, n, -1), static[:, None].expand(-1, n, -1, -1)]
        return motion, torch.cat([apart, motion[:, None] - motion[:, :, None], *kinds], -1)


class PatchModel(PatchNetwork):
    """Predicts every object's box one step later, and the collisions of that step and of the steps of the window.

    Differs from the paper: patches hold the mask drawn as its filled box, but no image (the proposals that real training
    data consist of have no pixels); position, motion, material and shape join the convolutions' output instead of being
    constant channels; the change of the box is predicted, from which the next patch is drawn, instead of the patch's
    pixels; the relation predictor also predicts the collisions of the window's own steps, whose effect it sees.
    """

    def __init__(self, config: PatchModelConfig) -> None:
        super().__init__(config)
        own = 2 * config.window + 2 + self.motion_features + STATIC_FEATURES
        self.object_encoder = PatchEncoder(config.window, own, config)
        self.relation_encoder = PatchEncoder(2 * config.window, self.pair_features, config)
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
        n, centre = boxes.shape[1], boxes[..., :2]
        motion, of_pair = self._features(boxes, static)
        # Patches of a pair lie around the receiver, so that both masks show how near they are.
        around = centre[:, :, None, -1].expand(-1, -1, n, -1)
        own = self._masks(boxes, centre[:, :, -1])
        sent = self._masks(boxes[:, None].expand(-1, n, -1, -1, -1), around)
        masks = torch.cat([own[:, :, None].expand(-1, -1, n, -1, -1, -1), sent], 3)
        objects = self.object_encoder(own, torch.cat([centre.flatten(2), boxes[:, :, -1, 2:], motion, static], -1))
        change, collision = self.network(objects, self.relation_encoder(masks, of_pair), exists)
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
        seen = PATCH_CHANNELS * config.window
        own, pair = 4 * config.window + self.motion_features + STATIC_FEATURES, self.pair_features
        self.object_encoder = PatchEncoder(seen + own, own, config)
        self.relation_encoder = PatchEncoder(2 * seen + pair, pair, config)
        sizes = 4 + config.hidden, config.window, config.hidden, config.propagation_steps
        self.network = PropNet(nn.Identity(), nn.Identity(), *sizes, edge_state=True)
        self.decoder = PatchDecoder(config)

    def forward(self, boxes: Tensor, patches: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """One step.

        Args:
            boxes, static, exists: see `PatchModel`.
            patches: (B, N, window, 4, cells, cells) in 0-1, red, green, blue and mask around each box's centre.

        Returns:
            Boxes (B, N, 4) and patches (B, N, 4, cells, cells) `stride_frames` later; collision logits (B, N, N, window) as
            of `PatchModel`.
        """
        n, centre = boxes.shape[1], boxes[..., :2]
        motion, of_pair = self._features(boxes, static)
        own = patches.flatten(2, 3)
        both = torch.cat([own[:, :, None].expand(-1, -1, n, -1, -1, -1), self._around_receivers(centre, patches)], 3)
        of_object = torch.cat([boxes.flatten(2), motion, static], -1)
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

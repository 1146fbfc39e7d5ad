"""The paper's dynamics networks: PropNet on patches of masks, or of images and masks (section 4.2 and the supplement)."""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.motion_states import feature_count
from nsdr.dynamics.propnet.layers import PropagationNetwork
from nsdr.errors import DataError
from nsdr.validation import Positive, Settings, Share, Size
from nsdr.world.world import CLEVRER_WORLD, World

PATCH_CHANNELS = 4
"""Number of channels of a patch: red, green, blue and the mask."""
BOX_PX = 50.0
"""Unit of the widths and heights of boxes (pixels of CLEVRER's images)."""
STEP_SCALE = 0.1
"""Unit of displacements in a time step: about that of a fast object (units of `box_scale`)."""
REACH = 0.3
"""Unit of the displacement from one object to another (units of `box_scale`)."""
MAX_REACH = 5.0
"""Limit to which displacements between objects are clamped (units of `REACH`)."""
DOWNSAMPLING = 8
"""Factor by which the three convolutions of the encoder shrink a patch, and those of the decoder enlarge it."""
DARKEST = 1 / 255
"""Values of the last patch are clamped to `DARKEST` to 1 - `DARKEST`, a step of 8-bit colours, so that their logits are
finite."""


@dataclass(frozen=True)
class PatchPropNetConfig(Settings):
    """Sizes and time steps of the networks. The defaults are those of the paper, where it gives them.

    Attributes:
        hidden: width D of the hidden layers (paper: 512).
        propagation_steps: number of propagation steps L (paper: 2).
        stride_frames: number of frames between two samples (5 in the released files).
        window: number of samples that the network sees, including the present (paper: 3).
        patch_cells: side length of a patch (cells).
        cell_px: side length of a cell (pixels).
        channels: numbers of output channels of the three convolutions.
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


def box_scale(world: World) -> tuple[float, float, float, float]:
    """Units of boxes (column, row, width, height) in pixels.

    Centres are relative to the centre of the image, so values are about -1 to 1.
    """
    side = BOX_PX * world.scales.px
    return world.camera.width / 2, world.camera.height / 2, side, side


class PatchEncoder(nn.Module):
    """An encoder of a patch and further features of an object or a pair: three convolutions and a linear layer."""

    def __init__(self, maps: int, features: int, config: PatchPropNetConfig) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise((maps, *config.channels)):
            layers += [nn.Conv2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers)
        flat = config.channels[-1] * (config.patch_cells // DOWNSAMPLING) ** 2
        self.head = nn.Sequential(nn.Linear(flat + features, config.hidden), nn.ReLU())

    def forward(self, maps: Tensor, features: Tensor) -> Tensor:
        """Encode maps (..., C, cells, cells) and features (..., F) of objects or pairs: (..., hidden)."""
        convolved = self.convolutions(maps.flatten(0, -4)).flatten(1).unflatten(0, maps.shape[:-3])
        encoded: Tensor = self.head(torch.cat([convolved, features], -1))
        return encoded


class PatchDecoder(nn.Module):
    """A decoder that predicts the next patches from hidden states and the last patches by three transposed convolutions."""

    def __init__(self, config: PatchPropNetConfig) -> None:
        super().__init__()
        first, second, third = config.channels
        self.side, self.channels = config.patch_cells // DOWNSAMPLING, third
        self.start = nn.Sequential(nn.Linear(config.hidden, third * self.side**2), nn.ReLU())
        layers: list[nn.Module] = []
        for inputs, outputs in ((third, second), (second, first)):
            layers += [nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers, nn.ConvTranspose2d(first, PATCH_CHANNELS, 4, stride=2, padding=1))

    def forward(self, hidden: Tensor, last: Tensor) -> Tensor:
        """Predict the next patches from hidden states (..., hidden) and the last patches.

        The patches are (..., 4, cells, cells) with values from 0 to 1.
        """
        maps = self.start(hidden).view(-1, self.channels, self.side, self.side)
        change = self.convolutions(maps).float().unflatten(0, hidden.shape[:-1])
        return (change + last.float().clamp(DARKEST, 1 - DARKEST).logit()).sigmoid()


class PatchNetwork(nn.Module):
    """The common part of both networks on patches: the configuration, and the features of motion and pairs.

    Args:
        config: sizes and time steps.
        world: the world that it is trained for.

    Attributes:
        box_scale: units of boxes, see `box_scale`.
    """

    def __init__(self, config: PatchPropNetConfig, world: World) -> None:
        super().__init__()
        self.config, self.world, self.box_scale = config, world, box_scale(world)
        self.static_features = feature_count(world.vocabulary)
        self.motion_features = 2 * (config.window - 1)
        self.pair_features = 2 * config.window + self.motion_features + 2 * self.static_features

    def _features(self, boxes: Tensor, static: Tensor) -> tuple[Tensor, Tensor]:
        """Displacements between samples (B, N, `motion_features`), and features of pairs (B, N, N, `pair_features`)."""
        n, centre = boxes.shape[1], boxes[..., :2]
        motion = ((centre[:, :, 1:] - centre[:, :, :-1]) / STEP_SCALE).flatten(2)
        apart = ((centre[:, None] - centre[:, :, None]) / REACH).clamp(-MAX_REACH, MAX_REACH).flatten(3)
        kinds = [static[:, :, None].expand(-1, -1, n, -1), static[:, None].expand(-1, n, -1, -1)]
        return motion, torch.cat([apart, motion[:, None] - motion[:, :, None], *kinds], -1)


class PatchPropNet(PatchNetwork):
    """A network that predicts the box of every object one step later, and the collisions in that step and in the window.

    Differs from the paper: patches hold the mask, drawn as its filled box, but no image, because the proposals of the real
    training data have no pixels; position, motion, material and shape are concatenated to the output of the convolutions
    instead of being constant channels; the network predicts the change of the box, from which the next patch is drawn, instead
    of the pixels of the patch; the relation predictor also predicts collisions in the steps of the window, whose effect it
    sees.
    """

    def __init__(self, config: PatchPropNetConfig, world: World = CLEVRER_WORLD) -> None:
        super().__init__(config, world)
        own = 2 * config.window + 2 + self.motion_features + self.static_features
        self.object_encoder = PatchEncoder(config.window, own, config)
        self.relation_encoder = PatchEncoder(2 * config.window, self.pair_features, config)
        steps = config.propagation_steps
        self.network = PropagationNetwork(nn.Identity(), nn.Identity(), 4, config.window, config.hidden, steps)

    def forward(self, boxes: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """Predict one step.

        Args:
            boxes: (B, N, window, 4) boxes, the present last (units of `box_scale`).
            static: (B, N, `static_features`) one-hot shape and material.
            exists: (B, N) bool, whether each object exists.

        Returns:
            The boxes (B, N, 4) `stride_frames` later, and symmetric collision logits (B, N, N, window): for the next step, for
            the step that ends at the present, and for the steps before it.
        """
        n, centre = boxes.shape[1], boxes[..., :2]
        motion, of_pair = self._features(boxes, static)
        # Both patches of a pair are centred on the receiver, so that their masks show how near the two objects are.
        around = centre[:, :, None, -1].expand(-1, -1, n, -1)
        own = self._masks(boxes, centre[:, :, -1])
        sent = self._masks(boxes[:, None].expand(-1, n, -1, -1, -1), around)
        masks = torch.cat([own[:, :, None].expand(-1, -1, n, -1, -1, -1), sent], 3)
        objects = self.object_encoder(own, torch.cat([centre.flatten(2), boxes[:, :, -1, 2:], motion, static], -1))
        change, collision = self.network(objects, self.relation_encoder(masks, of_pair), exists)
        inertia = boxes[:, :, -1] - boxes[:, :, -2]
        return boxes[:, :, -1] + inertia + change.float() * STEP_SCALE, (collision + collision.transpose(1, 2)) / 2

    def _masks(self, boxes: Tensor, around: Tensor) -> Tensor:
        """The share of each cell (..., window, cells, cells) that the box covers, in patches centred on `around`."""
        c = self.config
        scale = torch.tensor(self.box_scale, device=boxes.device)
        centre, half = boxes[..., :2] * scale[:2], boxes[..., 2:] * scale[2:] / 2
        edge = (torch.arange(c.patch_cells, device=boxes.device) - c.patch_cells / 2) * c.cell_px
        covered = []
        for axis in range(2):
            middle = (centre[..., axis] - around[..., None, axis] * scale[axis])[..., None]
            low = torch.maximum(edge, middle - half[..., axis, None])
            high = torch.minimum(edge + c.cell_px, middle + half[..., axis, None])
            covered.append((high - low).clamp(min=0) / c.cell_px)
        return covered[1][..., :, None] * covered[0][..., None, :]


class ImagePropNet(PatchNetwork):
    """A network that predicts the box, image and mask of every object one step later, and collisions.

    The collisions are those in that step and in the window. Relations keep a state over the propagation steps.

    Differs from the paper: images show the object alone (image times mask), so that a removed object leaves no pixels in the
    patches of others; a relation sees the patches of the receiver, and those of the sender cut at the position of the receiver;
    position, motion, material and shape are constant channels, as in the paper, and are also concatenated to the output of the
    convolutions; the decoder predicts the change of the last patch; the network predicts the change of the box in addition to
    the next patch; the relation predictor also predicts collisions in the steps of the window.
    """

    def __init__(self, config: PatchPropNetConfig, world: World) -> None:
        super().__init__(config, world)
        if config.patch_cells % DOWNSAMPLING:
            raise DataError(
                f"patch_cells: expected a multiple of {DOWNSAMPLING} for a network on images, got {config.patch_cells}"
            )
        seen = PATCH_CHANNELS * config.window
        own, pair = 4 * config.window + self.motion_features + self.static_features, self.pair_features
        self.object_encoder = PatchEncoder(seen + own, own, config)
        self.relation_encoder = PatchEncoder(2 * seen + pair, pair, config)
        sizes = 4 + config.hidden, config.window, config.hidden, config.propagation_steps
        self.network = PropagationNetwork(nn.Identity(), nn.Identity(), *sizes, edge_state=True)
        self.decoder = PatchDecoder(config)

    def forward(self, boxes: Tensor, patches: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Predict one step.

        Args:
            boxes: (B, N, window, 4) boxes, the present last (units of `box_scale`).
            patches: (B, N, window, 4, cells, cells) red, green, blue and mask around the centre of each box, from 0 to 1.
            static: (B, N, `static_features`) one-hot shape and material.
            exists: (B, N) bool, whether each object exists.

        Returns:
            The boxes (B, N, 4) and patches (B, N, 4, cells, cells) `stride_frames` later, and collision logits
            (B, N, N, window) as in `PatchPropNet.forward`.
        """
        n, centre = boxes.shape[1], boxes[..., :2]
        motion, of_pair = self._features(boxes, static)
        own = patches.flatten(2, 3)
        both = torch.cat([own[:, :, None].expand(-1, -1, n, -1, -1, -1), self._around_receivers(centre, patches)], 3)
        of_object = torch.cat([boxes.flatten(2), motion, static], -1)
        objects = self.object_encoder(_with_channels(own, of_object), of_object)
        pairs = self.relation_encoder(_with_channels(both, of_pair), of_pair)
        outputs, collision = self.network(objects, pairs, exists)
        inertia = F.pad(centre[:, :, -1] - centre[:, :, -2], (0, 2))  # sizes do not change
        following = boxes[:, :, -1] + inertia + outputs[..., :4].float() * STEP_SCALE
        drawn = self.decoder(outputs[..., 4:].relu(), patches[:, :, -1])
        return following, drawn, (collision + collision.transpose(1, 2)) / 2

    def _around_receivers(self, centre: Tensor, patches: Tensor) -> Tensor:
        """Patches (B, N, N, window * 4, cells, cells) of each sender, cut at the receiver's position in the same sample."""
        b, n, window = patches.shape[:3]
        cells, cell_px = self.config.patch_cells, self.config.cell_px
        scale = torch.tensor(self.box_scale[:2], device=centre.device)
        # Position of the receiver's patch relative to that of the sender, in units of half a patch.
        shift = (centre[:, :, None] - centre[:, None]) * scale / (cells * cell_px / 2)
        middles = (torch.arange(cells, device=centre.device) + 0.5) / cells * 2 - 1
        grid = torch.stack(torch.meshgrid(middles, middles, indexing="xy"), -1)
        places = grid + shift.flatten(0, 3)[:, None, None]
        sent = patches[:, None].expand(-1, n, -1, -1, -1, -1, -1).flatten(0, 3)
        moved = F.grid_sample(sent.float(), places.float(), padding_mode="zeros", align_corners=False)
        return moved.view(b, n, n, window * PATCH_CHANNELS, cells, cells)


def _with_channels(maps: Tensor, values: Tensor) -> Tensor:
    """Append to maps (..., C, cells, cells) a constant channel for each value (..., K): (..., C + K, cells, cells)."""
    constant = values[..., None, None].expand(*values.shape, *maps.shape[-2:])
    return torch.cat([maps, constant.to(maps.dtype)], -3)

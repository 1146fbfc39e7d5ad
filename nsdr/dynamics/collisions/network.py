"""The collision network, convolutions over time for objects and pairs that exchange messages, and the detector that uses it."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.collisions.features import (
    MOTION_CHANNELS,
    PAIR_CHANNELS,
    NetworkInputs,
    arrays_from_states,
    near_pairs,
    network_inputs,
)
from nsdr.dynamics.motion_states import MotionStates, feature_count
from nsdr.io.checkpoint import PretrainedPart
from nsdr.io.device import limit_threads
from nsdr.types import Event
from nsdr.validation import Settings, Size
from nsdr.world.world import ANY_LOOK, CLEVRER_WORLD, World

STEP_FRAMES = 2
"""Number of frames in a step of the output."""
KERNEL = 5
"""Kernel size of the convolutions (frames in the first layer, then steps)."""
PEAK_STEPS = 2
"""The frame of a collision is the mean, weighted by probability, over this many steps on each side of the most probable one."""
FIRST_LOGIT = -6.0
"""Initial bias of the logit, so that an untrained network predicts few collisions."""


@dataclass(frozen=True)
class CollisionNetworkConfig(Settings):
    """Sizes of the network. A value that is too small raises a `DataError`.

    Attributes:
        width: number of channels.
        object_dilations: dilations of the convolutions on objects.
        pair_dilations: dilations of the convolutions on pairs before messages are exchanged.
        last_dilations: dilations of the convolutions on pairs after messages are exchanged.
    """

    width: Size = 64
    object_dilations: tuple[Size, ...] = (1, 2)
    pair_dilations: tuple[Size, ...] = (1, 2, 4)
    last_dilations: tuple[Size, ...] = (1, 4, 8)


class CollisionNetwork(nn.Module):
    """A network that predicts when each pair collides, from the whole tracks of all objects.

    A change of an object's velocity is no evidence for a collision if another collision explains it. So pairs send messages to
    their objects, and objects send messages to their pairs.

    Args:
        config: sizes.
        world: the world that it is trained for.
    """

    def __init__(self, config: CollisionNetworkConfig, world: World = CLEVRER_WORLD) -> None:
        super().__init__()
        self.config, self.world = config, world
        width, channels = config.width, MOTION_CHANNELS + feature_count(world.vocabulary)
        self.of_object = nn.Conv1d(channels, width, KERNEL, STEP_FRAMES, KERNEL // 2)
        self.of_pair = nn.Conv1d(PAIR_CHANNELS, width, KERNEL, STEP_FRAMES, KERNEL // 2)
        self.objects = nn.Sequential(*(_Block(width, d) for d in config.object_dilations))
        self.to_pair = nn.Conv1d(2 * width, width, 1)
        self.pairs = nn.Sequential(*(_Block(width, d) for d in config.pair_dilations))
        self.message = nn.Conv1d(width, width, 1)
        self.exchanged = nn.Sequential(*(_Block(width, d) for d in config.object_dilations))
        self.back_to_pair = nn.Conv1d(2 * width, width, 1)
        self.last = nn.Sequential(*(_Block(width, d) for d in config.last_dilations))
        self.logit = nn.Conv1d(width, 1, 1)
        nn.init.constant_(self.logit.bias, FIRST_LOGIT)  # type: ignore[arg-type]

    def forward(self, inputs: NetworkInputs) -> Tensor:
        """Logits (P, S) of a collision of each pair in each of S steps of `STEP_FRAMES` frames. The logit of none is 0."""
        first, second = inputs.edges[:, 0], inputs.edges[:, 1]
        objects = self.objects(self.of_object(inputs.objects))
        pairs = self.of_pair(inputs.pairs) + self.to_pair(torch.cat([objects[first], objects[second]], 1))
        pairs = self.pairs(pairs)
        messages = F.relu(self.message(pairs))
        objects = self.exchanged(objects.index_add(0, first, messages))
        pairs = self.last(pairs + self.back_to_pair(torch.cat([objects[first], objects[second]], 1)))
        one_way, other_way = self.logit(F.relu(pairs))[:, 0].chunk(2)
        return (one_way + other_way) / 2


class _Block(nn.Module):
    """A residual block with one dilated convolution."""

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.wide = nn.Conv1d(width, width, KERNEL, padding=dilation * (KERNEL // 2), dilation=dilation)
        self.mix = nn.Conv1d(width, width, 1)
        with torch.no_grad():
            self.mix.weight *= 0.3

    def forward(self, x: Tensor) -> Tensor:
        """Transform sequences (B, width, S)."""
        return x + self.mix(F.relu(self.wide(F.relu(x))))


class TrackCollisionDetector(PretrainedPart[CollisionNetwork]):
    """A detector of collisions in observed motion with a temporal network on whole tracks.

    Differs from the paper: the paper's network sees image patches of few frames.

    Args:
        model: the trained network.
    """

    part = "collisions"
    free = ANY_LOOK
    built_from = (CollisionNetworkConfig, CollisionNetwork)

    def __init__(self, model: CollisionNetwork) -> None:
        self.model = model.eval()

    @limit_threads(1)
    @torch.no_grad()
    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        """For every pair that comes near each other, its most probable collision and its probability, in order of frames.

        Raises:
            DataError: the network was trained for another world.
        """
        self.check_world(states.world)
        arrays, scales = arrays_from_states(states), states.world.scales
        pairs = near_pairs(arrays.location_world, arrays.radius, scales)
        if not len(pairs):
            return []
        frames, device = states.present.shape[1], self.device
        inputs = NetworkInputs(*(x.to(device) for x in network_inputs(arrays, pairs, scales)))
        logits = self.model(inputs).cpu().double()
        log_total = logits.logsumexp(1)
        share = logits.softmax(1).numpy()
        candidates = []
        for pair, of_pair, probability in zip(pairs.tolist(), share, log_total.sigmoid().tolist(), strict=True):
            peak = int(of_pair.argmax())
            near = np.arange(max(peak - PEAK_STEPS, 0), min(peak + PEAK_STEPS + 1, len(of_pair)))
            frame = int(np.floor(STEP_FRAMES * np.average(near, weights=of_pair[near]) + 0.5))
            candidates.append((Event("collision", min(frame, frames - 1), (pair[0], pair[1])), probability))
        return sorted(candidates, key=lambda c: c[0].frame)

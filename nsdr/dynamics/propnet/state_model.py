"""The networks of the state backend: one detects collisions in observed motion, the other predicts the next positions."""

from dataclasses import dataclass
from typing import Annotated

import torch
from msgspec import Meta
from torch import Tensor, nn

from nsdr.dynamics.motion_states import feature_count
from nsdr.dynamics.propnet.layers import PropagationNetwork, mlp
from nsdr.validation import MAX_SIZE, Settings, Share, Size
from nsdr.world.world import CLEVRER_WORLD, World

LENGTH_WORLD = 0.1
"""Unit of length inside the networks (world units in CLEVRER): about the displacement of a fast object in one frame."""
NEAR, FAR, MAX_DISTANCE = 3.0, 6.0, 12.0
"""Only distances near contact matter: the distance minus that at which two objects touch is clamped to -`NEAR` to `FAR`, and
the smallest distance in a window to `MAX_DISTANCE` (units of `LENGTH_WORLD`)."""
INERTIA_STEPS = 3
"""Number of displacements between samples whose mean is taken as the current velocity."""


@dataclass(frozen=True)
class PropNetConfig(Settings):
    """Sizes and time steps of the networks.

    Attributes:
        hidden: width of the hidden layers.
        propagation_steps: number of propagation steps L (paper: 2).
        stride_frames: number of frames between two samples of a window, and from the present to the prediction.
        past_steps: number of samples that the forward network sees, including the present; at least 4, because the velocity is
            the mean of the last three displacements.
        side_steps: number of samples on each side of the present that the observer network sees.
        collision_threshold: probability above which a pair collides.
    """

    hidden: Size = 128
    propagation_steps: Size = 2
    stride_frames: Size = 2
    past_steps: Annotated[int, Meta(ge=INERTIA_STEPS + 1, le=MAX_SIZE)] = 6
    side_steps: Size = 6
    collision_threshold: Share = 0.5


class PropNet(nn.Module):
    """Two propagation networks on windows of ground-plane states: a forward network and an observer network.

    All inputs are relative to the current position of the object or to another object, so the networks see no absolute
    positions, and training may rotate scenes.

    Args:
        config: sizes and time steps.
        world: the world that it is trained for.

    Attributes:
        length_world: the unit of length (world units).
    """

    def __init__(self, config: PropNetConfig, world: World = CLEVRER_WORLD) -> None:
        super().__init__()
        self.config, self.world = config, world
        self.length_world = LENGTH_WORLD * world.scales.frame
        self.radii = [shape.radius_world / self.length_world for shape in world.vocabulary.shapes]
        static, past, whole = feature_count(world.vocabulary), config.past_steps, 2 * config.side_steps + 1

        def network(samples: int, outputs: int) -> PropagationNetwork:
            """A propagation network on windows of this many samples with this many outputs for each object."""
            width = config.hidden
            encoders = mlp(static + 3 * samples, width, width), mlp(4 * samples + 1, width, width)
            return PropagationNetwork(*encoders, outputs, 1, width, config.propagation_steps)

        self.forward_network = network(past, 2)
        self.observer_network = network(whole, 1)

    def predict(self, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """Predict the next position of every object, and the collisions until then.

        Args:
            window: (B, N, past_steps, 2) positions, the present last (world units).
            reliable: (B, N, past_steps) bool, whether each position is reliable.
            static: (B, N, `feature_count`) one-hot shape and material.
            exists: (B, N) bool, whether each object exists.

        Returns:
            The positions (B, N, 2) `stride_frames` later, and symmetric collision logits (B, N, N).
        """
        objects = self._object_inputs(window, reliable, static, present=-1)
        motion, collision = self.forward_network(objects, self._relation_inputs(window, static), exists)
        velocity = (window[:, :, -1] - window[:, :, -1 - INERTIA_STEPS]) / INERTIA_STEPS
        return window[:, :, -1] + velocity + motion * self.length_world, _symmetric(collision[..., 0])

    def observe(self, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor) -> Tensor:
        """Detect collisions in the middle of windows.

        Args:
            window: (B, N, 2 side_steps + 1, 2) positions (world units).
            reliable: (B, N, 2 side_steps + 1) bool, whether each position is reliable.
            static: (B, N, `feature_count`) one-hot shape and material.
            exists: (B, N) bool, whether each object exists.

        Returns:
            Symmetric collision logits (B, N, N).
        """
        objects = self._object_inputs(window, reliable, static, present=self.config.side_steps)
        return _symmetric(self.observer_network(objects, self._relation_inputs(window, static), exists)[1][..., 0])

    def _object_inputs(self, window: Tensor, reliable: Tensor, static: Tensor, present: int) -> Tensor:
        """Inputs of the object encoder (B, N, ...): positions relative to that at sample `present`, and the other features."""
        own = (window - window[:, :, present : present + 1 or None]) / self.length_world
        return torch.cat([static, own.flatten(2), reliable.to(window.dtype)], -1)

    def _relation_inputs(self, window: Tensor, static: Tensor) -> Tensor:
        """Inputs of the relation encoder (B, N, N, ...) from windows (B, N, samples, 2): senders relative to receivers."""
        radius = (static[..., : len(self.radii)] * static.new_tensor(self.radii)).sum(-1)
        touching = (radius[:, None] + radius[:, :, None])[..., None]
        apart = (window[:, None] - window[:, :, None]) / self.length_world
        distance = torch.linalg.vector_norm(apart, dim=-1)
        moving_apart = distance[..., 1:] - distance[..., :-1]
        nearest = distance.amin(-1, keepdim=True)
        beyond_contact, touches = (distance - touching).clamp(-NEAR, FAR), nearest - touching < 1
        width = 2 * sum(self.radii) / len(self.radii)
        parts = apart.flatten(-2) / width, beyond_contact, moving_apart, nearest.clamp(max=MAX_DISTANCE), touches
        return torch.cat(parts, -1)


def _symmetric(logits: Tensor) -> Tensor:
    """The mean of the logits (B, N, N) of both directions of each pair."""
    return (logits + logits.transpose(1, 2)) / 2

"""The state backend's networks: one detects collisions in observed motion, one predicts the next positions."""

from dataclasses import dataclass
from typing import Annotated

import torch
from msgspec import Meta
from torch import Tensor, nn

from nsdr.dynamics.propnet.layers import PropNet, mlp
from nsdr.validation import MAX_SIZE, Settings, Share, Size

STATIC_FEATURES = 5
LENGTH_WORLD = 0.1
"""Unit of lengths inside the networks: about the displacement of a fast object in one frame (world units)."""
DIAMETER = 4.0
"""An object's width in `LENGTH_WORLD`: the distance at which two touch."""
NEAR, FAR, MAX_DISTANCE = 3.0, 6.0, 12.0
"""Distances between objects are clamped to a range around contact (in `LENGTH_WORLD`), because only near contact matters."""
INERTIA_STEPS = 3
"""Displacements between samples whose mean is the current velocity."""


@dataclass(frozen=True)
class StateModelConfig(Settings):
    """Sizes and time steps.

    Attributes:
        hidden: width of the networks.
        propagation_steps: L (paper: 2).
        stride_frames: frames between two samples of a window, and of one prediction.
        past_steps: samples of the past that the forward network sees, the present included; at least 4, because the velocity
            is the mean over the last three displacements.
        side_steps: samples on each side of the present that the observer sees.
        collision_threshold: probability above which a pair collides.
    """

    hidden: Size = 128
    propagation_steps: Size = 2
    stride_frames: Size = 2
    past_steps: Annotated[int, Meta(ge=INERTIA_STEPS + 1, le=MAX_SIZE)] = 6
    side_steps: Size = 6
    collision_threshold: Share = 0.5


class StateModel(nn.Module):
    """Two propagation networks on windows of ground-plane states.

    All inputs are relative to the object's own current position, or to the other object, so the networks know no absolute
    position and training may rotate scenes.
    """

    def __init__(self, config: StateModelConfig) -> None:
        super().__init__()
        self.config = config
        past, whole = config.past_steps, 2 * config.side_steps + 1

        def network(samples: int, outputs: int) -> PropNet:
            width = config.hidden
            encoders = mlp(STATIC_FEATURES + 3 * samples, width, width), mlp(4 * samples + 1, width, width)
            return PropNet(*encoders, outputs, 1, width, config.propagation_steps)

        self.forward_network = network(past, 2)
        self.observer_network = network(whole, 1)

    def predict(self, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """The next position of every object, and the collisions until then.

        Args:
            window: (B, N, past_steps, 2) positions in world units, the present last.
            reliable: (B, N, past_steps) bool.
            static: (B, N, 5) one-hot shape and material.
            exists: (B, N) bool.

        Returns:
            Positions (B, N, 2) `stride_frames` later; collision logits (B, N, N), symmetric.
        """
        objects = _object_inputs(window, reliable, static, present=-1)
        motion, collision = self.forward_network(objects, _relation_inputs(window), exists)
        velocity = (window[:, :, -1] - window[:, :, -1 - INERTIA_STEPS]) / INERTIA_STEPS
        return window[:, :, -1] + velocity + motion * LENGTH_WORLD, _symmetric(collision[..., 0])

    def observe(self, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor) -> Tensor:
        """Collision logits (B, N, N) at the middle of windows (B, N, 2 side_steps + 1, 2)."""
        objects = _object_inputs(window, reliable, static, present=self.config.side_steps)
        return _symmetric(self.observer_network(objects, _relation_inputs(window), exists)[1][..., 0])


def _symmetric(logits: Tensor) -> Tensor:
    return (logits + logits.transpose(1, 2)) / 2


def _object_inputs(window: Tensor, reliable: Tensor, static: Tensor, present: int) -> Tensor:
    own = (window - window[:, :, present : present + 1 or None]) / LENGTH_WORLD
    return torch.cat([static, own.flatten(2), reliable.to(window.dtype)], -1)


def _relation_inputs(window: Tensor) -> Tensor:
    """What the relation encoder reads (B, N, N, ...) of windows (B, N, samples, 2), from receiver to sender."""
    apart = (window[:, None] - window[:, :, None]) / LENGTH_WORLD
    distance = torch.linalg.vector_norm(apart, dim=-1)
    moving_apart = distance[..., 1:] - distance[..., :-1]
    nearest = distance.amin(-1, keepdim=True)
    beyond_contact, touches = (distance - DIAMETER).clamp(-NEAR, FAR), nearest - DIAMETER < 1
    parts = apart.flatten(-2) / DIAMETER, beyond_contact, moving_apart, nearest.clamp(max=MAX_DISTANCE), touches
    return torch.cat(parts, -1)

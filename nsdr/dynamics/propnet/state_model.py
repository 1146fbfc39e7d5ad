"""The state backend's networks: one detects collisions in observed motion, one predicts the next positions."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import torch
from msgspec import Meta
from torch import Tensor, nn

from nsdr.dynamics.propnet.folded import FoldedPropNet, Pairs
from nsdr.dynamics.propnet.layers import PropNet, mlp
from nsdr.validation import MAX_SIZE, Settings, Share, Size

__all__ = ["FoldedStateModel", "StateModel", "StateModelConfig"]

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
    """Sizes and time steps; a `DataError` names a value that is too small.

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
        motion, collision = self.forward_network(objects, _relation_inputs(_apart(window)), exists)
        return _moved(window, motion), _symmetric(collision[..., 0])

    def observe(self, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor) -> Tensor:
        """Collision logits (B, N, N) at the middle of windows (B, N, 2 side_steps + 1, 2)."""
        objects = _object_inputs(window, reliable, static, present=self.config.side_steps)
        return _symmetric(self.observer_network(objects, _relation_inputs(_apart(window)), exists)[1][..., 0])

    def folded(self) -> "StateModel | FoldedStateModel":
        """The same functions for inference, with a copy of the weights."""
        return FoldedStateModel(self)


class FoldedStateModel:
    """`StateModel.predict` and `StateModel.observe` for inference.

    The same results but for rounding; collision logits of pairs that do not exist are minus infinity, and objects that do
    not exist move on at their velocity.

    Args:
        model: each network's weights are copied when it is first used: later changes have no effect.
    """

    def __init__(self, model: StateModel) -> None:
        self.config = model.config
        self._model = model
        self._exists = torch.zeros((1, 0), dtype=torch.bool)  # of the last call: mostly the next one has the same
        self._pairs = Pairs(self._exists)

    @cached_property
    def _forward_network(self) -> FoldedPropNet:
        return FoldedPropNet(self._model.forward_network)

    @cached_property
    def _observer_network(self) -> FoldedPropNet:
        return FoldedPropNet(self._model.observer_network)

    def predict(self, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """As `StateModel.predict`.

        Args:
            window, reliable, static, exists: (B, N, past_steps, 2), (B, N, past_steps), (B, N, 5) and (B, N).

        Returns:
            Positions (B, N, 2) and collision logits (B, N, N).
        """
        motion, collision = self._outputs(self._forward_network, window, reliable, static, exists, present=-1)
        return _moved(window, motion), collision

    def observe(self, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor) -> Tensor:
        """As `StateModel.observe`.

        Args:
            window, reliable, static, exists: (B, N, 2 side_steps + 1, 2), (B, N, 2 side_steps + 1), (B, N, 5) and (B, N).

        Returns:
            Collision logits (B, N, N).
        """
        present = self.config.side_steps
        return self._outputs(self._observer_network, window, reliable, static, exists, present)[1]

    def _outputs(
        self, network: FoldedPropNet, window: Tensor, reliable: Tensor, static: Tensor, exists: Tensor, present: int
    ) -> tuple[Tensor, Tensor]:
        if exists.device != self._exists.device or not torch.equal(exists, self._exists):
            self._exists, self._pairs = exists.clone(), Pairs(exists)
        pairs = self._pairs
        positions = window.flatten(0, 1).index_select(0, pairs.objects)
        apart = positions.index_select(0, pairs.sender) - positions.index_select(0, pairs.receiver)
        objects = _object_inputs(window, reliable, static, present).flatten(0, 1).index_select(0, pairs.objects)
        found, collision = network(objects, _relation_inputs(apart), pairs)
        motion = found.new_zeros((*exists.shape, found.shape[1]))
        motion.flatten(0, 1).index_copy_(0, pairs.objects, found)
        logits = collision.new_full((*exists.shape, exists.shape[1]), -torch.inf)
        logits.flatten().index_copy_(0, pairs.index, collision[:, 0])
        return motion, _symmetric(logits)


def _moved(window: Tensor, motion: Tensor) -> Tensor:
    """The next positions: the present ones moved on by the current velocity and by the network's output."""
    inertia = (window[:, :, -1] - window[:, :, -1 - INERTIA_STEPS]) / INERTIA_STEPS
    return window[:, :, -1] + inertia + motion * LENGTH_WORLD


def _apart(window: Tensor) -> Tensor:
    """Displacements (B, N, N, samples, 2) from receiver to sender."""
    return window[:, None] - window[:, :, None]


def _symmetric(logits: Tensor) -> Tensor:
    return (logits + logits.transpose(1, 2)) / 2


def _object_inputs(window: Tensor, reliable: Tensor, static: Tensor, present: int) -> Tensor:
    own = (window - window[:, :, present : present + 1 or None]) / LENGTH_WORLD
    return torch.cat([static, own.flatten(2), reliable.to(window.dtype)], -1)


def _relation_inputs(apart_world: Tensor) -> Tensor:
    """What the relation encoder reads of displacements (..., samples, 2) from receiver to sender."""
    apart = apart_world / LENGTH_WORLD
    distance = torch.linalg.vector_norm(apart, dim=-1)
    moving_apart = distance[..., 1:] - distance[..., :-1]
    nearest = distance.amin(-1, keepdim=True)
    beyond_contact, touches = (distance - DIAMETER).clamp(-NEAR, FAR), nearest - DIAMETER < 1
    parts = apart.flatten(-2) / DIAMETER, beyond_contact, moving_apart, nearest.clamp(max=MAX_DISTANCE), touches
    return torch.cat(parts, -1)

"""`PropNet` for inference: the same function with less arithmetic."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.propnet.layers import PropNet

__all__ = ["FoldedPropNet", "Pairs"]


@dataclass(frozen=True)
class Pairs:
    """The ordered pairs of objects that exist, of scenes of N objects; object i of scene b has the number b N + i.

    Attributes:
        scene, receiver, sender: (P,) int, indices into (B, N, N), by scene and receiver.
        ends: (P, 2) int, numbers of receiver and sender.
        start: (B N,) int, index of the first pair whose receiver is the object of this number.
    """

    scene: Tensor
    receiver: Tensor
    sender: Tensor
    ends: Tensor
    start: Tensor

    @classmethod
    def of(cls, exists: Tensor) -> Self:
        """All pairs of objects that exist (B, N)."""
        n = exists.shape[1]
        there = exists[:, :, None] & exists[:, None] & ~torch.eye(n, dtype=torch.bool, device=exists.device)
        scene, receiver, sender = there.nonzero(as_tuple=True)
        senders = there.sum(2).flatten()
        ends = torch.stack([receiver, sender], 1) + n * scene[:, None]
        return cls(scene, receiver, sender, ends, senders.cumsum(0) - senders)


class FoldedPropNet:
    """The weights of a `PropNet` whose encoders are made by `mlp`, multiplied out.

    Only pairs that exist are computed. What a pair's layers add up from its two objects is computed once for each object;
    linear layers that follow one another are one. Outputs differ from the network's by rounding.

    Args:
        network: the weights are copied: later changes of it have no effect.
    """

    def __init__(self, network: PropNet) -> None:
        self.steps = network.steps
        self.object_encoder, self.relation_encoder = _layers(network.object_encoder), _layers(network.relation_encoder)
        propagate, self.effect = _layers(network.relation_propagator)
        update, self.update = _layers(network.object_propagator)
        predict_object, *self.object_predictor = _layers(network.object_predictor)
        predict_relation, *self.relation_predictor = _layers(network.relation_predictor)
        update_encoded, self.update_effects, self.update_hidden = update.weight.chunk(3, 1)
        object_hidden, object_encoded = predict_object.weight.chunk(2, 1)
        relation_hidden, self.relation_effects, relation_pairs = predict_relation.weight.chunk(3, 1)
        # Both readers of a pair's encoding: the propagation and the relation predictor.
        self.pair = torch.cat([propagate.weight, relation_pairs])
        received, sent = network.relation_receiver, network.relation_sender
        constant = propagate.weight @ (network.effect_receiver.bias + network.effect_sender.bias) + propagate.bias
        bias = self.pair @ (received.bias + sent.bias) + torch.cat([constant, predict_relation.bias])
        self.ends = torch.cat([self.pair @ received.weight, self.pair @ sent.weight])
        self.ends_bias = torch.cat([bias, torch.zeros_like(bias)])
        effects = network.effect_receiver.weight, network.effect_sender.weight
        self.hidden_ends = torch.cat([propagate.weight @ weight for weight in effects])
        self.encoded = torch.cat([update_encoded, object_encoded])
        self.encoded_bias = torch.cat([update.bias, predict_object.bias])
        self.object_hidden, self.relation_hidden = object_hidden, relation_hidden

    def __call__(self, objects: Tensor, relations: Tensor, pairs: Pairs) -> tuple[Tensor, Tensor]:
        """Predict for all objects and pairs.

        Args:
            objects: (V, ...) what the object encoder reads, by number.
            relations: (P, ...) what the relation encoder reads.
            pairs: the pairs.

        Returns:
            (V, object_outputs), (P, relation_outputs).
        """
        number = torch.arange(len(relations), device=relations.device)
        by_role = 2 * pairs.ends + torch.tensor([0, 1], device=relations.device)  # rows: receiver, sender by turns
        encoded = _mlp(self.object_encoder, objects)
        update, object_features = F.linear(encoded, self.encoded, self.encoded_bias).chunk(2, 1)
        of_ends = F.linear(encoded, self.ends, self.ends_bias).view(2 * len(encoded), -1)
        of_pairs = F.linear(_mlp(self.relation_encoder, relations), self.pair) + _row_sums(of_ends, by_role)
        propagate, relation_features = of_pairs.chunk(2, 1)
        hidden = torch.zeros_like(encoded)
        for step in range(self.steps):
            inner = propagate
            if step:
                inner = propagate + _row_sums(F.linear(hidden, self.hidden_ends).view(2 * len(hidden), -1), by_role)
            effects = F.linear(inner.relu(), self.effect.weight, self.effect.bias).relu_()
            total = F.embedding_bag(number, effects, pairs.start, mode="sum")
            change = torch.addmm(update, total, self.update_effects.T)
            if step:
                change.addmm_(hidden, self.update_hidden.T)
            hidden = hidden + F.linear(change.relu_(), self.update.weight, self.update.bias).relu_()
        motion = torch.addmm(object_features, hidden, self.object_hidden.T).relu_()
        relation = torch.addmm(relation_features, effects, self.relation_effects.T)
        relation += _row_sums(F.linear(hidden, self.relation_hidden), pairs.ends)
        return _head(self.object_predictor, motion), _head(self.relation_predictor, relation.relu_())


def _layers(module: nn.Module) -> list[nn.Linear]:
    return [layer for layer in module.modules() if isinstance(layer, nn.Linear)]


def _mlp(layers: list[nn.Linear], x: Tensor) -> Tensor:
    for layer in layers:
        x = F.linear(x, layer.weight, layer.bias).relu_()
    return x


def _head(layers: list[nn.Linear], x: Tensor) -> Tensor:
    return F.linear(_mlp(layers[:-1], x), layers[-1].weight, layers[-1].bias)


def _row_sums(table: Tensor, rows: Tensor) -> Tensor:
    """Sums (P, H) of the rows (P, K) of a table (V, H)."""
    return F.embedding_bag(rows, table, mode="sum")

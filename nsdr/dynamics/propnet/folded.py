"""`PropNet` for inference: the same function with less arithmetic."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from nsdr.dynamics.propnet.layers import PropNet

__all__ = ["FoldedPropNet", "Pairs"]


class Pairs:
    """The objects that exist, numbered from 0 to V - 1, and their ordered pairs, of B scenes of N objects.

    Args:
        exists: (B, N) bool.

    Attributes:
        objects: (V,) int, where an object stands among all objects (B, N).
        receiver, sender: (P,) int, numbers of the objects of a pair, by receiver.
        index: (P,) int, where a pair stands among all pairs (B, N, N), the receiver before the sender.
    """

    def __init__(self, exists: Tensor) -> None:
        n, device = exists.shape[1], exists.device
        there = exists[:, :, None] & exists[:, None] & ~torch.eye(n, dtype=torch.bool, device=device)
        self.objects = exists.flatten().nonzero()[:, 0]
        self.index = there.flatten().nonzero()[:, 0]
        number = exists.flatten().cumsum(0) - 1
        receiver = self.index // max(n, 1)
        self.receiver, self.sender = number[receiver], number[receiver // max(n, 1) * n + self.index % max(n, 1)]
        senders = there.sum(2).flatten()[self.objects]
        self._first = senders.cumsum(0) - senders
        self._every = torch.arange(len(self.index), device=device)
        self._twos = 2 * self._every
        self._ends = torch.stack([self.receiver, self.sender], 1).flatten()
        self._roles = torch.stack([2 * self.receiver, 2 * self.sender + 1], 1).flatten()

    def received(self, effects: Tensor) -> Tensor:
        """(V, H): for each object, the sum of the rows (P, H) of the pairs that it receives in."""
        return _sums(effects, self._every, self._first)

    def of_ends(self, objects: Tensor) -> Tensor:
        """(P, H): the sum of the rows (V, H) of both objects of each pair."""
        return _sums(objects, self._ends, self._twos)

    def of_roles(self, objects: Tensor) -> Tensor:
        """(P, H): what objects (V, 2 H) say as receivers (first half) and as senders, added up for each pair."""
        return _sums(objects.view(2 * objects.shape[0], objects.shape[1] // 2), self._roles, self._twos)


class _Layer(NamedTuple):
    """A linear layer: x @ weight + bias."""

    weight: Tensor
    bias: Tensor

    @classmethod
    def of(cls, *parts: tuple[Tensor, Tensor]) -> "_Layer":
        """Layers (outputs, inputs), (outputs,) that read the same, as one whose outputs follow one another."""
        weights, biases = zip(*parts, strict=True)
        return cls(torch.cat(weights).T.contiguous(), torch.cat(biases))

    def __call__(self, x: Tensor) -> Tensor:
        return torch.addmm(self.bias, x, self.weight)


class FoldedPropNet(nn.Module):
    """The weights of a `PropNet` whose encoders are made by `mlp`, multiplied out.

    Only pairs that exist are computed. What a pair's layers add up from its two objects is computed once for each object;
    linear layers that follow one another, or read the same, are one. Outputs differ from the network's by rounding.

    Args:
        network: the weights are copied: later changes of it have no effect.
    """

    def __init__(self, network: PropNet) -> None:
        super().__init__()
        self.steps = network.steps
        self.object_encoder, self.relation_encoder = _layers(network.object_encoder), _layers(network.relation_encoder)
        propagate, effect = _linear(network.relation_propagator)
        update, new = _linear(network.object_propagator)
        predict_object, *object_predictor = _linear(network.object_predictor)
        predict_relation, *relation_predictor = _linear(network.relation_predictor)
        update_encoded, update_effects, update_hidden = update.weight.chunk(3, 1)
        object_hidden, object_encoded = predict_object.weight.chunk(2, 1)
        relation_hidden, relation_effects, relation_pairs = predict_relation.weight.chunk(3, 1)
        receiver, sender = network.relation_receiver, network.relation_sender
        from_receiver, from_sender = network.effect_receiver, network.effect_sender

        self.encoded_ends = _Layer.of((receiver.weight, receiver.bias), (sender.weight, sender.bias))
        self.encoded = _Layer.of((update_encoded, update.bias), (object_encoded, predict_object.bias))
        # Two read a pair's encoding: the propagation and the relation predictor.
        constant = propagate.weight @ (from_receiver.bias + from_sender.bias) + propagate.bias
        self.pair = _Layer.of((propagate.weight, constant), (relation_pairs, predict_relation.bias))
        ends = propagate.weight @ from_receiver.weight, propagate.weight @ from_sender.weight
        self.hidden_ends, self.update_hidden = torch.cat(ends).T.contiguous(), update_hidden.T.contiguous()
        self.last_hidden = torch.cat([object_hidden, relation_hidden]).T.contiguous()
        self.effect, self.update = (_Layer.of((x.weight, x.bias)) for x in (effect, new))
        self.update_effects, self.relation_effects = update_effects.T.contiguous(), relation_effects.T.contiguous()
        self.object_predictor = [_Layer.of((x.weight, x.bias)) for x in object_predictor]
        self.relation_predictor = [_Layer.of((x.weight, x.bias)) for x in relation_predictor]

    def forward(self, objects: Tensor, relations: Tensor, pairs: Pairs) -> tuple[Tensor, Tensor]:
        """Predict for all objects and pairs.

        Args:
            objects: (V, ...) what the object encoder reads, by number.
            relations: (P, ...) what the relation encoder reads.
            pairs: the pairs.

        Returns:
            (V, object_outputs), (P, relation_outputs).
        """
        encoded = _mlp(self.object_encoder, objects)
        update, object_features = self.encoded(encoded).chunk(2, 1)
        of_pairs = self.pair(_mlp(self.relation_encoder, relations).add_(pairs.of_roles(self.encoded_ends(encoded))))
        propagate, relation_features = of_pairs.chunk(2, 1)
        effects = self.effect(propagate.relu()).relu_()
        hidden = self.update(torch.addmm(update, pairs.received(effects), self.update_effects).relu_()).relu_()
        for _ in range(self.steps - 1):
            effects = self.effect(pairs.of_roles(hidden @ self.hidden_ends).add_(propagate).relu_()).relu_()
            change = torch.addmm(update, hidden, self.update_hidden)
            hidden += self.update(change.addmm_(pairs.received(effects), self.update_effects).relu_()).relu_()
        object_hidden, relation_hidden = (hidden @ self.last_hidden).chunk(2, 1)
        motion = (object_features + object_hidden).relu_()
        relation = pairs.of_ends(relation_hidden).add_(relation_features).addmm_(effects, self.relation_effects).relu_()
        return _head(self.object_predictor, motion), _head(self.relation_predictor, relation)


def _linear(module: nn.Module) -> list[nn.Linear]:
    return [layer for layer in module.modules() if isinstance(layer, nn.Linear)]


def _layers(module: nn.Module) -> list[_Layer]:
    return [_Layer.of((layer.weight, layer.bias)) for layer in _linear(module)]


def _mlp(layers: list[_Layer], x: Tensor) -> Tensor:
    for layer in layers:
        x = layer(x).relu_()
    return x


def _head(layers: list[_Layer], x: Tensor) -> Tensor:
    return layers[-1](_mlp(layers[:-1], x))


def _sums(table: Tensor, rows: Tensor, first: Tensor) -> Tensor:
    """Sums (K, H) of rows of a table (V, H): of those listed from each of K first places to the next."""
    sums: Tensor = torch.embedding_bag(table, rows, first)[0]
    return sums

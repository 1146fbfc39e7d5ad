"""`PropNet` for inference: the same function with less arithmetic."""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.propnet.layers import PropNet

__all__ = ["FoldedPropNet", "Pairs"]


class Pairs:
    """The ordered pairs of objects that exist, of B scenes of N objects; object i of scene b has the number b N + i.

    Args:
        exists: (B, N) bool.

    Attributes:
        receiver, sender: (P,) int, numbers of the objects, by receiver.
        index: (P,) int, where a pair stands among all pairs (B, N, N), the receiver before the sender.
    """

    def __init__(self, exists: Tensor) -> None:
        n, device = exists.shape[1], exists.device
        there = exists[:, :, None] & exists[:, None] & ~torch.eye(n, dtype=torch.bool, device=device)
        self.index = there.flatten().nonzero()[:, 0]
        self.receiver = self.index // max(n, 1)
        self.sender = self.receiver // max(n, 1) * n + self.index % max(n, 1)
        senders = there.sum(2).flatten()
        self._first = senders.cumsum(0) - senders
        self._every, self._firsts_of_two = (torch.arange(len(self.index) * k, device=device)[::k] for k in (1, 2))
        self._ends = torch.stack([self.receiver, self.sender], 1).flatten()
        self._ends_by_role = torch.stack([2 * self.receiver, 2 * self.sender + 1], 1).flatten()

    def received(self, effects: Tensor) -> Tensor:
        """(B N, H): for each object, the sum of the rows (P, H) of the pairs that it receives in."""
        return _sums(effects, self._every, self._first)

    def of_ends(self, objects: Tensor) -> Tensor:
        """(P, H): the sum of the rows (B N, H) of both objects of each pair."""
        return _sums(objects, self._ends, self._firsts_of_two)

    def of_receiver_and_sender(self, objects: Tensor) -> Tensor:
        """(P, H): what objects (B N, 2 H) say as receivers (first half) and senders, added up for each pair."""
        return _sums(objects.view(2 * objects.shape[0], objects.shape[1] // 2), self._ends_by_role, self._firsts_of_two)


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
        encoded = _mlp(self.object_encoder, objects)
        update, object_features = F.linear(encoded, self.encoded, self.encoded_bias).chunk(2, 1)
        of_pairs = F.linear(_mlp(self.relation_encoder, relations), self.pair)
        of_pairs += pairs.of_receiver_and_sender(F.linear(encoded, self.ends, self.ends_bias))
        propagate, relation_features = of_pairs.chunk(2, 1)
        hidden = torch.zeros_like(encoded)
        for step in range(self.steps):
            inner = propagate
            if step:
                inner = propagate + pairs.of_receiver_and_sender(F.linear(hidden, self.hidden_ends))
            effects = F.linear(inner.relu(), self.effect.weight, self.effect.bias).relu_()
            change = torch.addmm(update, pairs.received(effects), self.update_effects.T)
            if step:
                change.addmm_(hidden, self.update_hidden.T)
            hidden = hidden + F.linear(change.relu_(), self.update.weight, self.update.bias).relu_()
        motion = torch.addmm(object_features, hidden, self.object_hidden.T).relu_()
        relation = torch.addmm(relation_features, effects, self.relation_effects.T)
        relation += pairs.of_ends(F.linear(hidden, self.relation_hidden))
        return _head(self.object_predictor, motion), _head(self.relation_predictor, relation.relu_())


def _layers(module: nn.Module) -> list[nn.Linear]:
    return [layer for layer in module.modules() if isinstance(layer, nn.Linear)]


def _mlp(layers: list[nn.Linear], x: Tensor) -> Tensor:
    for layer in layers:
        x = F.linear(x, layer.weight, layer.bias).relu_()
    return x


def _head(layers: list[nn.Linear], x: Tensor) -> Tensor:
    return F.linear(_mlp(layers[:-1], x), layers[-1].weight, layers[-1].bias)


def _sums(table: Tensor, rows: Tensor, first: Tensor) -> Tensor:
    """Sums (K, H) of rows of a table (V, H): of those listed from each of K first places to the next."""
    sums: Tensor = torch.embedding_bag(table, rows, first)[0]
    return sums

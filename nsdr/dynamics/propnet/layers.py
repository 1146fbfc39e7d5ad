"""The propagation network (Li et al., "Propagation Networks", ICRA 2019; section 4.2 of the paper)."""

import torch
from torch import Tensor, nn


def mlp(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    """Two linear layers, each followed by a ReLU."""
    return nn.Sequential(nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, outputs), nn.ReLU())


class PropagationNetwork(nn.Module):
    """A propagation network: object and relation encoders, L propagation steps, object and relation predictors.

    With object states o_i and relation states r_ij, encoders c_i = f_O(o_i), c_ij = f_R(o_i, o_j, r_ij), and h_i = 0:
    e_ij = g_R(c_ij, h_i, h_j), h_i = g_O(c_i, sum_j e_ij, h_i), L times. The object predictor reads h_i and c_i (skip
    connection); the relation predictor reads e_ij, c_ij, h_i and h_j. With an edge state, g_R also reads the e_ij of the
    previous step (0 at first).

    Differs from the paper: nothing. The inputs of the encoders are chosen by the caller.

    Args:
        object_encoder, relation_encoder: encoders f_O and f_R with outputs of width `hidden`.
        object_outputs, relation_outputs: numbers of outputs for each object and each pair.
        hidden: width of all layers.
        steps: number of propagation steps L.
        edge_state: whether relations keep a state over the propagation steps.
    """

    def __init__(
        self,
        object_encoder: nn.Module,
        relation_encoder: nn.Module,
        object_outputs: int,
        relation_outputs: int,
        hidden: int = 128,
        steps: int = 2,
        edge_state: bool = False,
    ) -> None:
        super().__init__()
        self.steps = steps
        self.object_encoder = object_encoder
        self.relation_encoder = relation_encoder
        self.relation_receiver = nn.Linear(hidden, hidden)
        self.relation_sender = nn.Linear(hidden, hidden)
        self.relation_propagator = mlp(hidden, hidden, hidden)
        self.effect_receiver = nn.Linear(hidden, hidden)
        self.effect_sender = nn.Linear(hidden, hidden)
        self.effect_state = nn.Linear(hidden, hidden) if edge_state else None
        self.object_propagator = mlp(3 * hidden, hidden, hidden)
        self.object_predictor = nn.Sequential(mlp(2 * hidden, hidden, hidden), nn.Linear(hidden, object_outputs))
        self.relation_predictor = nn.Sequential(mlp(3 * hidden, hidden, hidden), nn.Linear(hidden, relation_outputs))

    def forward(self, objects: Tensor, relations: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """Predict for all objects and pairs.

        Args:
            objects: (B, N, ...) inputs of the object encoder.
            relations: (B, N, N, ...) inputs of the relation encoder; [b, i, j] describes the effect of sender j on receiver i.
            exists: (B, N) bool, whether each object exists. Other objects have no effect, and their outputs are meaningless.

        Returns:
            Outputs for objects (B, N, object_outputs) and for pairs (B, N, N, relation_outputs).
        """
        n = objects.shape[1]
        edges = exists[:, :, None] & exists[:, None, :] & ~torch.eye(n, dtype=torch.bool, device=objects.device)
        encoded = self.object_encoder(objects)
        pairs = self.relation_encoder(relations)
        pairs = pairs + self.relation_receiver(encoded)[:, :, None] + self.relation_sender(encoded)[:, None]
        hidden, effects = torch.zeros_like(encoded), torch.zeros_like(pairs)
        for _ in range(self.steps):
            received = self.effect_receiver(hidden)[:, :, None] + self.effect_sender(hidden)[:, None]
            if self.effect_state is not None:
                received = received + self.effect_state(effects)
            effects = self.relation_propagator(pairs + received) * edges[..., None]
            hidden = hidden + self.object_propagator(torch.cat([encoded, effects.sum(2), hidden], -1))
        both = torch.cat([hidden[:, :, None] + hidden[:, None], effects, pairs], -1)
        return self.object_predictor(torch.cat([hidden, encoded], -1)), self.relation_predictor(both)

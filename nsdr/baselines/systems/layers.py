"""Layers that several baselines share: the encoder of texts and the answer head."""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from nsdr.question_parser.tokenizer import PAD

__all__ = ["AnswerHead", "EncodedText", "TextEncoder", "initialise", "masked_mean"]


class EncodedText(NamedTuple):
    """B texts of up to T words.

    Attributes:
        states: (B, T, H) the LSTM's states, zeros where there is padding.
        summary: (B, H) the last state of the last layer, of each direction.
        mask: (B, T) bool, False where there is padding.
    """

    states: Tensor
    summary: Tensor
    mask: Tensor


class TextEncoder(nn.Module):
    """Word embeddings and an LSTM, whose states do not depend on padding.

    Args:
        words: number of word indices; `PAD` is one of them.
        embedding: width of the word embeddings.
        hidden: width H of the states; with two directions each has half of it, rounded down.
        layers: LSTM layers.
        bidirectional: whether a second direction reads from the end.
        dropout: dropout of the word embeddings and between layers, in training (0-1).

    Attributes:
        width: H, an even number where there are two directions.
    """

    def __init__(
        self,
        words: int,
        embedding: int,
        hidden: int,
        layers: int = 1,
        bidirectional: bool = True,
        dropout: float = 0.0,
    ) -> None:
        super().__init__()
        self.width = 2 * (hidden // 2) if bidirectional else hidden
        self.embedding = nn.Embedding(words, embedding, padding_idx=PAD)
        self.dropout = nn.Dropout(dropout)
        self.lstm = nn.LSTM(
            embedding,
            self.width // 2 if bidirectional else hidden,
            layers,
            batch_first=True,
            bidirectional=bidirectional,
            dropout=dropout if layers > 1 else 0.0,
        )

    def forward(self, words: Tensor) -> EncodedText:
        """Word indices (B, T), padded with `PAD` at the end, each text with at least one word -> its encoding."""
        mask = words != PAD
        embedded = self.dropout(self.embedding(words))
        packed = pack_padded_sequence(embedded, mask.sum(1).cpu(), batch_first=True, enforce_sorted=False)
        packed_states, (last, _) = self.lstm(packed)
        states, _ = pad_packed_sequence(packed_states, batch_first=True, total_length=words.shape[1])
        directions = 2 if self.lstm.bidirectional else 1
        return EncodedText(states, last[-directions:].transpose(0, 1).flatten(1), mask)


class AnswerHead(nn.Sequential):
    """Features (B, inputs) -> scores (B, answers) by a network with one hidden layer.

    Args:
        inputs: width of the features.
        hidden: units of the hidden layer.
        answers: number of answers.
        dropout: dropout before both layers, in training (0-1).
    """

    def __init__(self, inputs: int, hidden: int, answers: int, dropout: float = 0.0) -> None:
        super().__init__(
            nn.Dropout(dropout),
            nn.Linear(inputs, hidden),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(hidden, answers),
        )


def initialise(network: nn.Module, weights: Callable[[Tensor], Tensor]) -> None:
    """Draw the weights of all linear and convolution layers anew, and set their biases to 0.

    Args:
        network: its layers are changed in place; embeddings and LSTMs keep PyTorch's initialisation.
        weights: fills a tensor of weights, such as `torch.nn.init.xavier_uniform_`. PyTorch's default for these layers
            shrinks the signal with each of them: the scores of a deep network hardly differ from video to video at first.
    """
    for layer in network.modules():
        if isinstance(layer, nn.Linear | nn.Conv2d):
            weights(layer.weight)
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean (B, C) of values (B, T, C) over the items where mask (B, T) is True; zeros where there is none."""
    weights = mask.unsqueeze(-1).to(values.dtype)
    return torch.sum(values * weights, 1) / weights.sum(1).clamp(min=1)

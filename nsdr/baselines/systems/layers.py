"""Layers that several baselines share: the encoder of texts, the answer head, masked attention and the encoding of time."""

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import torch
from msgspec import Meta
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from nsdr.question_parser.tokenizer import PAD
from nsdr.validation import MAX_SIZE

__all__ = ["AnswerHead", "EncodedText", "TextEncoder", "Width", "initialise", "masked_softmax", "time_encoding"]

LONGEST_PERIOD = 10_000.0
"""Longest wavelength of the encoding of time, over 2 pi (Vaswani et al. 2017)."""
Width = Annotated[int, Meta(ge=2, le=MAX_SIZE)]
"""Width of the states of two directions; an odd one is rounded down."""


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
    """Word embeddings and an LSTM of two directions, whose states do not depend on padding.

    Args:
        words: number of word indices; `PAD` is one of them.
        embedding: width of the word embeddings.
        hidden: width H of the states; each direction has half of it, rounded down.
        layers: LSTM layers.
        dropout: dropout of the word embeddings and between layers, in training (0-1).

    Attributes:
        width: H, an even number.
    """

    def __init__(self, words: int, embedding: int, hidden: int, layers: int = 1, dropout: float = 0.0) -> None:
        super().__init__()
        self.width = 2 * (hidden // 2)
        self.embedding = nn.Embedding(words, embedding, padding_idx=PAD)
        self.dropout = nn.Dropout(dropout)
        between = dropout if layers > 1 else 0.0
        self.lstm = nn.LSTM(embedding, hidden // 2, layers, batch_first=True, bidirectional=True, dropout=between)

    def forward(self, words: Tensor) -> EncodedText:
        """Word indices (B, T), padded with `PAD` at the end, each text with at least one word -> its encoding."""
        mask = words != PAD
        embedded = self.dropout(self.embedding(words))
        packed = pack_padded_sequence(embedded, mask.sum(1).cpu(), batch_first=True, enforce_sorted=False)
        packed_states, (last, _) = self.lstm(packed)
        states, _ = pad_packed_sequence(packed_states, batch_first=True, total_length=words.shape[1])
        return EncodedText(states, last[-2:].transpose(0, 1).flatten(1), mask)


class AnswerHead(nn.Sequential):
    """Features (B, inputs) -> scores (B, answers) by a network with one hidden layer; dropout is before both layers."""

    def __init__(self, inputs: int, hidden: int, answers: int, dropout: float = 0.0) -> None:
        layers = (nn.Linear(inputs, hidden), nn.ReLU(), nn.Dropout(dropout), nn.Linear(hidden, answers))
        super().__init__(nn.Dropout(dropout), *layers)


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


def masked_softmax(scores: Tensor, mask: Tensor) -> Tensor:
    """Weights (..., K) of K items by their scores (..., K); 0 for those whose mask (..., K) is False, even for all."""
    weights = scores.masked_fill(~mask, torch.finfo(scores.dtype).min).softmax(-1)
    return weights * mask


def time_encoding(frames: int, width: int, like: Tensor) -> Tensor:
    """Sines and cosines (frames, width) of each frame's index, with wavelengths from 2 pi frames on (Vaswani et al. 2017).

    The result has the device and number format of `like` (of any shape).
    """
    waves = (width + 1) // 2
    frequency = torch.exp(torch.arange(waves, device=like.device) * (-math.log(LONGEST_PERIOD) / waves))
    angle = torch.arange(frames, device=like.device)[:, None] * frequency
    return torch.cat([angle.sin(), angle.cos()], 1)[:, :width].to(like.dtype)

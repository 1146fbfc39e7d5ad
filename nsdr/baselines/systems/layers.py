"""Layers that several baselines share: encoders of texts, objects and feature maps, the answer head, masked attention.

The papers' networks see features of single frames, and have to find motion and contact by attending to several frames. They do
not learn this from as few texts as are used here. `ObjectEncoder` and `MapEncoder` see motion and contact. They run once for
each video, however many questions are asked about it.
"""

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import torch
from msgspec import Meta
from torch import Tensor, nn
from torch.nn import functional as F
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from nsdr.baselines.features.files import BOX_NUMBERS
from nsdr.question_parser.tokenizer import PAD
from nsdr.validation import MAX_SIZE

LONGEST_PERIOD = 10_000.0
"""Longest wavelength of the encoding of time, over 2 pi (Vaswani et al. 2017)."""
Width = Annotated[int, Meta(ge=2, le=MAX_SIZE)]
"""Total width of the states of both directions of an LSTM; odd widths are rounded down."""


VIDEO_LAYERS = 2
"""Layers of `ObjectEncoder` and `MapEncoder`."""
WAVES = tuple(math.pi * 2**k for k in range(6))
"""Frequencies with which boxes are encoded, so that small changes are visible (radians per width or height of the image)."""
OBJECT_FRAMES = 5
"""Number of successive frames that a layer of `ObjectEncoder` sees."""
FRAME_STEP = 2
"""`ObjectEncoder` returns every second frame: attention to all takes twice as long and finds no more."""


class EncodedText(NamedTuple):
    """B texts of up to T words.

    Attributes:
        states: (B, T, H) the states of the LSTM; zeros at padding.
        summary: (B, H) the last states of the last layer in both directions.
        mask: (B, T) bool, False at padding.
    """

    states: Tensor
    summary: Tensor
    mask: Tensor


class TextEncoder(nn.Module):
    """Word embeddings and a bidirectional LSTM whose states do not depend on padding.

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
    """Features (B, inputs) -> scores (B, answers): a network with one hidden layer, with dropout before both layers."""

    def __init__(self, inputs: int, hidden: int, answers: int, dropout: float = 0.0) -> None:
        layers = (nn.Linear(inputs, hidden), nn.ReLU(), nn.Dropout(dropout), nn.Linear(hidden, answers))
        super().__init__(nn.Dropout(dropout), *layers)


def initialise(network: nn.Module, weights: Callable[[Tensor], Tensor]) -> None:
    """Initialise the weights of all linear and convolution layers, and set their biases to 0.

    Args:
        network: its layers are changed in place; embeddings and LSTMs keep PyTorch's initialisation.
        weights: fills a tensor of weights, such as `torch.nn.init.xavier_uniform_`. PyTorch's default for these layers
            shrinks the signal in each of them, so that at first a deep network gives almost the same scores to all videos.
    """
    for layer in network.modules():
        if isinstance(layer, nn.Linear | nn.Conv2d):
            weights(layer.weight)
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)


def masked_softmax(scores: Tensor, mask: Tensor) -> Tensor:
    """Softmax (..., K) of the scores (..., K) of K items; 0 where the mask (..., K) is False, even if it is False for all."""
    weights = scores.masked_fill(~mask, torch.finfo(scores.dtype).min).softmax(-1)
    return weights * mask


def time_encoding(frames: int, width: int, like: Tensor) -> Tensor:
    """Sines and cosines (frames, width) of the index of each frame, with wavelengths of at least 2 pi (Vaswani et al. 2017).

    The result has the device and number format of `like` (of any shape).
    """
    waves = (width + 1) // 2
    frequency = torch.exp(torch.arange(waves, device=like.device) * (-math.log(LONGEST_PERIOD) / waves))
    angle = torch.arange(frames, device=like.device)[:, None] * frequency
    return torch.cat([angle.sin(), angle.cos()], 1)[:, :width].to(like.dtype)


class ObjectEncoder(nn.Module):
    """Encodes objects (V, F, N, C) together with their motion and their relation to the other objects.

    Args:
        inputs: number C of features of an object in a frame.
        width: width W of the encoding.
        dropout: dropout of the inputs, in training (0-1).
    """

    waves: Tensor

    def __init__(self, inputs: int, width: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.register_buffer("waves", torch.tensor(WAVES), persistent=False)
        waves = 2 * len(WAVES) * BOX_NUMBERS
        self.first = nn.Sequential(nn.Dropout(dropout), nn.Linear(inputs + waves + 1, width))
        self.layers = nn.ModuleList(_ObjectLayer(width) for _ in range(VIDEO_LAYERS))
        self.last = nn.LayerNorm(width)

    def forward(self, objects: Tensor, has_object: Tensor) -> tuple[Tensor, Tensor]:
        """Encodings (V, K, W) of the objects in every second frame, in the order of the frames; and which of them exist (V, K).

        Args:
            objects: (V, F, N, C), each object in the same place in all frames.
            has_object: (V, F, N) bool.
        """
        objects = objects.masked_fill(~has_object[..., None], 0.0)
        angles = (objects[..., -BOX_NUMBERS:, None] * self.waves).flatten(-2)
        there = has_object[..., None].to(objects.dtype)
        x = self.first(torch.cat([objects, angles.sin(), angles.cos(), there], -1))
        x = x + time_encoding(x.shape[1], x.shape[-1], x)[:, None]
        for layer in self.layers:
            x = layer(x, has_object)
        return self.last(x)[:, ::FRAME_STEP].flatten(1, 2), has_object[:, ::FRAME_STEP].flatten(1)


class _ObjectLayer(nn.Module):
    """Adds the results of a convolution over time, and of the maximum over pairs with other objects, to each object."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.before_time, self.before_pairs = nn.LayerNorm(width), nn.LayerNorm(width)
        self.over_time = nn.Conv1d(width, width, OBJECT_FRAMES, padding=OBJECT_FRAMES // 2)
        self.one, self.other, self.pair, self.found = (nn.Linear(width, width) for _ in range(4))

    def forward(self, x: Tensor, has_object: Tensor) -> Tensor:
        """(V, F, N, W), (V, F, N) -> (V, F, N, W)."""
        videos, _, things, _ = x.shape
        of_object = self.before_time(x).permute(0, 2, 3, 1).flatten(0, 1)
        x = x + F.elu(self.over_time(of_object)).unflatten(0, (videos, things)).permute(0, 3, 1, 2)
        normal = self.before_pairs(x)
        pairs = F.elu(self.one(normal)[:, :, :, None] + self.other(normal)[:, :, None])  # (V, F, N, N, W)
        pairs = F.elu(self.pair(pairs))  # near in both directions: no single layer finds that
        is_pair = has_object[:, :, None] & ~torch.eye(things, dtype=torch.bool, device=x.device)
        found = pairs.masked_fill(~is_pair[..., None], -1.0).amax(3)  # -1 is the least value of ELU
        return x + self.found(found)


class SpaceConv(nn.Module):
    """Convolution of 3x3 over space, the same in every frame."""

    def __init__(self, inputs: int, outputs: int, dilation: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, padding=dilation, dilation=dilation)

    def forward(self, x: Tensor) -> Tensor:
        """(N, F, h, w, inputs) -> (N, F, h, w, outputs)."""
        images = x.flatten(0, 1).permute(0, 3, 1, 2)
        return self.conv(images).permute(0, 2, 3, 1).unflatten(0, x.shape[:2])


class TimeConv(nn.Module):
    """Convolution of 3 over time, the same at every place."""

    def __init__(self, inputs: int, outputs: int, dilation: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, (3, 1), padding=(dilation, 0), dilation=(dilation, 1))

    def forward(self, x: Tensor) -> Tensor:
        """(N, F, h, w, inputs) -> (N, F, h, w, outputs)."""
        rows = x.flatten(2, 3).permute(0, 3, 1, 2)
        return self.conv(rows).permute(0, 2, 3, 1).unflatten(2, x.shape[2:4])


class MapEncoder(nn.Module):
    """Encodes feature maps together with their neighbourhood in space and time; three more channels hold the coordinates.

    Each channel is standardised first (batch normalisation): an object fills few cells, so its features would be small compared
    with the coordinates. Without this, TbD-net learnt nothing from 128,000 texts with features of the truth. If several
    processes train, each standardises by its own batch.

    Args:
        channels: channels C of the maps.
        width: width W of the encoding.
        dropout: dropout of the maps, in training (0-1).
    """

    def __init__(self, channels: int, width: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.standardise = nn.BatchNorm3d(channels, affine=False)
        self.first = nn.Sequential(nn.Dropout(dropout), nn.Linear(channels + 3, width))
        self.layers = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(width), conv(width, width), nn.ELU())
            for _ in range(VIDEO_LAYERS)
            for conv in (SpaceConv, TimeConv)
        )
        self.last = nn.LayerNorm(width)

    def forward(self, maps: Tensor) -> Tensor:
        """(V, F, C, h, w) -> (V, F, h, w, W)."""
        cells = self.standardise(maps.transpose(1, 2)).permute(0, 2, 3, 4, 1)
        axes = [torch.linspace(-1, 1, n, device=maps.device, dtype=maps.dtype) for n in cells.shape[1:4]]
        coordinates = torch.stack(torch.meshgrid(*axes, indexing="ij"), -1)
        x = self.first(torch.cat([cells, coordinates.expand(len(cells), -1, -1, -1, -1)], -1))
        for layer in self.layers:
            x = x + layer(x)
        encoded: Tensor = self.last(x)
        return encoded

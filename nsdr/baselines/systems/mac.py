"""MAC (V) and MAC (V+): recurrent cells that attend to words, then to frames and their parts, and write to a memory.

Source: Hudson & Manning 2018, "Compositional attention networks for machine reasoning" (MAC), and Yi et al. 2020, "CLEVRER:
Collision Events for Video Representation and Reasoning", which adds a temporal attention unit over the frames (V) and object
information (V+).

Differs from the paper:
    - In each step, the temporal attention unit scores the maximum over each frame's cells, as MAC's read unit scores cells. The
      read unit attends to the weighted sum of the frames, which is one map. Yi et al. do not describe their unit further.
    - Features are those of `ObjectEncoder` and `MapEncoder`, which see motion and contact; in MAC, they come from two
      convolutions over one image. Sines and cosines of the frame's index are added, so that the network can tell the order of
      the frames.
    - MAC (V+) reads detected objects (features and box) of all frames at once instead of feature maps. Yi et al. do not say
      in enough detail how they give object information to the network. The frame parser's attributes are not given.
    - Words, features, the memory that is read and the answer have the same rate of dropout; in MAC, each has its own.
      Dropout of the memory is drawn anew in each step.
    - The write unit has neither of MAC's optional parts: self-attention to earlier memories, and a gate.
    - Linear and convolution layers start from Xavier's weights, as in MAC's code as far as we know; LSTMs from PyTorch's.
    - Word embeddings are learnt with the network; none are trained beforehand.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import (
    AnswerHead,
    MapEncoder,
    ObjectEncoder,
    TextEncoder,
    Width,
    initialise,
    masked_softmax,
    time_encoding,
)
from nsdr.validation import Settings, Share, Size


@dataclass(frozen=True)
class MacConfig(Settings):
    """Settings of `Mac` and `MacObjects`.

    Attributes:
        embedding: width of the word embeddings.
        width: width of the control, the memory and the features; an odd one is rounded down.
        steps: reasoning steps.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    width: Width = 512
    steps: Size = 12
    dropout: Share = 0.15


class Mac(Baseline):
    """MAC (V): in each step, temporal attention sums the frames' maps to one, and the read unit attends to its cells."""

    needs = frozenset({"maps"})
    Config = MacConfig

    def __init__(self, config: MacConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.reasoning = _Reasoning(config, sizes)
        width = self.reasoning.width
        self.encode = MapEncoder(sizes.channels, width, config.dropout)
        self.over_frames = _ReadAttention(width)
        self.over_cells = _ReadAttention(width)
        initialise(self, nn.init.xavier_uniform_)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.maps is not None
        cells = self.encode(batch.maps).flatten(2, 3)
        cells = cells + time_encoding(cells.shape[1], self.reasoning.width, cells)[:, None]
        summaries = self.over_frames.projected(cells.amax(2)).of(batch.video)

        def read(control: Tensor, memory: Tensor) -> Tensor:
            frame_weights = self.over_frames(control, memory, summaries)
            latent = _of_videos(frame_weights, cells.flatten(2), batch.video).unflatten(1, cells.shape[2:])
            return _weighted(self.over_cells(control, memory, self.over_cells.projected(latent)), latent)

        return self.reasoning(batch.words, read)


class MacObjects(Baseline):
    """MAC (V+): in each step, the read unit attends to the objects of all frames."""

    needs = frozenset({"objects"})
    Config = MacConfig

    def __init__(self, config: MacConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.reasoning = _Reasoning(config, sizes)
        width = self.reasoning.width
        self.encode = ObjectEncoder(sizes.channels + 4, width, config.dropout)
        self.over_objects = _ReadAttention(width)
        initialise(self, nn.init.xavier_uniform_)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.objects is not None
        assert batch.has_object is not None
        objects, has_object = self.encode(batch.objects, batch.has_object)
        projected, mask = self.over_objects.projected(objects).of(batch.video), has_object[batch.video]

        def read(control: Tensor, memory: Tensor) -> Tensor:
            return _of_videos(self.over_objects(control, memory, projected, mask), objects, batch.video)

        return self.reasoning(batch.words, read)


def _weighted(weights: Tensor, items: Tensor) -> Tensor:
    """Weighted sum (B, W) of items (B, K, W), with weights (B, K)."""
    return torch.bmm(weights[:, None], items)[:, 0]


def _of_videos(weights: Tensor, items: Tensor, video: Tensor) -> Tensor:
    """Weighted sum (B, W) of the items (V, K, W) of each text's video (B,), with weights (B, K).

    There is one product for each video, because copying the items for every text takes most of the time on a CPU.
    """
    found = weights.new_zeros(len(weights), items.shape[2])
    for row, of_video in enumerate(items):
        texts = (video == row).nonzero()[:, 0]
        product = weights[texts] @ of_video.to(weights.dtype)  # of fewer bits under autocast
        found = found.index_copy(0, texts, product.to(found.dtype))
    return found


class _Projected(NamedTuple):
    """What a read unit needs to know about its items in every step: `item` and `kept`, both (..., K, W)."""

    item: Tensor
    kept: Tensor

    def of(self, rows: Tensor) -> "_Projected":
        """The same for the given rows (B,) of the first axis."""
        return _Projected(self.item[rows], self.kept[rows])


class _ReadAttention(nn.Module):
    """The attention of MAC's read unit: which items fit the control, given the memory."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = width
        self.memory = nn.Linear(width, width)
        self.item = nn.Linear(width, width)
        self.join = nn.Linear(2 * width, width)
        self.score = nn.Linear(width, 1)

    def projected(self, items: Tensor) -> _Projected:
        """The part of the read unit that is the same in every step, for items (..., K, W): their projection, and what they add
        to the joined features."""
        return _Projected(self.item(items), F.linear(items, self.join.weight[:, self.width :], self.join.bias))

    def forward(self, control: Tensor, memory: Tensor, items: _Projected, mask: Tensor | None = None) -> Tensor:
        """Control and memory (B, W), items (B, K, W), mask (B, K) -> weights (B, K)."""
        interaction = self.memory(memory)[:, None] * items.item
        joined = F.elu(F.linear(interaction, self.join.weight[:, : self.width]) + items.kept)
        scores = self.score(F.elu(control[:, None] * joined))[..., 0]
        return scores.softmax(1) if mask is None else masked_softmax(scores, mask)


class _Reasoning(nn.Module):
    """The text encoder, the control and write units, and the answer head. The caller gives the read unit."""

    def __init__(self, config: MacConfig, sizes: Sizes) -> None:
        super().__init__()
        self.text = TextEncoder(sizes.words, config.embedding, config.width, dropout=config.dropout)
        self.width = width = self.text.width
        self.first_control = nn.Parameter(torch.randn(width))
        self.first_memory = nn.Parameter(torch.randn(width))
        self.question_of_step = nn.ModuleList(nn.Linear(width, width) for _ in range(config.steps))
        self.control = nn.Linear(2 * width, width)
        self.word_score = nn.Linear(width, 1)
        self.write = nn.Linear(2 * width, width)
        self.dropout = nn.Dropout(config.dropout)
        self.question = nn.Linear(width, width)
        self.answer = AnswerHead(2 * width, width, sizes.answers, config.dropout)

    def forward(self, words: Tensor, read: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
        """Words (B, T) -> scores (B, answers). `read` maps control and memory, both (B, W), to what is read (B, W)."""
        text = self.text(words)
        control, memory = self.first_control.expand(len(words), -1), self.first_memory.expand(len(words), -1)
        for question_of_step in self.question_of_step:
            query = self.control(torch.cat([control, question_of_step(text.summary)], 1))
            word_scores = self.word_score(query[:, None] * text.states)[..., 0]
            control = _weighted(masked_softmax(word_scores, text.mask), text.states)
            found = read(control, self.dropout(memory))
            memory = self.write(torch.cat([found, memory], 1))
        scores: Tensor = self.answer(torch.cat([self.question(text.summary), memory], 1))
        return scores

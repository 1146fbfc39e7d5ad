"""MAC (V) and MAC (V+): recurrent cells that attend to the words, then to the frames and their parts, and write to a memory.

Source: Hudson & Manning 2018, "Compositional attention networks for machine reasoning" (MAC), and Yi et al. 2020, "CLEVRER:
Collision Events for Video Representation and Reasoning", which adds a temporal attention unit over the frames (V) and object
information (V+).

Differs from the paper:
    - The temporal attention unit scores the mean of each frame's cells as MAC's read unit scores cells, anew in each step. Its
      weights sum the frames to one map, which the read unit attends to. Yi et al. do not describe their unit further.
    - Sines and cosines of the frame's index are added to the features, so that the network can tell the order of the frames.
    - MAC (V+) reads detected objects (features and box) of all frames at once instead of feature maps. Yi et al. do not say
      in enough detail how they give object information to the network. The frame parser's attributes are not given.
    - One rate of dropout for the words, the features, the memory that is read and the answer, where MAC has one each. Dropout
      of the memory is drawn anew in each step.
    - Linear and convolution layers start from Xavier's weights, as in MAC's code as far as we know; LSTMs from PyTorch's.
    - Word embeddings are learnt with the network; none are trained beforehand.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import torch
from msgspec import Meta
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.attention import masked_softmax, time_encoding
from nsdr.baselines.systems.layers import AnswerHead, TextEncoder, initialise
from nsdr.validation import MAX_SIZE, Settings, Share, Size

__all__ = ["Mac", "MacConfig", "MacObjects"]


@dataclass(frozen=True)
class MacConfig(Settings):
    """Settings of `Mac` and `MacObjects`.

    Attributes:
        embedding: width of the word embeddings.
        width: width of the control, the memory and the features; an odd one is rounded down.
        steps: reasoning steps.
        self_attention: whether the write unit attends to the memories of earlier steps.
        memory_gate: whether the write unit can keep the old memory.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    width: Annotated[int, Meta(ge=2, le=MAX_SIZE)] = 512
    steps: Size = 12
    self_attention: bool = False
    memory_gate: bool = False
    dropout: Share = 0.15


class Mac(Baseline):
    """MAC (V): in each step, temporal attention sums the frames' maps to one, and the read unit attends to its cells."""

    needs = frozenset({"maps"})
    Config = MacConfig

    def __init__(self, config: MacConfig, sizes: Sizes) -> None:
        super().__init__()
        self.reasoning = _Reasoning(config, sizes)
        width = self.reasoning.width
        self.stem = nn.Sequential(
            nn.Dropout(config.dropout),
            nn.Conv2d(sizes.channels, width, 3, padding=1),
            nn.ELU(),
            nn.Dropout(config.dropout),
            nn.Conv2d(width, width, 3, padding=1),
            nn.ELU(),
        )
        self.over_frames = _ReadAttention(width)
        self.over_cells = _ReadAttention(width)
        initialise(self, nn.init.xavier_uniform_)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.maps is not None
        videos, frames = batch.maps.shape[:2]
        cells = self.stem(batch.maps.flatten(0, 1)).flatten(2).transpose(1, 2).unflatten(0, (videos, frames))
        time = time_encoding(frames, self.reasoning.width, cells)
        summaries = self.over_frames.projected(cells.mean(2) + time).of(batch.video)
        of_texts = (cells + time[:, None]).flatten(2)[batch.video]

        def read(control: Tensor, memory: Tensor) -> Tensor:
            frame_weights = self.over_frames(control, memory, summaries)
            latent = torch.bmm(frame_weights[:, None], of_texts).unflatten(2, cells.shape[2:])[:, 0]
            return _weighted(self.over_cells(control, memory, self.over_cells.projected(latent)), latent)

        return self.reasoning(batch.words, read)


class MacObjects(Baseline):
    """MAC (V+): in each step, the read unit attends to the objects of all frames."""

    needs = frozenset({"objects"})
    Config = MacConfig

    def __init__(self, config: MacConfig, sizes: Sizes) -> None:
        super().__init__()
        self.reasoning = _Reasoning(config, sizes)
        width = self.reasoning.width
        self.stem = nn.Sequential(
            nn.Dropout(config.dropout),
            nn.Linear(sizes.channels + 4, width),
            nn.ELU(),
            nn.Dropout(config.dropout),
            nn.Linear(width, width),
            nn.ELU(),
        )
        self.over_objects = _ReadAttention(width)
        initialise(self, nn.init.xavier_uniform_)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.objects is not None
        assert batch.has_object is not None
        objects = self.stem(batch.objects)
        objects = objects + time_encoding(objects.shape[1], self.reasoning.width, objects)[:, None]
        objects = objects.flatten(1, 2)
        of_texts, projected = objects[batch.video], self.over_objects.projected(objects).of(batch.video)
        mask = batch.has_object.flatten(1)[batch.video]
        return self.reasoning(
            batch.words,
            lambda control, memory: _weighted(self.over_objects(control, memory, projected, mask), of_texts),
        )


def _weighted(weights: Tensor, items: Tensor) -> Tensor:
    """Sum (B, W) of items (B, K, W) with weights (B, K)."""
    return torch.bmm(weights[:, None], items)[:, 0]


class _Projected(NamedTuple):
    """What a read unit needs of its items in every step: `item` and `kept`, both (..., K, W)."""

    item: Tensor
    kept: Tensor

    def of(self, rows: Tensor) -> "_Projected":
        """Those of some rows (B,) of the first axis."""
        return _Projected(self.item[rows], self.kept[rows])


class _ReadAttention(nn.Module):
    """Attention of MAC's read unit: which items fit the control, given the memory."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = width
        self.memory = nn.Linear(width, width)
        self.item = nn.Linear(width, width)
        self.join = nn.Linear(2 * width, width)
        self.score = nn.Linear(width, 1)

    def projected(self, items: Tensor) -> _Projected:
        """Items (..., K, W), as far as they are the same in every step: projected, and their share of the joined features."""
        return _Projected(self.item(items), F.linear(items, self.join.weight[:, self.width :], self.join.bias))

    def forward(self, control: Tensor, memory: Tensor, items: _Projected, mask: Tensor | None = None) -> Tensor:
        """Control and memory (B, W), items (B, K, W), mask (B, K) -> weights (B, K)."""
        interaction = self.memory(memory)[:, None] * items.item
        joined = F.elu(F.linear(interaction, self.join.weight[:, : self.width]) + items.kept)
        scores = self.score(F.elu(control[:, None] * joined))[..., 0]
        return scores.softmax(1) if mask is None else masked_softmax(scores, mask)


class _Reasoning(nn.Module):
    """The text's encoder, the control and write units, and the answer; what is read comes from outside.

    Args:
        config: settings.
        sizes: sizes of the vocabulary and the answers.
    """

    def __init__(self, config: MacConfig, sizes: Sizes) -> None:
        super().__init__()
        self.config = config
        self.text = TextEncoder(sizes.words, config.embedding, config.width, dropout=config.dropout)
        self.width = width = self.text.width
        self.first_control = nn.Parameter(torch.randn(width))
        self.first_memory = nn.Parameter(torch.randn(width))
        self.question_of_step = nn.ModuleList(nn.Linear(width, width) for _ in range(config.steps))
        self.control = nn.Linear(2 * width, width)
        self.word_score = nn.Linear(width, 1)
        self.write = nn.Linear(2 * width, width)
        if config.self_attention:
            self.control_score = nn.Linear(width, 1)
            self.earlier_memory = nn.Linear(width, width, bias=False)
            self.new_memory = nn.Linear(width, width)
        if config.memory_gate:
            self.gate = nn.Linear(width, 1)
        self.dropout = nn.Dropout(config.dropout)
        self.question = nn.Linear(width, width)
        self.answer = AnswerHead(2 * width, width, sizes.answers, config.dropout)

    def forward(self, words: Tensor, read: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
        """Words (B, T) -> scores (B, answers); `read` gives the (B, W) that is read with control and memory (B, W)."""
        text = self.text(words)
        controls = [self.first_control.expand(len(words), -1)]
        memories = [self.first_memory.expand(len(words), -1)]
        for question_of_step in self.question_of_step:
            question = question_of_step(text.summary)
            query = self.control(torch.cat([controls[-1], question], 1))
            word_scores = self.word_score(query[:, None] * text.states)[..., 0]
            control = _weighted(masked_softmax(word_scores, text.mask), text.states)
            found = read(control, self.dropout(memories[-1]))
            memories.append(self._written(found, control, controls, memories))
            controls.append(control)
        scores: Tensor = self.answer(torch.cat([self.question(text.summary), memories[-1]], 1))
        return scores

    def _written(self, found: Tensor, control: Tensor, controls: list[Tensor], memories: list[Tensor]) -> Tensor:
        """The new memory, from what was read, the control, and the earlier steps' controls and memories, each (B, W)."""
        memory: Tensor = self.write(torch.cat([found, memories[-1]], 1))
        if self.config.self_attention:
            scores = self.control_score(control[:, None] * torch.stack(controls, 1))[..., 0]
            earlier = _weighted(scores.softmax(1), torch.stack(memories, 1))
            memory = self.earlier_memory(earlier) + self.new_memory(memory)
        if self.config.memory_gate:
            keep = torch.sigmoid(self.gate(control))
            memory = keep * memories[-1] + (1 - keep) * memory
        return memory

"""LSTM, which does not see the video, CNN+MLP and CNN+LSTM.

Source: Yi et al. 2020, "CLEVRER: Collision Events for Video Representation and Reasoning", baselines.

Differs from the paper:
    - The frames' features are normalised (layer normalisation): they may be small beside the text's.
    - Word embeddings are learnt with the network; none are trained beforehand.
    - The widths that the paper does not give are ours.
"""

from dataclasses import dataclass
from typing import Annotated

import torch
from msgspec import Meta
from torch import Tensor, nn

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, TextEncoder, Width
from nsdr.question_parser.tokenizer import PAD
from nsdr.validation import Settings, Share, Size


@dataclass(frozen=True)
class CnnMlpConfig(Settings):
    """Settings of `CnnMlp`.

    Attributes:
        embedding: width of the word embeddings.
        head: units of each hidden layer before the answer.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    head: Size = 512
    dropout: Share = 0.2


@dataclass(frozen=True)
class LstmConfig(CnnMlpConfig):
    """Settings of `Lstm`.

    Attributes:
        hidden: width of the text's encoding; each of two directions has half of it.
        layers: LSTM layers.
    """

    hidden: Width = 512
    layers: Annotated[int, Meta(ge=1, le=100)] = 1


@dataclass(frozen=True)
class CnnLstmConfig(LstmConfig):
    """Settings of `CnnLstm`.

    Attributes:
        video: LSTM units over the frames.
    """

    video: Size = 512


class Lstm(Baseline):
    """A bidirectional LSTM over the words, and an answer head."""

    Config = LstmConfig

    def __init__(self, config: LstmConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.text = TextEncoder(sizes.words, config.embedding, config.hidden, config.layers, config.dropout)
        self.head = AnswerHead(self.text.width, config.head, sizes.answers, config.dropout)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        scores: Tensor = self.head(self.text(batch.words).summary)
        return scores


class CnnMlp(Baseline):
    """A perceptron with two hidden layers, over the mean frame features and the mean word embedding."""

    needs = frozenset({"pooled"})
    Config = CnnMlpConfig

    def __init__(self, config: CnnMlpConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.embedding = nn.Embedding(sizes.words, config.embedding, padding_idx=PAD)
        self.video = nn.LayerNorm(sizes.channels)
        self.join = nn.Linear(sizes.channels + config.embedding, config.head)
        self.head = AnswerHead(config.head, config.head, sizes.answers, config.dropout)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.pooled is not None
        video, is_word = self.video(batch.pooled.mean(1))[batch.video], (batch.words != PAD)[..., None].float()
        text = (self.embedding(batch.words) * is_word).sum(1) / is_word.sum(1).clamp(min=1)
        scores: Tensor = self.head(torch.relu(self.join(torch.cat([video, text], 1))))
        return scores


class CnnLstm(Baseline):
    """Two LSTMs, over the frames of a video and over the words of a text, whose last states an answer head joins."""

    needs = frozenset({"pooled"})
    Config = CnnLstmConfig

    def __init__(self, config: CnnLstmConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        between = config.dropout if config.layers > 1 else 0.0
        self.frame = nn.LayerNorm(sizes.channels)
        self.frames = nn.LSTM(sizes.channels, config.video, config.layers, batch_first=True, dropout=between)
        self.text = TextEncoder(sizes.words, config.embedding, config.hidden, config.layers, config.dropout)
        self.head = AnswerHead(config.video + self.text.width, config.head, sizes.answers, config.dropout)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.pooled is not None
        video = self.frames(self.frame(batch.pooled))[1][0][-1][batch.video]
        scores: Tensor = self.head(torch.cat([video, self.text(batch.words).summary], 1))
        return scores

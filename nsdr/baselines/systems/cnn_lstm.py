"""CNN+LSTM: an LSTM over the frame features and one over the words, joined before the answer.

Source: Yi et al. 2020, "CLEVRER: Collision Events for Video Representation and Reasoning", baselines.

Differs from the paper:
    - Word embeddings are learnt with the network; none are trained beforehand.
    - The widths that the paper does not give are ours.
"""

from dataclasses import dataclass
from typing import Annotated

import torch
from msgspec import Meta
from torch import Tensor, nn

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, TextEncoder
from nsdr.validation import MAX_SIZE, Settings, Share, Size

__all__ = ["CnnLstm", "CnnLstmConfig"]


@dataclass(frozen=True)
class CnnLstmConfig(Settings):
    """Settings of `CnnLstm`.

    Attributes:
        embedding: width of the word embeddings.
        hidden: width of the text's encoding; each of two directions has half of it.
        video: LSTM units over the frames.
        layers: LSTM layers over the words and over the frames.
        head: units of the hidden layer before the answer.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    hidden: Annotated[int, Meta(ge=2, le=MAX_SIZE)] = 512
    video: Size = 512
    layers: Annotated[int, Meta(ge=1, le=100)] = 1
    head: Size = 512
    dropout: Share = 0.2


class CnnLstm(Baseline):
    """Two LSTMs, over the frames of a video and over the words of a text, whose last states an answer head joins."""

    needs = frozenset({"pooled"})
    Config = CnnLstmConfig

    def __init__(self, config: CnnLstmConfig, sizes: Sizes) -> None:
        super().__init__()
        between = config.dropout if config.layers > 1 else 0.0
        self.frames = nn.LSTM(sizes.channels, config.video, config.layers, batch_first=True, dropout=between)
        self.text = TextEncoder(sizes.words, config.embedding, config.hidden, config.layers, dropout=config.dropout)
        self.head = AnswerHead(config.video + self.text.width, config.head, sizes.answers, config.dropout)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.pooled is not None
        video = self.frames(batch.pooled)[1][0][-1][batch.video]
        scores: Tensor = self.head(torch.cat([video, self.text(batch.words).summary], 1))
        return scores

"""LSTM: answers from the question alone, without the video.

Source: Yi et al. 2020, "CLEVRER: Collision Events for Video Representation and Reasoning", baselines.

Differs from the paper:
    - Word embeddings are learnt with the network; none are trained beforehand.
    - The widths that the paper does not give are ours.
"""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta
from torch import Tensor

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, TextEncoder
from nsdr.validation import MAX_SIZE, Settings, Share, Size

__all__ = ["Lstm", "LstmConfig"]


@dataclass(frozen=True)
class LstmConfig(Settings):
    """Settings of `Lstm`.

    Attributes:
        embedding: width of the word embeddings.
        hidden: width of the text's encoding; each of two directions has half of it.
        layers: LSTM layers.
        head: units of the hidden layer before the answer.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    hidden: Annotated[int, Meta(ge=2, le=MAX_SIZE)] = 512
    layers: Annotated[int, Meta(ge=1, le=100)] = 1
    head: Size = 512
    dropout: Share = 0.2


class Lstm(Baseline):
    """A bidirectional LSTM over the words, and an answer head."""

    Config = LstmConfig

    def __init__(self, config: LstmConfig, sizes: Sizes) -> None:
        super().__init__()
        self.text = TextEncoder(sizes.words, config.embedding, config.hidden, config.layers, dropout=config.dropout)
        self.head = AnswerHead(self.text.width, config.head, sizes.answers, config.dropout)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        scores: Tensor = self.head(self.text(batch.words).summary)
        return scores

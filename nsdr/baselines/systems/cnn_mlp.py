"""CNN+MLP: the means of the frame features and of the word embeddings, and a multi-layer perceptron.

Source: Yi et al. 2020, "CLEVRER: Collision Events for Video Representation and Reasoning", baselines.

Differs from the paper:
    - Word embeddings are learnt with the network; none are trained beforehand.
    - The widths that the paper does not give are ours.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, masked_mean
from nsdr.question_parser.tokenizer import PAD
from nsdr.validation import Settings, Share, Size

__all__ = ["CnnMlp", "CnnMlpConfig"]


@dataclass(frozen=True)
class CnnMlpConfig(Settings):
    """Settings of `CnnMlp`.

    Attributes:
        embedding: width of the word embeddings.
        head: units of each of the two hidden layers.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    head: Size = 512
    dropout: Share = 0.2


class CnnMlp(Baseline):
    """A perceptron with two hidden layers, over the mean frame features and the mean word embedding."""

    needs = frozenset({"pooled"})
    Config = CnnMlpConfig

    def __init__(self, config: CnnMlpConfig, sizes: Sizes) -> None:
        super().__init__()
        self.embedding = nn.Embedding(sizes.words, config.embedding, padding_idx=PAD)
        self.join = nn.Linear(sizes.channels + config.embedding, config.head)
        self.head = AnswerHead(config.head, config.head, sizes.answers, config.dropout)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.pooled is not None
        video = batch.pooled.mean(1)[batch.video]
        text = masked_mean(self.embedding(batch.words), batch.words != PAD)
        scores: Tensor = self.head(torch.relu(self.join(torch.cat([video, text], 1))))
        return scores

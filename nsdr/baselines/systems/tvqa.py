"""TVQA+: each word of the question attends to the detected objects in all frames; the answer depends on the maximum over words.

Source: Yi et al. 2020, "CLEVRER: Collision Events for Video Representation and Reasoning", whose TVQA+ is a network by Lei et
al. with object features of a video frame parser. That words attend to objects is from Lei et al. 2020, "TVQA+: Spatio-temporal
grounding for video question answering".

Differs from the paper:
    - There are no subtitles, so the only stream is that of the objects. Nothing is trained to find the span of time or the
      object that a question is about.
    - A word attends to the objects of all frames at once; in Lei et al. to those of each frame, and the frames are summed
      afterwards. That learns later; a network whose objects attend to words (Lei et al. 2018) learnt nothing of 96,000 plain
      texts about features of the truth (docs/results_baselines.md).
    - An LSTM encodes the words; in Lei et al. 2020 convolutions and self-attention do.
    - A question and its option are one text, which is scored over all answers. Lei et al. encode them separately and give each
      option one number.
    - Objects are given by features of the shared backbone and their boxes, without the frame parser's attributes.
    - Objects are encoded by `ObjectEncoder`, which sees their motion, their contacts and the frame's index.
    - Word embeddings are learnt with the network; none are trained beforehand.
    - Yi et al. do not state the sizes; those here are those of Lei et al. 2018 as far as they are known to us.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, ObjectEncoder, TextEncoder, Width, initialise, masked_softmax
from nsdr.validation import Settings, Share, Size


@dataclass(frozen=True)
class TvqaConfig(Settings):
    """Settings of `TvqaPlus`.

    Attributes:
        embedding: width of the word embeddings.
        hidden: width of the encodings of words and objects; an odd one is rounded down.
        head: units of the hidden layer before the answer.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    hidden: Width = 300
    head: Size = 500
    dropout: Share = 0.2


class TvqaPlus(Baseline):
    """Fuses each word with the objects that fit it; the answer head reads the maximum over the words."""

    needs = frozenset({"objects"})
    Config = TvqaConfig

    def __init__(self, config: TvqaConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.text = TextEncoder(sizes.words, config.embedding, config.hidden, dropout=config.dropout)
        width = self.text.width
        self.embed = ObjectEncoder(sizes.channels + 4, width, config.dropout)
        self.word, self.last = nn.LayerNorm(width), nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.dropout = nn.Dropout(config.dropout)
        self.fuse = nn.Linear(3 * width, width)
        self.answer = AnswerHead(width, config.head, sizes.answers, config.dropout)
        initialise(self, nn.init.xavier_uniform_)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.objects is not None
        assert batch.has_object is not None
        objects, has_object = self.embed(batch.objects, batch.has_object)
        objects, has_object = objects[batch.video], has_object[batch.video]
        text = self.text(batch.words)
        words = self.word(text.states)
        scores = self.query(words) @ objects.transpose(1, 2) / math.sqrt(words.shape[2])  # (B, T, K)
        found = masked_softmax(scores, has_object[:, None]) @ objects
        fused = F.elu(self.fuse(self.dropout(torch.cat([words, found, words * found], 2))))
        found_most = fused.masked_fill(~text.mask[..., None], -1.0).amax(1)  # -1 is the least value of ELU
        answer: Tensor = self.answer(self.last(found_most))
        return answer

"""TVQA+: the detected objects of all frames attend to the words, between two LSTMs over the objects.

Source: Yi et al. 2020, "CLEVRER: Collision Events for Video Representation and Reasoning", whose TVQA+ is the network of Lei et
al. 2018, "TVQA: Localized, compositional video question answering", with object features of a video frame parser.

Differs from the paper:
    - There are no subtitles, so the only stream is that of the objects, in the order of the frames.
    - A question and its option are one text, which is scored over all answers. Lei et al. encode them separately and give each
      option one number.
    - The LSTM over the words and the first one over the objects do not share weights.
    - Objects are given by features of the shared backbone and their boxes, without the frame parser's attributes.
    - Objects are encoded by `ObjectEncoder`, which sees their motion, their contacts and the frame's index.
    - Word embeddings are learnt with the network; none are trained beforehand.
    - Yi et al. do not state the sizes; those here are those of Lei et al. as far as they are known to us.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, ObjectEncoder, TextEncoder, Width, masked_softmax
from nsdr.validation import Settings, Share, Size

__all__ = ["TvqaConfig", "TvqaPlus"]


@dataclass(frozen=True)
class TvqaConfig(Settings):
    """Settings of `TvqaPlus`.

    Attributes:
        embedding: width of the embeddings of words and objects.
        hidden: width of the LSTMs' states, half of it for each direction; an odd one is rounded down.
        head: units of the hidden layer before the answer.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    hidden: Width = 300
    head: Size = 500
    dropout: Share = 0.2


class TvqaPlus(Baseline):
    """Objects, encoded by an LSTM, are fused with the words that fit them; a second LSTM, and the maximum over all objects."""

    needs = frozenset({"objects"})
    Config = TvqaConfig

    def __init__(self, config: TvqaConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.text = TextEncoder(sizes.words, config.embedding, config.hidden, dropout=config.dropout)
        width = self.text.width
        self.embed = ObjectEncoder(sizes.channels + 4, config.embedding, config.dropout)
        self.encode = _BidirectionalLstm(config.embedding, width)
        self.dropout = nn.Dropout(config.dropout)
        self.fuse = _BidirectionalLstm(3 * width, width)
        self.answer = AnswerHead(width, config.head, sizes.answers, config.dropout)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax. A video without any object is read as one object of zeros."""
        assert batch.objects is not None
        assert batch.has_object is not None
        sequences, lengths = _compact(*self.embed(batch.objects, batch.has_object))
        encoded = self.encode(sequences, lengths)[batch.video]
        text = self.text(batch.words)
        attention = masked_softmax(encoded @ text.states.transpose(1, 2), text.mask[:, None])
        words = attention @ text.states
        fused = self.dropout(torch.cat([encoded, words, encoded * words], 2))
        lengths = lengths[batch.video]
        states = self.fuse(fused, lengths)
        is_object = torch.arange(states.shape[1], device=states.device) < lengths[:, None]
        scores: Tensor = self.answer(states.masked_fill(~is_object[..., None], float("-inf")).amax(1))
        return scores


def _compact(items: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """The items (V, K, W) where the mask (V, K) is True in their order, then zeros; and their numbers (V,), at least 1."""
    order = mask.to(torch.uint8).argsort(dim=1, descending=True, stable=True)
    kept = items.masked_fill(~mask[..., None], 0.0)
    lengths = mask.sum(1).clamp(min=1)
    return kept.gather(1, order[..., None].expand_as(kept))[:, : int(lengths.max())], lengths


class _BidirectionalLstm(nn.Module):
    """An LSTM of two directions over rows of different lengths. Without packing, it trains several times as fast on a CPU.

    Args:
        inputs: width of the items.
        width: width of the states, even; each direction has half of it.
    """

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.ahead = nn.LSTM(inputs, width // 2, batch_first=True)
        self.back = nn.LSTM(inputs, width // 2, batch_first=True)

    def forward(self, items: Tensor, lengths: Tensor) -> Tensor:
        """Items (R, K, I), of which the first `lengths` (R,) of each row count -> states (R, K, W), undefined behind them."""
        index = torch.arange(items.shape[1], device=items.device)
        from_end = lengths[:, None] - 1 - index
        order = torch.where(from_end >= 0, from_end, index)[..., None]
        back = self.back(items.gather(1, order.expand_as(items)))[0]
        return torch.cat([self.ahead(items)[0], back.gather(1, order.expand_as(back))], 2)

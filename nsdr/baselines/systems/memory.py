"""Memory: one memory of the video and one of the question, which attention combines in several steps.

Source: Fan et al. 2019, "Heterogeneous memory enhanced multimodal attention model for video question answering". Yi et al.
2020, "CLEVRER: Collision Events for Video Representation and Reasoning", use it as a baseline.

Differs from the paper:
    - The motion stream reads the differences of the frame features of successive frames, instead of features of a network for
      video clips (C3D).
    - The frames' features are normalised (layer normalisation).
    - The memory attends to its slots with a linear function of the states, and all activations inside of it are tanh.
    - A network with a hidden layer computes the answer from the last states of the fusion, of the question memory, of the video
      memory and of the encoded text. Without the text it learns only how frequent the answers are in our short trainings.
    - Linear layers start from Xavier's weights.
    - Word embeddings are learnt with the network; none are trained beforehand.
    - Yi et al. do not state the sizes; those here are ours, with three steps of fusion.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, TextEncoder, Width, initialise, masked_softmax
from nsdr.validation import Settings, Share, Size


@dataclass(frozen=True)
class MemoryConfig(Settings):
    """Settings of `HeterogeneousMemory`.

    Attributes:
        embedding: width of the word embeddings.
        hidden: width of all states and memory slots; an odd one is rounded down.
        slots: slots of each of the two memories.
        steps: steps of the fusion.
        dropout: dropout in training (0-1).
    """

    embedding: Size = 300
    hidden: Width = 512
    slots: Size = 20
    steps: Size = 3
    dropout: Share = 0.2


class HeterogeneousMemory(Baseline):
    """A memory that appearance and motion write to, a memory of the question, and an LSTM that attends to both."""

    needs = frozenset({"pooled"})
    Config = MemoryConfig

    def __init__(self, config: MemoryConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.text = TextEncoder(sizes.words, config.embedding, config.hidden, dropout=config.dropout)
        width = self.text.width
        self.dropout = nn.Dropout(config.dropout)
        self.frame = nn.LayerNorm(sizes.channels)
        self.appearance = nn.LSTM(sizes.channels, width, batch_first=True)
        self.motion = nn.LSTM(sizes.channels, width, batch_first=True)
        self.video_memory = _Memory(2, width, config.slots)
        self.question_memory = _Memory(1, width, config.slots)
        self.attend_video = _Attention(width)
        self.attend_question = _Attention(width)
        self.of_video = nn.Linear(width, width)
        self.of_question = nn.Linear(width, width)
        self.modality = _Attention(width)
        self.fusion = nn.LSTMCell(width, width)
        self.answer = AnswerHead(4 * width, width, sizes.answers, config.dropout)
        initialise(self, nn.init.xavier_uniform_)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.pooled is not None
        normal = self.frame(batch.pooled)
        frames = self.dropout(normal)
        change = self.dropout(torch.diff(normal, dim=1, prepend=normal[:, :1]))
        streams = torch.stack([self.appearance(frames)[0], self.motion(change)[0]], 2)
        video = self.video_memory(streams, torch.ones_like(frames[..., 0], dtype=torch.bool))[batch.video]
        text = self.text(batch.words)
        question = self.question_memory(text.states[:, :, None], text.mask)
        state = cell = torch.zeros_like(text.summary)
        for _ in range(self.config.steps):
            seen = self.attend_video(state, video)
            asked = self.attend_question(state, question, text.mask)
            both = torch.stack([torch.tanh(self.of_video(seen)), torch.tanh(self.of_question(asked))], 1)
            state, cell = self.fusion(self.modality(state, both), (state, cell))
        scores: Tensor = self.answer(torch.cat([state, question[:, -1], video[:, -1], text.summary], 1))
        return scores


class _Attention(nn.Module):
    """Additive attention of a state to items."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.state = nn.Linear(width, width, bias=False)
        self.item = nn.Linear(width, width)
        self.score = nn.Linear(width, 1, bias=False)

    def forward(self, state: Tensor, items: Tensor, mask: Tensor | None = None) -> Tensor:
        """State (B, W), items (B, K, W), mask (B, K) -> weighted mean (B, W) of the items."""
        scores = self.score(torch.tanh(self.state(state)[:, None] + self.item(items)))[..., 0]
        weights = scores.softmax(1) if mask is None else masked_softmax(scores, mask)
        return torch.bmm(weights[:, None], items)[:, 0]


class _Memory(nn.Module):
    """Slots that one or several streams of inputs write to in each step, and that are then read.

    Args:
        streams: number of streams S.
        width: width W of the inputs, the states and the slots.
        slots: number of slots.
    """

    def __init__(self, streams: int, width: int, slots: int) -> None:
        super().__init__()
        self.streams, self.slots = streams, slots
        self.contents = nn.ModuleList(nn.Linear(2 * width, width) for _ in range(streams))
        everything = (2 * streams + 1) * width
        self.write_slots = nn.Linear(everything, slots)
        self.write_shares = nn.Linear(everything, streams + 1)
        self.read_slots = nn.Linear(everything, slots)
        self.stream_states = nn.ModuleList(nn.Linear(3 * width, width) for _ in range(streams))
        self.memory_state = nn.Linear(2 * width, width)

    def forward(self, inputs: Tensor, mask: Tensor) -> Tensor:
        """Inputs (R, T, S, W), mask (R, T) -> state (R, T, W) of the memory after each step; masked steps do not change it."""
        rows, steps, _, width = inputs.shape
        slots = inputs.new_zeros(rows, self.slots, width)
        state = inputs.new_zeros(rows, width)
        stream_states = [inputs.new_zeros(rows, width) for _ in range(self.streams)]
        states = []
        for step in range(steps):
            now = inputs[:, step].unbind(1)
            everything = torch.cat([*now, *stream_states, state], 1)
            contents = [
                torch.tanh(content(torch.cat([x, h], 1)))
                for content, x, h in zip(self.contents, now, stream_states, strict=True)
            ]
            shares = self.write_shares(everything).softmax(1)
            content = (shares[:, :-1, None] * torch.stack(contents, 1)).sum(1)
            written = self.write_slots(everything).softmax(1)[..., None]
            slots = _where(mask[:, step], slots * shares[:, -1:, None] + written * content[:, None], slots)
            read = torch.bmm(self.read_slots(everything).softmax(1)[:, None], slots)[:, 0]
            next_states = [
                torch.tanh(update(torch.cat([x, h, read], 1)))
                for update, x, h in zip(self.stream_states, now, stream_states, strict=True)
            ]
            stream_states = [
                _where(mask[:, step], new, old) for new, old in zip(next_states, stream_states, strict=True)
            ]
            state = _where(mask[:, step], torch.tanh(self.memory_state(torch.cat([state, read], 1))), state)
            states.append(state)
        return torch.stack(states, 1)


def _where(mask: Tensor, new: Tensor, old: Tensor) -> Tensor:
    """Rows (R, ...) of `new` where the mask (R,) is True, else those of `old`."""
    return torch.where(mask.view(-1, *[1] * (new.dim() - 1)), new, old)

"""Sequence-to-sequence network from words to program tokens (paper, section 4.3)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from msgspec import Meta
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from nsdr.question_parser.constraint import allowed, first_stack, following
from nsdr.question_parser.tokenizer import END, PAD, START
from nsdr.validation import MAX_SIZE, Settings, Share, Size
from nsdr.world.vocabulary import Vocabulary

MAX_LAYERS = 100
"""Largest `QuestionParserConfig.layers`."""


@dataclass(frozen=True)
class QuestionParserConfig(Settings):
    """Architecture of each of the three networks.

    Attributes:
        embedding: width of the word and token embeddings (paper: 300).
        hidden: LSTM units of the decoder; each direction of the encoder has half as many (paper: 256).
        layers: LSTM layers of the encoder and of the decoder.
        dropout: dropout between layers in training (0-1).
        max_tokens: length of the longest program that is decoded (tokens).
    """

    embedding: Size = 64
    hidden: Annotated[int, Meta(ge=2, le=MAX_SIZE)] = 192
    layers: Annotated[int, Meta(ge=1, le=MAX_LAYERS)] = 2
    dropout: Share = 0.0
    max_tokens: Size = 40


class ParserNetwork(nn.Module):
    """Bidirectional LSTM encoder, and LSTM decoder with dot-product attention over the encoder's states.

    Differs from the paper: by default 192 units and 64-d embeddings instead of 256 and 300.

    Args:
        n_words: size of the word vocabulary, padding included.
        n_tokens: size of the program vocabulary, padding included.
        config: architecture.
    """

    def __init__(self, n_words: int, n_tokens: int, config: QuestionParserConfig) -> None:
        super().__init__()
        self.config = config
        hidden = config.hidden
        self.words = nn.Embedding(n_words, config.embedding, padding_idx=PAD)
        self.tokens = nn.Embedding(n_tokens, config.embedding, padding_idx=PAD)
        self.encoder = nn.LSTM(
            config.embedding, hidden // 2, config.layers, batch_first=True, bidirectional=True, dropout=config.dropout
        )
        self.decoder = nn.LSTM(config.embedding, hidden, config.layers, batch_first=True, dropout=config.dropout)
        self.join = nn.Linear(2 * hidden, hidden)
        self.output = nn.Linear(hidden, n_tokens)

    def encode(self, words: Tensor) -> tuple[Tensor, tuple[Tensor, Tensor], Tensor]:
        """Words (B, T) -> states (B, T, H), initial state of the decoder, and mask (B, T) that is False for padding."""
        mask = words != PAD
        packed = pack_padded_sequence(self.words(words), mask.sum(1).cpu(), batch_first=True, enforce_sorted=False)
        packed_states, (h, c) = self.encoder(packed)
        states, _ = pad_packed_sequence(packed_states, batch_first=True, total_length=words.shape[1])
        return states, (self._joined_directions(h), self._joined_directions(c)), mask

    def _joined_directions(self, state: Tensor) -> Tensor:
        """(2 layers, B, H/2) -> (layers, B, H)."""
        layers, batch, half = state.shape
        return state.view(layers // 2, 2, batch, half).transpose(1, 2).reshape(layers // 2, batch, 2 * half)

    def decode(
        self, tokens: Tensor, states: Tensor, mask: Tensor, state: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Tokens (B, S) -> logits (B, S, n_tokens) of the tokens that follow each, and the new state of the decoder."""
        out, state = self.decoder(self.tokens(tokens), state)
        scores = (out @ states.transpose(1, 2)).masked_fill(~mask[:, None], float("-inf"))
        context = scores.softmax(-1) @ states
        return self.output(torch.tanh(self.join(torch.cat([out, context], -1)))), state

    def forward(self, words: Tensor, tokens: Tensor) -> Tensor:
        """Words (B, T) and true tokens (B, S) from `<start>` on -> logits (B, S, n_tokens) of the tokens that follow each."""
        states, state, mask = self.encode(words)
        return self.decode(tokens, states, mask, state)[0]

    @torch.no_grad()
    def search(self, words: Tensor, kind: str, vocabulary: Vocabulary) -> tuple[list[list[int]], list[float]]:
        """Programs of the most probable token that the signature table permits after each (greedy search, `constraint`).

        Args:
            words: (B, T) word indices, on any device.
            kind: kind of the texts.
            vocabulary: of the program tokens.

        Returns:
            Token indices of each text's program, and its probability among all token sequences (0-1). The constraint does not
            renormalise probabilities.
        """
        self.eval()
        words = words.to(self.output.weight.device)
        states, state, mask = self.encode(words)
        batch, device = len(words), words.device
        token = torch.full((batch, 1), START, device=device)
        score = torch.zeros(batch, device=device)
        rows: list[list[int]] = [[] for _ in range(batch)]
        stacks, running = [first_stack(kind)] * batch, [True] * batch
        for step in range(self.config.max_tokens):
            logits, state = self.decode(token, states, mask, state)
            scores = logits[:, 0].log_softmax(-1)
            masks = np.stack([allowed(stack, kind, step == 0, vocabulary) for stack in stacks])
            scores = scores.masked_fill(~torch.from_numpy(masks).to(device), float("-inf"))
            best, token = scores.max(-1, keepdim=True)
            score += best[:, 0] * torch.tensor(running, device=device)
            for i, t in enumerate(token[:, 0].tolist()):
                running[i] = running[i] and t not in (PAD, END)
                if running[i]:
                    rows[i].append(t)
                stacks[i] = following(stacks[i], t, vocabulary) if running[i] else None
            if not any(running):
                break
        return rows, score.exp().tolist()

"""Sequence-to-sequence network from words to program tokens (paper, section 4.3)."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from nsdr.question_parser.tokenizer import END, PAD, START

__all__ = ["ParserNetwork", "QuestionParserConfig"]


@dataclass(frozen=True)
class QuestionParserConfig:
    """Sizes of each of the three networks.

    Attributes:
        embedding: width of word and token embeddings.
        hidden: LSTM units (each direction of the encoder has half of them).
        layers: LSTM layers of encoder and decoder.
        dropout: between layers, in training.
        max_tokens: longest program.
    """

    embedding: int = 64
    hidden: int = 192
    layers: int = 2
    dropout: float = 0.0
    max_tokens: int = 40


class ParserNetwork(nn.Module):
    """Bidirectional LSTM encoder, LSTM decoder with dot-product attention over the encoder's states.

    Differs from the paper: 192 units and 64-d embeddings instead of 256 and 300 (configurable).

    Args:
        n_words: size of the word vocabulary, padding included.
        n_tokens: size of the program vocabulary, padding included.
        config: sizes.
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
        """Words (B, T) -> states (B, T, H), the decoder's first state, and the mask (B, T) of real words."""
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
        """Tokens (B, S) so far -> logits (B, S, n_tokens) of the next ones, and the decoder's state."""
        out, state = self.decoder(self.tokens(tokens), state)
        scores = (out @ states.transpose(1, 2)).masked_fill(~mask[:, None], float("-inf"))
        context = scores.softmax(-1) @ states
        return self.output(torch.tanh(self.join(torch.cat([out, context], -1)))), state

    def forward(self, words: Tensor, tokens: Tensor) -> Tensor:
        """Teacher forcing: words (B, T), tokens (B, S) from `<start>` on -> logits (B, S, n_tokens)."""
        states, state, mask = self.encode(words)
        return self.decode(tokens, states, mask, state)[0]

    @torch.no_grad()
    def greedy(self, words: Tensor) -> tuple[list[list[int]], list[float]]:
        """Most probable token after token: for words (B, T) the token indices of each text and their probability."""
        self.eval()
        states, state, mask = self.encode(words)
        batch = len(words)
        token = torch.full((batch, 1), START, device=words.device)
        log_probability = torch.zeros(batch, device=words.device)
        ended = torch.zeros(batch, dtype=torch.bool, device=words.device)
        columns = []
        for _ in range(self.config.max_tokens):
            logits, state = self.decode(token, states, mask, state)
            best, token = logits.log_softmax(-1).max(-1)
            log_probability += best[:, 0].masked_fill(ended, 0.0)
            columns.append(token[:, 0].masked_fill(ended, PAD))
            ended |= token[:, 0] == END
            if bool(ended.all()):
                break
        rows = torch.stack(columns, 1).tolist()
        return [[t for t in row if t not in (PAD, END)] for row in rows], log_probability.exp().tolist()

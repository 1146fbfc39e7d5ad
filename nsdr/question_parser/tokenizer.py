"""Indices of words and program tokens."""

import re
from collections.abc import Iterable, Sequence
from functools import cache

from nsdr.errors import QuestionError
from nsdr.symbolic.modules import MODULES, program_words
from nsdr.world.vocabulary import Vocabulary

PAD, START, END = 0, 1, 2
"""Indices of the special tokens; 0 is also the padding of words."""
OTHER = "<other>"
"""The only token of a text of another kind than the network's."""

_WORD = re.compile(r"'s\b|[^\W_]+")


@cache
def decoder_tokens(vocabulary: Vocabulary) -> tuple[str, ...]:
    """The tokens of the decoder: special ones, CLEVRER's modules, and the words of programs."""
    modules = (name for name, module in MODULES.items() if module.in_data_set)
    return ("<pad>", "<start>", "<end>", OTHER, *modules, *program_words(vocabulary))


def split_words(text: str) -> list[str]:
    """Words of a text in lower case, without punctuation; the possessive 's is a word of its own."""
    return _WORD.findall(text.lower().replace("\u2019", "'").replace("\u2018", "'"))


class Tokenizer:
    """Word indices of a fixed vocabulary, from 1 on; 0 is padding.

    Args:
        words: known words, in the order of their indices.
    """

    def __init__(self, words: Sequence[str]) -> None:
        self.words = tuple(words)
        self._index = {word: i for i, word in enumerate(self.words, 1)}

    @classmethod
    def from_texts(cls, texts: Iterable[str]) -> "Tokenizer":
        """Tokenizer of all words in the texts, in alphabetical order."""
        return cls(sorted({word for text in texts for word in split_words(text)}))

    def __len__(self) -> int:
        return len(self.words) + 1

    def known(self, text: str) -> list[int]:
        """Word indices of a text without its unknown words."""
        return [self._index[word] for word in split_words(text) if word in self._index]

    def encode(self, text: str) -> list[int]:
        """Word indices of a text.

        Raises:
            QuestionError: an empty text or an unknown word; names it.
        """
        words = split_words(text)
        if not words:
            raise QuestionError(f"the text {text!r} is empty")
        for word in words:
            if word not in self._index:
                raise QuestionError(f"unknown word {word!r:.40} in {text!r:.200}")
        return [self._index[word] for word in words]

"""Words and program tokens as indices."""

import difflib
import re
import warnings
from collections.abc import Iterable, Sequence

from nsdr.errors import QuestionError
from nsdr.symbolic.modules import MODULES, WORDS

__all__ = ["OTHER", "PAD", "PROGRAM_TOKENS", "Tokenizer", "split_words"]

PAD, START, END = 0, 1, 2
OTHER = "<other>"
"""What a network says of a text that is not of its kind."""

PROGRAM_TOKENS = ("<pad>", "<start>", "<end>", OTHER, *(name for name, m in MODULES.items() if m.in_data_set), *WORDS)
"""The decoder's vocabulary, from the signature table."""

_WORD = re.compile(r"'s\b|[^\W_]+")


def split_words(text: str) -> list[str]:
    """Words of a text: lower case, without punctuation, the possessive 's as a word of its own."""
    return _WORD.findall(text.lower().replace("\u2019", "'").replace("\u2018", "'"))


class Tokenizer:
    """Word indices of a fixed vocabulary. Index 0 is padding.

    Args:
        words: known words, in order.
    """

    def __init__(self, words: Sequence[str]) -> None:
        self.words = tuple(words)
        self._index = {word: i for i, word in enumerate(self.words, 1)}

    @classmethod
    def from_texts(cls, texts: Iterable[str]) -> "Tokenizer":
        """Vocabulary of all words of the texts, in alphabetical order."""
        return cls(sorted({word for text in texts for word in split_words(text)}))

    def __len__(self) -> int:
        return len(self.words) + 1

    def encode(self, text: str, unknown: str = "error") -> list[int]:
        """Word indices of a text.

        Args:
            text: in English.
            unknown: "error", or "ignore" to warn and leave out words that are not known.

        Raises:
            QuestionError: an empty text, or a word that is not known; names it and the nearest known ones.
        """
        words = split_words(text)
        if not words:
            raise QuestionError(f"the text {text!r} is empty")
        strange = [word for word in words if word not in self._index]
        if strange:
            near = difflib.get_close_matches(strange[0], self.words, n=3, cutoff=0.5)
            hint = f"; did you mean {', '.join(near)}?" if near else "; docs/questions.md lists the known wordings"
            message = f"unknown word {strange[0]!r} in {text!r}{hint}"
            if unknown == "error" or len(strange) == len(words):
                raise QuestionError(message)
            warnings.warn(f"{message} (ignored)", stacklevel=2)
        return [self._index[word] for word in words if word in self._index]

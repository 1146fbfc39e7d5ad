"""Words, program tokens and answers of the baselines as indices."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions
from nsdr.errors import DataError, QuestionError
from nsdr.question_parser.tokenizer import END, PAD, PROGRAM_TOKENS, Tokenizer

__all__ = ["CHOICE_ANSWERS", "PAD", "PROGRAM_SEPARATOR", "Vocabulary", "encode_program"]

CHOICE_ANSWERS = ("correct", "wrong")
"""Answers to an option, the last two of all answers; the others are those to descriptive questions."""
PROGRAM_SEPARATOR = END
"""Token between the question's program and the option's."""
_TOKEN_INDEX = {token: i for i, token in enumerate(PROGRAM_TOKENS)}


@dataclass(frozen=True)
class Vocabulary:
    """Indices of the words and answers of the training questions.

    A text is the words of a question, and for an option `separator` and the words of the option.

    Attributes:
        words: known words, whose indices begin at 1; 0 is `PAD`.
        answers: answers to descriptive questions in alphabetical order, then `CHOICE_ANSWERS`.
    """

    words: tuple[str, ...]
    answers: tuple[str, ...]
    _tokenizer: Tokenizer = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.answers[-len(CHOICE_ANSWERS) :] != CHOICE_ANSWERS:
            raise DataError(f"answers end with {self.answers[-2:]}; expected {' and '.join(CHOICE_ANSWERS)}")
        object.__setattr__(self, "_tokenizer", Tokenizer(self.words))

    @classmethod
    def from_questions(cls, scenes: Iterable[SceneQuestions]) -> "Vocabulary":
        """The vocabulary of training questions."""
        questions = [q for scene in scenes for q in scene.questions]
        texts = {text for q in questions for text in (q.text, *(c.text for c in q.choices))}
        answers = sorted({q.answer for q in questions if q.answer is not None})
        return cls(Tokenizer.from_texts(texts).words, (*answers, *CHOICE_ANSWERS))

    @property
    def separator(self) -> int:
        """Index of the word between a question and an option, the highest one."""
        return len(self.words) + 1

    @property
    def size(self) -> int:
        """Number of word indices, with those of `PAD` and `separator`."""
        return len(self.words) + 2

    def encode_text(self, question: Question, choice: Choice | None = None) -> list[int]:
        """Word indices of a question, or of a question with one of its options.

        Raises:
            QuestionError: an empty text, or a word that did not occur in training; names it.
        """
        words = self._encoded(question.text)
        return words if choice is None else [*words, self.separator, *self._encoded(choice.text)]

    def _encoded(self, text: str) -> list[int]:
        try:
            return self._tokenizer.encode(text)
        except QuestionError as e:
            reason = str(e).partition(";")[0]
            raise QuestionError(f"{reason}; the baseline knows the {len(self.words)} words of its training") from e

    def answer_index(self, answer: str) -> int | None:
        """Index of an answer; None for one that did not occur in training."""
        return self.answers.index(answer) if answer in self.answers else None

    def possible_answers(self) -> Tensor:
        """(2, answers) bool: the answers to descriptive questions, and those to options."""
        is_choice = torch.tensor([answer in CHOICE_ANSWERS for answer in self.answers])
        return torch.stack([~is_choice, is_choice])


def encode_program(question: Question, choice: Choice | None = None) -> list[int]:
    """Program token indices of a question, and for an option `PROGRAM_SEPARATOR` and the option's.

    Raises:
        QuestionError: there is no program, or a token is none of the vocabulary; names it.
    """
    tokens = _token_indices(question.program, question.text)
    return tokens if choice is None else [*tokens, PROGRAM_SEPARATOR, *_token_indices(choice.program, choice.text)]


def _token_indices(program: Sequence[str] | None, text: str) -> list[int]:
    if program is None:
        raise QuestionError(f"{text!r} has no program; parse the questions, or give a file with programs")
    unknown = [token for token in program if token not in _TOKEN_INDEX]
    if unknown:
        raise QuestionError(f"the program of {text!r} has the unknown token {unknown[0]!r}")
    return [_TOKEN_INDEX[token] for token in program]

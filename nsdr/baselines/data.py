"""Turns questions and features of videos into the `Batch` of a baseline."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from nsdr.baselines.base import Batch, Sizes
from nsdr.baselines.features.files import KINDS, Features
from nsdr.baselines.features.words import recolored
from nsdr.baselines.q_type import OPTION_ANSWERS
from nsdr.clevrer.files.questions import PLAIN, Choice, Question, SceneQuestions
from nsdr.errors import DataError, QuestionError
from nsdr.question_parser.tokenizer import END, PAD, Tokenizer, decoder_tokens
from nsdr.world.vocabulary import CLEVRER, Vocabulary as ObjectWords

PROGRAM_SEPARATOR = END
"""Token between the question's program and the option's."""


@dataclass(frozen=True)
class Vocabulary:
    """Indices of the words and answers of the training questions.

    A text is the words of a question, followed by a separator (the highest index) and the words of an option if there is one.

    Attributes:
        words: known words; their indices begin at 1, and 0 is `PAD`.
        answers: answers to descriptive questions in alphabetical order, then `OPTION_ANSWERS`.
        objects: the words of objects, whose order is that of program tokens and features of words.
    """

    words: tuple[str, ...]
    answers: tuple[str, ...]
    objects: ObjectWords = CLEVRER

    def __post_init__(self) -> None:
        if self.answers[-len(OPTION_ANSWERS) :] != OPTION_ANSWERS:
            raise DataError(f"answers end with {self.answers[-2:]}; expected {' and '.join(OPTION_ANSWERS)}")

    @classmethod
    def from_questions(cls, scenes: Iterable[SceneQuestions], objects: ObjectWords) -> "Vocabulary":
        """The vocabulary of training questions about such objects."""
        questions = [q for scene in scenes for q in scene.questions]
        texts = {text for q in questions for text in (q.text, *(c.text for c in q.choices))}
        answers = sorted({q.answer for q in questions if q.answer is not None})
        return cls(Tokenizer.from_texts(texts).words, (*answers, *OPTION_ANSWERS), objects)

    @cached_property
    def _tokenizer(self) -> Tokenizer:
        return Tokenizer(self.words)

    @cached_property
    def token_indices(self) -> dict[str, int]:
        """Indices of program tokens."""
        return {token: i for i, token in enumerate(decoder_tokens(self.objects))}

    def sizes(self, channels: int = 0, grid: tuple[int, int] = (0, 0)) -> Sizes:
        """The sizes of a network for this vocabulary, and for features with `channels` and maps of height and width `grid`."""
        return Sizes(len(self.words) + 2, len(self.answers), channels, grid, self.objects)

    def encode_text(self, question: Question, choice: Choice | None) -> list[int]:
        """Word indices of a question, or of a question with one of its options.

        Raises:
            QuestionError: the text is empty, or has a word that did not occur in training; names it.
        """
        try:
            words = self._tokenizer.encode(question.text)
            return words if choice is None else [*words, len(self.words) + 1, *self._tokenizer.encode(choice.text)]
        except QuestionError as e:
            raise QuestionError(f"{e}; the baseline knows the {len(self.words)} words of its training") from e

    def possible_answers(self) -> Tensor:
        """(2, answers) bool: the answers to descriptive questions, and those to options."""
        is_choice = torch.tensor([answer in OPTION_ANSWERS for answer in self.answers])
        return torch.stack([~is_choice, is_choice])


class Example(NamedTuple):
    """A text about a video: a descriptive question, or a question with one of its options.

    Attributes:
        scene_index: index of the video.
        words: word indices, as in `Vocabulary.encode_text`.
        program: program token indices, as in `Batch.program`; empty where they are not needed.
        is_choice: whether the text is an option.
        is_plain: whether the question is about objects alone.
        answer: index of the answer; -1 if the file has none, or one that did not occur in training.
        colors: for each colour, the index of the one that replaces it in the video and the text; empty if all stay.
    """

    scene_index: int
    words: list[int]
    program: list[int]
    is_choice: bool
    is_plain: bool
    answer: int
    colors: tuple[int, ...] = ()


def encoded(scene_index: int, question: Question, vocabulary: Vocabulary, needs: Collection[str]) -> list[Example]:
    """The examples of a question: a single one for a descriptive question, else one for each option.

    Raises:
        QuestionError: a word is unknown, or a program that is needed is missing or has an unknown token; names it.
    """
    examples = []
    for choice in question.choices or (None,):
        words, program = vocabulary.encode_text(question, choice), list[int]()
        if "program" in needs:
            program = _token_indices(question, vocabulary)
            program += [] if choice is None else [PROGRAM_SEPARATOR, *_token_indices(choice, vocabulary)]
        answer = question.answer if choice is None else choice.answer
        index = vocabulary.answers.index(answer) if answer in vocabulary.answers else -1
        examples.append(Example(scene_index, words, program, choice is not None, question.subtype == PLAIN, index))
    return examples


def _token_indices(text: Question | Choice, vocabulary: Vocabulary) -> list[int]:
    if text.program is None:
        raise QuestionError(f"{text.text!r} has no program; parse the questions, or give a file with programs")
    indices = vocabulary.token_indices
    unknown = [token for token in text.program if token not in indices]
    if unknown:
        raise QuestionError(f"the program of {text.text!r} has the unknown token {unknown[0]!r}")
    return [indices[token] for token in text.program]


def training_examples(
    scenes: Iterable[SceneQuestions], vocabulary: Vocabulary, needs: Collection[str]
) -> list[list[Example]]:
    """The examples of each video with questions.

    Raises:
        DataError: a question lacks its answer, or a program that is needed; names the scene and the question.
    """
    videos = []
    for scene in scenes:
        examples: list[Example] = []
        for question in scene.questions:
            try:
                found = encoded(scene.scene_index, question, vocabulary, needs)
                if any(example.answer < 0 for example in found):
                    raise QuestionError("has no answer; train on questions with answers")
            except QuestionError as e:
                raise DataError(f"scene {scene.scene_index}, question {question.id}: {e}") from e
            examples += found
        if examples:
            videos.append(examples)
    return videos


def make_batch(
    examples: Sequence[Example], features: Features | None, needs: Collection[str], objects: ObjectWords
) -> Batch:
    """One batch on the CPU. Row b is example b; each video has one row in the tensors of videos.

    Args:
        examples: at least one.
        features: features of the videos; None if none are needed.
        needs: `Baseline.needs`.
        objects: the words of objects.

    Raises:
        DataError: a video has no features, or videos have features of different shapes; names the video.
    """
    rows = {video: row for row, video in enumerate(dict.fromkeys((e.scene_index, e.colors) for e in examples))}
    arrays: dict[str, Tensor] = {}
    if set(needs) & set(KINDS):
        assert features is not None, f"needs {', '.join(sorted(needs))}"
        found = ((features.get(index, needs), colors) for index, colors in rows)
        videos = [recolored(video, colors, len(objects.attributes)) if colors else video for video, colors in found]
        arrays = {name: torch.from_numpy(np.stack([video[name] for video in videos])) for name in videos[0]}
    if "has_object" in arrays:
        places = arrays["has_object"].any((0, 1)).nonzero()
        used = 1 + int(places.max()) if len(places) else 1
        arrays |= {name: arrays[name][:, :, :used] for name in ("objects", "has_object")}
    return Batch(
        _padded([e.words for e in examples]),
        torch.tensor([rows[e.scene_index, e.colors] for e in examples]),
        program=_padded([e.program for e in examples]) if "program" in needs else None,
        **arrays,
    )


def _padded(rows: Sequence[Sequence[int]]) -> Tensor:
    return pad_sequence([torch.tensor(row, dtype=torch.long) for row in rows], batch_first=True, padding_value=PAD)

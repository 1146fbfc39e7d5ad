"""From questions and features of videos to the `Batch` of a baseline."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from nsdr.baselines.base import Batch
from nsdr.baselines.vocabulary import PAD, Vocabulary, encode_program
from nsdr.clevrer.files.questions import Question, SceneQuestions
from nsdr.errors import DataError, QuestionError

__all__ = [
    "VIDEO_FEATURES",
    "Example",
    "FeatureSource",
    "encoded",
    "feature_sizes",
    "make_batch",
    "training_examples",
    "video_needs",
]

VIDEO_FEATURES = ("pooled", "maps", "objects")
"""What of `Baseline.needs` comes from a `FeatureSource`."""


class FeatureSource(Protocol):
    """Features of videos, such as `nsdr.baselines.features.files.FeatureCache`.

    Attributes:
        channels: C of the feature vectors and maps.
        grid: (h, w) of the feature maps.
    """

    @property
    def channels(self) -> int: ...

    @property
    def grid(self) -> tuple[int, int]: ...

    def get(self, scene_index: int, needs: Collection[str]) -> Mapping[str, NDArray[Any]]:
        """Arrays of one video, named as the fields of `Batch`, without their first axis.

        Args:
            scene_index: index of the video.
            needs: some of `VIDEO_FEATURES`; "objects" gives `has_object`, too.

        Raises:
            DataError: the video has no such features; names it.
        """


class Example(NamedTuple):
    """A text about a video: a descriptive question, or a question with one of its options.

    Attributes:
        scene_index: index of the video.
        words: word indices, as of `Vocabulary.encode_text`.
        program: program token indices, as of `encode_program`; empty where they are not needed.
        is_choice: whether the text is an option.
        answer: index of the answer; -1 where the file has none, or one that did not occur in training.
    """

    scene_index: int
    words: list[int]
    program: list[int]
    is_choice: bool
    answer: int


def encoded(scene_index: int, question: Question, vocabulary: Vocabulary, with_program: bool) -> list[Example]:
    """The examples of a question: one for a descriptive question, else one for each of its options.

    Raises:
        QuestionError: an unknown word, or a program that is needed and missing or unknown; names it.
    """
    examples = []
    for choice in question.choices or (None,):
        answer = question.answer if choice is None else choice.answer
        index = None if answer is None else vocabulary.answer_index(answer)
        examples.append(
            Example(
                scene_index,
                vocabulary.encode_text(question, choice),
                encode_program(question, choice) if with_program else [],
                choice is not None,
                -1 if index is None else index,
            )
        )
    return examples


def training_examples(
    scenes: Iterable[SceneQuestions], vocabulary: Vocabulary, with_program: bool
) -> list[list[Example]]:
    """The examples of each video that has some.

    Raises:
        DataError: a question without its answer or without a program that is needed; names the scene and the question.
    """
    videos = []
    for scene in scenes:
        examples: list[Example] = []
        for question in scene.questions:
            try:
                found = encoded(scene.scene_index, question, vocabulary, with_program)
                if any(example.answer < 0 for example in found):
                    raise QuestionError("has no answer; train on questions with answers")
            except QuestionError as e:
                raise DataError(f"scene {scene.scene_index}, question {question.id}: {e}") from e
            examples += found
        if examples:
            videos.append(examples)
    return videos


def video_needs(needs: Collection[str]) -> frozenset[str]:
    """Those of `Baseline.needs` that come from a `FeatureSource`."""
    return frozenset(needs) & frozenset(VIDEO_FEATURES)


def feature_sizes(features: FeatureSource | None, needs: Collection[str]) -> tuple[int, tuple[int, int]]:
    """C and (h, w) of the features, as far as they are read: 0 and (0, 0) without features and without maps."""
    if features is None:
        return 0, (0, 0)
    return features.channels, (features.grid[0], features.grid[1]) if "maps" in needs else (0, 0)


def make_batch(examples: Sequence[Example], features: FeatureSource | None, needs: Collection[str]) -> Batch:
    """One batch on the CPU: row b is that of example b, each video has one row.

    Args:
        examples: at least one.
        features: of their videos; None where none are needed.
        needs: `Baseline.needs`.

    Raises:
        DataError: a video has no features, or videos have features of different shapes; names the video.
    """
    rows = {index: row for row, index in enumerate(dict.fromkeys(e.scene_index for e in examples))}
    wanted, arrays = video_needs(needs), {}
    if wanted:
        assert features is not None, f"needs {', '.join(sorted(wanted))}"
        videos = [features.get(index, wanted) for index in rows]
        for name in (*sorted(wanted), *(("has_object",) if "objects" in wanted else ())):
            arrays[name] = _stacked(name, {index: video[name] for index, video in zip(rows, videos, strict=True)})
    return Batch(
        _padded([e.words for e in examples]),
        torch.tensor([rows[e.scene_index] for e in examples]),
        program=_padded([e.program for e in examples]) if "program" in needs else None,
        **arrays,
    )


def _padded(rows: Sequence[Sequence[int]]) -> Tensor:
    return pad_sequence([torch.tensor(row, dtype=torch.long) for row in rows], batch_first=True, padding_value=PAD)


def _stacked(name: str, arrays: Mapping[int, NDArray[Any]]) -> Tensor:
    """Arrays of videos with a new first axis; those of objects are padded to the largest number of objects."""
    if name in ("objects", "has_object"):
        most = max(array.shape[1] for array in arrays.values())
        arrays = {index: _with_objects(array, most) for index, array in arrays.items()}
    shape = next(iter(arrays.values())).shape
    for index, array in arrays.items():
        if array.shape != shape:
            raise DataError(
                f"scene {index}: {name} has shape {array.shape}, another video {shape}; make the features anew"
            )
    return torch.from_numpy(np.stack(list(arrays.values())))


def _with_objects(array: NDArray[Any], number: int) -> NDArray[Any]:
    missing = [(0, 0)] * array.ndim
    missing[1] = (0, number - array.shape[1])
    return np.pad(array, missing)

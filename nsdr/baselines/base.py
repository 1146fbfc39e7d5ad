"""What the trained baselines of the paper's Table 2 have in common: their input, their base class and their registry."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from torch import Tensor, nn

from nsdr.io.registry import Registry
from nsdr.world.vocabulary import Vocabulary


class Batch(NamedTuple):
    """B texts about V videos of F frames. A text is a descriptive question, or a multiple-choice question with one option.

    Attributes:
        words: (B, T) int64 word indices of the question, followed by a separator and the option if there is one; padded with
            `PAD`.
        video: (B,) int64, each text's row in the tensors of the videos.
        pooled: (V, F, C) float32 feature vectors of the frames; None where `Baseline.needs` has no "pooled".
        maps: (V, F, C, h, w) float32 feature maps of the frames, or None.
        objects: (V, F, N, C + 4) float32 features of the detected objects and their boxes (left, top, right, bottom as shares
            of the image), padded with zeros; or None.
        has_object: (V, F, N) bool, which of them are objects, or None.
        program: (B, P) int64 postfix program tokens of the question, followed by `PROGRAM_SEPARATOR` and the option's tokens if
            there is one; padded with `PAD`; or None.
    """

    words: Tensor
    video: Tensor
    pooled: Tensor | None = None
    maps: Tensor | None = None
    objects: Tensor | None = None
    has_object: Tensor | None = None
    program: Tensor | None = None


@dataclass(frozen=True)
class Sizes:
    """Sizes that the data set and the feature extractor give a baseline.

    Attributes:
        words: number of word indices.
        answers: number of answers.
        channels: C of the feature vectors and maps; 0 if none are read.
        grid: (h, w) of the feature maps; (0, 0) if none are read.
        objects: the words of objects in programs.
    """

    words: int
    answers: int
    channels: int
    grid: tuple[int, int]
    objects: Vocabulary


class Baseline(nn.Module):
    """A network that scores every answer to a text about a video.

    Args:
        config: its settings, of the class `Config`.
        sizes: of the data set and the features.

    Attributes:
        needs: what it reads from a `Batch` besides the words: some of "pooled", "maps", "objects", "program".
        Config: frozen dataclass of its settings.
    """

    needs: ClassVar[frozenset[str]] = frozenset()
    Config: ClassVar[type[Any]]

    def __init__(self, config: Any, sizes: Sizes) -> None:
        super().__init__()
        self.config, self.sizes = config, sizes

    @abstractmethod
    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax; impossible answers are masked outside."""


BASELINES: Registry[type[Baseline]] = Registry(
    "baseline",
    "nsdr.baselines",
    {
        "lstm": "nsdr.baselines.systems.simple:Lstm",
        "cnn_mlp": "nsdr.baselines.systems.simple:CnnMlp",
        "cnn_lstm": "nsdr.baselines.systems.simple:CnnLstm",
        "tvqa": "nsdr.baselines.systems.tvqa:TvqaPlus",
        "memory": "nsdr.baselines.systems.memory:HeterogeneousMemory",
        "iep": "nsdr.baselines.systems.modular:Iep",
        "tbd": "nsdr.baselines.systems.modular:TbdNet",
        "mac": "nsdr.baselines.systems.mac:Mac",
        "mac_objects": "nsdr.baselines.systems.mac:MacObjects",
    },
)
"""Trained baselines by name; other packages add theirs by the entry point group `nsdr.baselines`."""

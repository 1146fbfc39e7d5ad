"""What IEP and TbD-net share: features of a video, the network assembled by the program, and the classifier."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead
from nsdr.baselines.systems.program_graph import ProgramGraph, execute, program_graph
from nsdr.errors import DataError
from nsdr.question_parser.tokenizer import PROGRAM_TOKENS
from nsdr.validation import Settings, Size

__all__ = ["Assembled", "AssembledConfig", "SpaceConv", "TimeConv"]


@dataclass(frozen=True)
class AssembledConfig(Settings):
    """Settings; the defaults are those of both papers.

    Attributes:
        width: channels of the features and of every module.
        frames: frames left after the mean over neighbouring ones.
        projection: channels before the classifier's maximum.
        hidden: units of the classifier's hidden layer.
    """

    width: Size = 128
    frames: Size = 25
    projection: Size = 512
    hidden: Size = 1024


class SpaceConv(nn.Module):
    """Convolution of 3x3 over space, the same in every frame."""

    def __init__(self, inputs: int, outputs: int, dilation: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, padding=dilation, dilation=dilation)

    def forward(self, x: Tensor) -> Tensor:
        """(N, F, h, w, inputs) -> (N, F, h, w, outputs)."""
        images = x.flatten(0, 1).permute(0, 3, 1, 2)
        return self.conv(images).permute(0, 2, 3, 1).unflatten(0, x.shape[:2])


class TimeConv(nn.Module):
    """Convolution of 3 over time, the same at every place."""

    def __init__(self, inputs: int, outputs: int, dilation: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, (3, 1), padding=(dilation, 0), dilation=(dilation, 1))

    def forward(self, x: Tensor) -> Tensor:
        """(N, F, h, w, inputs) -> (N, F, h, w, outputs)."""
        rows = x.flatten(2, 3).permute(0, 3, 1, 2)
        return self.conv(rows).permute(0, 2, 3, 1).unflatten(2, x.shape[2:4])


class _Stem(nn.Module):
    """Feature maps (V, F, C, h, w) -> features (V, frames, h, w, width), with the coordinates as three more channels."""

    def __init__(self, channels: int, config: AssembledConfig) -> None:
        super().__init__()
        self.frames = config.frames
        self.layers = nn.Sequential(
            SpaceConv(channels + 3, config.width), nn.ReLU(), SpaceConv(config.width, config.width), nn.ReLU()
        )

    def forward(self, maps: Tensor) -> Tensor:
        """See the class. Videos of fewer frames than `frames` have some of them repeated."""
        v, f, c, h, w = maps.shape
        pooled = functional.adaptive_avg_pool1d(maps.permute(0, 3, 4, 2, 1).reshape(v, h * w * c, f), self.frames)
        x = pooled.reshape(v, h, w, c, self.frames).permute(0, 4, 1, 2, 3)
        axes = [torch.linspace(-1, 1, n, device=x.device, dtype=x.dtype) for n in x.shape[1:4]]
        coordinates = torch.stack(torch.meshgrid(*axes, indexing="ij"), -1)
        features: Tensor = self.layers(torch.cat([x, coordinates.expand(v, -1, -1, -1, -1)], -1))
        return features


class _Classifier(nn.Module):
    """Values (B, F, h, w, width) -> scores (B, answers)."""

    def __init__(self, sizes: Sizes, config: AssembledConfig) -> None:
        super().__init__()
        h, w = sizes.grid
        places = -(-h // 2) * -(-w // 2)
        self.project = nn.Linear(config.width, config.projection)
        self.head = AnswerHead(config.projection * places, config.hidden, sizes.answers)

    def forward(self, values: Tensor) -> Tensor:
        """(B, F, h, w, width) -> (B, answers)."""
        images = self.project(values).relu().amax(1).permute(0, 3, 1, 2)
        scores: Tensor = self.head(functional.max_pool2d(images, 2, ceil_mode=True).flatten(1))
        return scores


class Assembled(Baseline):
    """A network whose modules are put together as a text's program says; the program's value goes to a classifier.

    Args:
        config: settings.
        sizes: sizes of the data set and the features.

    Raises:
        DataError: `sizes.program_tokens` is not the number of `PROGRAM_TOKENS`.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"maps", "program"})
    Config: ClassVar[type[Any]] = AssembledConfig

    def __init__(self, config: AssembledConfig, sizes: Sizes) -> None:
        super().__init__()
        if sizes.program_tokens != len(PROGRAM_TOKENS):
            raise DataError(
                f"program_tokens is {sizes.program_tokens}; expected {len(PROGRAM_TOKENS)}, the program tokens of the data set"
            )
        self.stem = _Stem(sizes.channels, config)
        self.classifier = _Classifier(sizes, config)

    @abstractmethod
    def run_module(self, instruction: str, features: Tensor, arguments: list[Tensor]) -> Tensor:
        """Run one instruction for N nodes.

        Args:
            instruction: key of `INSTRUCTIONS`.
            features: (N, F, h, w, width) features of the nodes' videos.
            arguments: (N, F, h, w, channels) each.

        Returns:
            (N, F, h, w, channels).
        """

    def values(self, batch: Batch) -> tuple[ProgramGraph, list[Tensor]]:
        """The programs' graph, and the value (F, h, w, channels) of each of its nodes.

        Raises:
            DataError: the batch has no maps or no programs.
        """
        if batch.maps is None or batch.program is None:
            raise DataError(
                f"the batch has no {'maps' if batch.maps is None else 'program'}; `needs` says what to read"
            )
        features = self.stem(batch.maps)
        graph = program_graph(batch.program, batch.video)

        def run(instruction: str, videos: Tensor, arguments: list[Tensor]) -> Tensor:
            return self.run_module(instruction, features[videos], arguments)

        return graph, execute(graph, run, features.device)

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        graph, values = self.values(batch)
        scores: Tensor = self.classifier(torch.stack([values[text[-1]] for text in graph.texts]))
        return scores

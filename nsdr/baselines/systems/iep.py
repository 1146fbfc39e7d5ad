"""IEP (V): a residual module per program instruction, assembled by the program's tree.

Johnson, Hariharan, van der Maaten, Hoffman, Fei-Fei, Zitnick, Girshick: "Inferring and Executing Programs for Visual Reasoning"
(2017), adapted to video as in Yi et al.: "CLEVRER: Collision Events for Video Representation and Reasoning" (2020).

Differs from the paper:
    - no program generator: programs are given, the data set's or those of our question parser;
    - video: Yi et al. run the modules on features of a convolutional LSTM, as far as we know; here values are features of every
      frame, and the second 3x3 convolution of a residual module runs over 3 frames instead;
      the classifier takes the maximum over time; three channels hold the coordinates in time and space;
    - an option's program and its question's are one tree, joined by `belong_to`;
    - the modules without arguments (`objects`, `events`, `start` ...) are residual modules on the video's features; the paper's
      only one, `scene`, is the features themselves;
    - a malformed program runs one module of its own on the features.
"""

from typing import final

import torch
from torch import Tensor, nn

from nsdr.baselines.base import Sizes
from nsdr.baselines.systems.assembled import Assembled, AssembledConfig, SpaceConv, TimeConv
from nsdr.baselines.systems.program_graph import INSTRUCTIONS

__all__ = ["Iep"]


class _Residual(nn.Module):
    """Residual module of one argument, or of two after a 1x1 projection: (N, F, h, w, width) each -> (N, F, h, w, width)."""

    def __init__(self, width: int, arguments: int) -> None:
        super().__init__()
        self.project = nn.Linear(2 * width, width) if arguments == 2 else None
        self.space, self.time = SpaceConv(width, width), TimeConv(width, width)

    def forward(self, *arguments: Tensor) -> Tensor:
        """See the class."""
        x = arguments[0] if self.project is None else self.project(torch.cat(arguments, -1)).relu()
        value: Tensor = (x + self.time(self.space(x).relu())).relu()
        return value


@final
class Iep(Assembled):
    """Inferring and executing programs; see the module.

    Args:
        config: settings.
        sizes: sizes of the data set and the features.
    """

    def __init__(self, config: AssembledConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.program_modules = nn.ModuleDict({name: _Residual(config.width, n) for name, n in INSTRUCTIONS.items()})

    def run_module(self, instruction: str, features: Tensor, arguments: list[Tensor]) -> Tensor:
        """As of `Assembled`, with (N, F, h, w, width) everywhere; a module without arguments reads the features."""
        value: Tensor = self.program_modules[instruction](*(arguments or [features]))
        return value

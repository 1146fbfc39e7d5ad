"""TbD-net (V): modules with attention masks that can be looked at, assembled by the program's tree.

Mascharka, Tran, Soklaski, Majumdar: "Transparency by Design: Closing the Gap Between Performance and Interpretability in Visual
Reasoning" (2018), adapted to video as in Yi et al.: "CLEVRER: Collision Events for Video Representation and Reasoning" (2020).

Sets, objects, events and frames are masks over time and space; answers are encodings. The kinds of module:
    - the whole video: a mask of ones (`objects`, `null`);
    - attend: a mask from the features within a mask (`events`, `start`, `filter_color red` ...); of two arguments, within the
      minimum of both (`filter_moving`, `filter_collision` ...), which is the paper's And;
    - relate: a mask from the features within a mask, by dilated convolutions (`get_object`; `get_col_partner`: within the event
      but not the object); of two arguments the second is related, and the minimum with the first taken (`filter_before` ...);
    - query: an encoding of the features within a mask (`query_color`, `count`, `exist`);
    - compare: an encoding of the features within two masks (`belong_to`); `negate` recodes an encoding;
    - `unique` passes its mask on; `get_frame` gives each frame its highest value, over all of space.

Differs from the paper:
    - programs are given, the data set's or those of our question parser;
    - video: masks and features are those of every frame; of two successive 3x3 convolutions the second runs over 3 frames
      instead, and `relate` has both at each dilation; the classifier takes the maximum over time; three channels hold the
      coordinates in time and space;
    - no `same` module, which CLEVRER's programs do not need, and no Or; `compare` reads masks, not encodings;
    - an option's program and its question's are one tree, joined by `belong_to`;
    - a malformed program runs a `query` module of its own on the whole video;
    - no penalty on the masks;
    - all linear and convolution layers start from He's weights (Kaiming, normal), as in the paper's code as far as we know.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, final

import torch
from torch import Tensor, nn

from nsdr.baselines.base import Batch, Sizes
from nsdr.baselines.systems.assembled import Assembled, AssembledConfig, SpaceConv, TimeConv
from nsdr.baselines.systems.layers import initialise
from nsdr.baselines.systems.program_graph import INSTRUCTIONS, MALFORMED
from nsdr.validation import Size

__all__ = ["Mask", "TbdConfig", "TbdNet"]

WHOLE_VIDEO = ("objects", "null")
RELATED = ("get_object", "get_col_partner", "filter_before", "filter_after", "filter_ancestor", "get_counterfact")
QUERIES = ("query_color", "query_material", "query_shape", "count", "exist", MALFORMED)
PARAMETERLESS = (*WHOLE_VIDEO, "unique", "get_frame")


@dataclass(frozen=True)
class TbdConfig(AssembledConfig):
    """Settings; the defaults are the paper's.

    Attributes:
        dilations: dilations of the convolutions of `relate`, in their order.
    """

    dilations: tuple[Size, ...] = (1, 2, 4, 8, 1)


class Mask(NamedTuple):
    """What a step of a program attends to.

    Attributes:
        instruction: the step's module and word.
        mask: (frames, h, w) values from 0 to 1.
    """

    instruction: str
    mask: Tensor


@final
class TbdNet(Assembled):
    """Transparency by design; see the module.

    Args:
        config: settings.
        sizes: sizes of the data set and the features.
    """

    Config: ClassVar[type[Any]] = TbdConfig

    def __init__(self, config: TbdConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        names = [name for name in INSTRUCTIONS if name not in PARAMETERLESS]
        self.program_modules = nn.ModuleDict({name: _module(name, config) for name in names})
        initialise(self, nn.init.kaiming_normal_)

    def run_module(self, instruction: str, features: Tensor, arguments: list[Tensor]) -> Tensor:
        """As of `Assembled`: masks are (N, F, h, w, 1), encodings (N, F, h, w, width)."""
        whole = torch.ones_like(features[..., :1])
        if instruction in WHOLE_VIDEO:
            return whole
        if instruction == "unique":
            return arguments[0]
        if instruction == "get_frame":
            return arguments[0].amax((2, 3), keepdim=True).expand_as(whole)
        module = self.program_modules[instruction]
        value: Tensor
        if instruction == "negate":
            value = module(arguments[0])
        elif instruction == "belong_to":
            value = module(torch.cat([features * mask for mask in arguments], -1))
        elif instruction == "get_col_partner":
            event, one = arguments
            value = module(features * torch.minimum(event, 1 - one))
        elif instruction in RELATED and len(arguments) == 2:
            value = torch.minimum(arguments[0], module(features * arguments[1]))
        else:
            value = module(features * torch.stack([whole, *arguments]).amin(0))
        return value

    @torch.no_grad()
    def masks(self, batch: Batch) -> list[list[Mask]]:
        """The masks of each text's steps, in the program's order; an option's steps come before its question's."""
        graph, values = self.values(batch)
        return [
            [Mask(graph.nodes[i].instruction, values[i][..., 0]) for i in text if values[i].shape[-1] == 1]
            for text in graph.texts
        ]


def _module(instruction: str, config: TbdConfig) -> nn.Sequential:
    """The network of an instruction: features (N, F, h, w, width; of `belong_to` 2 width) within masks -> mask or encoding."""
    width = config.width
    if instruction == "belong_to":
        return nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), *_pair(width))
    if instruction == "negate" or instruction in QUERIES:
        return nn.Sequential(*_pair(width))
    dilations = config.dilations if instruction in RELATED else (1,)
    layers = [layer for dilation in dilations for layer in _pair(width, dilation)]
    return nn.Sequential(*layers, nn.Linear(width, 1), nn.Sigmoid())


def _pair(width: int, dilation: int = 1) -> list[nn.Module]:
    return [SpaceConv(width, width, dilation), nn.ReLU(), TimeConv(width, width, dilation), nn.ReLU()]

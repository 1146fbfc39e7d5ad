"""IEP (V) and TbD-net (V): networks whose modules are assembled as the program of a text says.

Sources: Johnson et al. 2017, "Inferring and Executing Programs for Visual Reasoning"; Mascharka et al. 2018, "Transparency by
Design: Closing the Gap Between Performance and Interpretability in Visual Reasoning"; adapted to video as in Yi et al. 2020,
"CLEVRER: Collision Events for Video Representation and Reasoning".

Differs from the papers:
    - no program generator: programs are given, the data set's or those of our question parser;
    - video: Yi et al. run the modules on features of a convolutional LSTM, as far as we know; here features are those of
      `MapEncoder`, features and values are those of every frame, and of two successive 3x3 convolutions the second runs over
      3 frames instead (`relate` of TbD-net has both at each dilation); the classifier takes the maximum over time;
    - an option's program and its question's are one tree, joined by `belong_to`;
    - a malformed program runs one module of its own on the whole video;
    - IEP: the modules without arguments (`objects`, `events`, `start` ...) are residual modules on the video's features; the
      paper's only one, `scene`, is the features themselves; convolutions read normalised values (`_Residual`);
    - TbD-net: no `same` module, which CLEVRER's programs do not need, and no Or; `compare` reads masks, not encodings; no
      penalty on the masks; activations are bounded before they become a mask (`_Bounded`);
    - all layers start from He's weights (Kaiming, normal), as in TbD-net's code as far as we know. With PyTorch's, IEP does not
      learn to tell the colour of a single object (`tests/test_baselines_look.py`).
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from nsdr.baselines.base import Baseline, Batch, Sizes
from nsdr.baselines.systems.layers import AnswerHead, MapEncoder, SpaceConv, TimeConv, initialise
from nsdr.baselines.systems.program_graph import MALFORMED, execute, instructions, program_graph
from nsdr.validation import Settings, Size

WHOLE_VIDEO = ("objects", "null")
RELATED = ("get_object", "get_col_partner", "filter_before", "filter_after", "filter_ancestor", "get_counterfact")
QUERIES = ("query_color", "query_material", "query_shape", "count", "exist", MALFORMED)
PARAMETERLESS = (*WHOLE_VIDEO, "unique", "get_frame")
"""Instructions of TbD-net; see `TbdNet`."""


@dataclass(frozen=True)
class ModularConfig(Settings):
    """Settings; the defaults are those of both papers.

    Attributes:
        width: channels of the features and of every module.
        frames: number of frames after neighbouring frames are averaged.
        projection: channels before the maximum in the classifier.
        hidden: units of the classifier's hidden layer.
    """

    width: Size = 128
    frames: Size = 25
    projection: Size = 512
    hidden: Size = 1024


@dataclass(frozen=True)
class TbdConfig(ModularConfig):
    """Settings; the defaults are the paper's.

    Attributes:
        dilations: dilations of the convolutions of `relate`, in their order.
    """

    dilations: tuple[Size, ...] = (1, 2, 4, 8, 1)


class _Stem(nn.Module):
    """Feature maps (V, F, C, h, w) -> features (V, frames, h, w, width)."""

    def __init__(self, channels: int, config: ModularConfig) -> None:
        super().__init__()
        self.frames = config.frames
        self.encode = MapEncoder(channels, config.width)

    def forward(self, maps: Tensor) -> Tensor:
        """See the class. If a video has fewer frames than `frames`, some are repeated."""
        features = self.encode(maps)  # (V, F, h, w, W)
        pooled = functional.adaptive_avg_pool1d(features.flatten(2).transpose(1, 2), self.frames)
        return pooled.transpose(1, 2).unflatten(2, features.shape[2:])


class _Classifier(nn.Module):
    """Values (B, F, h, w, width) -> scores (B, answers)."""

    def __init__(self, sizes: Sizes, config: ModularConfig) -> None:
        super().__init__()
        h, w = sizes.grid
        places = -(-h // 2) * -(-w // 2)
        self.project = nn.Linear(config.width, config.projection)
        self.head = AnswerHead(config.projection * places, config.hidden, sizes.answers)

    def forward(self, values: Tensor) -> Tensor:
        images = self.project(values).relu().amax(1).permute(0, 3, 1, 2)
        scores: Tensor = self.head(functional.max_pool2d(images, 2, ceil_mode=True).flatten(1))
        return scores


class Modular(Baseline):
    """Base of both systems: the program runs modules on the features of a video, and a classifier reads the program's value."""

    needs: ClassVar[frozenset[str]] = frozenset({"maps", "program"})
    Config: ClassVar[type[Any]] = ModularConfig

    def __init__(self, config: ModularConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.stem = _Stem(sizes.channels, config)
        self.classifier = _Classifier(sizes, config)

    @abstractmethod
    def run_module(self, instruction: str, features: Tensor, arguments: list[Tensor]) -> Tensor:
        """Run one instruction for N nodes.

        Args:
            instruction: key of `instructions`.
            features: (N, F, h, w, width) features of the nodes' videos.
            arguments: (N, F, h, w, channels) each.

        Returns:
            (N, F, h, w, channels).
        """

    def forward(self, batch: Batch) -> Tensor:
        """Scores (B, answers) before the softmax."""
        assert batch.maps is not None
        assert batch.program is not None
        features = self.stem(batch.maps)
        graph = program_graph(batch.program, batch.video, self.sizes.objects)

        def run(instruction: str, videos: Tensor, arguments: list[Tensor]) -> Tensor:
            return self.run_module(instruction, features[videos], arguments)

        values = execute(graph, run, features.device)
        scores: Tensor = self.classifier(torch.stack([values[text[-1]] for text in graph.texts]))
        return scores


class _Residual(nn.Module):
    """Residual module of one argument, or of two after a 1x1 projection: (N, F, h, w, width) each -> (N, F, h, w, width).

    Its convolutions read normalised values (layer normalisation), and no ReLU follows the sum. After 16 untrained modules in a
    row, values are 5 times as large; without normalisation and with the ReLU, as in the paper, 100 times.
    """

    def __init__(self, width: int, arguments: int) -> None:
        super().__init__()
        self.project = nn.Linear(2 * width, width) if arguments == 2 else None
        self.normalise = nn.LayerNorm(width)
        self.space, self.time = SpaceConv(width, width), TimeConv(width, width)

    def forward(self, *arguments: Tensor) -> Tensor:
        x = arguments[0] if self.project is None else self.project(torch.cat(arguments, -1)).relu()
        value: Tensor = x + self.time(self.space(self.normalise(x)).relu())
        return value


class Iep(Modular):
    """IEP (Inferring and Executing Programs): one residual module for each instruction."""

    def __init__(self, config: ModularConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        self.program_modules = nn.ModuleDict(
            {name: _Residual(config.width, n) for name, n in instructions(sizes.objects).items()}
        )
        initialise(self, nn.init.kaiming_normal_)

    def run_module(self, instruction: str, features: Tensor, arguments: list[Tensor]) -> Tensor:
        """As in `Modular`, with (N, F, h, w, width) everywhere; a module without arguments reads the features."""
        value: Tensor = self.program_modules[instruction](*(arguments or [features]))
        return value


class TbdNet(Modular):
    """TbD-net (Transparency by Design): sets, objects, events and frames are masks over time and space; answers are encodings.

    The kinds of module:
        - the whole video: a mask of ones (`objects`, `null`);
        - attend: a mask from the features within a mask (`events`, `start`, `filter_color red` ...); of two arguments, within
          the minimum of both (`filter_moving`, `filter_collision` ...), which is the paper's And;
        - relate: a mask from the features within a mask, by dilated convolutions (`get_object`; `get_col_partner`: within the
          event but not the object); of two arguments the second is related, and the minimum with the first taken;
        - query: an encoding of the features within a mask (`query_color`, `count`, `exist`);
        - compare: an encoding of the features within two masks (`belong_to`); `negate` recodes an encoding;
        - `unique` passes its mask on; `get_frame` gives each frame its highest value, over all of space.
    """

    Config: ClassVar[type[Any]] = TbdConfig

    def __init__(self, config: TbdConfig, sizes: Sizes) -> None:
        super().__init__(config, sizes)
        names = [name for name in instructions(sizes.objects) if name not in PARAMETERLESS]
        self.program_modules = nn.ModuleDict({name: _tbd_module(name, config) for name in names})
        initialise(self, nn.init.kaiming_normal_)

    def run_module(self, instruction: str, features: Tensor, arguments: list[Tensor]) -> Tensor:
        """As in `Modular`: masks are (N, F, h, w, 1), encodings (N, F, h, w, width)."""
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


class _Bounded(nn.Module):
    """Scales the activations (N, F, h, w, width) of each of N videos to a standard deviation below 1. Weak ones stay weak.

    Activations grow in the chain of convolutions of `relate` while it learns. Without this, the masks of `filter_after` and
    `filter_ancestor` became 0 everywhere, with logits of -49 and -27 on average, so that hardly any gradient reached them.
    """

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        return functional.layer_norm(x, x.shape[1:], eps=1.0)


def _tbd_module(instruction: str, config: TbdConfig) -> nn.Sequential:
    """The network of an instruction: features (N, F, h, w, width; of `belong_to` 2 width) within masks -> mask or encoding."""
    width = config.width

    def pair(dilation: int = 1) -> list[nn.Module]:
        return [SpaceConv(width, width, dilation), nn.ReLU(), TimeConv(width, width, dilation), nn.ReLU()]

    if instruction == "belong_to":
        return nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), *pair())
    if instruction == "negate" or instruction in QUERIES:
        return nn.Sequential(*pair())
    dilations = config.dilations if instruction in RELATED else (1,)
    layers = [layer for dilation in dilations for layer in pair(dilation)]
    return nn.Sequential(*layers, _Bounded(), nn.Linear(width, 1), nn.Sigmoid())

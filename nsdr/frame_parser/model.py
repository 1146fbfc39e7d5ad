"""The frame parser's network: torchvision's `MaskRCNN` with a slim backbone and attribute heads (paper, section 4.1)."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

from torch import Tensor, nn
from torchvision import models
from torchvision.models.detection import MaskRCNN
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.backbone_utils import BackboneWithFPN
from torchvision.models.detection.faster_rcnn import FastRCNNPredictor, TwoMLPHead
from torchvision.models.detection.mask_rcnn import MaskRCNNHeads, MaskRCNNPredictor
from torchvision.models.resnet import BasicBlock
from torchvision.ops import FeaturePyramidNetwork, MultiScaleRoIAlign

from nsdr.errors import DataError
from nsdr.frame_parser.roi_heads import AttributePredictor, AttributeRoIHeads, JointAttributePredictor

__all__ = ["FrameParserConfig", "SlimBackbone", "TorchvisionBackbone", "build_frame_parser"]


@dataclass(frozen=True)
class FrameParserConfig:
    """Sizes of the frame parser.

    Attributes:
        backbone: "slim", or torchvision's "resnet18", "resnet50" (the paper's) or "mobilenet_v3", from random weights.
        attributes: "three" heads for colour, material and shape, or "joint": one label for the 48 combinations (the paper's).
        widths: of the slim backbone: channels of the four residual stages (strides 4, 8, 16, 32 px); multiples of 16.
        blocks: of the slim backbone: residual blocks in each stage.
        fpn_channels: channels of every pyramid level.
        anchor_sizes_px: anchor side on the levels of stride 4, 8 and 16; CLEVRER's objects are 25-110 px wide.
        box_features: width of the box head's two layers.
        mask_channels: channels of the mask head's convolutions.
        mask_layers: number of those convolutions.
        proposals: regions kept for the second stage at inference.
        train_proposals: the same in training.
        image_mean, image_std: RGB normalisation, measured on the rendered training frames (0-1).
    """

    backbone: str = "slim"
    attributes: str = "three"
    widths: tuple[int, int, int, int] = (32, 64, 128, 192)
    blocks: int = 2
    fpn_channels: int = 64
    anchor_sizes_px: tuple[int, int, int] = (24, 48, 88)
    box_features: int = 256
    mask_channels: int = 64
    mask_layers: int = 3
    proposals: int = 60
    train_proposals: int = 200
    image_mean: tuple[float, float, float] = (0.510, 0.508, 0.506)
    image_std: tuple[float, float, float] = (0.056, 0.056, 0.059)

    def __post_init__(self) -> None:
        if self.backbone not in ("slim", *_BACKBONES):
            raise DataError(
                f"FrameParserConfig.backbone: {self.backbone!r}; expected one of slim, {', '.join(_BACKBONES)}"
            )
        if self.attributes not in ("three", "joint"):
            raise DataError(f"FrameParserConfig.attributes: {self.attributes!r}; expected three or joint")
        # oneDNN's channels-last convolutions crash the process on other widths (seen with torch 2.15 on CPU).
        for name, value in (("widths", self.widths), ("fpn_channels", (self.fpn_channels,))):
            if any(v % 16 for v in value):
                raise DataError(f"FrameParserConfig.{name}: expected multiples of 16, got {value}")


class SlimBackbone(nn.Module):
    """A narrow ResNet with a feature pyramid on strides 4, 8 and 16 px (stride 32 px feeds it from above).

    `forward(images (B, 3, H, W))` returns `{"0": (B, C, H/4, W/4), "1": (B, C, H/8, W/8), "2": (B, C, H/16, W/16)}`.
    """

    def __init__(self, widths: tuple[int, int, int, int], blocks: int, fpn_channels: int) -> None:
        super().__init__()
        stem = widths[0]
        self.stem = nn.Sequential(
            nn.Conv2d(3, stem, 5, stride=2, padding=2, bias=False),
            nn.BatchNorm2d(stem),
            nn.ReLU(inplace=True),
            nn.MaxPool2d(3, stride=2, padding=1),
        )
        self.stages = nn.ModuleList()
        channels = stem
        for index, width in enumerate(widths):
            self.stages.append(_stage(channels, width, blocks, stride=1 if index == 0 else 2))
            channels = width
        self.fpn = FeaturePyramidNetwork(list(widths), fpn_channels)
        self.out_channels = fpn_channels

    def forward(self, images: Tensor) -> dict[str, Tensor]:
        """(B, 3, H, W) normalised images -> feature maps by level, (B, channels, H / stride, W / stride)."""
        x = self.stem(images)
        features: OrderedDict[str, Tensor] = OrderedDict()
        for index, stage in enumerate(self.stages):
            x = features[str(index)] = stage(x)
        pyramid: dict[str, Tensor] = self.fpn(features)
        del pyramid[str(len(self.stages) - 1)]
        return pyramid


_BACKBONES: dict[str, tuple[dict[str, str], list[int]]] = {
    "resnet18": ({f"layer{i}": str(i - 1) for i in (1, 2, 3, 4)}, [64, 128, 256, 512]),
    "resnet50": ({f"layer{i}": str(i - 1) for i in (1, 2, 3, 4)}, [256, 512, 1024, 2048]),
    "mobilenet_v3": ({"3": "0", "6": "1", "12": "2", "15": "3"}, [24, 40, 112, 160]),
}
"""torchvision's backbones: layers of stride 4, 8, 16 and 32 px, and their channels."""


class TorchvisionBackbone(nn.Module):
    """A torchvision network with a feature pyramid; levels as of `SlimBackbone`."""

    def __init__(self, name: str, fpn_channels: int) -> None:
        super().__init__()
        layers, channels = _BACKBONES[name]
        if name == "mobilenet_v3":
            body: nn.Module = models.mobilenet_v3_large(weights=None).features
        else:
            body = getattr(models, name)(weights=None)
        self.pyramid = BackboneWithFPN(body, layers, channels, fpn_channels)
        self.out_channels = fpn_channels

    def forward(self, images: Tensor) -> dict[str, Tensor]:
        """(B, 3, H, W) normalised images -> feature maps by level, (B, channels, H / stride, W / stride)."""
        levels: dict[str, Tensor] = self.pyramid(images)
        return {name: levels[name] for name in ("0", "1", "2")}


def _stage(in_channels: int, channels: int, blocks: int, stride: int) -> nn.Sequential:
    shortcut = None
    if stride != 1 or in_channels != channels:
        shortcut = nn.Sequential(
            nn.Conv2d(in_channels, channels, 1, stride=stride, bias=False), nn.BatchNorm2d(channels)
        )
    first = BasicBlock(in_channels, channels, stride, shortcut)
    return nn.Sequential(first, *(BasicBlock(channels, channels) for _ in range(blocks - 1)))


def build_frame_parser(config: FrameParserConfig | None = None) -> MaskRCNN:
    """Mask R-CNN for one class "object" with colour, material and shape heads, for 480x320 images, not upscaled.

    Training: `model(images, targets)` returns the losses by name. Evaluation: `model(images)` returns a list of
    detections (see `AttributeRoIHeads`). Images are (3, 320, 480) float RGB in 0-1.

    Differs from the paper: by default a slim ResNet and three attribute heads, trained from scratch, so that a CPU suffices;
    `backbone="resnet50", attributes="joint"` is the paper's.
    """
    c = config or FrameParserConfig()
    backbone: nn.Module = (
        SlimBackbone(c.widths, c.blocks, c.fpn_channels)
        if c.backbone == "slim"
        else TorchvisionBackbone(c.backbone, c.fpn_channels)
    )
    levels = ["0", "1"]
    # Both stages read strides 4 and 8: objects are 25-110 px wide.
    box_pool = MultiScaleRoIAlign(levels, output_size=7, sampling_ratio=2, canonical_scale=64, canonical_level=2)
    mask_pool = MultiScaleRoIAlign(levels, output_size=14, sampling_ratio=2, canonical_scale=64, canonical_level=2)
    heads: dict[str, Any] = {
        "box_roi_pool": box_pool,
        "box_head": TwoMLPHead(c.fpn_channels * 7 * 7, c.box_features),
        "box_predictor": FastRCNNPredictor(c.box_features, num_classes=2),
        "mask_roi_pool": mask_pool,
        "mask_head": MaskRCNNHeads(c.fpn_channels, (c.mask_channels,) * c.mask_layers, dilation=1),
        "mask_predictor": MaskRCNNPredictor(c.mask_channels, c.mask_channels, num_classes=2),
    }
    model = MaskRCNN(
        backbone,
        min_size=320,
        max_size=480,
        image_mean=list(c.image_mean),
        image_std=list(c.image_std),
        rpn_anchor_generator=AnchorGenerator(
            sizes=tuple((size,) for size in c.anchor_sizes_px), aspect_ratios=((0.6, 1.0, 1.5),) * 3
        ),
        rpn_pre_nms_top_n_train=600,
        rpn_pre_nms_top_n_test=200,
        rpn_post_nms_top_n_train=c.train_proposals,
        rpn_post_nms_top_n_test=c.proposals,
        _skip_resize=True,
        **heads,
    )
    model.roi_heads = AttributeRoIHeads(
        AttributePredictor(c.box_features) if c.attributes == "three" else JointAttributePredictor(c.box_features),
        fg_iou_thresh=0.5,
        bg_iou_thresh=0.5,
        batch_size_per_image=64,
        positive_fraction=0.25,
        bbox_reg_weights=None,
        score_thresh=0.5,
        nms_thresh=0.5,
        detections_per_img=20,
        **heads,
    )
    return model

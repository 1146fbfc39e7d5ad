"""The frame parser's network: torchvision's `MaskRCNN` with attribute heads and a choice of backbones (paper, section 4.1)."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from msgspec import Meta
from torch import Tensor, nn
from torchvision import models
from torchvision.models.detection import MaskRCNN
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.backbone_utils import BackboneWithFPN
from torchvision.models.detection.faster_rcnn import FastRCNNPredictor, TwoMLPHead
from torchvision.models.detection.image_list import ImageList
from torchvision.models.detection.mask_rcnn import MaskRCNNHeads, MaskRCNNPredictor
from torchvision.models.detection.rpn import RPNHead
from torchvision.models.resnet import BasicBlock
from torchvision.ops import FeaturePyramidNetwork

from nsdr.errors import DataError
from nsdr.frame_parser.regions import GROUP_SPACING_PX, ProposalNetwork, RegionPool
from nsdr.frame_parser.roi_heads import AttributePredictor, AttributeRoIHeads, JointAttributePredictor
from nsdr.validation import Settings, Share, Size, one_of
from nsdr.world.world import CLEVRER_WORLD, World

CHANNEL_MULTIPLE = 16
"""Channels of the slim backbone and the pyramid are multiples of this: oneDNN's channels-last convolutions crash the process
on other widths (seen with torch 2.15 on a CPU)."""
BOX_CELLS, MASK_CELLS = 7, 14
"""Side of the pooled features of the box head and of the mask head (cells)."""
ANCHOR_ASPECT_RATIOS = (0.6, 1.0, 1.5)
"""Height / width of the anchors."""
RPN_CANDIDATES_TRAIN, RPN_CANDIDATES = 600, 200
"""Best regions of each level before non-maximum suppression, in training and at inference."""
RPN_NMS_IOU = 0.7
"""Of two proposed regions of a level with a larger intersection over union, the one with the lower score is dropped (0-1)."""
RPN_POSITIVE_IOU, RPN_NEGATIVE_IOU = 0.7, 0.3
"""Anchors with at least the first intersection over union with a true box are positive in training, those with less than the
second are negative (0-1)."""
RPN_BATCH, RPN_POSITIVE_SHARE = 256, 0.5
"""Anchors per image that the first stage is trained on, and the largest share of positive ones (0-1). These and the values of
the two constants above are torchvision's defaults."""
ROI_MATCH_IOU = 0.5
"""Regions with at least this intersection over union with a true box are positive in training, all others negative (0-1)."""
ROI_BATCH = 64
"""Regions per image that the second stage is trained on."""
ROI_POSITIVE_SHARE = 0.25
"""Largest share of positive regions among them (0-1)."""
MIN_DETECTION_SCORE = 0.5
"""Detections with a score up to this are dropped (0-1); the tracker has its own, higher threshold."""
NMS_IOU = 0.5
"""Of two detections with a larger intersection over union, the one with the lower score is dropped (0-1)."""
MAX_DETECTIONS = 20
"""Largest number of detections in an image."""
_BACKBONES = {"resnet18": [64, 128, 256, 512], "resnet50": [256, 512, 1024, 2048]}
"""torchvision's backbones: channels of the layers of stride 4, 8, 16 and 32 px."""
PositiveShare = Annotated[float, Meta(gt=0, le=1)]


@dataclass(frozen=True)
class FrameParserConfig(Settings):
    """Architecture of the frame parser.

    Attributes:
        backbone: "slim", or torchvision's "resnet18" or "resnet50" (paper); weights are random at first.
        attributes: "three" heads for colour, material and shape, or "joint": one label for all combinations (paper).
        widths: channels of the slim backbone's four residual stages (strides 4, 8, 16 and 32 px); multiples of 16.
        blocks: residual blocks in each stage of the slim backbone.
        fpn_channels: channels of every pyramid level; a multiple of 16.
        anchor_sizes_px: anchor side on the levels of stride 4, 8 and 16 px (pixels). CLEVRER's objects are 25-110 px wide.
        box_features: width of the box head's two layers.
        mask_channels: channels of the mask head's convolutions.
        mask_layers: number of the mask head's convolutions.
        proposals: regions that the second stage takes at inference.
        train_proposals: regions that the second stage's training samples are drawn from.
        image_mean: mean of each RGB channel (0-1), measured on the rendered training frames.
        image_std: standard deviation of each RGB channel (0-1), measured on the rendered training frames.
    """

    backbone: Annotated[str, one_of(("slim", *_BACKBONES))] = "slim"
    attributes: Literal["three", "joint"] = "three"
    widths: tuple[Size, Size, Size, Size] = (32, 64, 128, 192)
    blocks: Size = 2
    fpn_channels: Size = 64
    anchor_sizes_px: tuple[Size, Size, Size] = (24, 48, 88)
    box_features: Size = 256
    mask_channels: Size = 64
    mask_layers: Size = 3
    proposals: Size = 60
    train_proposals: Size = 200
    image_mean: tuple[Share, Share, Share] = (0.510, 0.508, 0.506)
    image_std: tuple[PositiveShare, PositiveShare, PositiveShare] = (0.056, 0.056, 0.059)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in (("widths", self.widths), ("fpn_channels", (self.fpn_channels,))):
            if any(v % CHANNEL_MULTIPLE for v in value):
                raise DataError(f"FrameParserConfig.{name}: expected multiples of {CHANNEL_MULTIPLE}, got {value}")


class SlimBackbone(nn.Module):
    """A narrow ResNet with a feature pyramid of strides 4, 8 and 16 px; the stage of stride 32 px is its top-down input."""

    def __init__(self, widths: tuple[int, int, int, int], blocks: int, fpn_channels: int) -> None:
        super().__init__()
        stem = widths[0]
        self.stem = nn.Sequential(
            nn.Conv2d(3, stem, 5, stride=2, padding=2, bias=False),
            nn.BatchNorm2d(stem),
            nn.ReLU(inplace=True),
            nn.MaxPool2d(3, stride=2, padding=1),
        )
        inputs = (stem, *widths[:-1])
        self.stages = nn.ModuleList(
            _stage(channels, width, blocks, 1 if index == 0 else 2)
            for index, (channels, width) in enumerate(zip(inputs, widths, strict=True))
        )
        self.fpn = FeaturePyramidNetwork(list(widths), fpn_channels)
        self.out_channels = fpn_channels

    def forward(self, images: Tensor) -> dict[str, Tensor]:
        """Normalised images (B, 3, H, W) -> {"0": (B, C, H/4, W/4), "1": (B, C, H/8, W/8), "2": (B, C, H/16, W/16)}."""
        x = self.stem(images)
        features: OrderedDict[str, Tensor] = OrderedDict()
        for index, stage in enumerate(self.stages):
            x = features[str(index)] = stage(x)
        pyramid: dict[str, Tensor] = self.fpn(features)
        del pyramid[str(len(self.stages) - 1)]
        return pyramid


class TorchvisionBackbone(nn.Module):
    """A torchvision network with a feature pyramid of the same levels."""

    def __init__(self, name: str, fpn_channels: int) -> None:
        super().__init__()
        layers = {f"layer{i + 1}": str(i) for i in range(4)}
        self.pyramid = BackboneWithFPN(getattr(models, name)(weights=None), layers, _BACKBONES[name], fpn_channels)
        self.out_channels = fpn_channels

    def forward(self, images: Tensor) -> dict[str, Tensor]:
        """Normalised images (B, 3, H, W) -> levels {"0": (B, C, H/4, W/4), …}, as in `SlimBackbone`."""
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


class FrameParserNetwork(MaskRCNN):
    """torchvision's `MaskRCNN` that keeps the settings and the world it was built from; made by `build_frame_parser`."""

    config: FrameParserConfig
    world: World


def build_frame_parser(config: FrameParserConfig | None = None, world: World = CLEVRER_WORLD) -> FrameParserNetwork:
    """Mask R-CNN for the single class "object" with heads for a world's words, for images that are not rescaled.

    In training mode, `model(images, targets)` returns the losses by name. In evaluation mode, `model(images)` returns one
    dictionary of detections per image (see `AttributeRoIHeads`). Images are (3, height, width) float RGB in 0-1.

    Differs from the paper: the default is a slim ResNet with three attribute heads, trained from scratch, so that a CPU
    suffices. `backbone="resnet50", attributes="joint"` gives the paper's architecture.

    Raises:
        DataError: the world's images are too large.
    """
    c, size = config or FrameParserConfig(), (world.camera.width, world.camera.height)
    if max(size) >= GROUP_SPACING_PX:
        raise DataError(
            f"images of {size[0]}x{size[1]} (world {world.name}): the frame parser takes sides below {GROUP_SPACING_PX} pixels"
        )
    backbone: nn.Module = (
        SlimBackbone(c.widths, c.blocks, c.fpn_channels)
        if c.backbone == "slim"
        else TorchvisionBackbone(c.backbone, c.fpn_channels)
    )
    heads: dict[str, Any] = {
        "box_roi_pool": RegionPool(BOX_CELLS),
        "box_head": TwoMLPHead(c.fpn_channels * BOX_CELLS**2, c.box_features),
        "box_predictor": FastRCNNPredictor(c.box_features, num_classes=2),
        "mask_roi_pool": RegionPool(MASK_CELLS),
        "mask_head": MaskRCNNHeads(c.fpn_channels, (c.mask_channels,) * c.mask_layers, dilation=1),
        "mask_predictor": MaskRCNNPredictor(c.mask_channels, c.mask_channels, num_classes=2),
    }
    anchors = _ExactAnchors(
        sizes=tuple((size,) for size in c.anchor_sizes_px),
        aspect_ratios=(ANCHOR_ASPECT_RATIOS,) * len(c.anchor_sizes_px),
    )
    head = _ExactRPNHead(c.fpn_channels, anchors.num_anchors_per_location()[0])
    model = FrameParserNetwork(
        backbone,
        min_size=world.camera.height,
        max_size=world.camera.width,
        image_mean=list(c.image_mean),
        image_std=list(c.image_std),
        rpn_anchor_generator=anchors,
        rpn_head=head,
        _skip_resize=True,
        **heads,
    )
    model.rpn = ProposalNetwork(
        anchors,
        head,
        fg_iou_thresh=RPN_POSITIVE_IOU,
        bg_iou_thresh=RPN_NEGATIVE_IOU,
        batch_size_per_image=RPN_BATCH,
        positive_fraction=RPN_POSITIVE_SHARE,
        pre_nms_top_n={"training": RPN_CANDIDATES_TRAIN, "testing": RPN_CANDIDATES},
        post_nms_top_n={"training": c.train_proposals, "testing": c.proposals},
        nms_thresh=RPN_NMS_IOU,
    )
    predictor = AttributePredictor if c.attributes == "three" else JointAttributePredictor
    model.roi_heads = AttributeRoIHeads(
        predictor(c.box_features, {name: len(words) for name, words in world.vocabulary.words.items()}),
        fg_iou_thresh=ROI_MATCH_IOU,
        bg_iou_thresh=ROI_MATCH_IOU,
        batch_size_per_image=ROI_BATCH,
        positive_fraction=ROI_POSITIVE_SHARE,
        bbox_reg_weights=None,
        score_thresh=MIN_DETECTION_SCORE,
        nms_thresh=NMS_IOU,
        detections_per_img=MAX_DETECTIONS,
        **heads,
    )
    model.config, model.world = c, world
    return model


class _ExactAnchors(AnchorGenerator):
    """Anchors in float32 in mixed precision, too: bfloat16 has whole pixels only up to 256."""

    def forward(self, image_list: ImageList, feature_maps: list[Tensor]) -> list[Tensor]:
        found: list[Tensor] = super().forward(image_list, [level[:1].float() for level in feature_maps])
        return found


class _ExactRPNHead(RPNHead):
    """Its outputs are float32 in lower precision, too, so that boxes are decoded in it."""

    def forward(self, x: list[Tensor]) -> tuple[list[Tensor], list[Tensor]]:
        logits, deltas = super().forward(x)
        return [level.float() for level in logits], [level.float() for level in deltas]

"""The COCO weights of torchvision's Mask R-CNN, which the paper's frame parser starts from."""

from urllib.error import URLError

import torch
from torch import Tensor
from torchvision.models.detection import MaskRCNN_ResNet50_FPN_Weights, maskrcnn_resnet50_fpn

from nsdr.errors import DataError
from nsdr.frame_parser.model import FrameParserNetwork

__all__ = ["load_coco_weights"]

BACKBONE, FPN_CHANNELS = "resnet50", 256
"""Backbone and channels of the pyramid of torchvision's network."""
MAX_REASON = 120
"""Characters of an error's reason that are shown."""


def load_coco_weights(model: FrameParserNetwork) -> list[str]:
    """Copy the weights of the backbone, the pyramid, the region proposals and the heads' inner layers.

    The outputs for COCO's classes have no counterpart and stay as they are. torchvision's file is downloaded once and its
    checksum verified; only tensors are read from it.

    Returns:
        Names of the tensors that were copied.

    Raises:
        DataError: another architecture, or the file cannot be had; says where it is looked for.
    """
    config = model.config
    if config.backbone != BACKBONE or config.fpn_channels != FPN_CHANNELS:
        raise DataError(
            f"pretrained is 'coco', which needs model.backbone {BACKBONE} with {FPN_CHANNELS} fpn_channels; got "
            f"{config.backbone} with {config.fpn_channels}"
        )
    weights = MaskRCNN_ResNet50_FPN_Weights.COCO_V1
    try:
        state = weights.get_state_dict(progress=False, check_hash=True, weights_only=True)
    except (URLError, OSError, RuntimeError, ValueError) as e:
        folder = f"{torch.hub.get_dir()}/checkpoints"
        raise DataError(
            f"pretrained: the COCO weights cannot be had from {weights.url} ({str(e)[:MAX_REASON]}); put that file into "
            f"{folder}, or give --pretrained '' to start from random weights"
        ) from e
    reference = maskrcnn_resnet50_fpn(weights=None, weights_backbone=None)
    missing = reference.load_state_dict(state, strict=False).missing_keys
    if any(not name.endswith("num_batches_tracked") for name in missing):
        raise DataError(f"pretrained: {weights.url} is not of this torchvision's network ({missing[0]} is missing)")
    ours = model.state_dict()
    fitting: dict[str, Tensor] = {}
    for name, value in reference.state_dict().items():
        target = name.replace("backbone.", "backbone.pyramid.", 1) if name.startswith("backbone.") else name
        if target in ours and ours[target].shape == value.shape:
            fitting[target] = value
    model.load_state_dict(fitting, strict=False)
    return sorted(fitting)

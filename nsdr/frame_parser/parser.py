"""Proposals of videos by a trained network."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from itertools import count, islice, pairwise
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from pycocotools import mask as rle
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval
from torchvision.models.detection.image_list import ImageList
from tqdm import tqdm

from nsdr.clevrer.files.proposals import proposals_from_rows
from nsdr.errors import CheckpointError, DataError
from nsdr.frame_parser.model import ROI_LEVELS, FrameParserConfig, FrameParserNetwork, build_frame_parser
from nsdr.frame_parser.roi_heads import MASK_THRESHOLD
from nsdr.io.checkpoint import PretrainedPart
from nsdr.io.device import limit_threads, resolve_precision
from nsdr.types import VideoProposals
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

MIN_OBJECTNESS = 0.05
"""Regions that are objects with a lower probability are not proposed (0-1). Not in training, where they are the negatives.
`python benchmarks/frame_parser.py --objectness FRAMES` prints how many detections in training frames come from lower ones."""


class FrameParser(PretrainedPart[nn.Module]):
    """Detects objects with their masks and attributes in the frames of a video (paper, section 4.1).

    It runs on the device of the network's weights, and its results are on the CPU.

    Args:
        model: a trained network of `build_frame_parser`.
        batch_size: frames per forward pass.
        stride: process every n-th frame of 25 per second and the last one; the tracker bridges the others. Frames that a
            slower video shows again are never processed twice.
        precision: number format of the convolutions, "float32" or "bfloat16"; "auto" is bfloat16 where the device multiplies
            matrices of it (AMX, CUDA), else float32.

    Raises:
        DataError: `batch_size` or `stride` is less than 1, or `precision` is unknown.
    """

    part = "frame_parser"
    built_from = (FrameParserConfig, build_frame_parser)

    def __init__(self, model: nn.Module, batch_size: int = 8, stride: int = 1, precision: str = "auto") -> None:
        if batch_size < 1 or stride < 1:
            raise DataError(f"batch_size {batch_size} and stride {stride}: expected at least 1")
        resolve_precision(precision, torch.device("cpu"))
        self.model = model.eval().to(memory_format=torch.channels_last)
        self.batch_size, self.stride, self.precision = batch_size, stride, precision

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        if not isinstance(self.model, FrameParserNetwork):
            raise CheckpointError(f"expected a network of build_frame_parser, got {type(self.model).__name__}")
        return super()._description()

    @limit_threads()
    @torch.no_grad()
    def parse(self, frames: Iterable[NDArray[np.uint8]], progress: bool = False) -> VideoProposals:
        """Proposals of a video.

        Args:
            frames: images (320, 480, 3) uint8 RGB, or an array (F, 320, 480, 3) of them. An image that is the same object as
                the one before it, as `nsdr.io.video.read_frames` repeats those of slow videos, shows nothing new.
            progress: show a progress bar.

        Returns:
            Detections with a score above 0.5, with masks; the tracker applies its own threshold.

        Raises:
            DataError: no frames, or a frame of another shape or dtype.
        """
        counter, detect = count(), Detector(self.model, resolve_precision(self.precision, self.device))
        rows: list[tuple[int, int, float, str]] = []
        processed: list[int] = []
        bar = tqdm(desc="frames", unit="frame", disable=not progress, leave=False)
        with ThreadPoolExecutor(1) as decoding:  # decodes the next batch while the network processes the present one
            batches = _batches(zip(frames, counter, strict=False), self.batch_size, self.stride)
            upcoming = decoding.submit(next, batches, None)
            while (batch := upcoming.result()) is not None:
                upcoming = decoding.submit(next, batches, None)
                detections = detect([frame for _, frame in batch])
                for (index, _), detection in zip(batch, detections, strict=True):
                    rows += [(index, *found) for found in _found(detection)]
                processed += [index for index, _ in batch]
                bar.update(processed[-1] + 1 - bar.n)
        bar.close()
        n_frames = next(counter)
        if not n_frames:
            raise DataError("no frames to parse")
        return proposals_from_rows(n_frames, rows, processed)


def _batches(
    frames: Iterable[tuple[NDArray[np.uint8], int]], size: int, stride: int
) -> Iterator[list[tuple[int, NDArray[np.uint8]]]]:
    """Batches of (frame index, frame): every `stride`-th frame and the last one, of those that are not repeated."""

    def chosen() -> Iterator[tuple[int, NDArray[np.uint8]]]:
        last, following = None, 0
        for frame, index in frames:
            if last is not None and frame is last[1]:
                continue
            shape = (HEIGHT_PX, WIDTH_PX, 3)
            if not isinstance(frame, np.ndarray) or frame.dtype != np.uint8 or frame.shape != shape:
                got = f"{frame.shape} {frame.dtype}" if isinstance(frame, np.ndarray) else type(frame).__name__
                raise DataError(f"frame {index}: expected an array {shape} of uint8, RGB from 0 to 255, got {got}")
            last = (index, frame)
            if index >= following:
                following = index + stride
                yield last
        if last is not None and last[0] + stride != following:
            yield last

    iterator = chosen()
    while batch := list(islice(iterator, size)):
        yield batch


def _found(detection: dict[str, Any]) -> Iterator[tuple[int, float, str]]:
    """(attribute index, score, COCO run-length mask) of each detected object."""
    boxes, masks = detection["boxes"].numpy(), detection["masks"][:, 0].numpy()
    attributes = detection["attribute"].argmax(1).tolist()
    for i, score in enumerate(detection["scores"].tolist()):
        yield attributes[i], score, rle.encode(_pasted(masks[i], boxes[i]))["counts"].decode()


def _pasted(mask: NDArray[np.float32], box_xyxy_px: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Mask probabilities (M, M) in a box -> binary mask (320, 480) of the image, in Fortran order.

    torchvision's `paste_masks_in_image` truncates boxes to whole pixels, which shifts masks by half a pixel and makes them
    jitter by as much. Here, pixel i has its value at coordinate i, as in the training targets (RoIAlign, `aligned=False`).
    """
    image = np.zeros((HEIGHT_PX, WIDTH_PX), np.uint8, order="F")
    x0, y0, x1, y1 = box_xyxy_px.astype(float)
    columns = np.arange(max(int(x0) - 1, 0), min(int(x1) + 2, WIDTH_PX))
    rows = np.arange(max(int(y0) - 1, 0), min(int(y1) + 2, HEIGHT_PX))
    u = ((columns - x0) / (x1 - x0) * mask.shape[1] - 0.5).astype(np.float32)
    v = ((rows - y0) / (y1 - y0) * mask.shape[0] - 0.5).astype(np.float32)
    map_u, map_v = np.meshgrid(u, v)
    values = cv2.remap(mask, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = values > MASK_THRESHOLD
    return image


class Detector:
    """Detections of a trained network of `build_frame_parser`, the same as the network's own within rounding.

    The first stage is a copy, with batch normalisation in the convolutions' weights; boxes, classes and masks are computed in
    float32 by the network's own second stage.

    Args:
        model: the network, in evaluation mode; on the device to use.
        precision: number format of the copy.
        min_objectness: regions that are objects with a lower probability are not proposed (0-1).
    """

    def __init__(self, model: Any, precision: torch.dtype, min_objectness: float = MIN_OBJECTNESS) -> None:
        self.precision, self.roi_heads = precision, model.roi_heads
        self.backbone = _fused(deepcopy(model.backbone))
        self.rpn = _fused(deepcopy(model.rpn))
        for part in (self.backbone, self.rpn.head):
            part.to(precision).to(memory_format=torch.channels_last)
        self.rpn.score_thresh = min_objectness
        self.device = next(model.parameters()).device
        mean, std = torch.tensor([model.transform.image_mean, model.transform.image_std], device=self.device)
        self.scale, self.offset = 1 / (255 * std), mean / std

    def __call__(self, frames: Sequence[NDArray[np.uint8]]) -> list[dict[str, Tensor]]:
        """Detections in RGB frames (H, W, 3) of one size, as `AttributeRoIHeads` describes them; on the CPU."""
        images, sizes = self.normalized(frames), [frame.shape[:2] for frame in frames]
        levels = self.backbone(images)
        proposals, _ = self.rpn(ImageList(images, sizes), levels)
        # RoIAlign wants contiguous features; conversion and copy in one step take a quarter of the time of two.
        pooled = {k: levels[k].to(torch.float32, memory_format=torch.contiguous_format) for k in ROI_LEVELS}
        detections = self.roi_heads(pooled, proposals, sizes)[0]
        return [{name: value.cpu() for name, value in found.items()} for found in detections]

    def normalized(self, frames: Sequence[NDArray[np.uint8]]) -> Tensor:
        """The network's input (B, 3, H, W), channels last."""
        pixels = torch.from_numpy(np.stack(frames)).to(self.device)
        # Whole rows at a time: arithmetic along an axis of three channels takes three times as long.
        width = pixels.shape[2]
        rows = pixels.float().flatten(2).mul_(self.scale.repeat(width)).sub_(self.offset.repeat(width))
        return rows.to(self.precision).view(pixels.shape).permute(0, 3, 1, 2)


def _fused(module: Any) -> Any:
    """The module with each convolution and the batch normalisation that follows it as one convolution."""
    names = list(module._modules)
    for name, following in pairwise(names):
        conv, norm = module._modules[name], module._modules[following]
        if isinstance(conv, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            module._modules[name], module._modules[following] = fuse_conv_bn_eval(conv, norm), nn.Identity()
    for child in module.children():
        _fused(child)
    return module

"""Proposals of videos by a trained network."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace
from itertools import chain, count, islice, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F
from torch.nn.utils.fusion import fuse_conv_bn_eval
from torchvision.models.detection.image_list import ImageList
from tqdm import tqdm

from nsdr.clevrer.files.masks import ObjectRuns, encoded_runs
from nsdr.clevrer.files.proposals import proposals_from_runs
from nsdr.errors import CheckpointError, DataError
from nsdr.frame_parser.model import FrameParserConfig, FrameParserNetwork, build_frame_parser
from nsdr.frame_parser.pasting import mask_changes
from nsdr.frame_parser.regions import ROI_LEVELS
from nsdr.io.checkpoint import PretrainedPart
from nsdr.io.device import limit_threads, resolve_precision
from nsdr.types import VideoProposals
from nsdr.world.world import World

if TYPE_CHECKING:
    from nsdr.io.images import VideoSource

MIN_OBJECTNESS = 0.05
"""Regions that are objects with a lower probability are not proposed (0-1). Not in training, where they are the negatives.
`python -m benchmarks.frame_parser --objectness FRAMES` prints how many detections in training frames come from lower ones."""

LARGEST_STRIDE = 32
"""Of the network's stages (pixels). torchvision pads images to multiples of it in training."""


class FrameParser(PretrainedPart[nn.Module]):
    """Detects objects with their masks and attributes in the frames of a video (paper, section 4.1).

    It runs on the device of the network's weights, and its results are on the CPU.

    Args:
        model: a trained network of `build_frame_parser`.
        batch_size: frames per forward pass.
        stride: process every n-th frame of 25 per second and the last one; the tracker bridges the others. Frames that a
            slower video shows again are never processed twice.
        precision: number format of the convolutions, "float32" or "bfloat16"; "auto" is bfloat16 where a CPU multiplies
            matrices of it (AMX), else float32. On CUDA, bfloat16 saves little and changes doubtful detections
            (`make gpu`).
        world: what the videos are of; None for the world that the network was trained for. It has the same words.

    Raises:
        DataError: `batch_size` or `stride` is less than 1, `precision` is unknown, or the network has other words.
    """

    part = "frame_parser"
    free = ("vocabulary.", "physics.", "timeline.", "camera.")
    built_from = (FrameParserConfig, build_frame_parser)

    def __init__(
        self,
        model: nn.Module,
        batch_size: int = 8,
        stride: int = 1,
        precision: str = "auto",
        world: World | None = None,
    ) -> None:
        if batch_size < 1 or stride < 1:
            raise DataError(f"batch_size {batch_size} and stride {stride}: expected at least 1")
        resolve_precision(precision, torch.device("cpu"))
        self.model = model.eval().to(memory_format=torch.channels_last)
        self.batch_size, self.stride, self.precision = batch_size, stride, precision
        self.world = world or self.trained_for
        self.check_world(self.world)
        self._prepared: tuple[Any, Detector] | None = None

    def check_world(self, world: World) -> None:
        """Raise `DataError` if the network was trained on other words or images than the world's; says what differs."""
        if not isinstance(self.model, FrameParserNetwork):
            return
        remedy = "give the weights of this world, or train them (`nsdr train frame-parser`)"
        trained, own = (f"{one.camera.width}x{one.camera.height}" for one in (self.trained_for, world))
        if trained != own:
            raise DataError(
                f"the frame parser was trained on images of {trained}; those of the world {world.name} have {own}: {remedy}"
            )
        for (name, known), words in zip(
            self.trained_for.vocabulary.words.items(), world.vocabulary.words.values(), strict=True
        ):
            if words != known:
                raise DataError(
                    f"the frame parser was trained on the {name} words {', '.join(known)}; the world {world.name} has "
                    f"{', '.join(words)}: {remedy}"
                )

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        if not isinstance(self.model, FrameParserNetwork):
            raise CheckpointError(f"expected a network of build_frame_parser, got {type(self.model).__name__}")
        return super()._description()

    @limit_threads()
    @torch.no_grad()
    def parse(self, frames: "VideoSource", progress: bool = False) -> VideoProposals:
        """Proposals of a video.

        Args:
            frames: a video file; or its frames (F, height, width, 3) uint8 RGB, as an array or as images such as those of
                Pillow; or an iterator over arrays (height, width, 3) of the world's size, which are parsed as they come. Frames
                of another size are scaled to it, which is noted. An image that is the same object as the one before it, as
                `nsdr.io.video.read_frames` repeats those of slow videos, shows nothing new.
            progress: show a progress bar.

        Returns:
            Detections with a score above 0.5, with masks; the tracker applies its own threshold.

        Raises:
            DataError: no frames, or a frame of another shape or dtype.
            VideoError: the file cannot be read.
        """
        notes: list[str] = []
        if not isinstance(frames, Iterator):
            from nsdr.io.video import read_frames  # OpenCV changes the environment of the process

            frames = read_frames(frames, note=notes.append, world=self.world)
        counter, detect = count(), self._detector()
        size = (self.world.camera.height, self.world.camera.width)
        rows: list[NDArray[np.float64]] = []
        changes: list[NDArray[np.int64]] = []
        processed: list[int] = []
        bar = tqdm(desc="looking for objects", unit="frame", disable=not progress, leave=False)
        with ThreadPoolExecutor(1) as decoding:  # decodes the next batch while the network processes the present one
            batches = _batches(zip(frames, counter, strict=False), self.batch_size, self.stride, size)
            upcoming = decoding.submit(next, batches, None)
            while (batch := upcoming.result()) is not None:
                upcoming = decoding.submit(next, batches, None)
                found = detect([frame for _, frame in batch])
                columns = (found["image"] + len(processed), found["attribute"].argmax(1), found["scores"])
                changes.append(mask_changes(found["masks"][:, 0], found["boxes"], size).cpu().numpy())
                changes[-1][0] += sum(map(len, rows))
                rows.append(torch.stack([column.float() for column in columns], 1).cpu().numpy())
                processed += [index for index, _ in batch]
                bar.update(processed[-1] + 1 - bar.n)
        bar.close()
        n_frames = next(counter)
        if not n_frames:
            raise DataError("no frames to parse")
        place, attribute, score = np.concatenate(rows).astype(np.float64).T
        (mask, start), (_, stop) = (np.concatenate(changes, 1)[:, k::2] for k in (0, 1))
        runs = ObjectRuns(mask, start, stop)
        masks = encoded_runs(runs, len(score), *size)
        frame_index = np.array(processed, np.int64)[place.astype(np.int64)]
        parsed = proposals_from_runs(
            n_frames, frame_index, attribute.astype(np.int64), score, masks, runs, processed, self.world
        )
        return replace(parsed, notes=tuple(notes))

    def _detector(self) -> "Detector":
        """The prepared network, made again where the weights, the device or the precision have changed."""
        is_float32 = self.precision == "auto" and self.device.type == "cuda"
        precision = resolve_precision("float32" if is_float32 else self.precision, self.device)
        tensors = chain(self.model.parameters(), self.model.buffers())
        versions = ((t.data_ptr(), 0 if t.is_inference() else t._version) for t in tensors)
        state = (precision, self.model.roi_heads, *versions)
        if self._prepared is None or self._prepared[0] != state:
            self._prepared = (state, Detector(self.model, precision))
        return self._prepared[1]


def _batches(
    frames: Iterable[tuple[NDArray[np.uint8], int]], count: int, stride: int, size: tuple[int, int]
) -> Iterator[list[tuple[int, NDArray[np.uint8]]]]:
    """Batches of `count` pairs (frame index, frame): every `stride`-th frame and the last one, without repeated ones."""

    def chosen() -> Iterator[tuple[int, NDArray[np.uint8]]]:
        last, following = None, 0
        for frame, index in frames:
            if last is not None and frame is last[1]:
                continue
            shape = (*size, 3)
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
    while batch := list(islice(iterator, count)):
        yield batch


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

    def __call__(self, frames: Sequence[NDArray[np.uint8]]) -> dict[str, Tensor]:
        """`AttributeRoIHeads.detections` in RGB frames (H, W, 3) of one size."""
        images, sizes = self.normalized(frames), [frame.shape[:2] for frame in frames]
        levels = self.backbone(images)
        proposals, _ = self.rpn(ImageList(images, sizes), levels)
        # RoIAlign wants contiguous features; conversion and copy in one step take a quarter of the time of two.
        pooled = {k: levels[k].to(torch.float32, memory_format=torch.contiguous_format) for k in ROI_LEVELS}
        found: dict[str, Tensor] = self.roi_heads.detections(pooled, proposals, sizes)
        return found

    def normalized(self, frames: Sequence[NDArray[np.uint8]]) -> Tensor:
        """The network's input (B, 3, H, W), channels last; zeros fill it up to multiples of the largest stride."""
        # From pinned memory, the frames go to a GPU ten times as fast.
        shape = (len(frames), *frames[0].shape)
        stacked = torch.empty(shape, dtype=torch.uint8, pin_memory=self.device.type == "cuda")
        np.stack(frames, out=stacked.numpy())
        pixels = stacked.to(self.device, non_blocking=True)
        # Whole rows at a time: arithmetic along an axis of three channels takes three times as long.
        width = pixels.shape[2]
        rows = pixels.float().flatten(2).mul_(self.scale.repeat(width)).sub_(self.offset.repeat(width))
        images = rows.to(self.precision).view(pixels.shape).permute(0, 3, 1, 2)
        padding = [-side % LARGEST_STRIDE for side in reversed(images.shape[2:])]
        return F.pad(images, (0, padding[0], 0, padding[1])) if any(padding) else images


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

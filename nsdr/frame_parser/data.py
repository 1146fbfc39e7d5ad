"""Frames with masks and attributes, for training and evaluating the frame parser."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from pycocotools import mask as rle
from torch import Tensor
from torch.utils.data import Dataset

from nsdr.clevrer.vocab import ATTRIBUTES
from nsdr.errors import DataError

__all__ = ["AugmentConfig", "FrameDataset", "augment", "image_tensor"]

Target = dict[str, Tensor]


@dataclass(frozen=True)
class AugmentConfig:
    """What real H.264 video does to a clean render; each change is drawn for every picture anew.

    Attributes:
        flip: probability of a horizontal flip (the camera looks along the symmetry plane y = 0).
        brightness: largest relative change of brightness, and of each colour channel at a third of it.
        noise: largest standard deviation of pixel noise (0-255).
        blur: probability of a slight Gaussian blur.
        jpeg: probability of JPEG compression, at quality 30-90.
    """

    flip: float = 0.5
    brightness: float = 0.12
    noise: float = 4.0
    blur: float = 0.3
    jpeg: float = 0.5


def augment(
    image: NDArray[np.uint8], masks: NDArray[np.uint8], config: AugmentConfig, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Change a picture (H, W, 3) and its masks (N, H, W) at random; both come back as new arrays."""
    if rng.random() < config.flip:
        image, masks = image[:, ::-1], masks[:, :, ::-1]
    gain = 1 + config.brightness * (rng.uniform(-1, 1) + rng.uniform(-1, 1, 3) / 3)
    changed = image * gain + rng.normal(size=image.shape) * rng.uniform(0, config.noise)
    image = np.clip(changed, 0, 255).astype(np.uint8)
    if rng.random() < config.blur:
        image = cv2.GaussianBlur(image, (3, 3), rng.uniform(0.3, 0.9))  # type: ignore[assignment]
    if rng.random() < config.jpeg:
        _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 91))])
        image = cv2.imdecode(code, cv2.IMREAD_COLOR)  # type: ignore[assignment]
    return image, np.ascontiguousarray(masks)


def image_tensor(image: NDArray[np.uint8]) -> Tensor:
    """RGB picture (H, W, 3) uint8 -> (3, H, W) float in 0-1, as the network takes it."""
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))).float().div_(255)


class FrameDataset(Dataset[tuple[Tensor, Target]]):
    """Pictures listed in `annotations_*.jsonl` beside a folder `images`, one line a frame.

    A line holds `file_name`, `scene`, `objects: [{color, material, shape, segmentation (COCO RLE)}]`. Items are an
    image tensor (3, H, W) and a target (see `AttributeRoIHeads`). The split is by scene, so that no scene is in both.

    Args:
        folder: where the JSON lines are.
        part: "train", "evaluation" (every 20th scene) or "all".
        augmentation: what to change, or None to leave the pictures as they are.

    Raises:
        DataError: no annotations, an unknown attribute or a missing picture, with its name.
    """

    def __init__(self, folder: str | Path, part: str = "train", augmentation: AugmentConfig | None = None) -> None:
        self.folder = Path(folder)
        self.augmentation = augmentation
        if part not in ("train", "evaluation", "all"):
            raise DataError(f"part is {part!r}; expected train, evaluation or all")
        self.records = [
            r for r in _records(self.folder) if part == "all" or (r["scene"] % 20 == 0) != (part == "train")
        ]
        if not self.records:
            raise DataError(f"{self.folder}: no frames for part {part!r}; expected annotations_*.jsonl and images/")

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, index: int) -> tuple[Tensor, Target]:
        return self.get(index, np.random.default_rng())

    def get(self, index: int, rng: np.random.Generator) -> tuple[Tensor, Target]:
        """Item `index`, its augmentation drawn from `rng`."""
        record = self.records[index]
        path = self.folder / "images" / record["file_name"]
        image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
        if image is None:
            raise DataError(f"{path}: no readable picture")
        objects = record["objects"]
        masks = np.zeros((0, *image.shape[:2]), np.uint8)
        if objects:
            masks = rle.decode([o["segmentation"] for o in objects]).transpose(2, 0, 1)
        if self.augmentation is not None:
            image, masks = augment(image, masks, self.augmentation, rng)  # type: ignore[arg-type]
        return image_tensor(image), _target(objects, masks)  # type: ignore[arg-type]


def _records(folder: Path) -> Iterator[dict[str, Any]]:
    for path in sorted(folder.glob("annotations_*.jsonl")):
        for number, line in enumerate(path.read_text().splitlines(), 1):
            try:
                record = json.loads(line)
                for o in record["objects"]:
                    if any(o[name] not in words for name, words in ATTRIBUTES.items()):
                        raise DataError(f"{path}, line {number}: unknown attribute in {o}")
            except (json.JSONDecodeError, KeyError, TypeError) as e:
                raise DataError(f"{path}, line {number}: not a frame record ({e!r})") from e
            yield record


def _target(objects: list[dict[str, Any]], masks: NDArray[np.uint8]) -> Target:
    boxes = np.zeros((len(objects), 4), np.float32)
    for box, mask in zip(boxes, masks, strict=True):
        x, y, w, h = cv2.boundingRect(mask)
        box[:] = x, y, x + w, y + h
    target = {
        "boxes": torch.from_numpy(boxes),
        "labels": torch.ones(len(objects), dtype=torch.int64),
        "masks": torch.from_numpy(np.ascontiguousarray(masks)),
    }
    for name, words in ATTRIBUTES.items():
        target[name] = torch.tensor([words.index(o[name]) for o in objects], dtype=torch.int64)
    return target

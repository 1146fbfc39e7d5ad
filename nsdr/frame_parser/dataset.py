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

from nsdr.errors import DataError
from nsdr.io.files import read_json
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["AugmentConfig", "FrameDataset", "augment", "image_tensor"]

Target = dict[str, Tensor]


@dataclass(frozen=True)
class AugmentConfig:
    """What real H.264 video does to a clean render; each change is drawn for every image anew.

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
    """Change a image (H, W, 3) and its masks (N, H, W) at random; both come back as new arrays."""
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
    """RGB image (H, W, 3) uint8 -> (3, H, W) float in 0-1, as the network takes it."""
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))).float().div_(255)


class FrameDataset(Dataset[tuple[Tensor, Target]]):
    """Images beside their masks and attributes.

    Either `annotations_*.jsonl` beside a folder `images`, one line a frame (`nsdr data frames` makes them of videos with mask
    proposals, the release's or generated ones), or COCO's `*.json` whose categories are named like "red metal cube". A line
    holds `file_name`, `scene`, `objects: [{color, material, shape, segmentation (COCO RLE)}]`. Items are an image tensor
    (3, H, W) and a target (see `AttributeRoIHeads`). The split is by scene, so that no scene is in both.

    Args:
        folder: where the annotations are.
        part: "train", "evaluation" (every 20th scene) or "all".
        augmentation: what to change, or None to leave the images as they are.

    Raises:
        DataError: no annotations, an unknown attribute or a missing image, with its name.
    """

    def __init__(self, folder: str | Path, part: str = "train", augmentation: AugmentConfig | None = None) -> None:
        self.folder = Path(folder)
        self.augmentation = augmentation
        if part not in ("train", "evaluation", "all"):
            raise DataError(f"part is {part!r}; expected train, evaluation or all")
        self.records = [
            r for r in _all_records(self.folder) if part == "all" or (r["scene"] % 20 == 0) != (part == "train")
        ]
        if not self.records:
            raise DataError(
                f"{self.folder}: no frames for part {part!r}; expected annotations_*.jsonl or COCO *.json, and images/"
            )

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, index: int) -> tuple[Tensor, Target]:
        return self.get(index, np.random.default_rng())

    def get(self, index: int, rng: np.random.Generator) -> tuple[Tensor, Target]:
        """Item `index`, a image (3, 320, 480) in 0-1 and its target, the augmentation drawn from `rng`."""
        record = self.records[index]
        path = self.folder / "images" / record["file_name"]
        image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
        if image is None:
            raise DataError(f"{path}: no readable image")
        objects = record["objects"]
        masks = np.zeros((0, *image.shape[:2]), np.uint8)
        if objects:
            masks = rle.decode([o["segmentation"] for o in objects]).transpose(2, 0, 1)
        if self.augmentation is not None:
            image, masks = augment(image, masks, self.augmentation, rng)  # type: ignore[arg-type]
        return image_tensor(image), _target(objects, masks)  # type: ignore[arg-type]


def _all_records(folder: Path) -> Iterator[dict[str, Any]]:
    lines = sorted(folder.glob("annotations_*.jsonl"))
    return _records(folder) if lines else (r for path in sorted(folder.glob("*.json")) for r in _coco_records(path))


def _coco_records(path: Path) -> Iterator[dict[str, Any]]:
    """Frame records of a COCO file; a image's `scene` is its `video_id` where it has one, else its own `id`."""
    content = read_json(path)
    try:
        words = {c["id"]: dict(zip(ATTRIBUTES, c["name"].split(), strict=True)) for c in content["categories"]}
        for number, named in words.items():
            if any(named[name] not in known for name, known in ATTRIBUTES.items()):
                raise DataError(f'{path}: category {number}: expected a name like "red metal cube", got {named}')
        found: dict[Any, list[dict[str, Any]]] = {image["id"]: [] for image in content["images"]}
        sizes = {image["id"]: (image["height"], image["width"]) for image in content["images"]}
        for a in content["annotations"]:
            mask = _coco_mask(a["segmentation"], *sizes[a["image_id"]])
            found[a["image_id"]].append({**words[a["category_id"]], "segmentation": mask})
        for image in content["images"]:
            scene = image.get("video_id", image["id"])
            yield {"file_name": image["file_name"], "scene": scene, "objects": found[image["id"]]}
    except (KeyError, TypeError, ValueError) as e:
        raise e if isinstance(e, DataError) else DataError(f"{path}: not a COCO file ({e!r})") from e


def _coco_mask(segmentation: Any, height: int, width: int) -> dict[str, Any]:
    """A compressed run-length mask from any of COCO's three forms."""
    if isinstance(segmentation, list):
        return dict(rle.merge(rle.frPyObjects(segmentation, height, width)))
    if isinstance(segmentation["counts"], list):
        return dict(rle.frPyObjects(segmentation, height, width))
    return dict(segmentation)


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

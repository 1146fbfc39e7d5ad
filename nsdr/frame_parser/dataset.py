"""Frames with masks and attributes, for training and evaluation of the frame parser."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import torch
from msgspec import Meta
from numpy.typing import NDArray
from PIL import Image
from pycocotools import mask as rle
from torch import Tensor
from torch.utils.data import Dataset
from torchvision.ops import box_convert

from nsdr.errors import DataError, machine_error
from nsdr.frame_parser.frame_files import read_frame_records
from nsdr.io.description import differing
from nsdr.io.limits import check_limit
from nsdr.io.worlds import world_of_folder
from nsdr.validation import Settings, Share, expect

Target = dict[str, Tensor]
"""Target of one image, as `AttributeRoIHeads` describes it."""

EVALUATION_EVERY = 20
"""Scenes whose index is a multiple of this are for evaluation, all others for training."""
CHANNEL_GAIN_DIVISOR = 3
"""The relative change of each colour channel is at most that of the brightness divided by this."""
BLUR_KERNEL_PX = 3
"""Side of the Gaussian blur's kernel (pixels)."""
BLUR_SIGMA_PX = (0.3, 0.9)
"""Smallest and largest standard deviation of the Gaussian blur (pixels)."""
JPEG_QUALITY_RANGE = (30, 90)
"""Lowest and highest JPEG quality (0-100)."""


@dataclass(frozen=True)
class AugmentConfig(Settings):
    """Random changes that make clean renders look like H.264 video; drawn independently for every image.

    Attributes:
        flip: probability of a horizontal flip (0-1). The camera lies in the plane y = 0, so that a flipped view is valid.
        brightness: largest relative change of brightness (0-1); that of each colour channel is a third of it.
        noise: largest standard deviation of the pixel noise (grey levels, 0-255).
        blur: probability of a slight Gaussian blur (0-1).
        jpeg: probability of JPEG compression at a quality of 30-90 (0-1).
    """

    flip: Share = 0.5
    brightness: Share = 0.12
    noise: Annotated[float, Meta(ge=0.0, le=255.0)] = 4.0
    blur: Share = 0.3
    jpeg: Share = 0.5


def augment(
    image: NDArray[np.uint8], masks: NDArray[np.uint8], config: AugmentConfig, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Randomly changed copies of an RGB image (H, W, 3) and its masks (N, H, W)."""
    if rng.random() < config.flip:
        image, masks = image[:, ::-1], masks[:, :, ::-1]
    gain = 1 + config.brightness * (rng.uniform(-1, 1) + rng.uniform(-1, 1, 3) / CHANNEL_GAIN_DIVISOR)
    changed = image * gain + rng.normal(size=image.shape) * rng.uniform(0, config.noise)
    image = np.clip(changed, 0, 255).astype(np.uint8)
    if rng.random() < config.blur:
        image = cv2.GaussianBlur(image, (BLUR_KERNEL_PX, BLUR_KERNEL_PX), rng.uniform(*BLUR_SIGMA_PX))  # type: ignore[assignment]
    if rng.random() < config.jpeg:
        quality = int(rng.integers(JPEG_QUALITY_RANGE[0], JPEG_QUALITY_RANGE[1] + 1))
        _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
        image = cv2.imdecode(encoded, cv2.IMREAD_COLOR)  # type: ignore[assignment]
    return image, np.ascontiguousarray(masks)


def image_tensor(image: NDArray[np.uint8]) -> Tensor:
    """RGB image (H, W, 3) uint8 -> (3, H, W) float32 in 0-1, the network's input."""
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))).float().div_(255)


def collate(items: Sequence[tuple[Tensor, Target]]) -> tuple[list[Tensor], list[Target]]:
    """Items of `FrameDataset` -> a list of B images (3, H, W) and a list of B targets: `model(*collate(items))`.

    It is the `collate_fn` of a `DataLoader`. Targets are not stacked, because they differ in their number of objects.
    """
    return [image for image, _ in items], [target for _, target in items]


class FrameDataset(Dataset[tuple[Tensor, Target]]):
    """Images with the masks and attributes of their objects.

    The folder holds `images/` and `annotations_*.jsonl`, which have one line per frame, with `file_name`, `scene` and
    `objects: [{color, material, shape, segmentation (COCO RLE)}]`, and `world.json` for frames of another world than CLEVRER's;
    `nsdr data frames` makes them from videos with mask proposals.

    Items are an image (3, H, W) in 0-1 and its target (see `AttributeRoIHeads`). Their augmentation is drawn anew each time, by
    torch's seed; `get` draws it from a generator that is given. The split is by scene: no scene is in both parts.

        >>> loader = DataLoader(FrameDataset(folder, augmentation=AugmentConfig()), 8, collate_fn=collate)

    Args:
        folder: folder with the annotations and `images/`.
        part: "train", "evaluation" (every 20th scene) or "all".
        augmentation: random changes; None leaves the images as they are.

    Attributes:
        world: the world of the frames; targets have the indices of its words.

    Raises:
        DataError: no annotations, an unknown attribute or a missing image; names it.
    """

    def __init__(
        self,
        folder: str | Path,
        part: str = "train",
        augmentation: AugmentConfig | None = None,
    ) -> None:
        expect(part in ("train", "evaluation", "all"), "part", "train, evaluation or all", part)
        self.folder, self.augmentation = Path(folder), augmentation
        kept = {"train": (False,), "evaluation": (True,), "all": (False, True)}[part]
        self.world = world_of_folder(self.folder)
        records = read_frame_records(self.folder, self.world.vocabulary.words)
        self.records = [r for r in records if (r["scene"] % EVALUATION_EVERY == 0) in kept]
        if not self.records:
            raise DataError(f"{self.folder}: no frames for part {part!r}; expected annotations_*.jsonl and images/")

    def __repr__(self) -> str:
        told = [repr(str(self.folder)), f"{len(self)} frames", *differing(self.world)]
        return f"FrameDataset({', '.join(told)})"

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, index: int) -> tuple[Tensor, Target]:
        return self.get(index, np.random.default_rng(int(torch.randint(2**63 - 1, ()))))

    def get(self, index: int, rng: np.random.Generator) -> tuple[Tensor, Target]:
        """Image (3, H, W) in 0-1 and target of item `index`, with the augmentation drawn from `rng`."""
        path, objects = self.folder / "images" / self.records[index]["file_name"], self.records[index]["objects"]
        image = _read_image(path)
        masks = np.zeros((0, *image.shape[:2]), np.uint8)
        if objects:
            masks = rle.decode([o["segmentation"] for o in objects]).transpose(2, 0, 1)
            if masks.shape[1:] != image.shape[:2]:
                raise DataError(f"{path}: is {image.shape[:2]}, its masks are {masks.shape[1:]} (height, width)")
        if self.augmentation is not None:
            image, masks = augment(image, masks, self.augmentation, rng)
        return image_tensor(image), _target(objects, masks, self.world.vocabulary.words)


def _read_image(path: Path) -> NDArray[np.uint8]:
    """An RGB image; its size is checked before it is decoded."""
    try:
        with Image.open(path) as header:
            check_limit(header.width * header.height, "image_pixels", str(path))
    except (OSError, Image.DecompressionBombError) as e:
        if failure := machine_error(e, path):
            raise failure from e
        raise DataError(f"{path}: no readable image ({e})") from e
    image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise DataError(f"{path}: no readable image")
    return np.asarray(image, np.uint8)


def _target(objects: list[dict[str, Any]], masks: NDArray[np.uint8], known: Mapping[str, Sequence[str]]) -> Target:
    boxes_xywh = np.array([cv2.boundingRect(mask) for mask in masks], np.float32).reshape(-1, 4)
    target = {
        "boxes": box_convert(torch.from_numpy(boxes_xywh), "xywh", "xyxy"),
        "labels": torch.ones(len(objects), dtype=torch.int64),
        "masks": torch.from_numpy(np.ascontiguousarray(masks)),
    }
    words = {name: [of_one.index(o[name]) for o in objects] for name, of_one in known.items()}
    return target | {name: torch.tensor(indices, dtype=torch.int64) for name, indices in words.items()}

"""Features of videos for the baselines: their settings, and the folder that `nsdr data features` writes."""

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from nsdr.baselines.features.backbone import CHANNELS, FRAME_PARSER, PYRAMID_LEVELS, STRIDE
from nsdr.errors import DataError, MachineError, machine_error
from nsdr.frame_parser.model import FrameParserConfig
from nsdr.io.checkpoint import find_checkpoint, load_description
from nsdr.io.configuration import config_of
from nsdr.io.device import PRECISIONS
from nsdr.io.fingerprint import fingerprint
from nsdr.io.ledger import LEDGER
from nsdr.io.reading import read_json
from nsdr.validation import MAX_SIZE, Settings, Size, one_of
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.layout import MAX_OBJECTS
from nsdr.world.vocabulary import CLEVRER, Words

KINDS = ("pooled", "maps", "objects")
"""Kinds of features; the names of the fields of `nsdr.baselines.base.Batch`."""
MANIFEST = "features.json"
"""The file in a folder of features that says how they were made."""
NAMES = ("detector",)
"""Settings that name weights. Features depend on the content of these weights, whose fingerprint is in the manifest."""
BOX_NUMBERS = 4
"""Numbers for an object's box, after its features: left, top, right and bottom as shares of the image."""
WORDS = ("colors", "materials", "shapes")
"""Settings that name words."""
SOURCES = ("truth", "proposals")
"""Where objects that are described by words come from: annotations, or a frame parser's detections."""
Objects = Annotated[int, Meta(ge=1, le=MAX_OBJECTS)]
"""Number of objects in a video."""
Side = Annotated[int, Meta(ge=STRIDE, le=MAX_SIZE)]
"""Height or width of an image (pixels)."""


@dataclass(frozen=True)
class FeatureConfig(Settings):
    """How features are made of a video. The defaults are the paper's settings.

    Attributes:
        backbone: "resnet50" (paper) or "resnet18" with torchvision's weights, downloaded when first used, or "frame_parser",
            the backbone of the detector.
        frames: number of frames, evenly spaced from the first to the last one.
        image_size: height and width to which frames are scaled (pixels); the frame parser's is 320 and 480.
        grid: height and width to which the maps are average-pooled; None leaves them as they are. The frame parser's maps have
            several sizes and need a grid.
        pooled_grid: height and width of a coarser grid; "pooled" has the means of the last maps over its cells. With 1 and 1
            these are pool5 of a ResNet.
        kinds: what is written: "pooled", "maps" (of a ResNet's third stage, or of the frame parser's pyramid) and "objects".
        detector: checkpoint of the frame parser that finds the objects.
        max_objects: most objects in a video; those seen in most frames are kept.
        precision: number format of the backbone, "float32" or "bfloat16"; "auto" as in `nsdr.io.device`.

    Raises:
        DataError: a value is out of its range; names it.
    """

    backbone: Annotated[str, one_of((*CHANNELS, FRAME_PARSER))] = "resnet50"
    frames: Size = 25
    image_size: tuple[Side, Side] = (224, 224)
    grid: tuple[Size, Size] | None = None
    pooled_grid: tuple[Size, Size] = (1, 1)
    kinds: tuple[str, ...] = KINDS
    detector: str = "default"
    max_objects: Objects = 10
    precision: Annotated[str, one_of(PRECISIONS)] = "auto"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_kinds(self.kinds)
        if self.backbone == FRAME_PARSER and (self.grid is None or self.image_size != (HEIGHT_PX, WIDTH_PX)):
            raise DataError(f"backbone {FRAME_PARSER} needs a grid, and image_size [{HEIGHT_PX}, {WIDTH_PX}]")
        height, width = self.map_size
        if self.grid is not None and (self.grid[0] > height or self.grid[1] > width):
            raise DataError(f"grid is {list(self.grid)}; expected at most the maps' {height} and {width}")
        of_parser = self.grid if self.backbone == FRAME_PARSER else None
        height, width = of_parser or ((height + 1) // 2, (width + 1) // 2)  # a ResNet's last maps are half as large
        if self.pooled_grid[0] > height or self.pooled_grid[1] > width:
            raise DataError(f"pooled_grid is {list(self.pooled_grid)}; expected at most {height} and {width}")

    @property
    def map_size(self) -> tuple[int, int]:
        """Height and width of the coarsest maps, before pooling."""
        height, width = (math.ceil(side / STRIDE) for side in self.image_size)
        return height, width

    @property
    def reads_detector(self) -> bool:
        """Whether features depend on the detector."""
        return self.backbone == FRAME_PARSER or "objects" in self.kinds

    def channels(self) -> tuple[int, int]:
        """Channels of the maps, and of the last ones.

        Raises:
            CheckpointError: there is no such frame parser.
        """
        if self.backbone != FRAME_PARSER:
            return CHANNELS[self.backbone]
        described = load_description(find_checkpoint(self.detector), "frame_parser")
        of_maps = len(PYRAMID_LEVELS) * config_of(FrameParserConfig, described["config"]).fpn_channels
        return of_maps, of_maps

    def shape(self, kind: str) -> tuple[int, ...]:
        """Shape of a video's features of a kind, as in `nsdr.baselines.base.Batch` without its first axis.

        Raises:
            CheckpointError: there is no such frame parser.
        """
        of_maps, last = self.channels()
        if kind == "pooled":
            return self.frames, last * math.prod(self.pooled_grid)
        if kind == "maps":
            return self.frames, of_maps, *(self.grid or self.map_size)
        return self.frames, self.max_objects, of_maps + BOX_NUMBERS

    def manifest(self) -> dict[str, Any]:
        """How features are made, as plain values, with a fingerprint of the weights, and nothing that they do not depend on.

        Raises:
            CheckpointError: there is no such checkpoint.
        """
        values = asdict(self)
        if self.reads_detector:
            folder = find_checkpoint(self.detector)
            files = [folder / f"frame_parser.{suffix}" for suffix in ("safetensors", "json")]
            values["detector_fingerprint"] = fingerprint(weights=files)
        else:
            del values["detector"]
        if "objects" not in self.kinds:
            del values["max_objects"]
        return _plain(values, self)


@dataclass(frozen=True)
class WordConfig(Settings):
    """How features are made of the words and boxes of a video's objects in place of its pixels.

    Attributes:
        frames: number of frames, evenly spaced from the first to the last one.
        grid: height and width of the maps.
        pooled_grid: height and width of a coarser grid, over whose cells the maps are averaged for "pooled".
        kinds: what is written: "pooled", "maps" and "objects".
        max_objects: objects of a video.
        source: whose words and boxes: "truth" (of the annotation) or "proposals" (of a frame parser's detections).
        colors, materials, shapes: the words; `nsdr data features` takes those of the data set's world.

    Raises:
        DataError: a value out of its range; names it.
    """

    frames: Size = 25
    grid: tuple[Size, Size] = (8, 12)
    pooled_grid: tuple[Size, Size] = (4, 6)
    kinds: tuple[str, ...] = KINDS
    max_objects: Objects = 10
    source: Annotated[str, one_of(SOURCES)] = "truth"
    colors: Words = CLEVRER.words["color"]
    materials: Words = CLEVRER.words["material"]
    shapes: Words = CLEVRER.words["shape"]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_kinds(self.kinds)
        if any(cells % coarse for cells, coarse in zip(self.grid, self.pooled_grid, strict=True)):
            raise DataError(
                f"pooled_grid is {list(self.pooled_grid)}; expected divisors of the grid's {list(self.grid)}"
            )

    def shape(self, kind: str) -> tuple[int, ...]:
        """Shape of a video's features of a kind, as in `nsdr.baselines.base.Batch` without its first axis."""
        channels = sum(map(len, self.words.values())) + BOX_NUMBERS
        if kind == "pooled":
            return self.frames, channels * math.prod(self.pooled_grid)
        if kind == "maps":
            return self.frames, channels, *self.grid
        return self.frames, self.max_objects, channels

    @property
    def words(self) -> dict[str, tuple[str, ...]]:
        """The words of each attribute: a 0 or 1 for each comes before an object's box."""
        return {"color": self.colors, "material": self.materials, "shape": self.shapes}

    def manifest(self) -> dict[str, Any]:
        """How features are made, as plain values, without CLEVRER's words."""
        values = asdict(self)
        if self.words == CLEVRER.words:
            values = {name: value for name, value in values.items() if name not in WORDS}
        return _plain({"from": values.pop("source"), **values}, self)


def check_kinds(kinds: Collection[str]) -> None:
    """Raise `DataError` unless these are one or more of `KINDS`, each once."""
    if not kinds or len(set(kinds)) < len(kinds) or not set(kinds) <= set(KINDS):
        raise DataError(f"kinds is {list(kinds)}; expected one or more of {', '.join(KINDS)}, each once")


def check_settings(found: Mapping[str, Any], wanted: Mapping[str, Any], needs: Collection[str], where: str) -> None:
    """Refuse features that a network cannot read because it learnt from features with other settings.

    Args:
        found, wanted: `features` of two manifests.
        needs: `Baseline.needs` of the network.
        where: the start of the error message.

    Raises:
        DataError: the settings differ; names how.
    """
    idle = ["from", "kinds", "precision", *([] if "objects" in needs else ["max_objects"])]
    if "objects" not in needs and wanted.get("backbone") != FRAME_PARSER:
        idle.append("detector_fingerprint")
    different = _differences(*({k: v for k, v in values.items() if k not in idle} for values in (found, wanted)))
    if different:
        raise DataError(f"{where}features have {different}; make them with the settings of the training's")


def _differences(mine: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    names = [n for n in {**wanted, **mine} if n not in NAMES and mine.get(n, "none") != wanted.get(n, "none")]
    return ", ".join(f"{n} {mine.get(n, 'none')} in place of {wanted.get(n, 'none')}" for n in names)


def _plain(values: dict[str, Any], config: FeatureConfig | WordConfig) -> dict[str, Any]:
    plain = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
    return {"features": plain, "shapes": {kind: list(config.shape(kind)) for kind in config.kinds}}


def feature_file(folder: Path, scene_index: int) -> Path:
    """The file with a video's features."""
    return folder / f"{scene_index:05d}.safetensors"


class Features(Protocol):
    """Where the features of videos come from."""

    def get(self, scene_index: int, needs: Collection[str]) -> dict[str, NDArray[Any]]:
        """The features of a video.

        Args:
            scene_index: the video.
            needs: kinds of features; other names, such as "program", are ignored.

        Returns:
            By kind, float32 arrays of the shapes in `nsdr.baselines.base.Batch` without the axis of the videos. With "objects"
            there is also `has_object`, (F, N) bool.
        """


def as_inputs(stored: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """What `Features.get` returns, from features as `nsdr data features` stores them."""
    found: dict[str, NDArray[Any]] = {kind: value.astype(np.float32) for kind, value in stored.items()}
    if "objects" in found:
        left, _, right, _ = np.moveaxis(found["objects"][..., -BOX_NUMBERS:], -1, 0)
        found["has_object"] = right > left
    return found


class FeatureCache:
    """The features of videos that `nsdr data features` wrote to a folder.

    Files are mapped into memory, so processes that read the same file share it.

    Args:
        folder: the folder.
        needs: which kinds are read: `Baseline.needs`, whose "program" is ignored; None for all kinds in the folder.

    Attributes:
        channels: C of the feature vectors and maps that are read; 0 if none are.
        grid: height and width of the maps that are read; (0, 0) if none are.

    Raises:
        DataError: the folder has no features or lacks a kind, or kinds that are read differ in their channels.
    """

    def __init__(self, folder: str | Path, needs: Collection[str] | None = None) -> None:
        self.folder = Path(folder)
        path = self.folder / MANIFEST
        if not path.is_file():
            raise DataError(f"{folder}: holds no features; `nsdr data features --root DATA -o {folder}` makes them")
        self.manifest: dict[str, Any] = read_json(path)
        shapes = self.manifest.get("shapes") if isinstance(self.manifest, dict) else None
        settings = self.manifest.get("features") if isinstance(self.manifest, dict) else None
        if (
            not isinstance(settings, dict)
            or not isinstance(shapes, dict)
            or not shapes
            or not set(shapes) <= set(KINDS)
        ):
            raise DataError(f"{path}: not the manifest of a folder of features; extract them again")
        self._shapes = {kind: tuple(shape) for kind, shape in shapes.items()}
        read = [kind for kind in KINDS if kind in needs] if needs is not None else []
        self._check_kinds(read)
        channels = {k: self._shapes[k][-1] - BOX_NUMBERS if k == "objects" else self._shapes[k][1] for k in read}
        if len(set(channels.values())) > 1:
            raise DataError(f"{folder}: expected as many channels of each kind, got {channels}")
        self.channels: int = next(iter(channels.values()), 0)
        self.grid: tuple[int, int] = self._shapes["maps"][2:] if "maps" in read else (0, 0)

    def check(self, config: FeatureConfig | WordConfig) -> None:
        """Refuse settings that differ from those of the folder's features.

        Raises:
            DataError: they differ; names how.
        """
        expected = config.manifest()
        different = _differences(self.manifest["features"], expected["features"])
        if different or self.manifest["shapes"] != expected["shapes"]:
            why = f"its features have other settings ({different or 'shapes'})"
            raise DataError(f"{self.folder}: {why}; choose another folder, or delete it")

    def _check_kinds(self, kinds: Collection[str]) -> None:
        for kind in kinds:
            if kind not in self._shapes:
                remedy = "extract features with this kind to another folder"
                raise DataError(f"{self.folder}: has {', '.join(self._shapes)} and no {kind}; {remedy}")

    @cached_property
    def fingerprint(self) -> str:
        """Changes when any of the features may have."""
        return fingerprint(inputs=[p for p in (self.folder / MANIFEST, self.folder / LEDGER) if p.is_file()])

    def get(self, scene_index: int, needs: Collection[str]) -> dict[str, NDArray[Any]]:
        """See `Features`.

        Raises:
            DataError: the folder lacks the kind or the video, or a file is damaged; names it.
            MachineError: the system cannot read the file; names it.
        """
        kinds, path = [kind for kind in KINDS if kind in needs], feature_file(self.folder, scene_index)
        self._check_kinds(kinds)
        again = "delete it and run `nsdr data features` again"
        try:
            path.open("rb").close()  # safetensors says "no such file" whatever the system's error is
            with safe_open(path, "np") as file:
                stored = {kind: file.get_tensor(kind) for kind in kinds}
        except FileNotFoundError as e:
            why = f"run `nsdr data features` to its end on a data set with video {scene_index}"
            raise DataError(f"{path}: no such file; {why}") from e
        except (OSError, MemoryError) as e:
            raise machine_error(e, path) or MachineError(f"{path}: cannot be read ({e})") from e
        except SafetensorError as e:
            raise DataError(f"{path}: damaged ({e}); {again}") from e
        for kind, value in stored.items():
            if value.shape != self._shapes[kind]:
                raise DataError(f"{path}: {kind}: expected {self._shapes[kind]}, got {value.shape}; {again}")
        return as_inputs(stored)

"""Extraction of features from videos, resumable and in parallel: `nsdr data features`."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import numpy as safetensors
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d
from torchvision.ops import roi_align

from nsdr.baselines.features import VERSION
from nsdr.baselines.features.backbone import FRAME_PARSER, FrameParserBackbone, ResnetBackbone
from nsdr.baselines.features.files import (
    BOX_NUMBERS,
    KINDS,
    MANIFEST,
    NAMES,
    FeatureCache,
    FeatureConfig,
    WordConfig,
    as_inputs,
    check_settings,
    feature_file,
)
from nsdr.baselines.features.words import detected_features, linked_boxes, truth_features
from nsdr.clevrer.dataset import CLEVRER, SPLITS
from nsdr.clevrer.files.annotations import check_annotation
from nsdr.clevrer.files.proposals import find_proposals, read_proposals
from nsdr.errors import DataError
from nsdr.frame_parser.parser import Detector, FrameParser
from nsdr.io.configuration import config_of
from nsdr.io.device import limit_threads, resolve_device, resolve_precision
from nsdr.io.files import find_files, locked, write_file, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.notes import Note, unsaid
from nsdr.io.reading import read_json
from nsdr.io.tasks import ENGINES
from nsdr.io.video import read_frames, spaced
from nsdr.io.worlds import world_beside
from nsdr.types import VideoProposals
from nsdr.validation import Count, PathName, Settings, one_of
from nsdr.world.world import check_as_clevrer

REGION_CELLS = 7
"""Cells along each side of a region, over which the mean is taken."""
REGION_SAMPLES = 2
"""Samples of the map per cell along each axis (`sampling_ratio` of RoIAlign)."""


@dataclass(frozen=True)
class _Extraction(Settings):
    root: PathName
    output: PathName
    engine: Annotated[str, one_of(ENGINES)] = "processes"
    workers: Count = 0


@dataclass(frozen=True)
class FeatureExtraction(_Extraction):
    """Features of all videos of a data set.

    Attributes:
        root: folder of a data set in the official layout, or any folder with `video_N.mp4`.
        output: folder to write; what an earlier run wrote is kept under its fingerprint.
        engine: "processes" or "ray".
        workers: processes, 0 for one a CPU core.
        features: the settings.
        device: where the networks of every process run: auto, cpu, cuda or cuda:N.
    """

    features: FeatureConfig = field(default_factory=FeatureConfig)
    device: str = "auto"

    def resolved(self, kept: FeatureCache | None) -> "FeatureExtraction":
        """The same extraction with a known device, and the precision of the folder's features or else the device's best."""
        device, config = resolve_device(self.device), self.features
        if config.precision == "auto":
            best = str(resolve_precision("auto", device)).removeprefix("torch.")
            config = replace(config, precision=kept.manifest["features"].get("precision", best) if kept else best)
        check_as_clevrer(world_beside(Path(self.root) / "manifest.json"), "features of pixels")
        FeatureExtractor(config, str(device))  # what is wrong with the weights is found before the work
        return replace(self, features=config, device=str(device))

    def inputs(self) -> dict[int, Path]:
        """The videos by index."""
        return find_videos(self.root)

    def features_of(self, video: Path) -> dict[str, NDArray[Any]]:
        """The features of a video by kind."""
        return _extractor(self.features, self.device)(frames_of(video))


@dataclass(frozen=True)
class WordExtraction(_Extraction):
    """Features of the words and boxes of all annotations or proposals of a data set, in place of its videos.

    Attributes:
        root: folder of a data set in the official layout, which needs no videos; for features of proposals any source of
            `nsdr.clevrer.find_proposals`.
        output: folder to write; what an earlier run wrote is kept under its fingerprint.
        engine: "processes" or "ray".
        workers: processes, 0 for one a CPU core.
        features: the settings.
    """

    features: WordConfig = field(default_factory=WordConfig)

    def resolved(self, kept: FeatureCache | None) -> "WordExtraction":
        """The same extraction with the words of the data set's world."""
        words = world_beside(Path(self.root) / "manifest.json").vocabulary.words
        features = replace(self.features, colors=words["color"], materials=words["material"], shapes=words["shape"])
        return replace(self, features=features)

    def inputs(self) -> dict[int, Path | VideoProposals]:
        """The annotations or proposals by index of the video."""
        if self.features.source == "proposals":
            return {_index(number, name): item for number, (name, item) in find_proposals(self.root).items()}
        dataset = CLEVRER(self.root)
        found = {i: path for name in SPLITS for i, path in dataset.split(name).entries("annotations").items()}
        if not found:
            raise DataError(f"{self.root}: holds no annotations; make some with `nsdr generate dataset`")
        return {**found}

    def features_of(self, item: Path | VideoProposals) -> dict[str, NDArray[Any]]:
        """The features of a video by kind."""
        if self.features.source == "proposals":
            proposals = read_proposals(item) if isinstance(item, Path) else item
            return detected_features(proposals, self.features)
        assert isinstance(item, Path)
        return annotation_features(item, self.features)


def _index(number: str, name: str) -> int:
    if not number.isdigit():
        raise DataError(f"{name}: expected a name that ends with the video's index, such as proposal_00012.json")
    return int(number)


def extract_features(extraction: FeatureExtraction | WordExtraction, keep_going: bool = False) -> int:
    """Write the features of every video for `FeatureCache`. A second process that writes to the folder waits.

    Args:
        extraction: what to do.
        keep_going: leave out videos that fail.

    Returns:
        Number of videos with features, those of an earlier run included.

    Raises:
        DataError: no videos, the folder has features of other settings, or a video failed.
        CheckpointError: weights cannot be found or loaded.
    """
    folder = Path(extraction.output)
    extraction = extraction.resolved(FeatureCache(folder) if (folder / MANIFEST).is_file() else None)
    manifest = extraction.features.manifest()
    depends_on = {name: value for name, value in manifest["features"].items() if name not in NAMES}
    common = fingerprint(config=[VERSION, depends_on]).encode()
    jobs = []
    for index, item in extraction.inputs().items():
        output = feature_file(folder, index)
        jobs.append(Job(f"video {index}", item, output, fingerprint(inputs=[common, item])))
    with locked(folder, wait=True):
        if (folder / MANIFEST).is_file():
            FeatureCache(folder).check(extraction.features)
        write_json(folder / MANIFEST, manifest, indent=1)
        summary = run_jobs(partial(_extract, extraction), jobs, folder, extraction.engine, extraction.workers)
    return len(summary.succeeded(jobs, folder, keep_going))


def _extract(extraction: FeatureExtraction | WordExtraction, item: Any, output: Path) -> None:
    features = _rounded(extraction.features_of(item))
    write_file(output, safetensors.save(features))


def _rounded(features: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.float16]]:
    """As they are stored. Safetensors writes an array's memory as it lies, whatever the order of its axes."""
    return {kind: np.ascontiguousarray(value, np.float16) for kind, value in features.items()}


def annotation_features(annotation: str | Path, config: WordConfig) -> dict[str, NDArray[Any]]:
    """`truth_features` of an annotation file.

    Raises:
        DataError: it cannot be read; names it.
    """
    content = read_json(annotation)
    check_annotation(content, f"{annotation}: ")
    return truth_features(content, config)


def features_of(
    source: str | Path, made: Mapping[str, Any], needs: Collection[str], note: Note, device: str = "auto"
) -> dict[str, NDArray[Any]]:
    """The features of one video, made as those that a network learnt from.

    Args:
        source: the video; where the network learnt from features of the truth, its annotation file, too. Of a video, its
            objects are then those that the default frame parser finds.
        made: `features` of the manifest of those.
        needs: kinds of features.
        note: gets what is unusual about the video.
        device: where networks run.

    Returns:
        See `Features.get`.

    Raises:
        DataError: an annotation where the network learnt from pixels, or the source cannot be read.
        CheckpointError: the weights that features are made with cannot be found, or are others.
    """
    from_words, is_annotation = "from" in made, Path(source).suffix == ".json"
    if is_annotation and not from_words:
        raise DataError(f"{source}: the baseline learnt from pixels: give a video")
    config: Any = WordConfig if from_words else FeatureConfig
    values = {f.name: made[f.name] for f in fields(config) if f.name in made}
    config = config_of(config, values | {"kinds": [kind for kind in KINDS if kind in needs]})
    if is_annotation:
        return as_inputs(_rounded(annotation_features(source, config)))
    if from_words:
        frames = frames_of(source, note)
        chosen = np.stack([frames[i] for i in spaced(len(frames), config.frames)])
        found = FrameParser.from_pretrained("default", device).parse(chosen)
        return as_inputs(_rounded(detected_features(found, config)))
    extractor = FeatureExtractor(config, device)
    check_settings(extractor.config.manifest()["features"], made, needs, "the weights that are found here: ")
    return as_inputs(extractor(frames_of(source, note)))


def find_videos(root: str | Path) -> dict[int, Path]:
    """The videos of a data set in the official layout, or of any folder with `video_N.mp4`, by index.

    Raises:
        DataError: there are none, or two with the same index.
    """
    dataset = CLEVRER(root)
    splits = [dataset.split(name) for name in SPLITS]
    found = {index: split.video(index) for split in splits for index in split.entries("videos")}
    if found:
        return found
    for path in find_files(root, "video_*.mp4"):
        number = path.stem.removeprefix("video_")
        if number.isdigit() and found.setdefault(int(number), path) != path:
            raise DataError(f"{found[int(number)]} and {path}: both are video {int(number)}; use two folders")
    if not found:
        raise DataError(f"{root}: holds no video_N.mp4")
    return found


@lru_cache(maxsize=1)
def _extractor(config: FeatureConfig, device: str) -> "FeatureExtractor":
    """The extractor of a worker process, loaded once."""
    return FeatureExtractor(config, device)


def frames_of(video: str | Path, note: Note = unsaid) -> list[NDArray[np.uint8]]:
    """All frames (320, 480, 3) of a video; what is unusual about it is noted."""
    return list(read_frames(video, note=note))


class FeatureExtractor:
    """Features of videos by a backbone, and by a frame parser for the regions of objects.

    Args:
        config: the settings.
        device: where the networks run.

    Raises:
        CheckpointError: weights cannot be found or loaded.
        DataError: the device cannot be used.
    """

    def __init__(self, config: FeatureConfig, device: str = "auto") -> None:
        self.config, where = config, resolve_device(device)
        precision = resolve_precision(config.precision, where)
        self.parser = FrameParser.from_pretrained(config.detector, device) if config.reads_detector else None
        self.backbone: FrameParserBackbone | ResnetBackbone
        if config.backbone == FRAME_PARSER:
            assert self.parser is not None
            self.backbone = FrameParserBackbone(Detector(self.parser.model, precision))
        else:
            self.backbone = ResnetBackbone(config.backbone, config.image_size, precision, where)

    @limit_threads()
    @torch.no_grad()
    def __call__(self, frames: Sequence[NDArray[np.uint8]]) -> dict[str, NDArray[np.float16]]:
        """The features of a video.

        Args:
            frames: all frames (320, 480, 3) of the video, RGB.

        Returns:
            By kind, float16 arrays of the shapes of `FeatureConfig.shape`.

        Raises:
            DataError: features that float16 cannot hold.
        """
        c = self.config
        chosen = np.stack([frames[i] for i in spaced(len(frames), c.frames)])
        found = self.backbone(list(chosen))
        maps = torch.cat([m if c.grid is None else adaptive_avg_pool2d(m, c.grid) for m in found.levels], 1)
        features: dict[str, Tensor] = {}
        if "pooled" in c.kinds:
            last = maps if found.last is None else found.last
            features["pooled"] = adaptive_avg_pool2d(last, c.pooled_grid).flatten(1)
        if "maps" in c.kinds:
            features["maps"] = maps
        if "objects" in c.kinds:
            assert self.parser is not None
            _, boxes = linked_boxes(self.parser.parse(chosen), c.max_objects)
            features["objects"] = region_features(found.levels, boxes)
        half = {kind: value.to("cpu", torch.float16).contiguous() for kind, value in features.items()}
        for kind, value in half.items():
            if not bool(value.isfinite().all()):
                raise DataError(f"{kind}: features beyond the range of float16; choose another backbone")
        return {kind: value.numpy() for kind, value in half.items()}


def region_features(maps: Sequence[Tensor], boxes: NDArray[np.float32]) -> Tensor:
    """Mean features of regions, and their boxes.

    Args:
        maps: of each level, (F, C, h, w) float32.
        boxes: (F, N, 4) left, top, right and bottom as shares of the image, zeros for none.

    Returns:
        (F, N, all C + 4), zeros where there is no box.
    """
    shares = torch.from_numpy(boxes).to(maps[0].device)
    frame, place = torch.nonzero(shares.any(2), as_tuple=True)
    found = []
    for level in maps:
        height, width = level.shape[2:]
        regions = torch.cat([frame[:, None], shares[frame, place] * level.new_tensor([width, height] * 2)], 1)
        cells = roi_align(level.contiguous(), regions, REGION_CELLS, 1.0, REGION_SAMPLES, aligned=True)
        found.append(cells.mean((2, 3)))
    channels = sum(level.shape[1] for level in maps)
    features = maps[0].new_zeros(*shares.shape[:2], channels + BOX_NUMBERS)
    features[frame, place] = torch.cat([*found, shares[frame, place]], 1)
    return features

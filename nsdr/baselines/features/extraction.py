"""Extraction of features from videos, on many processes and resumable: `nsdr extract-features`."""

import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
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
from nsdr.baselines.features.backbone import image_batch, load_backbone
from nsdr.baselines.features.files import BOX_NUMBERS, MANIFEST, FeatureCache, FeatureConfig, feature_file, manifest_of
from nsdr.clevrer.dataset import CLEVRER, SPLITS
from nsdr.errors import DataError
from nsdr.frame_parser.parser import FrameParser
from nsdr.io.device import limit_threads, resolve_device, resolve_precision
from nsdr.io.files import atomic_path, find_files, locked, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import ENGINES, Job, run_jobs
from nsdr.io.video import read_frames
from nsdr.types import VideoProposals
from nsdr.validation import Count, PathName, Settings, one_of
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

__all__ = ["FeatureExtraction", "FeatureExtractor", "extract_features", "find_videos", "frames_of", "spaced"]

REGION_CELLS = 7
"""Cells along each side of a region, of which the mean is taken."""
MIN_SCORE = 0.9
"""Objects with a score up to this are left out (0-1; the paper's threshold for proposals)."""
REGION_SAMPLES = 2
"""Samples of the map per cell along each axis (`sampling_ratio` of RoIAlign)."""


@dataclass(frozen=True)
class FeatureExtraction(Settings):
    """Features of all videos of a data set.

    Attributes:
        root: folder of a data set in the official layout (zips included), or any folder with `video_N.mp4`.
        output: folder to write; what an earlier run wrote is kept under its fingerprint.
        features: the settings.
        engine: "processes" or "ray".
        workers: processes, 0 for one a CPU core.
        device: where the networks of every process run: auto, cpu, cuda or cuda:N.
    """

    root: PathName
    output: PathName
    features: FeatureConfig = field(default_factory=FeatureConfig)
    engine: Annotated[str, one_of(ENGINES)] = "processes"
    workers: Count = 0
    device: str = "auto"


def extract_features(extraction: FeatureExtraction, keep_going: bool = False) -> int:
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
    folder, device, config = Path(extraction.output), resolve_device(extraction.device), extraction.features
    kept = FeatureCache(folder) if (folder / MANIFEST).is_file() else None
    if config.precision == "auto":  # that of the folder's features, or else the device's best
        best = str(resolve_precision("auto", device)).removeprefix("torch.")
        config = replace(config, precision=kept.manifest["features"]["precision"] if kept else best)
    manifest = manifest_of(config)
    common = fingerprint(config=[VERSION, manifest]).encode()
    jobs = []
    for index, video in find_videos(extraction.root).items():
        jobs.append(Job(video.name, video, feature_file(folder, index), fingerprint(inputs=[common, video])))
    with locked(folder, wait=True):
        if (folder / MANIFEST).is_file():
            FeatureCache(folder).check(config)
        load_backbone(config.backbone, config.weights)  # what is wrong with the weights is found before the work
        write_json(folder / MANIFEST, manifest, indent=1)
        summary = run_jobs(partial(_extract, config, str(device)), jobs, folder, extraction.engine, extraction.workers)
    return len(summary.succeeded(jobs, folder, keep_going))


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


def _extract(config: FeatureConfig, device: str, video: Path, output: Path) -> None:
    content = safetensors.save(_extractor(config, device)(frames_of(video)))
    with atomic_path(output) as temporary:
        temporary.write_bytes(content)


@lru_cache(maxsize=1)
def _extractor(config: FeatureConfig, device: str) -> "FeatureExtractor":
    """The extractor of a worker process, loaded once."""
    return FeatureExtractor(config, device)


def frames_of(video: str | Path) -> list[NDArray[np.uint8]]:
    """All frames (320, 480, 3) of a video; of another size without a warning, as they are scaled in any case."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*resized to")
        return list(read_frames(video))


def spaced(n_frames: int, count: int) -> NDArray[np.intp]:
    """`count` frame indices, evenly spaced from the first to the last one; of a shorter video, some repeatedly."""
    return np.linspace(0, n_frames - 1, count).round().astype(np.intp)


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
        self.config, self.device = config, resolve_device(device)
        backbone = load_backbone(config.backbone, config.weights).eval()
        self.backbone: Any = backbone.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.precision = resolve_precision(config.precision, self.device)
        detects = "objects" in config.kinds
        self.parser = FrameParser.from_pretrained(config.detector, device) if detects else None

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
        images = image_batch(list(chosen), c.image_size).to(self.device)
        mixed = self.precision != torch.float32  # some devices have no autocast, even to be disabled
        with torch.autocast(self.device.type, self.precision) if mixed else nullcontext():
            third, last = self.backbone(images)
        maps = third.float()
        features: dict[str, Tensor] = {}
        if "pooled" in c.kinds:
            features["pooled"] = last.float().mean((2, 3))
        if "maps" in c.kinds:
            features["maps"] = maps if c.grid is None else adaptive_avg_pool2d(maps, c.grid)
        if self.parser is not None:
            boxes = best_boxes(self.parser.parse(chosen), c.max_objects)
            features["objects"] = region_features(maps, boxes, c.max_objects)
        half = {kind: value.to("cpu", torch.float16).contiguous() for kind, value in features.items()}
        for kind, value in half.items():
            if not bool(value.isfinite().all()):
                raise DataError(f"{kind}: features beyond the range of float16; give other weights")
        return {kind: value.numpy() for kind, value in half.items()}


def best_boxes(proposals: VideoProposals, max_objects: int) -> list[NDArray[np.float32]]:
    """(N, 4) boxes of at most `max_objects` objects of each frame, best first, as shares of the image."""
    p = proposals
    sides = np.array([WIDTH_PX, HEIGHT_PX, WIDTH_PX, HEIGHT_PX], np.float32)
    boxes = []
    for frame in range(p.n_frames):
        rows = np.flatnonzero((p.frame_index == frame) & (p.score > MIN_SCORE) & (p.area_px > 0))
        best = rows[np.argsort(-p.score[rows], kind="stable")][:max_objects]
        boxes.append((p.box_xyxy_px[best] / sides).astype(np.float32))
    return boxes


def region_features(maps: Tensor, boxes: Sequence[NDArray[np.float32]], max_objects: int) -> Tensor:
    """Mean features of regions, and their boxes.

    Args:
        maps: (F, C, h, w) float32.
        boxes: of each frame (N, 4) left, top, right and bottom as shares of the image, N at most `max_objects`.
        max_objects: objects of a frame.

    Returns:
        (F, max_objects, C + 4), padded with zeros.
    """
    n_frames, channels, height, width = maps.shape
    features = maps.new_zeros(n_frames, max_objects, channels + BOX_NUMBERS)
    shares = [torch.from_numpy(b).to(maps.device) for b in boxes]
    regions = [s * maps.new_tensor([width, height, width, height]) for s in shares]
    pooled = roi_align(maps.contiguous(), regions, REGION_CELLS, 1.0, REGION_SAMPLES, aligned=True).mean((2, 3))
    for frame, (share, found) in enumerate(zip(shares, pooled.split([len(s) for s in shares]), strict=True)):
        features[frame, : len(share)] = torch.cat([found, share], 1)
    return features

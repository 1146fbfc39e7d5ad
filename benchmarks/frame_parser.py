"""The frame parser against torchvision's Mask R-CNN (speed), and against given masks (accuracy).

`python -m benchmarks.frame_parser --videos DIR --proposals DIR [--every 4] [--precision float32 bfloat16] [--rounds 3]`
`python -m benchmarks.frame_parser --objectness FRAMES [--every 4]`

Accuracy on `video_N.mp4` whose `proposal_N.json` or `sim_N.json` is there: attribute-exact F1 at box IoU 0.5 of objects with at
least 60 visible pixels, average precision of masks and boxes; of the parser's result, with its masks.

All networks see the same frames by turns, `--rounds` times, and the fastest counts: CPU time of all threads, and wall time.
"the same network in torchvision" is the parser's network as torchvision runs it: the like-for-like comparison.

The second command counts, in frames of `nsdr data frames`, the detections of proposals whose objectness is below some values.
"""

import resource
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from pycocotools import mask as rle
from torch import Tensor, nn
from torchvision.models.detection import MaskRCNN, maskrcnn_resnet50_fpn
from torchvision.models.detection.backbone_utils import resnet_fpn_backbone

from benchmarks.shared import fastest, parser_of, table
from nsdr.frame_parser.dataset import FrameDataset, image_tensor
from nsdr.frame_parser.metrics import average_precision, detection_scores
from nsdr.frame_parser.parser import Detector, FrameParser
from nsdr.frame_parser.training_frames import write_frames
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.device import PRECISIONS, available_cores, limit_threads
from nsdr.io.video import read_video
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.vocabulary import CLEVRER

TIMED_FRAMES = 64
"""Frames in a round of the parser."""
OBJECTNESS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)


class ParserAsNetwork(nn.Module):
    """The parser's results in the form of its network's, for the metrics."""

    def __init__(self, parser: FrameParser) -> None:
        super().__init__()
        self.network, self.parser = parser.model, parser

    def forward(self, images: list[Tensor]) -> list[dict[str, Tensor]]:
        return [self._detections((image * 255).round().byte().permute(1, 2, 0).numpy()) for image in images]

    def _detections(self, frame: Any) -> dict[str, Tensor]:
        found = self.parser.parse([frame])
        size = [HEIGHT_PX, WIDTH_PX]
        encoded = [{"size": size, "counts": counts} for counts in found.masks or ()]
        masks = [rle.decode(mask) for mask in encoded]
        x0, y0, width, height = rle.toBbox(encoded).reshape(-1, 4).T
        combinations = len(CLEVRER.words["color"]) * len(CLEVRER.words["material"]) * len(CLEVRER.words["shape"])
        return {
            "boxes": torch.tensor(np.stack([x0, y0, x0 + width, y0 + height], 1), dtype=torch.float32),
            "scores": torch.tensor(found.score, dtype=torch.float32),
            "labels": torch.ones(len(found), dtype=torch.int64),
            "masks": torch.tensor(np.array(masks, np.float32).reshape(-1, 1, *size)),
            "attribute": torch.eye(combinations)[torch.tensor(found.attribute, dtype=torch.int64)],
        }


def references(model: nn.Module) -> dict[str, nn.Module]:
    """Networks of torchvision, with random weights except the parser's own."""
    small = {"min_size": HEIGHT_PX, "max_size": WIDTH_PX}
    resnet18 = resnet_fpn_backbone(backbone_name="resnet18", weights=None)
    options: dict[str, Any] = {"weights": None, "weights_backbone": None}
    networks = {
        "the same network in torchvision": model,
        "torchvision, ResNet-18, 480x320": MaskRCNN(resnet18, num_classes=2, **small),
        "torchvision, ResNet-50, 480x320": maskrcnn_resnet50_fpn(**options, **small),
        "torchvision, ResNet-50, its default size": maskrcnn_resnet50_fpn(**options),
    }
    return {name: network.eval() for name, network in networks.items()}


def one_by_one(network: nn.Module, images: list[Tensor]) -> None:
    for image in images:
        network([image])


@limit_threads()
@torch.no_grad()
def compare_speed(parsers: dict[str, FrameParser], video: Any, rounds: int, reference_frames: int) -> None:
    frames = video[:TIMED_FRAMES]
    runs: dict[str, Callable[[], Any]] = {f"nsdr, {name}": partial(p.parse, frames) for name, p in parsers.items()}
    count = dict.fromkeys(runs, len(frames))
    images = [image_tensor(frame) for frame in frames[:reference_frames]]
    if images:
        for name, network in references(next(iter(parsers.values())).model).items():
            runs[name], count[name] = partial(one_by_one, network, images), len(images)
    ms = {name: [1000 * s / count[name] for s in best] for name, best in fastest(runs, rounds).items()}
    print(
        f"{torch.get_num_threads()} threads, {available_cores()} cores; the times of nsdr include masks, but no decoding"
    )
    columns = ["network", "CPU, ms a frame", "wall, ms a frame", *(f"CPU, times {name}" for name in parsers)]
    rows = []
    for name, (cpu, wall) in ms.items():
        ratios = (f"{cpu / ms[f'nsdr, {other}'][0]:.1f}" for other in parsers)
        rows.append((name, f"{cpu:.1f}", f"{wall:.1f}", *ratios))
    print(table(columns, rows))


@limit_threads()
@torch.no_grad()
def count_objectness(folder: Path, every: int, parser: FrameParser) -> None:
    """Print how many detections are left in training frames when regions of a lower objectness are not proposed."""
    frames = FrameDataset(folder, "train")
    detectors = {value: Detector(parser.model, torch.float32, value) for value in OBJECTNESS}
    kept = dict.fromkeys(OBJECTNESS, 0)
    indices = range(0, len(frames), every)
    for i in indices:
        frame = (frames[i][0] * 255).round().byte().permute(1, 2, 0).numpy()
        for value, detector in detectors.items():
            kept[value] += len(detector([frame])["scores"])
    print(f"{len(indices)} frames; detections by the lowest objectness: {kept}")


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--videos", type=Path)
    parser.add_argument("--proposals", type=Path)
    parser.add_argument("--objectness", type=Path)
    parser.add_argument("--checkpoint", default="default")
    parser.add_argument("--every", type=int, default=4, help="measure accuracy on every n-th frame; 0 leaves it out")
    parser.add_argument("--precision", nargs="+", default=["auto"], choices=PRECISIONS)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--reference-frames", type=int, default=3, help="0 leaves torchvision's networks out")
    options = parser.parse_args()
    folder = find_checkpoint(options.checkpoint)
    if options.objectness:
        count_objectness(options.objectness, options.every, FrameParser.from_checkpoint(folder))
        return
    if not options.videos or not options.proposals:
        parser.error("give --videos and --proposals, or --objectness")
    parsers = {name: FrameParser.from_checkpoint(folder, precision=name) for name in options.precision}

    if options.every:
        with TemporaryDirectory() as work:
            write_frames(options.videos, options.proposals, work, options.every)
            frames = FrameDataset(work, "all")
            pairs = [frames[i] for i in range(len(frames))]
            for name, ours in parsers.items():
                network = ParserAsNetwork(ours)
                scores = detection_scores(network, pairs) | average_precision(network, pairs)
                print(f"{name}, {len(pairs)} frames: " + ", ".join(f"{k} {value:.4f}" for k, value in scores.items()))

    video = read_video(sorted(options.videos.rglob("video_*.mp4"))[0])
    if options.rounds:
        compare_speed(parsers, video, options.rounds, options.reference_frames)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.1f} GiB")


if __name__ == "__main__":
    main()

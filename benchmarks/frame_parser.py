"""The frame parser against torchvision's Mask R-CNN (speed), and against given masks (accuracy).

`python benchmarks/frame_parser.py --videos DIR --proposals DIR [--every 4] [--stride 1 2 4] [--reference_frames 3]`

Both networks see the same frames in one run. Accuracy on `video_N.mp4` whose `proposal_N.json` or `sim_N.json` is there:
attribute-exact F1 at box IoU 0.5 of objects with at least 60 visible pixels, average precision of masks and boxes.
"""

import argparse
import resource
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torchvision.models.detection import maskrcnn_resnet50_fpn

from nsdr.frame_parser.dataset import FrameDataset
from nsdr.frame_parser.metrics import average_precision, detection_scores
from nsdr.frame_parser.parser import FrameParser
from nsdr.frame_parser.training_frames import write_frames
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.video import read_video


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--videos", type=Path, required=True)
    parser.add_argument("--proposals", type=Path, required=True)
    parser.add_argument("--checkpoint", default="default")
    parser.add_argument("--every", type=int, default=4, help="measure accuracy on every n-th frame")
    parser.add_argument("--stride", type=int, nargs="*", default=[1, 2, 4])
    parser.add_argument("--reference_frames", type=int, default=3, help="0 leaves torchvision's network out")
    options = parser.parse_args()
    folder = find_checkpoint(options.checkpoint)
    ours = FrameParser.from_checkpoint(folder)

    with TemporaryDirectory() as work:
        write_frames(options.videos, options.proposals, work, options.every)
        frames = FrameDataset(work, "all")
        pairs = [frames[i] for i in range(len(frames))]
        scores = detection_scores(ours.model, pairs) | average_precision(ours.model, pairs)
    print(f"{len(pairs)} frames: " + ", ".join(f"{name} {value:.3f}" for name, value in scores.items()))

    video = read_video(sorted(options.videos.rglob("video_*.mp4"))[0])
    ours.parse(video[:16])
    for stride in options.stride:
        strided = FrameParser.from_checkpoint(folder, stride=stride)
        start = time.perf_counter()
        strided.parse(video)
        seconds = time.perf_counter() - start
        print(f"stride {stride}: {seconds:.1f} s for {len(video)} frames")
        if stride == 1:
            per_frame = seconds / len(video)
    if options.reference_frames and 1 in options.stride:
        reference = maskrcnn_resnet50_fpn(weights=None, weights_backbone=None).eval()
        images = [torch.from_numpy(frame).permute(2, 0, 1).float() / 255 for frame in video[: options.reference_frames]]
        with torch.no_grad():
            start = time.perf_counter()
            for image in images:
                reference([image])
            theirs = (time.perf_counter() - start) / len(images)
        print(
            f"{1000 * per_frame:.0f} ms a frame, torchvision's default {1000 * theirs:.0f} ms: {theirs / per_frame:.0f} x"
        )
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.1f} GiB")


if __name__ == "__main__":
    main()

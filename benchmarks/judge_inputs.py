"""What the judge says of videos of other kinds, sizes and qualities, in which nothing is broken.

`python benchmarks/judge_inputs.py CLIP ... [--kinds KIND ...]` prints how many of the objects of the unaltered clips are found,
how many others, which laws seem to be broken, how wide edges are (pixels), and how many videos are refused without `--force`.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from nsdr import Pipeline, PipelineConfig, VideoConfig, VideoError
from nsdr.frame_parser.check.reasons import SPACING_FRAMES, edge_width_px
from nsdr.frame_parser.check.video import SAMPLED_SECONDS, check_video
from nsdr.io.video import read_video, sample_frames, write_video

Frames = NDArray[np.uint8]


def blurred(sigma: float) -> Callable[[Frames], Frames]:
    return lambda frames: np.stack([np.asarray(cv2.GaussianBlur(f, (0, 0), sigma), np.uint8) for f in frames])


def resized(width: int, height: int, back: bool = False) -> Callable[[Frames], Frames]:
    def change(frame: Frames) -> Frames:
        small = cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.resize(small, (480, 320), interpolation=cv2.INTER_LINEAR) if back else small, np.uint8)

    return lambda frames: np.stack([change(frame) for frame in frames])


def mp4(crf: int = 20) -> Callable[[Path, Frames], Path]:
    def write(folder: Path, frames: Frames) -> Path:
        write_video(folder / "video.mp4", frames, crf=crf)
        return folder / "video.mp4"

    return write


def animated(suffix: str, every: int = 1) -> Callable[[Path, Frames], Path]:
    def write(folder: Path, frames: Frames) -> Path:
        path = folder / f"video{suffix}"
        images = [Image.fromarray(frame) for frame in frames[::every]]
        images[0].save(path, save_all=True, append_images=images[1:], duration=40 * every)
        return path

    return write


def pngs(folder: Path, frames: Frames) -> Path:
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"frame_{k}.png"), cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    return folder


def same(frames: Frames) -> Frames:
    return frames


KINDS: dict[str, tuple[Callable[[Frames], Frames], Callable[[Path, Frames], Path]]] = {
    "encoded again": (same, mp4()),
    "GIF": (same, animated(".gif")),
    "GIF, 12.5 frames a second": (same, animated(".gif", 2)),
    "GIF, 8.3 frames a second": (same, animated(".gif", 3)),
    "GIF, 6.25 frames a second": (same, animated(".gif", 4)),
    "WebP": (same, animated(".webp")),
    "folder of PNG": (same, pngs),
    "240x160": (resized(240, 160), mp4()),
    "128x86": (resized(128, 86), mp4()),
    "blurred, 1 pixel": (blurred(1), mp4()),
    "blurred, 2 pixels": (blurred(2), mp4()),
    "blurred, 3 pixels": (blurred(3), mp4()),
    "x264 with crf 40": (same, mp4(40)),
    "x264 with crf 48": (same, mp4(48)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    options = parser.parse_args()
    pipeline = Pipeline.from_pretrained(config=PipelineConfig(video=VideoConfig("warn")))
    clips = [read_video(clip) for clip in options.clips]
    known = [{o.name for o in pipeline.judge(clip).objects} for clip in options.clips]
    total = sum(map(len, known))
    print("| kind | objects | others | false alarms | edges | refused |\n|---|---|---|---|---|---|", flush=True)
    for kind in options.kinds:
        change, write = KINDS[kind]
        found, others, refused, alarms, edges = 0, 0, 0, list[str](), list[float]()
        for clip, names in zip(clips, known, strict=True):
            with tempfile.TemporaryDirectory() as folder:
                path = write(Path(folder), change(clip))
                edges.append(edge_width_px(sample_frames(path, SAMPLED_SECONDS, SPACING_FRAMES).frames))
                check = check_video(path, pipeline.video)
                unfit = bool(check.refused or check.unfit)
                try:
                    judgement = pipeline.judge(path)
                except VideoError as e:
                    print(e)
                    refused += 1
                    continue
            refused += unfit
            seen = {o.name for o in judgement.objects}
            found, others = found + len(seen & names), others + len(seen - names)
            alarms += [v.law for v in judgement.violations]
        widths = f"{min(edges):.1f} to {max(edges):.1f}"
        laws = ", ".join(f"{law} {n}" for law, n in Counter(alarms).items()) or "-"
        print(f"| {kind} | {found} of {total} | {others} | {laws} | {widths} | {refused} of {len(clips)} |", flush=True)


if __name__ == "__main__":
    main()

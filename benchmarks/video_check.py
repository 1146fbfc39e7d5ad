"""What `nsdr.frame_parser.check.video` says of altered and foreign videos.

`python benchmarks/video_check.py CLIP ...` alters each clip in many ways, makes foreign videos, and prints the class and the
figures of each kind; the last line counts what is classed wrongly. `--references` makes `empty_scenes.npz` from the clips
instead. `--cuts` prints the largest jumps of each clip at several frame rates.
"""

import argparse
import tempfile
import time
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from video_kinds import ALTERED, FOREIGN, RATES, Frames

from nsdr.frame_parser.check import ground
from nsdr.frame_parser.check.shots import MIN_CHANGE, SAME, change, is_cut, small_gray
from nsdr.frame_parser.check.video import VideoConfig, check_video, clip_frames
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.io.video import read_video


def write(path: Path, frames: Frames, rate: float = 25) -> None:
    """As people encode videos: x264, its default quality; fast, because there are many."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=Fraction(rate).limit_denominator(1000))
        stream.height, stream.width = frames.shape[1] // 2 * 2, frames.shape[2] // 2 * 2
        stream.pix_fmt, stream.options = "yuv420p", {"preset": "veryfast", "crf": "23"}
        for frame in frames[:, : stream.height, : stream.width]:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")))
        container.mux(stream.encode())


def at_rate(frames: Frames, rate: float) -> Frames:
    """The frames nearest in time at another rate."""
    index = np.round(np.arange(int(len(frames) * rate / 25)) * 25 / rate).astype(int)
    return frames[np.minimum(index, len(frames) - 1)]


def make_references(clips: list[Path]) -> None:
    """Write `empty_scenes.npz` of the package."""
    medians = [np.median(read_video(clip)[::6], 0) for clip in clips]
    images = {"clevrer": np.median(medians, 0), "preview": render_preview([], [], View())}
    path = Path(ground.__file__).with_name("empty_scenes.npz")
    np.savez_compressed(path, **{name: ground.cells(image).astype(np.float16) for name, image in images.items()})
    print(path)


def print_cuts(clips: list[Path]) -> None:
    """The frames of a clip at which most changes relative to their neighbours, at several rates."""
    for clip in clips:
        original = read_video(clip)
        for rate in (25, *RATES.values()):
            frames = at_rate(original, rate)
            changes = [c for a, b in pairwise(map(small_gray, frames)) if (c := change(a, b)) > SAME]
            found = [is_cut(a, b, c) for a, b, c in zip(changes, changes[1:], changes[2:], strict=False)]
            jumps = [
                b / max(a, c) for a, b, c in zip(changes, changes[1:], changes[2:], strict=False) if b > MIN_CHANGE
            ]
            print(f"{clip.name} {rate:3} fps: {sum(found)} cuts; largest jump {max(jumps, default=0):.2f}")


def judge(path: Path, kind: str, right: str, work: Path) -> bool:
    """Print the class of a video; whether it is one of the right ones."""
    began = time.process_time()
    check = check_video(path, VideoConfig("warn"))
    seconds = time.process_time() - began
    notes: list[str] = []
    n = sum(1 for _ in clip_frames(path, VideoConfig("warn"), note=notes.append))
    found = "warned" if check.kind == "in" and notes else check.kind
    reasons = "; ".join(notes)
    g = check.ground
    figures = (
        f"D {g.distance:5.2f} g {g.gain:5.2f} b {g.brightness:4.0f} c {g.color:5.2f} t {g.tint:3.0f}" if g else " " * 37
    )
    is_right = found in right.split(", ")
    print(
        f"{'  ' if is_right else '! '}{kind:28}{found:10}{n:4} frames  {figures}  {seconds:.2f} s  {reasons}",
        flush=True,
    )
    return is_right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--references", action="store_true")
    parser.add_argument("--cuts", action="store_true")
    parser.add_argument("--only", default="", help="kinds with this in their name")
    parser.add_argument("--photo", type=Path, action="append", default=[], help="image to pan over")
    options = parser.parse_args()
    if options.references or options.cuts:
        (make_references if options.references else print_cuts)(options.clips)
        return
    total = wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"

        def case(kind: str, right: str, frames: Frames, rate: float = 25) -> None:
            nonlocal total, wrong
            if options.only in kind:
                write(path, frames, rate)
                total += 1
                wrong += not judge(path, kind, right, path)

        for clip in options.clips:
            print(clip.name)
            original = read_video(clip)
            total += 1
            wrong += not judge(clip, "the file", "in", clip)
            for kind, (right, change_frames) in ALTERED.items():
                if options.only in kind:
                    case(kind, right, change_frames(original))
            for kind, rate in RATES.items():
                case(kind, "in, warned", at_rate(original, rate), rate)
        print("foreign")
        for kind, (right, make) in FOREIGN.items():
            if options.only in kind:
                case(kind, right, make(np.random.default_rng(0)))
        for photo in options.photo:
            image = cv2.resize(cv2.imread(str(photo), cv2.IMREAD_COLOR_RGB), (900, 600))
            case(photo.name, "refused", np.stack([image[f : f + 320, 3 * f : 3 * f + 480] for f in range(128)]))
    print(f"{wrong} of {total} classed wrongly")


if __name__ == "__main__":
    main()

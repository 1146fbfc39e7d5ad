"""Altered, encoded and foreign videos: whether they are accepted, what is found in them, and what laws they seem to break.

    python -m benchmarks.videos check CLIP ... [--only PART] [--photo IMAGE ...]
    python -m benchmarks.videos perceive CLIP ... [--only PART]
    python -m benchmarks.videos judge CLIP ... [--only PART]
    python -m benchmarks.videos references CLIP ...
    python -m benchmarks.videos cuts CLIP ...

`check` alters each clip in many ways, makes foreign videos, and prints the class and the figures of each kind; the last line
counts what is classed wrongly. `perceive` compares objects and collisions of altered videos with those of the unaltered one.
`judge` judges videos of other encodings, sizes and qualities, in which nothing is broken, even if they would be refused.
`references` makes `empty_scenes.npz` of the package from the clips. `cuts` prints the largest jumps of each clip at several
frame rates. Kinds are those of `benchmarks.video_kinds`; `--only` takes those with this text in their name.
"""

import tempfile
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from benchmarks.shared import collision_frames, parser_of, table
from benchmarks.video_kinds import ALTERED, ENCODED, FOREIGN, RATES, Frames, at_rate, write
from nsdr import Pipeline, PipelineConfig, Scene, VideoError
from nsdr.frame_parser import VideoConfig
from nsdr.frame_parser.check import ground
from nsdr.frame_parser.check.reasons import SPACING_FRAMES, edge_width_px
from nsdr.frame_parser.check.shots import MIN_CHANGE, SAME_SHARE, change, is_cut, small_gray
from nsdr.frame_parser.check.video import SAMPLED_SECONDS, check_video, clip_frames
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.io.video import read_video, sample_frames

TOLERANCE_FRAMES = 5
"""Frames that a collision in an altered video may be off."""


def altered(clip: Path, only: str) -> Iterator[tuple[str, str, Frames, float]]:
    """Kind, classes that are right for it, frames and rate of each altered video of a clip."""
    original = read_video(clip)
    for kind, (right, make) in ALTERED.items():
        if only in kind:
            yield kind, right, make(original), 25
    for kind, rate in RATES.items():
        if only in kind:
            yield kind, "in, warned", at_rate(original, rate), rate


def foreign(options: Namespace) -> Iterator[tuple[str, str, Frames, float]]:
    """The same of each foreign video."""
    for kind, (right, make) in FOREIGN.items():
        if options.only in kind:
            yield kind, right, make(np.random.default_rng(0)), 25
    for photo in options.photo:
        image = cv2.resize(cv2.imread(str(photo), cv2.IMREAD_COLOR_RGB), (900, 600))
        yield photo.name, "refused", np.stack([image[f : f + 320, 3 * f : 3 * f + 480] for f in range(128)]), 25


def check(options: Namespace, path: Path) -> None:
    """Print the class of each video."""
    total = wrong = 0
    for clip in (*options.clips, None):
        print(clip.name if clip else "foreign")
        for kind, right, frames, rate in altered(clip, options.only) if clip else foreign(options):
            total += 1
            wrong += not is_classed(write(path, frames, rate), kind, right)
    print(f"{wrong} of {total} classed wrongly")


def is_classed(path: Path, kind: str, right: str) -> bool:
    """Print the class of a video; whether it is one of the right ones."""
    began, notes = time.process_time(), list[str]()
    found = check_video(path, VideoConfig("warn"))
    seconds = time.process_time() - began
    n = sum(1 for _ in clip_frames(path, VideoConfig("warn"), note=notes.append))
    name = "warned" if found.kind == "in" and notes else found.kind
    g, figures = found.ground, ""
    if g:
        figures = f"distance {g.distance:.2f} gain {g.gain:.2f} brightness {g.brightness:.0f}"
        figures += f" color {g.color:.2f} tint {g.tint:.0f}"
    is_right = name in right.split(", ")
    reasons = "; ".join(notes)
    print(
        f"{'  ' if is_right else '! '}{kind:28}{name:10}{n:4} frames  {figures}  {seconds:.2f} s  {reasons}", flush=True
    )
    return is_right


def perceive(options: Namespace, path: Path) -> None:
    """Print what is found in each altered video."""
    pipeline = Pipeline.from_pretrained(dynamics="propnet")
    for clip in options.clips:
        true = pipeline.scene(clip)
        for kind, _, frames, rate in altered(clip, options.only):
            write(path, np.asarray(frames), rate)
            try:
                scene = pipeline.scene(path)
            except VideoError as e:
                print(f"{clip.stem} {kind:27} refused   {str(e).split(': ', 2)[-1][:100]}", flush=True)
                continue
            is_right, text = compared(scene, true)
            outcome = "right" if is_right else "noted" if scene.notes else "WRONG"
            print(f"{clip.stem} {kind:27} {outcome:8}  {text}  [{'; '.join(scene.notes)[:160]}]", flush=True)


def compared(scene: Scene, true: Scene) -> tuple[bool, str]:
    """Whether objects and collisions are the same, and the counts."""
    names, expected = {o.name for o in scene.objects}, {o.name for o in true.objects}
    found, right = collision_frames(scene), collision_frames(true)
    same = sum(pair in right and abs(right[pair] - frame) <= TOLERANCE_FRAMES for pair, frame in found.items())
    text = f"objects {len(names & expected)}/{len(expected)} (+{len(names - expected)}), "
    text += f"collisions {same}/{len(right)} (+{len(found) - same})"
    return names == expected and same == len(right) == len(found), text


def judge(options: Namespace, path: Path) -> None:
    """Print what the judge finds in videos of other encodings."""
    pipeline = Pipeline.from_pretrained(config=PipelineConfig(video=VideoConfig("warn")))
    clips = [(read_video(clip), {o.name for o in pipeline.judge(clip).objects}) for clip in options.clips]
    rows, total = [], sum(len(names) for _, names in clips)
    for kind, save in ENCODED.items():
        if options.only not in kind:
            continue
        found, others, refused, alarms, edges = 0, 0, 0, Counter[str](), list[float]()
        for frames, names in clips:
            with tempfile.TemporaryDirectory() as folder:
                video = save(Path(folder), frames)
                edges.append(edge_width_px(sample_frames(video, SAMPLED_SECONDS, SPACING_FRAMES).frames))
                checked = check_video(video, pipeline.video)
                try:
                    judgement = pipeline.judge(video)
                except VideoError as e:
                    print(e)
                    refused += 1
                    continue
            refused += bool(checked.refused or checked.unfit)
            seen = {o.name for o in judgement.objects}
            found, others = found + len(seen & names), others + len(seen - names)
            alarms.update(v.law for v in judgement.violations)
        laws = ", ".join(f"{law} {n}" for law, n in alarms.items()) or "-"
        widths = f"{min(edges):.1f} to {max(edges):.1f}"
        rows.append((kind, f"{found} of {total}", others, laws, widths, f"{refused} of {len(clips)}"))
    columns = ("change", "objects found", "objects too many", "false alarms", "width of edges (pixels)", "refused")
    print(table(columns, rows))


def references(options: Namespace, path: Path) -> None:
    """Write `empty_scenes.npz` of the package."""
    medians = [np.median(read_video(clip)[::6], 0) for clip in options.clips]
    images = {"clevrer": np.median(medians, 0), "preview": render_preview([], [], View())}
    output = Path(ground.__file__).with_name("empty_scenes.npz")
    np.savez_compressed(output, **{name: ground.cells(image).astype(np.float16) for name, image in images.items()})
    print(output)


def cuts(options: Namespace, path: Path) -> None:
    """Print the frames of a clip at which most changes relative to their neighbours, at several rates."""
    for clip in options.clips:
        original = read_video(clip)
        for rate in (25, *RATES.values()):
            changes = [
                c for a, b in pairwise(map(small_gray, at_rate(original, rate))) if (c := change(a, b)) > SAME_SHARE
            ]
            triples = [*zip(changes, changes[1:], changes[2:], strict=False)]
            largest = max((b / max(a, c) for a, b, c in triples if b > MIN_CHANGE), default=0)
            print(f"{clip.name} {rate:3} fps: {sum(is_cut(*t) for t in triples)} cuts; largest jump {largest:.2f}")


def main() -> None:
    parser = parser_of(__doc__)
    commands = {run.__name__: run for run in (check, perceive, judge, references, cuts)}
    parser.add_argument("command", choices=commands)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--only", default="", help="kinds with this in their name")
    parser.add_argument("--photo", type=Path, action="append", default=[], help="with check, an image to pan over")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        commands[options.command](options, Path(folder) / "video.mp4")


if __name__ == "__main__":
    main()

"""Objects and collisions of altered videos against those of the unaltered one.

`python benchmarks/video_perception.py CLIP ... [--kinds KIND ...]` prints for each kind of `video_kinds.py`: refused, or how
many objects and collisions of the unaltered video were found and how many others, and whether it was noted.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from video_check import at_rate, write
from video_kinds import ALTERED, RATES, Frames

from nsdr import Pipeline, Scene, VideoError
from nsdr.io.video import read_video

TOLERANCE_FRAMES = 5


def hits(scene: Scene) -> dict[tuple[str, ...], int]:
    """Frame of each pair's collision, by the objects' names."""
    found = [(tuple(sorted(scene.objects[i].name for i in e.objects)), e) for e in scene.events]
    return {names: e.frame for names, e in found if e.kind == "collision"}


def compared(scene: Scene, true: Scene) -> tuple[bool, str]:
    """Whether objects and collisions are the same, and the counts."""
    names, expected = {o.name for o in scene.objects}, {o.name for o in true.objects}
    found, right = hits(scene), hits(true)
    same = sum(pair in right and abs(right[pair] - frame) <= TOLERANCE_FRAMES for pair, frame in found.items())
    text = f"objects {len(names & expected)}/{len(expected)} (+{len(names - expected)}), "
    text += f"collisions {same}/{len(right)} (+{len(found) - same})"
    return names == expected and same == len(right) == len(found), text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--kinds", nargs="+", default=[*ALTERED, *RATES])
    options = parser.parse_args()
    pipeline = Pipeline.from_pretrained(dynamics="state")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        for clip in options.clips:
            true, original = pipeline.scene(clip), read_video(clip)
            for kind in options.kinds:
                frames: Frames = original if kind in RATES else ALTERED[kind][1](original)
                rate = RATES.get(kind, 25)
                write(path, at_rate(np.asarray(frames), rate), rate)
                began = time.process_time()
                notes: tuple[str, ...] = ()
                try:
                    scene = pipeline.scene(path)
                    notes = scene.notes
                    is_right, text = compared(scene, true)
                    outcome = "right" if is_right else "noted" if notes else "WRONG"
                except VideoError as e:
                    outcome, text = "refused", str(e).split(": ", 2)[-1][:100]
                reasons = "; ".join(notes)
                seconds = time.process_time() - began
                print(f"{clip.stem} {kind:27} {outcome:8} {seconds:4.0f} s  {text}  [{reasons[:160]}]", flush=True)


if __name__ == "__main__":
    main()

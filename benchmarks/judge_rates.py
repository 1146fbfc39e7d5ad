"""What the judge finds at other frame rates and lengths, from proposals.

`python benchmarks/judge_rates.py SUITE PROPOSALS.npz [--every N]` prints a table. SUITE is a folder of `nsdr generate
violations`; in official proposals nothing is broken. Videos of another rate are made from those of 25 frames a second by
interpolation: 12.5 frames a second are a stride of 2. Shorter ones are cut out around the violation.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from violations import judged

from nsdr.clevrer import read_compact_proposals, read_proposals
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.io.files import find_files
from nsdr.types import Judgement, VideoProposals
from nsdr.world.physics_constants import FPS

RATES = (30.0, 25.0, 24.0, 12.5, 10.0, 25 / 3, 8.0, 6.25)
LENGTHS = (64, 32, 24, 16)


def at_rate(proposals: VideoProposals, fps: float) -> tuple[VideoProposals, NDArray[np.float64]]:
    """The proposals of a video of another rate, and how late each frame is."""
    p, late, taken = proposals, np.zeros(proposals.n_frames), dict[int, float]()
    for time in np.arange(0, p.n_frames - 1 + 1e-6, FPS / fps).tolist():
        frame = int(np.ceil(time - 0.5 - 1e-6))
        if frame not in taken or abs(time - frame) < abs(late[frame]):
            taken[frame], late[frame] = time, time - frame
    row_of = {(int(f), int(a)): k for k, (f, a) in enumerate(zip(p.frame_index, p.attribute, strict=True))}
    rows, before, after, share = [], [], [], []
    for frame, time in taken.items():
        start = int(time + 1e-6)
        for k in np.flatnonzero(p.frame_index == start).tolist():
            following = row_of.get((start + (time - start > 1e-6), int(p.attribute[k])))
            if following is not None:
                rows.append(frame)
                before.append(k)
                after.append(following)
                share.append(max(time - start, 0.0))
    weight = np.array(share)[:, None]

    def between(values: NDArray[np.number]) -> NDArray[np.float64]:
        return np.asarray((1 - weight) * values[before] + weight * values[after])

    area = between(p.area_px[:, None])[:, 0].round().astype(int)
    box = between(p.box_xyxy_px).round().astype(int)
    columns = np.array(rows), p.attribute[before], p.score[before], between(p.centroid_px), area, box
    return VideoProposals(p.n_frames, *columns, None, np.array(sorted(taken))), late


def part(proposals: VideoProposals, middle: int, frames: int) -> VideoProposals:
    """So many frames around one."""
    first = int(np.clip(middle - frames // 2, 0, proposals.n_frames - frames))
    kept = (proposals.frame_index >= first) & (proposals.frame_index < first + frames)
    names = ("attribute", "score", "centroid_px", "area_px", "box_xyxy_px")
    return VideoProposals(frames, proposals.frame_index[kept] - first, *(getattr(proposals, n)[kept] for n in names))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", type=Path)
    parser.add_argument("official", type=Path)
    parser.add_argument("--every", type=int, default=1, help="every n-th official video")
    o = parser.parse_args()
    official = [p for _, p in read_compact_proposals(o.official)][:: o.every]
    truths = [read_truth_file(path) for path in find_files(o.suite / "truth", "truth_*.json")]
    folder = o.suite / "derender_proposals"
    made = [(read_proposals(folder / f"proposal_{truth['scene_index']:05d}.json"), truth) for truth in truths]
    print("| frames | found | law right | false alarms, suite | official |\n|---|---|---|---|---|")
    for kind in (*RATES, *LENGTHS):
        is_rate = isinstance(kind, float)

        def judgement(p: VideoProposals, middle: int = 64, kind: float = kind, is_rate: bool = is_rate) -> Judgement:
            return (judged(*at_rate(p, kind)) if is_rate else judged(part(p, middle, int(kind))))[0]

        found, right, broken, alarms = 0, 0, 0, 0
        for proposals, truth in made:
            violation = truth.get("violation")
            if violation is None:
                alarms += bool(judgement(proposals).violations)
                continue
            middle = 64 if violation["law"] == "arrow" else violation["frame"]
            top = max(judgement(proposals, middle).violations, key=lambda v: v.probability, default=None)
            broken += 1
            found += top is not None
            right += top is not None and top.law == violation["law"]
        others = sum(bool(judgement(p).violations) for p in official)
        text = f"{kind:.3g} a second" if is_rate else f"{kind} at 25 a second"
        lawful = f"{alarms} of {len(made) - broken} | {others} of {len(official)}"
        print(f"| {text} | {found} of {broken} | {right} | {lawful} |", flush=True)


if __name__ == "__main__":
    main()

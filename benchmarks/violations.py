"""How well violations are found: area under the ROC curve by law and size, what is said of them, and false alarms.

    nsdr generate violations --first_scene 560000 --videos 486 --renderer none -o SUITE
    python benchmarks/violations.py SUITE --lawful PROPOSALS_VALIDATION.npz --every 5 -o results/violations.md
    python benchmarks/violations.py --figure docs/images/violations.png

The suite needs masks. `--lawful` takes official proposals, in which nothing is broken; of these, `--every N --first K` takes a
part. `--fit` prints the constants of `nsdr.laws.judge`, from a suite of training seeds and proposals of `train`; `--jumps` how
far objects seem to jump while they are hidden in part, from those proposals.
"""

import argparse
import os
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.optimize import minimize_scalar
from tqdm import tqdm

from nsdr.clevrer import read_compact_proposals, read_proposals
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.evaluation.measures import wilson_interval
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.physics.violations import SIZES, break_law
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import RenderConfig, view_of
from nsdr.generate.scene_files import annotation_document, solids_at
from nsdr.io.files import find_files
from nsdr.io.fingerprint import code_revision
from nsdr.io.reading import read_json
from nsdr.laws.breaks import HIDDEN_NOISE_WORLD, JUMP_FRAMES
from nsdr.laws.evidence import evidence_in_time
from nsdr.laws.judge import judgement_of
from nsdr.laws.motion import Evidence, cut_motion
from nsdr.laws.timing import timing_of
from nsdr.tracking.tracker import track, tracks_from_annotation
from nsdr.types import LAWS, Judgement, VideoProposals
from nsdr.world.camera import CLEVRER_CAMERA, HEIGHT_PX, WIDTH_PX

T = TypeVar("T")
R = TypeVar("R")
FRAMES = 3
"""Frames that the first frame of a violation may be off."""
FIGURE_SEED = 340000
"""Scenes of the figure come after this one."""
FIGURE_FRAMES = (-16, -6, 0, 6, 16)
"""Its frames, from that of the violation; of time that runs backwards, from the video's middle."""
CELL_PX = (240, 160)
"""Width and height of its frames (pixels)."""
TEXT = (cv2.FONT_HERSHEY_SIMPLEX, 0.5)
"""Font of its texts, and size in OpenCV's unit."""
QUANTILES = (0.5, 0.9, 0.98, 1.0)
MARGIN, LEAST = 1.5, 6.0
"""See `fit`; the least evidence that counts as even (nats)."""


class Row(NamedTuple):
    violation: dict[str, Any] | None
    names: list[str]
    size: str
    judgement: Judgement
    evidence: list[Evidence]


def rows_of(root: Path, workers: int) -> list[Row]:
    manifest = read_json(root / "manifest.json")
    laws, sizes = manifest["config"]["laws"], manifest["config"]["sizes"]
    first = next(start for start, stop in manifest["splits"].values() if start < stop)
    rows: list[Row] = []
    truths = [read_truth_file(path) for path in find_files(root / "truth", "truth_*.json")]
    files = [root / "derender_proposals" / f"proposal_{truth['scene_index']:05d}.json" for truth in truths]
    for truth, found in zip(truths, in_parallel(judged_file, files, workers), strict=True):
        names = [f"{o['color']} {o['material']} {o['shape']}" for o in truth["objects"]]
        size = sizes[(truth["scene_index"] - first) // 2 // len(laws) % len(sizes)]  # as `ViolationsConfig` orders them
        rows.append(Row(truth.get("violation"), names, size, *found))
    return rows


def in_parallel(function: Callable[[T], R], items: Sequence[T], workers: int) -> list[R]:
    with ProcessPoolExecutor(workers) as pool:
        return list(tqdm(pool.map(function, items), total=len(items), desc="videos"))


def judged_file(path: Path) -> tuple[Judgement, list[Evidence]]:
    return judged(read_proposals(path))


def judged(proposals: VideoProposals, late: NDArray[np.float64] | None = None) -> tuple[Judgement, list[Evidence]]:
    """What is said of a video, and the evidence; `late` as of `nsdr.judge`."""
    tracks, n = track(proposals), proposals.n_frames
    processed = np.arange(n) if proposals.processed is None else proposals.processed
    timing = timing_of(tracks, processed, np.zeros(n) if late is None else late)
    evidence = evidence_in_time(tracks, timing, proposals)
    return replace(judgement_of(tracks, evidence), notes=timing.notes), evidence


def area(broken: list[float], lawful: list[float]) -> tuple[float, float, float]:
    """Area under the ROC curve, and its 95 % interval by a bootstrap over videos."""
    wins = (np.array(broken)[:, None] > np.array(lawful)) + 0.5 * (np.array(broken)[:, None] == np.array(lawful))
    rng = np.random.default_rng(0)
    n, m = wins.shape
    means = [wins[rng.integers(n, size=n)][:, rng.integers(m, size=m)].mean() for _ in range(1000)]
    return float(wins.mean()), *np.quantile(means, [0.025, 0.975]).tolist()


def report(rows: list[Row], official: list[Judgement]) -> str:
    lawful = [row.judgement.probability for row in rows if row.violation is None]
    lines = [
        "# Violations of the laws of CLEVRER's world",
        "",
        "| law | size | pairs | AUC | found (%) | law right (%) | objects right (%) | frame within 3 (%) | taken for |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    cases: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        if row.violation is not None:
            cases[row.violation["law"], row.size].append(row)
    for law in LAWS:
        for size in SIZES:
            if not (case := cases[law, size]):
                continue
            found = [row for row in case if row.judgement.violations]
            right: Counter[str] = Counter()
            taken: Counter[str] = Counter()
            for row in found:
                assert row.violation is not None
                top = max(row.judgement.violations, key=lambda v: v.probability)
                named = {row.judgement.objects[i].name for i in top.objects}
                true = {row.names[i] for i in row.violation["objects"]}
                right["law"] += top.law == law
                right["objects"] += bool(named & true) if law == "identity" else named <= true
                right["frame"] += abs(top.frame - row.violation["frame"]) <= FRAMES
                if top.law != law:
                    taken[top.law] += 1
            auc = area([row.judgement.probability for row in case], lawful)
            shares = [percent(right[k], len(found)) for k in ("law", "objects", "frame")]
            others = ", ".join(f"{name} {n}" for name, n in taken.most_common()) or "-"
            values = [law, size, len(case), f"{auc[0]:.3f} ({auc[1]:.3f}-{auc[2]:.3f})", percent(len(found), len(case))]
            lines.append(f"| {' | '.join(map(str, [*values, *shares, others]))} |")
    alarms = sum(p > 0.5 for p in lawful)
    lines += [
        "",
        f"False alarms: {alarms} of {len(lawful)} lawful videos of the suite ({percent(alarms, len(lawful))} %).",
    ]
    if official:
        alarms = sum(bool(j.violations) for j in official)
        laws = Counter(v.law for j in official for v in j.violations)
        kinds = ", ".join(f"{law} {n}" for law, n in laws.most_common())
        share = percent(alarms, len(official))
        lines.append(f"Official proposals: {alarms} of {len(official)} videos ({share} %){': ' * bool(kinds)}{kinds}.")
    return "\n".join(lines)


def percent(k: int, n: int) -> str:
    if not n:
        return "-"
    low, high = wilson_interval(k / n, n)
    return f"{100 * k / n:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def fit(rows: list[Row], official: list[list[Evidence]]) -> None:
    """Print the evidence against each law that counts as even, and how steep the probability is around it.

    Even is `MARGIN` times the second highest that lawful videos show: the highest may be a failure of the detector.
    """
    lawful = [row.evidence for row in rows if row.violation is None] + official
    logits: list[NDArray[np.floating[Any]]] = []
    for law in LAWS:
        broken = [row.evidence for row in rows if row.violation is not None and row.violation["law"] == law]
        hits, misses = (
            np.sort([max((e.nats for e in found if e.law == law), default=1.0) for found in side])
            for side in (broken, lawful)
        )
        even = max(MARGIN * float(misses[-2]), LEAST)
        hits, misses = hits[hits > 1], misses[misses > 1]  # how probable a violation is of which something speaks
        print(
            f'    "{law}": {even:.1f},  # the highest of {len(lawful)} lawful videos: {misses[-4:].round(1).tolist()}'
        )
        logits += [np.log(even / hits), np.log(misses / even)]
    best = minimize_scalar(
        lambda k: np.logaddexp(0, k * np.concatenate(logits)).mean(), bounds=(0.5, 10), method="bounded"
    )
    print(f"STEEPNESS = {best.x:.1f}")


def jumps(proposals: VideoProposals) -> list[float]:
    """How far objects seem to jump in a lawful video where they are hidden, if only in part (world units)."""
    explanation = cut_motion(states_from_tracks(track(proposals)))
    breaks = [b for one in explanation.breaks for b in one if b.is_sure]
    hidden = [b for b in breaks if b.hidden_frames > JUMP_FRAMES >= b.missing_frames]
    known = [b for b in hidden if b.position_variance < HIDDEN_NOISE_WORLD**2]
    return [b.jump().size for b in known]


def draw(path: Path) -> None:
    """A row of frames around a clear violation of each law, with boxes around the objects that break it."""
    rows = []
    for law in LAWS:
        seed, made = FIGURE_SEED, None
        while made is None:
            seed += 1
            made = break_law(simulate_scene(seed), law, "clear", seed)
        scene, violation = made
        middle = scene.n_frames // 2 if law == "arrow" else violation.frame
        frames = np.clip(middle + np.array(FIGURE_FRAMES), 0, scene.n_frames - 1).tolist()
        tracks = tracks_from_annotation(annotation_document(scene, 0, "", CLEVRER_CAMERA))
        names = [scene.objects[i].name for i in violation.objects]
        about = [t for t in tracks.tracks if t.object.name in names]
        view = view_of(RenderConfig(), seed)
        images = [render_preview(scene.objects, solids_at(scene, f), view) for f in frames]
        boxes = [[t.box_xyxy_px[np.abs(t.frame_index - f).argmin()].tolist() for t in about] for f in frames]
        shown = [  # what vanishes is missed where it was seen last
            [box for t, box in zip(about, row, strict=True) if law == "permanence" or f in t.frame_index]
            for f, row in zip(frames, boxes, strict=True)
        ]
        part = (0, 0, WIDTH_PX, HEIGHT_PX) if law == "arrow" else cut_out(np.concatenate(boxes))
        label = np.full((CELL_PX[1], 110, 3), 255, np.uint8)
        cv2.putText(label, law, (6, CELL_PX[1] // 2), *TEXT, (0, 0, 0), 1, cv2.LINE_AA)
        cells = [cell(image, [] if law == "arrow" else row, part) for image, row in zip(images, shown, strict=True)]
        for f, image in zip(frames, cells, strict=True):
            when = f"frame {f}" if law == "arrow" or f == middle else f"{f - middle:+d}"
            cv2.putText(image, when, (6, CELL_PX[1] - 8), *TEXT, (255, 255, 255), 1, cv2.LINE_AA)
        rows.append(np.concatenate([label, *cells], 1))
    Image.fromarray(np.concatenate(rows)).save(path, optimize=True)


def cut_out(boxes: NDArray[np.integer[Any]]) -> tuple[int, int, int, int]:
    """The part of the image around boxes (x0, y0, x1, y1 each): at least a half of each side, and of the same shape."""
    low, high = boxes[:, :2].min(0), boxes[:, 2:].max(0)
    size = np.array([WIDTH_PX, HEIGHT_PX])
    share = min(max(float(((high - low + 60) / size).max()), 0.5), 1.0)
    width, height = (share * size).astype(int).tolist()
    x, y = np.clip((low + high) // 2 - (width // 2, height // 2), 0, size - (width, height)).tolist()
    return x, y, x + width, y + height


def cell(image: NDArray[np.uint8], boxes: list[list[int]], part: tuple[int, int, int, int]) -> NDArray[np.uint8]:
    """A part of a frame with boxes, as large as each cell of the figure."""
    image = image.copy()
    for x0, y0, x1, y1 in boxes:
        cv2.rectangle(image, (x0 - 2, y0 - 2), (x1 + 2, y1 + 2), (255, 210, 60), 1, cv2.LINE_AA)
    x0, y0, x1, y1 = part
    return np.asarray(cv2.resize(image[y0:y1, x0:x1], CELL_PX, interpolation=cv2.INTER_AREA), np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suites", nargs="*", type=Path, help="folders of `nsdr generate violations`")
    parser.add_argument("--lawful", type=Path, help="official proposals, .npz")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--jumps", action="store_true")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--figure", type=Path, help="draw each law broken into a PNG file, and no more")
    parser.add_argument("-o", "--output", type=Path)
    o = parser.parse_args()
    if o.figure:
        draw(o.figure)
        return
    given = [p for _, p in read_compact_proposals(o.lawful)][o.first :: o.every] if o.lawful else []
    if o.jumps:
        sizes = np.concatenate(in_parallel(jumps, given, o.workers))
        print(f"{len(sizes)} jumps in {len(given)} videos:", *(f"{q} {np.quantile(sizes, q):.3f}" for q in QUANTILES))
        return
    rows = [row for root in o.suites for row in rows_of(root, o.workers)]
    official = in_parallel(judged, given, o.workers)
    if o.fit:
        fit(rows, [evidence for _, evidence in official])
        return
    text = report(rows, [judgement for judgement, _ in official])
    part = f" --lawful {o.lawful.name} --every {o.every} --first {o.first}" if o.lawful else ""
    command = f"python benchmarks/violations.py SUITE{part} -o {o.output}"
    text += f"\n95 % intervals. Made by `{command}`, revision {code_revision()}.\n"
    print(text)
    if o.output:
        o.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

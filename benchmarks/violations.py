"""How well violations are found: area under the ROC curve by law and size, what is said of them, and false alarms.

    nsdr generate violations --first-scene 560000 --videos 486 --renderer none -o SUITE
    python -m benchmarks.violations SUITE --lawful PROPOSALS_VALIDATION.npz --every 5 -o results/violations.md
    python -m benchmarks.violations SUITE --lawful PROPOSALS_VALIDATION.npz --every 80 --rates
    python -m benchmarks.violations --figure docs/images/violations.png

The suite needs masks. `--lawful` takes official proposals, in which nothing is broken; of these, `--every N --first K` takes a
part. `--rates` prints what is found at other frame rates and lengths instead: videos of another rate are made from those of 25
frames a second by interpolation (12.5 frames a second are a stride of 2), shorter ones are cut out around the violation.
`--fit` prints the constants of `nsdr.laws.judge`, from a suite of training seeds and proposals of `train`; `--jumps` how far
objects seem to jump while they are hidden in part, from those proposals.
"""

import os
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.optimize import minimize_scalar
from tqdm import tqdm

from benchmarks.shared import made_by, parser_of, percent, show, table
from nsdr.clevrer import read_compact_proposals, read_proposals
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.physics.violations import SIZES, break_law
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import RenderConfig, view_of
from nsdr.generate.scene_files import annotation_document, solids_at
from nsdr.io.files import find_files
from nsdr.io.reading import read_json
from nsdr.io.worlds import world_in
from nsdr.laws.breaks import HIDDEN_NOISE_WORLD, JUMP_FRAMES, SURE_FRAMES
from nsdr.laws.evidence import evidence_in_time
from nsdr.laws.judge import judgement_of
from nsdr.laws.motion import Evidence, cut_motion
from nsdr.laws.timing import timing_of
from nsdr.tracking.tracker import track, tracks_from_annotation
from nsdr.types import LAWS, Judgement, VideoProposals
from nsdr.types.events import SAME_EVENT_FRAMES
from nsdr.world.camera import CLEVRER_CAMERA, HEIGHT_PX, WIDTH_PX
from nsdr.world.world import CLEVRER_WORLD

T = TypeVar("T")
R = TypeVar("R")
RATES = (30.0, 25.0, 24.0, 12.5, 10.0, 25 / 3, 8.0, 6.25)
LENGTHS = (64, 32, 24, 16)
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
    """A video of a suite, and what is said of it."""

    path: Path
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
    for truth, path, found in zip(truths, files, in_parallel(judged_file, files, workers), strict=True):
        names = [f"{o['color']} {o['material']} {o['shape']}" for o in truth["objects"]]
        size = sizes[(truth["scene_index"] - first) // 2 // len(laws) % len(sizes)]  # as `ViolationsConfig` orders them
        rows.append(Row(path, truth.get("violation"), names, size, *found))
    return rows


def in_parallel(function: Callable[[T], R], items: Sequence[T], workers: int) -> list[R]:
    with ProcessPoolExecutor(workers) as pool:
        return list(tqdm(pool.map(function, items), total=len(items), desc="videos"))


def judged_file(path: Path) -> tuple[Judgement, list[Evidence]]:
    return judged(read_proposals(path))


def judged(proposals: VideoProposals, late: NDArray[np.float64] | None = None) -> tuple[Judgement, list[Evidence]]:
    """What is said of a video, and the evidence; `late` as in `nsdr.laws.judge`."""
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


def report(rows: list[Row], official: list[Judgement], world: str) -> str:
    lawful = [row.judgement.probability for row in rows if row.violation is None]
    cases: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        if row.violation is not None:
            cases[row.violation["law"], row.size].append(row)
    lines = []
    for law, size in (key for key in product(LAWS, SIZES) if key in cases):
        case, right, taken = cases[law, size], Counter[str](), Counter[str]()
        found = [row for row in case if row.judgement.violations]
        for row in found:
            assert row.violation is not None
            top = max(row.judgement.violations, key=lambda v: v.probability)
            named = {row.judgement.objects[i].name for i in top.objects}
            true = {row.names[i] for i in row.violation["objects"]}
            right["law"] += top.law == law
            right["objects"] += bool(named & true) if law == "identity" else named <= true
            right["frame"] += abs(top.frame - row.violation["frame"]) <= SAME_EVENT_FRAMES
            if top.law != law:
                taken[top.law] += 1
        auc = area([row.judgement.probability for row in case], lawful)
        shares = [
            percent(len(found), len(case), 0),
            *(percent(right[k], len(found), 0) for k in ("law", "objects", "frame")),
        ]
        lines.append(
            (law, size, len(case), f"{auc[0]:.3f} ({auc[1]:.3f}-{auc[2]:.3f})", *shares, _counts(taken) or "-")
        )
    columns = (
        "law",
        "size",
        "pairs",
        "AUC",
        "found (%)",
        "law right (%)",
        "objects right (%)",
        "frame within 3 (%)",
        "taken for",
    )
    alarms = sum(p > 0.5 for p in lawful)
    text = f"# Violations of the laws of the world {world}\n\n{table(columns, lines)}\n\n"
    text += (
        f"False alarms: {alarms} of {len(lawful)} lawful videos of the suite ({percent(alarms, len(lawful), 0)} %).\n"
    )
    if official:
        alarms = sum(bool(j.violations) for j in official)
        laws = _counts(Counter(v.law for j in official for v in j.violations))
        share = percent(alarms, len(official), 0)
        text += f"Official proposals: {alarms} of {len(official)} videos ({share} %){': ' * bool(laws)}{laws}.\n"
    return f"{text}95 % intervals. {made_by()}"


def _counts(laws: Counter[str]) -> str:
    return ", ".join(f"{law} {n}" for law, n in laws.most_common())


def report_rates(rows: list[Row], official: list[VideoProposals], workers: int) -> str:
    """What is found at other rates and lengths."""
    made, lines = [(read_proposals(row.path), row.violation) for row in rows], []
    for kind in (*RATES, *LENGTHS):
        items = [(p, 64 if v is None or v["law"] == "arrow" else v["frame"]) for p, v in made]
        judgements = in_parallel(partial(judged_part, kind), [*items, *((p, 64) for p in official)], workers)
        found = right = alarms = 0
        for judgement, (_, violation) in zip(judgements, made, strict=False):
            top = max(judgement.violations, key=lambda v: v.probability, default=None)
            found += top is not None and violation is not None
            right += top is not None and violation is not None and top.law == violation["law"]
            alarms += top is not None and violation is None
        broken = sum(violation is not None for _, violation in made)
        others = sum(bool(j.violations) for j in judgements[len(made) :])
        text = f"{kind:.3g} a second" if isinstance(kind, float) else f"{kind} at 25 a second"
        lawful = (f"{alarms} of {len(made) - broken}", f"{others} of {len(official)}")
        lines.append((text, f"{found} of {broken}", right, *lawful))
    return table(("frames", "violations found", "right law", "false alarms, suite", "false alarms, official"), lines)


def judged_part(kind: float, item: tuple[VideoProposals, int]) -> Judgement:
    """What is said of a video at another rate, or of some frames around one of its frames."""
    proposals, middle = item
    return (judged(*at_rate(proposals, kind)) if isinstance(kind, float) else judged(part(proposals, middle, kind)))[0]


def at_rate(proposals: VideoProposals, fps: float) -> tuple[VideoProposals, NDArray[np.float64]]:
    """The proposals of a video of another rate, and how late each frame is."""
    p, late, taken = proposals, np.zeros(proposals.n_frames), dict[int, float]()
    for time in np.arange(0, p.n_frames - 1 + 1e-6, CLEVRER_WORLD.timeline.fps / fps).tolist():
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
    breaks = [b for one in explanation.breaks for b in one if min(len(b.before), len(b.after)) >= SURE_FRAMES]
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
        view = view_of(RenderConfig(), seed, CLEVRER_WORLD)
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
    parser = parser_of(__doc__)
    parser.add_argument("suites", nargs="*", type=Path, help="folders of `nsdr generate violations`")
    parser.add_argument("--lawful", type=Path, help="official proposals, .npz")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rates", action="store_true")
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
    if o.rates:
        show(report_rates(rows, given, o.workers), o.output)
        return
    official = in_parallel(judged, given, o.workers)
    if o.fit:
        fit(rows, [evidence for _, evidence in official])
    else:
        world = world_in(read_json(o.suites[0] / "manifest.json")).name
        show(report(rows, [judgement for judgement, _ in official], world), o.output)


if __name__ == "__main__":
    main()

"""Tracks from exact masks and a camera from clicked points, beside the tracks of the truth.

`python -m benchmarks.masks [--scenes 40] [--first 500000] [-o results/masks.md]`

Each generated scene is seen by a camera of its own. Its exact masks become tracks: with the true camera, and with cameras that
are found from points on the table, clicked with a pixel of noise. Positions are compared with the true ones wherever an object
has a mask. Generated questions are answered in the scenes that the default perceives from these tracks and from those of the
truth: "same" are answers that are equal, whether or not they are right. About 5 seconds of a core a scene.
"""

import math
import random
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.shared import made_by, parser_of, percent_right, show, table
from nsdr import Camera, Executor, Pipeline, Scene, VideoTracks, World, tracks_from_masks
from nsdr.clevrer.files.questions import QUESTION_TYPES, SceneQuestions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.evaluation.report import Row
from nsdr.evaluation.score import score_scenes
from nsdr.generate import generate_questions, simulate_scene
from nsdr.generate.physics.scene import SimulatedScene
from nsdr.generate.render.geometry import instance_ids
from nsdr.generate.scene_files import annotation_document, solids_at, truth_document
from nsdr.tracking import tracks_from_annotation

TRUE, KNOWN = "true tracks", "true camera"
POINTS = {
    "9 points": [(x, y) for x in (1.5, 0.0, -1.5) for y in (-1.5, 0.0, 1.5)],
    "4 points": [(x, y) for x in (1.5, -1.5) for y in (-1.5, 1.5)],
}
"""Places on the table that are clicked (world units)."""
CLICK_PX = 1.0
"""Standard deviation of each coordinate of a click (pixels)."""
RESAMPLES = 500
"""Number of draws of the bootstrap."""


def camera_of(seed: int) -> Camera:
    """A camera somewhere around the table's front."""
    rng = random.Random(f"camera {seed}")
    around, up = math.radians(rng.uniform(-40, 40)), math.radians(rng.uniform(25, 45))
    away, lens = rng.uniform(4.5, 5.5), rng.uniform(28, 38)
    eye = away * math.cos(up) * math.cos(around), away * math.cos(up) * math.sin(around), away * math.sin(up)
    return Camera(eye, (rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0.0), lens)


def found_camera(camera: Camera, places: Sequence[tuple[float, float]], seed: int) -> Camera:
    """The camera from points that are clicked with noise."""
    pixels = camera.pixels(np.c_[places, np.zeros(len(places))])
    noise = np.random.default_rng(seed).normal(scale=CLICK_PX, size=pixels.shape)
    return Camera.from_points(pixels + noise, places)[0]


def errors(scene: SimulatedScene, tracks: VideoTracks) -> np.ndarray:
    """Distances of all positions of tracks from the true ones (world units)."""
    true = dict(zip((o.name for o in scene.objects), scene.motion.location_world[..., :2], strict=True))
    off = [t.location_world - true[t.object.name][t.frame_index] for t in tracks.tracks]
    return np.linalg.norm(np.concatenate(off), axis=1)


def answers(pipeline: Pipeline, tracks: VideoTracks, questions: SceneQuestions) -> list[Row]:
    """What the default answers from tracks."""
    scene = pipeline.perceive(tracks=tracks).scene
    return score_scenes([(questions, Executor(scene))]).results


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--first", type=int, default=500000)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    pipeline = Pipeline.from_pretrained()
    seeds = range(options.first, options.first + options.scenes)
    scenes = {seed: simulate_scene(seed) for seed in seeds}
    truths: dict[int, Scene] = {s: scene_from_truth(truth_document(scenes[s], s, camera_of(s))) for s in seeds}
    asked = {q.scene_index: q for q in generate_questions((s, "", truth) for s, truth in truths.items())}
    off: dict[str, list[np.ndarray]] = defaultdict(list)
    found: dict[str, list[Row]] = defaultdict(list)
    for seed, scene in tqdm(scenes.items(), unit="scene"):
        camera = camera_of(seed)
        labels = np.stack([instance_ids(solids_at(scene, f), camera) + 1 for f in range(scene.n_frames)])
        seen = [o for o in scene.objects if (labels == o.id + 1).any()]
        labels = np.searchsorted([0, *(o.id + 1 for o in seen)], labels)
        tracks = {TRUE: tracks_from_annotation(annotation_document(scene, seed, "", camera), World(camera=camera))}
        cameras = {KNOWN: camera} | {name: found_camera(camera, places, seed) for name, places in POINTS.items()}
        for name, one in cameras.items():
            tracks[name] = tracks_from_masks(labels, seen, World(camera=one))
            off[name].append(errors(scene, tracks[name]))
        for name, one in tracks.items():
            found[name] += answers(pipeline, one, asked[seed])
    rows = []
    for name in found:
        cells: list[str] = []
        if name in off:
            cells = [_quantile(off[name], 0.5), _quantile(off[name], 0.95)]
        rows.append([name, *(cells or ["0", "0"]), *_shares(found[name], found[TRUE])])
    kinds = ["all", *QUESTION_TYPES]
    columns = ["tracks", "median error", "95th percentile", *(f"same: {k}" for k in kinds), "right"]
    head = (
        "# Tracks from masks\n\n"
        f"{len(scenes)} generated scenes, {len(found[TRUE])} questions. Errors of positions in world units: median and 95th "
        "percentile. Answers that are the same as from true tracks, and right answers, in % of questions. 95 % intervals."
    )
    show(f"{head}\n\n{table(columns, rows)}\n\n{made_by()}", options.output)


def _quantile(of_scenes: Sequence[np.ndarray], share: float) -> str:
    """A quantile of all errors, with an interval by a bootstrap that draws scenes."""
    rng = np.random.default_rng(0)
    draws = (rng.integers(len(of_scenes), size=len(of_scenes)) for _ in range(RESAMPLES))
    found = [np.quantile(np.concatenate([of_scenes[k] for k in draw]), share) for draw in draws]
    low, high = np.quantile(found, [0.025, 0.975])
    return f"{np.quantile(np.concatenate(of_scenes), share):.4f} ({low:.4f}-{high:.4f})"


def _shares(rows: Sequence[Row], true: Sequence[Row]) -> list[str]:
    """Questions with the answers of the true tracks, of all and of each type, and questions with right answers (%)."""
    same = [_said(a) == _said(b) for a, b in zip(rows, true, strict=True)]
    index = [row["scene_index"] for row in rows]
    shares = [percent_right(same, index)]
    for kind in QUESTION_TYPES:
        of_kind = [k for k, row in enumerate(rows) if row["question_type"] == kind]
        shares.append(percent_right([same[k] for k in of_kind], [index[k] for k in of_kind]))
    return [*shares, percent_right([bool(row["correct"]) for row in rows], index)]


def _said(row: Row) -> object:
    return row.get("answer"), [c["answer"] for c in row.get("choices", ())], row.get("error")


if __name__ == "__main__":
    main()

"""Directions in the image, as benchmarks ask for them: how many are right on generated videos, with exact masks.

`python benchmarks/directions.py [--first 500000] [--videos 100]`

Each object of each video is asked about. The truth is the motion of its centre in the image from its first visible frame to
its last, of the simulation that made the video; an object is stationary if it never moves while visible. Prints how many are
right, by how probable they were said to be, and the errors of the motion, on which MOTION_ERROR_PX in
`nsdr/symbolic/quantities.py` is based (of training seeds: `--first 370000 --videos 40`). About 3 seconds a video on one core.
"""

import argparse
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from tqdm import tqdm

from nsdr import load_backend
from nsdr.clevrer.files.proposals import parse_proposals
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.dynamics.scene import motion_px, scene_from_prediction
from nsdr.evaluation.measures import accuracy_interval
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.scene_files import proposal_document, truth_document
from nsdr.io.checkpoint import find_checkpoint
from nsdr.question_parser.grammar import GrammarParser
from nsdr.symbolic import Executor
from nsdr.tracking.tracker import existence, track
from nsdr.types import Scene
from nsdr.world.camera import CLEVRER_CAMERA as CAMERA

SURE = 0.9
"""Answers that are said to be more probable are counted by themselves."""


def scenes_of(seed: int, backend: Any) -> tuple[Scene, Scene]:
    """The perceived and the true scene of a generated video."""
    made = simulate_scene(seed, removals=False)
    tracks = track(parse_proposals(json.dumps(proposal_document(made, seed, "", CAMERA)).encode(), f"seed {seed}"))
    found = scene_from_prediction(backend.predict(tracks), existence(tracks), CAMERA)
    true = scene_from_truth(truth_document(made, seed, CAMERA))
    motion = motion_px(made.motion.location_world[:, :, :2], true.visible, CAMERA)
    return found, Scene(true.objects, true.n_frames, true.visible, true.moving, true.events, motion_px=motion)


def compared(found: Scene, true: Scene) -> Iterator[tuple[bool, float, float]]:
    """Whether each object's direction is right, how probable it is said to be, and the error of its motion (pixels)."""
    parser, ids = GrammarParser(), {o.name: o.id for o in found.objects}
    for o in true.objects:
        if o.name not in ids or not true.visible[o.id].any():
            continue
        program = parser.parse(f"In which direction does the {o.name} move in the video?")
        answer, truth = (Executor(scene).answer(program) for scene in (found, true))
        error = np.abs(found.motion_px[ids[o.name]] - true.motion_px[o.id]).max()
        yield answer.answer == truth.answer, answer.probability or 0.0, float(error)


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--first", type=int, default=500_000, help="seed of the first video")
    parser.add_argument("--videos", type=int, default=100)
    options = parser.parse_args()
    backend: Any = load_backend(find_checkpoint("default"), "physics")
    rows = []
    for seed in tqdm(range(options.first, options.first + options.videos), unit="video"):
        rows += [(*row, seed) for row in compared(*scenes_of(seed, backend))]
    right, probability, error, seeds = map(np.array, zip(*rows, strict=True))
    for name, chosen in (("all", right >= 0), ("sure", probability > SURE), ("unsure", probability <= SURE)):
        low, high = accuracy_interval(right[chosen].tolist(), seeds[chosen].tolist())
        share = f"{100 * right[chosen].mean():.1f} % right ({100 * low:.1f}-{100 * high:.1f})" if chosen.any() else "-"
        print(f"{name}: {chosen.sum()} objects, {share}")
    print(f"error of the motion, px: 68 % {np.quantile(error, 0.68):.2f}, 95 % {np.quantile(error, 0.95):.2f}")


if __name__ == "__main__":
    main()

"""Seconds a scene, frames a second and statistics of the generator: `python benchmarks/generate.py [--scenes 40] [-o OUT]`.

Scenes with their recursive construction and every removal on one core (CPU time); the preview renderer on all cores. With
`-o` the scenes' statistics are written beside the release's.
"""

import argparse
import os
import time
from functools import partial

from nsdr.clevrer.scenes import scene_from_truth
from nsdr.generate.physics.bullet import Simulator
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.records import solids_at, truth_document
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.generate.statistics import count_scenes, write_statistics
from nsdr.io.tasks import run_tasks
from nsdr.world.camera import Camera

FIRST_SEED = 510000


def render(scene: SimulatedScene, part: int) -> int:
    """Render every fourth frame from `part` on; returns how many."""
    frames = range(part, scene.n_frames, 4)
    for f in frames:
        render_preview(scene.objects, solids_at(scene, f), View())
    return len(frames)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("-o", "--output", default="")
    options = parser.parse_args()
    start = time.process_time()
    with Simulator() as simulator:
        scenes = [simulate_scene(seed, None, simulator) for seed in range(FIRST_SEED, FIRST_SEED + options.scenes)]
    print(f"{(time.process_time() - start) / len(scenes):.2f} s a scene, all removals included")
    for parts in (range(2), range(2, 10)):  # the first round starts the workers
        start = time.perf_counter()
        frames = sum(o.result for o in run_tasks(partial(render, scenes[0]), [p % 4 for p in parts]))
        seconds = time.perf_counter() - start
    print(f"{frames / seconds:.0f} preview frames/s on {os.cpu_count()} cores, the workers' start included")
    if options.output:
        counts = count_scenes(scene_from_truth(truth_document(s, s.seed, Camera())) for s in scenes)
        write_statistics(options.output, counts, f"{len(scenes)} simulated scenes")


if __name__ == "__main__":
    main()

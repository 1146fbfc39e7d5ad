"""Speed and statistics of the generator: `python benchmarks/generate.py [--scenes 40] [-o OUT]`.

Measures seconds per scene (CPU time on one core, with the construction and the simulation without each object) and frames
per second of the preview renderer (all cores). With `-o`, writes the scenes' statistics compared with the release's.
"""

import argparse
import os
import time
from functools import partial

from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.generate.scene_files import solids_at, truth_document
from nsdr.generate.statistics import count_scenes, write_statistics
from nsdr.io.tasks import run_tasks
from nsdr.world.camera import Camera

FIRST_SEED = 510000
"""Seed of the first scene."""
PARTS = 4
"""Parts into which a video's frames are divided."""
WARMUP_TASKS, TIMED_TASKS = 2, 8
"""Rendering tasks before and during the measurement."""


def render(scene: SimulatedScene, part: int) -> int:
    """Render one part of the frames; returns their number."""
    frames = range(part, scene.n_frames, PARTS)
    for f in frames:
        render_preview(scene.objects, solids_at(scene, f), View())
    return len(frames)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=40, help="number of scenes")
    parser.add_argument("-o", "--output", default="", help="folder for the statistics")
    options = parser.parse_args()
    start = time.process_time()
    scenes = [simulate_scene(seed) for seed in range(FIRST_SEED, FIRST_SEED + options.scenes)]
    print(f"{(time.process_time() - start) / len(scenes):.2f} s per scene, with all removals")
    for tasks in (range(WARMUP_TASKS), range(WARMUP_TASKS, WARMUP_TASKS + TIMED_TASKS)):
        start = time.perf_counter()
        frames = sum(o.result for o in run_tasks(partial(render, scenes[0]), [k % PARTS for k in tasks]))
        seconds = time.perf_counter() - start
    print(f"{frames / seconds:.0f} preview frames/s on {os.cpu_count()} cores, with the start of the workers")
    if options.output:
        counts = count_scenes(scene_from_truth(truth_document(s, s.seed, Camera())) for s in scenes)
        write_statistics(options.output, counts, f"{len(scenes)} simulated scenes")


if __name__ == "__main__":
    main()

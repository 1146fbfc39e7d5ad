"""Observed collisions, rollouts and speed of the dynamics backends on real proposals.

`python benchmarks/dynamics.py --proposals FILE.npz --truth FILE.json.gz [--scenes 400] [--dynamics physics state]`

Collisions count as right when the pair is the true one and the frames are at most 3 apart; the truth's objects are matched by
their attributes. Rollouts start from the frames before 60, 80 and 100 and are compared with the real tracks, beside a
continuation with constant velocity.

Seconds are CPU time on one thread, with all removals: `--scenes 50` gives the figures of `results/speed.md`.
"""

import argparse
import time
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from nsdr import DynamicsPrediction, Event, Scene, track
from nsdr.clevrer.files.annotations import read_truth
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.scenes import scene_from_ground_truth
from nsdr.dynamics.metrics import collision_scores, rollout_errors
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.dynamics.registry import load_backend
from nsdr.io.checkpoint import find_checkpoint
from nsdr.types import Rollout
from nsdr.world.physics_constants import VIDEO_FRAMES, horizon_frame


class ConstantVelocity:
    """Goes on as over the last nine frames."""

    def continue_motion(self, states: MotionStates) -> Rollout:
        positions = states.location_world
        frames = positions.shape[1]
        velocity = (positions[:, -1] - positions[:, -9]) / 8
        later = positions[:, -1:] + velocity[:, None] * np.arange(1, 53)[:, None]
        location = np.concatenate([positions, later], 1)
        return Rollout(location, np.ones((len(positions), frames + 52), bool), ())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--proposals", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=400)
    parser.add_argument("--rollouts", type=int, default=60, help="scenes whose rollouts are measured")
    parser.add_argument("--dynamics", nargs="+", default=["physics", "state"], help="backends, or their YAML files")
    options = parser.parse_args()
    truth = read_truth(options.truth)
    videos = list(islice(read_compact_proposals(options.proposals), options.scenes))
    scenes = [(scene_from_ground_truth(truth[v], truth[v]["n_frames"]), track(p)) for v, p in videos]
    states = [states_from_tracks(tracks) for _, tracks in scenes[:: max(len(scenes) // options.rollouts, 1)]]
    print("rollouts, constant velocity: " + _text(rollout_errors(ConstantVelocity(), states)))
    for name in options.dynamics:
        backend: Any = load_backend(find_checkpoint("default"), name)
        backend.horizon_frame = horizon_frame(VIDEO_FRAMES)  # of rollouts of a video's first frames, too
        backend.predict(scenes[0][1])  # compiles
        predictions, seconds = [], []
        for _, tracks in scenes:
            start = time.process_time()
            predictions.append(backend.predict(tracks))
            seconds.append(time.process_time() - start)
        pairs = [(_found(p, true), _true(true)) for p, (true, _) in zip(predictions, scenes, strict=True)]
        print(f"{name}, {len(pairs)} scenes: {_text(collision_scores(pairs))}, {_errors(pairs)}")
        middle, high = np.percentile(seconds, [50, 95])
        print(f"  s CPU a scene: median {middle:.3f}, 95th percentile {high:.3f}, largest {max(seconds):.3f}")
        if hasattr(backend, "continue_motion"):
            print("  rollouts: " + _text(rollout_errors(backend, states)))


def _found(prediction: DynamicsPrediction, true: Scene) -> list[Event]:
    """Collisions during the video with the true objects' ids; objects that are not there get numbers that no true one has."""
    number = {o.name: o.id for o in true.objects}
    ids = [number.get(o.name, 100 + o.id) for o in prediction.objects]
    return [
        replace(e, objects=tuple(sorted(ids[i] for i in e.objects)))
        for e in prediction.observed.collisions
        if e.frame < prediction.n_frames
    ]


def _true(scene: Scene) -> list[Event]:
    return [e for e in scene.events if e.kind == "collision"]


def _text(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in values.items())


def _errors(pairs: list[tuple[list[Event], list[Event]]]) -> str:
    missing = sum(len({e.objects for e in true} - {e.objects for e in found}) for found, true in pairs)
    extra = sum(len({e.objects for e in found} - {e.objects for e in true}) for found, true in pairs)
    total = sum(len(true) for _, true in pairs)
    return f"pairs alone: {missing} of {total} missing, {extra} too many"


if __name__ == "__main__":
    main()

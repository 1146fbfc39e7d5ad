"""Observed collisions, rollouts and speed of the dynamics predictor on real proposals.

`python benchmarks/dynamics.py --proposals FILE.npz --truth FILE.json.gz [--scenes 400]`

Collisions count as right when the pair is the true one and the frames are at most 3 apart; the truth's objects are matched by
their attributes. Rollouts start from the frames before 60, 80 and 100 and are compared with the real tracks, beside a
continuation with constant velocity.
"""

import argparse
import time
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from nsdr import DynamicsPredictor, Event, track
from nsdr.checkpoint import find_checkpoint
from nsdr.clevrer.proposals import read_compact_proposals
from nsdr.clevrer.scenes import scene_from_ground_truth
from nsdr.dynamics.data import read_truth
from nsdr.dynamics.metrics import collision_scores, rollout_errors
from nsdr.dynamics.states import MotionStates, states_from_tracks
from nsdr.types import Rollout


class ConstantVelocity:
    """Goes on as over the last nine frames."""

    def continue_motion(self, states: MotionStates) -> Rollout:
        places = states.location_world
        frames = places.shape[1]
        velocity = (places[:, -1] - places[:, -9]) / 8
        later = places[:, -1:] + velocity[:, None] * np.arange(1, 53)[:, None]
        location = np.concatenate([places, later], 1)
        return Rollout(location, np.ones((len(places), frames + 52), bool), ())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--proposals", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=400)
    options = parser.parse_args()
    predictor = DynamicsPredictor.from_checkpoint(find_checkpoint("default"))
    truth = read_truth(options.truth)
    pairs, states, seconds = [], [], 0.0
    for video, proposals in islice(read_compact_proposals(options.proposals), options.scenes):
        true = scene_from_ground_truth(truth[video], truth[video]["n_frames"])
        tracks = track(proposals)
        start = time.process_time()
        prediction = predictor.predict(tracks)
        seconds += time.process_time() - start
        # Objects that are not there get numbers that no true collision has.
        number = {o.name: o.id for o in true.objects}
        ids = [number.get(o.name, 100 + o.id) for o in prediction.objects]
        found = [
            replace(e, objects=tuple(sorted(ids[i] for i in e.objects)))
            for e in prediction.observed.collisions
            if e.frame < prediction.n_frames
        ]
        pairs.append((found, [e for e in true.events if e.kind == "collision"]))
        states.append(states_from_tracks(tracks))
    print(f"{len(pairs)} scenes: " + _text(collision_scores(pairs)))
    print(f"{_errors(pairs)}; {seconds / len(pairs):.2f} s CPU a scene, all removals included")
    some = states[:: max(len(states) // 60, 1)]
    print("rollouts, median error: " + _text(rollout_errors(predictor, some)))
    print("constant velocity:      " + _text(rollout_errors(ConstantVelocity(), some)))  # type: ignore[arg-type]


def _text(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in values.items())


def _errors(pairs: list[tuple[list[Event], list[Event]]]) -> str:
    missing = sum(len({e.objects for e in true} - {e.objects for e in found}) for found, true in pairs)
    extra = sum(len({e.objects for e in found} - {e.objects for e in true}) for found, true in pairs)
    total = sum(len(true) for _, true in pairs)
    return f"pairs alone: {missing} of {total} missing, {extra} too many"


if __name__ == "__main__":
    main()

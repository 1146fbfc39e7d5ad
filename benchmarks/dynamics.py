"""Observed collisions, rollouts and speed of the dynamics backends on real proposals; and how sure the default should be.

    python -m benchmarks.dynamics --proposals FILE.npz --truth FILE.json.gz [--scenes 400] [--dynamics physics state]
    python -m benchmarks.dynamics --proposals FILE.npz --truth FILE.json.gz --cut [--every 5] [--set NAME=VALUE ...]

Collisions count as right when the pair is the true one and the frames are at most 3 apart. Rollouts start from the frames
before 60, 80 and 100 and are compared with the real tracks, beside a continuation with constant velocity. Seconds are CPU
time on one thread, with all removals.

With `--cut`, each video is cut at the last of `CUTS` that has collisions before and after it. The physics backend explains the
part before it, given the true collisions, and the probabilities of the pairs that had not met are scored. Several `--set` of
one field of `PhysicsConfig` are compared, such as `--set yaw_noise=0.1 --set yaw_noise=0.2`. `--every 5` keeps the scenes of
`train` that nothing was trained on.
"""

import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np

from benchmarks.shared import RealScene, add_real_scenes, load_default, parser_of, real_scenes, table
from nsdr import Event, Remove, VideoTracks
from nsdr.dynamics.base import Explanation
from nsdr.dynamics.metrics import collision_scores, rollout_errors
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.types import Rollout
from nsdr.types.interventions import Intervention

CUTS = (50, 70, 90)
"""Frames at which videos are cut."""
MARGIN_FRAMES = 3
"""Distance of collisions from the cut."""
MIN_DETECTIONS = 4
"""Detections that every object must have before the cut."""
VELOCITY_FRAMES = 8
"""Frames over which the constant velocity is measured."""


class ConstantVelocity(Explanation):
    """A video whose objects go on as over its last frames; also the backend that explains it."""

    def __init__(self, states: MotionStates) -> None:
        super().__init__(states.objects, states.n_frames)
        self.positions = states.location_world

    @classmethod
    def explain(cls, states: MotionStates, collisions: Sequence[Event] | None = None) -> "ConstantVelocity":
        return cls(states)

    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        last = self.positions[:, -1:]
        velocity = (last - self.positions[:, [-1 - VELOCITY_FRAMES]]) / VELOCITY_FRAMES
        later = last + velocity * np.arange(1, frames - self.n_frames + 1)[:, None]
        location = np.concatenate([self.positions, later], 1)
        return Rollout(location, np.ones(location.shape[:2], bool), ())


def compare(options: Namespace) -> None:
    """Print collisions, seconds and rollouts of each backend."""
    scenes = list(real_scenes(options))
    some = [s.states for s in scenes[:: max(len(scenes) // options.rollouts, 1)]]
    print("rollouts, constant velocity: " + _text(rollout_errors(ConstantVelocity, some)))
    for name in options.dynamics:
        backend = load_default(name)
        backend.explain(scenes[0].states).rollout([Remove(0)])  # compiles
        pairs, seconds = [], []
        for scene in scenes:
            start = time.process_time()
            prediction = backend.explain(states_from_tracks(scene.tracks)).prediction
            seconds.append(time.process_time() - start)
            found = [e for e in prediction.observed.collisions if e.frame < prediction.n_frames]
            pairs.append((found, scene.true_collisions))
        print(f"{name}, {len(pairs)} scenes: {_text(collision_scores(pairs))}, {_errors(pairs)}")
        middle, high = np.percentile(seconds, [50, 95])
        print(f"  s CPU a scene: median {middle:.3f}, 95th percentile {high:.3f}, largest {max(seconds):.3f}")
        print("  rollouts: " + _text(rollout_errors(backend, some)))


def _text(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in values.items())


def _errors(pairs: Sequence[tuple[Sequence[Event], Sequence[Event]]]) -> str:
    both = [({e.objects for e in found}, {e.objects for e in true}) for found, true in pairs]
    missing, extra = sum(len(true - found) for found, true in both), sum(len(found - true) for found, true in both)
    return f"pairs alone: {missing} of {sum(len(true) for _, true in pairs)} missing, {extra} too many"


def score_cuts(options: Namespace) -> None:
    """Print how good the probabilities of collisions after a cut are, for each combination of settings."""
    backend = load_default()
    settings: dict[str, list[float]] = {}
    for text in options.set:
        name, value = text.split("=")
        settings.setdefault(name, []).append(float(value))
    configs = [dict(zip(settings, values, strict=True)) for values in product(*settings.values())]
    scores: list[list[Any]] = [[] for _ in configs]
    scenes = 0
    for states, last_frame, given, later in cut_videos(options):
        scenes += 1
        for config, found in zip(configs, scores, strict=True):
            backend.config = replace(backend.config, **config)
            probability = backend.explain(states, given).rollout(frames=last_frame + 1).predicted_scores
            met = {e.objects for e in given}
            pairs = (pair for pair in combinations(range(len(states.objects)), 2) if pair not in met)
            found += [(pair in later, probability[pair]) for pair in pairs]
    rows = []
    for config, found in zip(configs, scores, strict=True):
        true, p = np.array(found, float).T
        p = np.clip(p, 1e-2, 1 - 1e-2)
        loss = -np.log(np.where(true > 0, p, 1 - p)).sum()
        name = ", ".join(f"{k} {v:g}" for k, v in config.items()) or "default"
        brier, wrong = ((p - true) ** 2).sum(), ((p > 0.5) != true).sum()
        rows.append((name, len(true), f"{true.sum():.0f}", f"{loss:.1f}", f"{brier:.2f}", wrong))
    print(table(("setting", "pairs", "that collide", "log loss", "Brier", "wrong"), rows))
    print(f"{scenes} scenes")


def cut_videos(options: Namespace) -> Iterator[tuple[MotionStates, int, list[Event], set[tuple[int, ...]]]]:
    """States before a cut, the video's last frame, the true collisions before the cut, and the pairs that collide after it."""
    for scene in real_scenes(options):
        cut = _cut_of(scene)
        if cut:
            before = [e for e in scene.true_collisions if e.frame < cut]
            after = {e.objects for e in scene.true_collisions if e.frame > cut}
            yield states_from_tracks(_first_part(scene.tracks, cut)), scene.tracks.n_frames - 1, before, after


def _cut_of(scene: RealScene) -> int | None:
    """Where a video is cut; None if it cannot be."""
    frames = [e.frame for e in scene.true_collisions]
    cuts = [c for c in CUTS if frames and min(frames) < c < max(frames)]
    cuts = [c for c in cuts if all(abs(f - c) >= MARGIN_FRAMES for f in frames)]
    is_known = bool(cuts) and scene.found_names == scene.true_names
    return (
        cuts[-1]
        if is_known and all((t.frame_index < cuts[-1]).sum() >= MIN_DETECTIONS for t in scene.tracks.tracks)
        else None
    )


def _first_part(video: VideoTracks, cut: int) -> VideoTracks:
    arrays = ("frame_index", "location_world", "centroid_px", "box_xyxy_px", "score")
    tracks = [replace(t, **{name: getattr(t, name)[t.frame_index < cut] for name in arrays}) for t in video.tracks]
    return VideoTracks(cut, tuple(tracks))


def main() -> None:
    parser = parser_of(__doc__)
    add_real_scenes(parser)
    parser.add_argument("--rollouts", type=int, default=60, help="scenes whose rollouts are measured")
    parser.add_argument("--dynamics", nargs="+", default=["physics", "propnet"], help="backends, or their YAML files")
    parser.add_argument("--cut", action="store_true", help="score probabilities of collisions after a cut")
    parser.add_argument("--set", action="append", default=[], help="with --cut, a field of PhysicsConfig and a number")
    options = parser.parse_args()
    (score_cuts if options.cut else compare)(options)


if __name__ == "__main__":
    main()

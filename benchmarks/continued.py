"""How sure the physics backend is, and how sure it should be: real videos are cut, and it predicts what follows.

`python benchmarks/continued.py --proposals FILE.npz --truth FILE.json.gz [--every 5] [--scenes N] [--set NAME=VALUE]`
fits each video up to the last of `CUTS` that has collisions before and after it, continues it to its end, and scores the
probabilities of the pairs that had not met: log loss, Brier score, and wrong decisions. Several `--set` of one name are
compared, such as `--set yaw_noise=0.1 --set yaw_noise=0.2`. `--every 5` keeps the scenes whose index 5 divides: those of
`train` that nothing was trained on. The collisions before the cut are the true ones.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np

from nsdr import track
from nsdr.clevrer.files.annotations import read_truth
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.scenes import scene_from_ground_truth
from nsdr.dynamics.registry import load_backend
from nsdr.io.checkpoint import find_checkpoint
from nsdr.types import Event, VideoTracks

CUTS = (50, 70, 90)
"""Frames at which videos are cut."""
MARGIN_FRAMES = 3
"""Collisions keep this distance from the cut."""
MIN_DETECTIONS = 4
"""Detections that every object must have before the cut."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--proposals", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=10**6)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], help="a field of PhysicsConfig and a number")
    options = parser.parse_args()
    backend: Any = load_backend(find_checkpoint("default"), "physics")
    settings: dict[str, list[float]] = {}
    for text in options.set:
        name, value = text.split("=")
        settings.setdefault(name, []).append(float(value))
    configs = [dict(zip(settings, values, strict=True)) for values in product(*settings.values())]
    scores: list[list[Any]] = [[] for _ in configs]
    scenes = 0
    for tracks, last_frame, given, future in cut_videos(options):
        scenes += 1
        for config, found in zip(configs, scores, strict=True):
            backend.config = replace(backend.config, **config)
            backend.horizon_frame = last_frame
            rollout = backend.predict(tracks, given).observed
            met = {e.objects for e in given}
            for pair in combinations(range(len(tracks.tracks)), 2):
                if pair not in met:
                    found.append((pair in future, rollout.unseen_scores[pair]))
    print("| setting | pairs | that collide | log loss | Brier | wrong |\n|---|---|---|---|---|---|")
    for config, found in zip(configs, scores, strict=True):
        true, p = np.array(found, float).T
        p = np.clip(p, 1e-2, 1 - 1e-2)
        loss = -np.log(np.where(true > 0, p, 1 - p))
        named = ", ".join(f"{k} {v:g}" for k, v in config.items()) or "default"
        figures = f"{loss.sum():.1f} | {((p - true) ** 2).sum():.2f} | {((p > 0.5) != true).sum()}"
        print(f"| {named} | {len(true)} | {true.sum():.0f} | {figures} |")
    print(f"{scenes} scenes")


def cut_videos(options: argparse.Namespace) -> Iterator[tuple[VideoTracks, int, list[Event], set[tuple[int, ...]]]]:
    """Tracks up to a cut, the video's last frame, the true collisions before it, and the pairs that collide after it."""
    truth, count = read_truth(options.truth), 0
    for index, proposals in read_compact_proposals(options.proposals):
        if index % options.every:
            continue
        scene = scene_from_ground_truth(truth[index], truth[index]["n_frames"])
        collisions = [e for e in scene.events if e.kind == "collision"]
        frames = [e.frame for e in collisions]
        cuts = [c for c in CUTS if frames and min(frames) < c < max(frames)]
        cuts = [c for c in cuts if all(abs(f - c) >= MARGIN_FRAMES for f in frames)]
        if not cuts:
            continue
        video, cut = track(proposals), cuts[-1]
        ids = {t.object.name: i for i, t in enumerate(video.tracks)}
        if ids.keys() != {o.name for o in scene.objects}:
            continue
        if any((t.frame_index < cut).sum() < MIN_DETECTIONS for t in video.tracks):
            continue
        number = [ids[o.name] for o in scene.objects]
        pairs = {e: tuple(sorted(number[i] for i in e.objects)) for e in collisions}
        given = [Event("collision", e.frame, pair) for e, pair in pairs.items() if e.frame < cut]
        yield cut_tracks(video, cut), video.n_frames - 1, given, {pair for e, pair in pairs.items() if e.frame > cut}
        count += 1
        if count == options.scenes:
            return


def cut_tracks(video: VideoTracks, cut: int) -> VideoTracks:
    """The tracks before a frame."""
    tracks, arrays = [], ("frame_index", "location_world", "centroid_px", "box_xyxy_px", "score")
    for t in video.tracks:
        before = t.frame_index < cut
        tracks.append(replace(t, **{name: getattr(t, name)[before] for name in arrays}))
    return VideoTracks(cut, tuple(tracks))


if __name__ == "__main__":
    main()

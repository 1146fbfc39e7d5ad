"""Observed collisions one by one: what is missed and why, how probabilities are calibrated, and the weights of the evidence.

`python benchmarks/collisions.py --proposals FILE.npz --truth FILE.json.gz [--every 5] [--scenes N]` lists the
missed and the false collisions of the physics backend; `--weights` fits those of `CollisionEvidence`. `--every 5` keeps the
scenes whose index 5 divides: those of `train` that the collision network was not trained on.
"""

import argparse
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from nsdr import Event, track
from nsdr.clevrer.files.annotations import read_truth
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.scenes import scene_from_ground_truth
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.dynamics.physics.collision_search import CollisionEvidence, CollisionSearch, search_collisions
from nsdr.dynamics.registry import load_backend
from nsdr.evaluation.measures import wilson_interval
from nsdr.io.checkpoint import find_checkpoint

AROUND_FRAMES = 15
"""Frames on each side of a collision in which the hidden share is measured."""
BINS = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Bounds of the bins of probabilities."""
TOLERANCE_FRAMES = 3
RIDGE = 0.05
"""Weight decay of the logistic regression, of inputs in `SCALES`."""
SCALES = (1.0, 1.0, 0.05)
"""Units of the constant and the numbers of `CollisionEvidence` in the regression."""
FOLDS = 5


@dataclass(frozen=True)
class Video:
    """One video: tracks as states, candidates with their probabilities, and frames of true collisions by pairs of tracks.

    `lost` is the number of true collisions with an object that has no track; `missing` and `spurious` are objects.
    """

    index: int
    states: MotionStates
    candidates: list[Any]
    true: dict[tuple[int, ...], int]
    lost: int
    missing: set[str]
    spurious: set[str]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--proposals", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=10**6)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--dynamics", default="physics", help="backend, or its YAML file")
    parser.add_argument("--checkpoint", default="default")
    parser.add_argument("--weights", action="store_true")
    options = parser.parse_args()
    backend: Any = load_backend(find_checkpoint(options.checkpoint), options.dynamics)
    videos = read_videos(options, backend)
    if options.weights:
        print_weights(videos, backend)
    else:
        print_errors(videos, backend)


def read_videos(options: argparse.Namespace, backend: Any) -> list[Video]:
    truth, videos = read_truth(options.truth), []
    for index, proposals in read_compact_proposals(options.proposals):
        if index % options.every:
            continue
        if len(videos) == options.scenes:
            break
        states = states_from_tracks(track(proposals))
        scene = scene_from_ground_truth(truth[index], truth[index]["n_frames"])
        names = {o.id: o.name for o in scene.objects}
        ids = {o.name: o.id for o in states.objects}
        true, lost = {}, 0
        for event in scene.events:
            if event.kind == "collision":
                pair = tuple(sorted(ids.get(names[i], -1) for i in event.objects))
                lost += pair[0] < 0
                if pair[0] >= 0:
                    true[pair] = event.frame
        candidates = backend.detector.collision_candidates(states)
        missing, spurious = set(names.values()) - ids.keys(), ids.keys() - set(names.values())
        videos.append(Video(index, states, candidates, true, lost, missing, spurious))
    return videos


def print_errors(videos: list[Video], backend: Any) -> None:
    """Table of errors, their numbers, and the calibration of the detector."""
    print("video pair frame error network_p searched hidden cost_with cost_without gap")
    counts = dict.fromkeys(("missing", "extra", "frame", "found", "network missing", "network extra"), 0)
    no_candidate, off = 0, Counter[int]()
    for video in videos:
        config = backend.config
        search = CollisionSearch(video.states, video.candidates, config)
        found = search_collisions(video.states, video.candidates, config)[0]
        frames = {e.objects: e.frame for e in found}
        counts["found"] += len(frames)
        probable, event_of = {e.objects for e in search.probable}, {e.objects: e for e in search.probability}
        counts["network missing"] += len(video.true.keys() - probable)
        counts["network extra"] += len(probable - video.true.keys())
        for pair in sorted(frames.keys() | video.true.keys()):
            if pair in frames and pair in video.true:
                off[frames[pair] - video.true[pair]] += 1
                counts["frame"] += abs(frames[pair] - video.true[pair]) > TOLERANCE_FRAMES
                continue
            error = "missing" if pair in video.true else "extra"
            counts[error] += 1
            no_candidate += pair not in event_of
            print(video.index, pair, _error_line(video, search, pair, event_of.get(pair), frozenset(found), error))
    true, lost = sum(len(v.true) for v in videos), sum(v.lost for v in videos)
    wrong = counts["missing"] + lost + counts["frame"], counts["extra"] + counts["frame"]
    f1 = 1 - sum(wrong) / (true + lost + counts["found"])
    print(
        f"{len(videos)} scenes, {true + lost} collisions: F1 {f1:.4f}, "
        + ", ".join(f"{k} {v}" for k, v in counts.items())
    )
    low, high = wilson_interval((counts["missing"] + lost) / (true + lost), true + lost)
    print(
        f"missing {100 * low:.2f}-{100 * high:.2f} %, {lost} of them with a lost object, {no_candidate} never near each other"
    )
    print("frames off:", ", ".join(f"{d:+d}: {k}" for d, k in sorted(off.items())))
    missing, spurious = sum(len(v.missing) for v in videos), sum(len(v.spurious) for v in videos)
    print(f"objects: {missing} missing, {spurious} too many, {sum(len(v.states.objects) for v in videos)} found")
    found_p = np.array([p for v in videos for _, p in v.candidates])
    is_true = np.array([e.objects in v.true for v in videos for e, _ in v.candidates])
    for low, high in pairwise(BINS):
        inside = (found_p > low) & (found_p <= high)
        if inside.any():
            share = is_true[inside].mean()
            print(
                f"p in ({low}, {high}]: {inside.sum()} pairs, mean p {found_p[inside].mean():.3f}, share true {share:.3f}"
            )


def _error_line(
    video: Video,
    search: CollisionSearch,
    pair: tuple[int, ...],
    found: Event | None,
    chosen: frozenset[Event],
    error: str,
) -> str:
    p, at = 0.0 if found is None else search.probability[found], video.true.get(pair, -1)
    frame = at if at >= 0 or found is None else found.frame
    near = slice(max(frame - AROUND_FRAMES, 0), frame + AROUND_FRAMES + 1)
    hidden = ",".join(f"{1 - video.states.reliable[i, near].mean():.2f}" for i in pair)
    line = f"{frame} {error} {p:.4f} {found in search.uncertain} {hidden}"
    if found is None:
        return line
    without, given = search.fitted(chosen - {found}), search.fitted(chosen | {found})
    return f"{line} {given.cost:.3f} {without.cost:.3f} {CollisionEvidence.of(pair, p, given).gap:.3f}"


def print_weights(videos: list[Video], backend: Any) -> None:
    """Logistic regression on the evidence for uncertain pairs, given the other collisions that the detector finds probable."""
    rows, labels, groups = [], [], []
    for video in videos:
        search = CollisionSearch(video.states, video.candidates, backend.config)
        for event in search.uncertain:
            e = search.evidence(event, search.probable)
            rows.append((1.0, e.network, e.gap))
            labels.append(event.objects in video.true)
            groups.append(video.index)
    x, y, fold = np.array(rows) / SCALES, np.array(labels), np.array(groups) // 5 % FOLDS
    print(f"{len(y)} uncertain pairs of {len(videos)} scenes, {y.sum()} true")
    for name, columns in {"network": x[:, :2], "network and gap": x}.items():
        z = np.zeros(len(y))
        for k in range(FOLDS):
            z[fold == k] = columns[fold == k] @ fit_logistic(columns[fold != k], y[fold != k])
        print(f"  {name}: cross-validated log loss {_log_loss(z, y):.4f}, wrong {((z > 0) != y).sum()}")
    print(f"  network alone as it is: log loss {_log_loss(x[:, 1], y):.4f}, wrong {((x[:, 1] > 0) != y).sum()}")
    for name, value in zip(("bias", "network", "gap"), fit_logistic(x, y) / SCALES, strict=True):
        print(f"{name}: {value:.3f}")


def fit_logistic(x: Any, y: Any) -> Any:
    """Weights (K,) of a logistic regression of labels (N,) on x (N, K), the first column constant."""

    def loss(weights: Any) -> float:
        return _log_loss(x @ weights, y) * len(y) + RIDGE * float((weights[1:] ** 2).sum())

    return minimize(loss, np.zeros(x.shape[1])).x


def _log_loss(log_odds: Any, y: Any) -> float:
    return float(np.logaddexp(0, np.where(y, -log_odds, log_odds)).mean())


if __name__ == "__main__":
    main()

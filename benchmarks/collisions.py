"""Observed collisions one by one: what is missed and why, how probabilities are calibrated, and the weights of the evidence.

`python -m benchmarks.collisions --proposals FILE.npz --truth FILE.json.gz [--every 5] [--scenes N]` lists the missed and the
false collisions of the physics backend; `--weights` fits those of `CollisionEvidence`. `--every 5` keeps the scenes of `train`
that the collision network was not trained on.
"""

from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.shared import RealScene, add_real_scenes, load_default, parser_of, percent, real_scenes
from nsdr import Event
from nsdr.dynamics.physics.collision_search import CollisionEvidence, CollisionSearch, search_collisions
from nsdr.types.events import SAME_EVENT_FRAMES

AROUND_FRAMES = 15
"""Frames on each side of a collision in which the hidden share is measured."""
BINS = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Bounds of the bins of probabilities."""
RIDGE = 0.05
"""Weight decay of the logistic regression, of inputs in `SCALES`."""
SCALES = (1.0, 1.0, 0.05)
"""Units of the constant and the numbers of `CollisionEvidence` in the regression."""
FOLDS = 5


@dataclass(frozen=True)
class Video:
    """A video with its candidates for collisions and their probabilities.

    Attributes:
        scene: tracks and truth.
        candidates: (collision, probability) of the network.
        true: frames of true collisions by pairs of tracks.
    """

    scene: RealScene
    candidates: list[Any]
    true: dict[tuple[int, ...], int]

    @property
    def lost(self) -> int:
        """Number of true collisions with an object that has no track."""
        return len(self.scene.true_collisions) - len(self.true)


def read_videos(options: Namespace, backend: Any) -> list[Video]:
    videos = []
    for scene in real_scenes(options):
        n = len(scene.states.objects)
        true = {e.objects: e.frame for e in scene.true_collisions if max(e.objects) < n}
        videos.append(Video(scene, backend.detector.collision_candidates(scene.states), true))
    return videos


def print_errors(videos: Sequence[Video], config: Any) -> None:
    """Print each error, their numbers, and the calibration of the network."""
    print("video pair frame error network_p searched hidden cost_with cost_without gap")
    counts = dict.fromkeys(("missing", "extra", "frame", "found", "network missing", "network extra"), 0)
    no_candidate, off = 0, Counter[int]()
    for video in videos:
        search = CollisionSearch(video.scene.states, video.candidates, config)
        found = search_collisions(video.scene.states, video.candidates, config)[0]
        frames = {e.objects: e.frame for e in found}
        probable, event_of = {e.objects for e in search.probable}, {e.objects: e for e in search.probability}
        counts["found"] += len(frames)
        counts["network missing"] += len(video.true.keys() - probable)
        counts["network extra"] += len(probable - video.true.keys())
        for pair in frames.keys() & video.true.keys():
            off[frames[pair] - video.true[pair]] += 1
            counts["frame"] += abs(frames[pair] - video.true[pair]) > SAME_EVENT_FRAMES
        for pair in sorted(frames.keys() ^ video.true.keys()):
            error = "missing" if pair in video.true else "extra"
            counts[error] += 1
            no_candidate += pair not in event_of
            print(
                video.scene.index, pair, _error_line(video, search, pair, event_of.get(pair), frozenset(found), error)
            )
    true, lost = sum(len(v.true) for v in videos), sum(v.lost for v in videos)
    wrong = counts["missing"] + lost + counts["extra"] + 2 * counts["frame"]
    numbers = ", ".join(f"{k} {v}" for k, v in counts.items())
    print(
        f"{len(videos)} scenes, {true + lost} collisions: F1 {1 - wrong / (true + lost + counts['found']):.4f}, {numbers}"
    )
    missing = percent(counts["missing"] + lost, true + lost, 2)
    print(f"missing {missing} %, {lost} of them with a lost object, {no_candidate} never near each other")
    print("frames off:", ", ".join(f"{d:+d}: {k}" for d, k in sorted(off.items())))
    names = [(v.scene.found_names, v.scene.true_names) for v in videos]
    missing, spurious = sum(len(true - found) for found, true in names), sum(len(found - true) for found, true in names)
    print(f"objects: {missing} missing, {spurious} too many, {sum(len(found) for found, _ in names)} found")
    p = np.array([p for v in videos for _, p in v.candidates])
    is_true = np.array([e.objects in v.true for v in videos for e, _ in v.candidates])
    for low, high in pairwise(BINS):
        inside = (p > low) & (p <= high)
        if inside.any():
            share = f"mean p {p[inside].mean():.3f}, share true {is_true[inside].mean():.3f}"
            print(f"p in ({low}, {high}]: {inside.sum()} pairs, {share}")


def _error_line(
    video: Video, search: CollisionSearch, pair: Any, candidate: Event | None, chosen: frozenset[Event], error: str
) -> str:
    p, at = 0.0 if candidate is None else search.probability[candidate], video.true.get(pair, -1)
    frame = at if at >= 0 or candidate is None else candidate.frame
    near = slice(max(frame - AROUND_FRAMES, 0), frame + AROUND_FRAMES + 1)
    hidden = ",".join(f"{1 - video.scene.states.reliable[i, near].mean():.2f}" for i in pair)
    line = f"{frame} {error} {p:.4f} {candidate in search.uncertain} {hidden}"
    if candidate is None:
        return line
    without, given = search.fitted(chosen - {candidate}), search.fitted(chosen | {candidate})
    return f"{line} {given.cost:.3f} {without.cost:.3f} {CollisionEvidence.of(pair, p, given, 1.0).gap:.3f}"


def print_weights(videos: Sequence[Video], config: Any) -> None:
    """Logistic regression on the evidence for uncertain pairs, given the other collisions that the network finds probable."""
    rows, labels, groups = [], [], []
    for video in videos:
        search = CollisionSearch(video.scene.states, video.candidates, config)
        for event in search.uncertain:
            e = search.evidence(event, search.probable)
            rows.append((1.0, e.network, e.gap))
            labels.append(event.objects in video.true)
            groups.append(video.scene.index)
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
    """Weights (K,) of a logistic regression of labels (N,) on x (N, K), whose first column is constant."""

    def loss(weights: Any) -> float:
        return _log_loss(x @ weights, y) * len(y) + RIDGE * float((weights[1:] ** 2).sum())

    return minimize(loss, np.zeros(x.shape[1])).x


def _log_loss(log_odds: Any, y: Any) -> float:
    return float(np.logaddexp(0, np.where(y, -log_odds, log_odds)).mean())


def main() -> None:
    parser = parser_of(__doc__)
    add_real_scenes(parser)
    parser.add_argument("--weights", action="store_true", help="fit the weights of the evidence instead")
    options = parser.parse_args()
    backend = load_default()
    (print_weights if options.weights else print_errors)(read_videos(options, backend), backend.config)


if __name__ == "__main__":
    main()

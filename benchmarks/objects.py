"""Objects, entrances and exits against the truth: which are missing, too many, or at another frame.

`python benchmarks/objects.py --proposals FILE.npz --truth FILE.json.gz [--every 5] [--first 0]` prints the counts, the
histogram of frame errors, and every case that is off by more than two frames. `--every 5` keeps the scenes whose index 5
divides: those of `train` that the collision network was not trained on; `--first 1` those whose remainder is 1. `--shifts`
prints the constants of `nsdr.dynamics.track_smoothing` instead.
"""

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nsdr import track
from nsdr.clevrer.files.annotations import read_truth
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.scenes import enter_exit_events, scene_from_ground_truth
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.dynamics.physics.collision_search import search_collisions
from nsdr.dynamics.registry import load_backend
from nsdr.dynamics.track_smoothing import SmoothedTracks, border_depths, smooth_tracks
from nsdr.evaluation.measures import wilson_interval
from nsdr.io.checkpoint import find_checkpoint
from nsdr.types import Scene

LISTED_FRAMES = 2
"""Errors of more frames are listed."""
LATE_FRAMES = 4
"""Objects that are seen in up to so many frames, the last ones, are counted by that number."""
BORDERS = ("left", "top", "right", "bottom")


@dataclass(frozen=True)
class Video:
    """One video as tracked and smoothed, and its truth."""

    index: int
    states: MotionStates
    smoothed: SmoothedTracks
    truth: Scene


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--proposals", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=10**6)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--checkpoint", default="default")
    parser.add_argument("--shifts", action="store_true")
    options = parser.parse_args()
    videos = read_videos(options)
    if options.shifts:
        print_shifts(videos)
    else:
        print_errors(videos)


def read_videos(options: argparse.Namespace) -> Iterator[Video]:
    backend: Any = load_backend(find_checkpoint(options.checkpoint), "physics")
    truth, n = read_truth(options.truth), 0
    for index, proposals in read_compact_proposals(options.proposals):
        if index % options.every != options.first or n == options.scenes:
            continue
        n += 1
        states = states_from_tracks(track(proposals))
        candidates = backend.detector.collision_candidates(states)
        found = search_collisions(states, candidates, backend.config)[0]
        smoothed = smooth_tracks(states, found)
        yield Video(index, states, smoothed, scene_from_ground_truth(truth[index], truth[index]["n_frames"]))


def print_errors(videos: Iterator[Video]) -> None:
    """Counts of objects, entrances and exits, and the cases that are wrong."""
    objects: Counter[str] = Counter()
    late: Counter[tuple[bool, int, bool]] = Counter()
    errors: dict[str, Counter[int]] = {"in": Counter(), "out": Counter()}
    without: dict[str, Counter[str]] = {"in": Counter(), "out": Counter()}
    scenes = 0
    for video in videos:
        scenes += 1
        found, true = {o.name for o in video.states.objects}, {o.name for o in video.truth.objects}
        for one, detected in zip(video.states.objects, video.states.detected, strict=True):
            n = int(detected.sum())
            if n <= LATE_FRAMES and detected[-n:].all():
                late[one.shape == "sphere", n, one.name in true] += 1
        objects.update(found=len(found), true=len(true), missing=len(true - found), extra=len(found - true))
        for what, names in (("missing", true - found), ("too many", found - true)):
            for name in sorted(names):
                print(video.index, name, what)
        for (name, kind), ours, theirs in frames_of_events(video):
            for a, b in pairs(ours, theirs):
                if a is not None and b is not None:
                    errors[kind][a - b] += 1
                else:
                    lost = name not in found & true
                    without[kind]["with its object" if lost else "missing" if a is None else "too many"] += 1
                if a is None or b is None or abs(a - b) > LISTED_FRAMES:
                    print(video.index, name, kind, f"found {a}, true {b}")
    print(f"{scenes} scenes")
    for what, total in (("missing", "true"), ("extra", "found")):
        print(f"objects {what}: {shown(objects[what], objects[total])}")
    for is_sphere, kind in ((True, "spheres"), (False, "others")):
        for n in range(1, LATE_FRAMES + 1):
            right, wrong = late[is_sphere, n, True], late[is_sphere, n, False]
            print(f"{kind} seen in the last {n} frames only: {right} right, {wrong} too many")
    for kind, title in (("in", "entrances"), ("out", "exits")):
        matched = errors[kind].total()
        near = sum(errors[kind][d] for d in (-1, 0, 1))
        exact, within = shown(errors[kind][0], matched), shown(near, matched)
        print(f"{title}: exact {exact}, within one frame {within}, {dict(without[kind])}")
        print("  errors (frames):", ", ".join(f"{d:+d}: {k}" for d, k in sorted(errors[kind].items())))


def frames_of_events(video: Video) -> Iterator[tuple[tuple[str, str], list[int], list[int]]]:
    """For each object and kind of event: our frames and the true ones."""
    frames: dict[tuple[str, str], tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    for side, objects, events in (
        (0, video.states.objects, enter_exit_events(video.smoothed.visible)),
        (1, video.truth.objects, [e for e in video.truth.events if e.kind != "collision"]),
    ):
        for event in events:
            frames[objects[event.objects[0]].name, event.kind][side].append(event.frame)
    for key, (ours, theirs) in sorted(frames.items()):
        yield key, ours, theirs


def pairs(ours: list[int], theirs: list[int]) -> Iterator[tuple[int | None, int | None]]:
    """Nearest frames of the two lists, in pairs; those left over with None."""
    ours, theirs = list(ours), list(theirs)
    while ours and theirs:
        _, a, b = min((abs(a - b), a, b) for a in ours for b in theirs)
        ours.remove(a)
        theirs.remove(b)
        yield a, b
    yield from ((a, None) for a in ours)
    yield from ((None, b) for b in theirs)


def shown(count: int, total: int) -> str:
    low, high = wilson_interval(count / total, total) if total else (0.0, 1.0)
    return f"{count} of {total} ({100 * low:.2f}-{100 * high:.2f} %)"


def print_shifts(videos: Iterator[Video]) -> None:
    """Median, by border and shape, of what must be added to the depths so that objects cross at the true frame."""
    needed: dict[tuple[str, str], list[float]] = defaultdict(list)
    for video in videos:
        states, numbers = video.states, {o.name: o.id for o in video.states.objects}
        for event in video.truth.events:
            i = numbers.get(video.truth.objects[event.objects[0]].name)
            if event.kind == "collision" or i is None or not states.detected[i].any():
                continue
            seen, shape = np.flatnonzero(states.detected[i]), states.objects[i].shape
            end, around = int(seen[0 if event.kind == "in" else -1]), np.array([event.frame - 1, event.frame])
            location = video.smoothed.location_world[i]
            middle = border_depths(shape, location, around, states.detected[i], end, states.box_xyxy_px[i]).mean(0)
            if np.isfinite(middle).all():
                nearest = int(np.abs(middle).argmin())
                needed[BORDERS[nearest], shape].append(-float(middle[nearest]))
    for (border, shape), shifts in sorted(needed.items()):
        low, median, high = np.quantile(shifts, [0.25, 0.5, 0.75])
        print(f"{border} {shape}: {len(shifts)} crossings, shift {median:.2f} px, quartiles {low:.2f} and {high:.2f}")
    for border in BORDERS:
        print(
            f"{border}: {np.median([s for key, values in needed.items() if key[0] == border for s in values]):.2f} px"
        )


if __name__ == "__main__":
    main()

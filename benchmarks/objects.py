"""Objects, entrances, exits and positions against the truth: which are missing, too many, or elsewhere.

    python -m benchmarks.objects --proposals FILE.npz --truth FILE.json.gz [--every 5] [--first 0] [--shifts]
    python -m benchmarks.objects --videos CLEVRER_FOLDER

The first command prints the counts, the histogram of frame errors, every case that is off by more than two frames, and how
much the sizes of objects differ from what is expected at their places. `--every 5` keeps the scenes of `train` that the
collision network was not trained on. `--shifts` prints the constants of `nsdr.dynamics.track_smoothing` instead.

The second command perceives the videos of a folder of `video_N.mp4` and `annotation_N.json` with the default pipeline, and
compares objects, collisions and positions on the ground with the annotations.
"""

import sys
from argparse import Namespace
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.shared import (
    RealScene,
    add_real_scenes,
    collision_frames,
    load_default,
    parser_of,
    percent,
    real_scenes,
)
from nsdr import Pipeline, Scene, VideoTracks
from nsdr.clevrer.files.annotations import read_annotation
from nsdr.clevrer.files.scenes import scene_from_annotation
from nsdr.dynamics.physics.collision_search import search_collisions
from nsdr.dynamics.track_smoothing import SmoothedTracks, border_depths, smooth_tracks
from nsdr.io.files import find_files
from nsdr.tracking.localization import MAX_RATIO, TYPICAL_RATIO, size_ratio
from nsdr.types.events import SAME_EVENT_FRAMES, enter_exit_events

LISTED_FRAMES = 2
"""Errors of more frames are listed."""
LATE_FRAMES = 4
"""Objects that are seen in up to so many frames, the last ones, are counted by that number."""
BORDERS = ("left", "top", "right", "bottom")
Video = tuple[RealScene, SmoothedTracks]


def smoothed_scenes(options: Namespace) -> Iterator[Video]:
    backend = load_default()
    for scene in real_scenes(options):
        candidates = backend.detector.collision_candidates(scene.states)
        found = search_collisions(scene.states, candidates, backend.config)[0]
        yield scene, smooth_tracks(scene.states, found)


def print_errors(videos: Iterator[Video]) -> None:
    """Print counts of objects, entrances and exits, and the cases that are wrong."""
    objects: Counter[str] = Counter()
    late: Counter[tuple[bool, int, bool]] = Counter()
    errors: dict[str, Counter[int]] = {"in": Counter(), "out": Counter()}
    without: dict[str, Counter[str]] = {"in": Counter(), "out": Counter()}
    sizes = []
    for scene, smoothed in videos:
        found, true, states = scene.found_names, scene.true_names, scene.states
        sizes.append(size_ratio(scene.tracks))
        for one, detected in zip(states.objects, states.detected, strict=True):
            n = int(detected.sum())
            if n <= LATE_FRAMES and detected[-n:].all():
                late[one.shape == "sphere", n, one.name in true] += 1
        objects.update(found=len(found), true=len(true), missing=len(true - found), extra=len(found - true))
        for what, names in (("missing", true - found), ("too many", found - true)):
            for name in sorted(names):
                print(scene.index, name, what)
        for (name, kind), ours, theirs in event_frames(scene, smoothed):
            for a, b in nearest(ours, theirs):
                if a is not None and b is not None:
                    errors[kind][a - b] += 1
                else:
                    is_lost = name not in found & true
                    without[kind]["with its object" if is_lost else "missing" if a is None else "too many"] += 1
                if a is None or b is None or abs(a - b) > LISTED_FRAMES:
                    print(scene.index, name, kind, f"found {a}, true {b}")
    print(f"{len(sizes)} scenes")
    for what, total in (("missing", "true"), ("extra", "found")):
        print(f"objects {what}: {shown(objects[what], objects[total])}")
    for is_sphere, kind in ((True, "spheres"), (False, "others")):
        for n in range(1, LATE_FRAMES + 1):
            right, wrong = late[is_sphere, n, True], late[is_sphere, n, False]
            print(f"{kind} seen in the last {n} frames only: {right} right, {wrong} too many")
    for kind, title in (("in", "entrances"), ("out", "exits")):
        n = errors[kind].total()
        near = sum(errors[kind][d] for d in (-1, 0, 1))
        print(f"{title}: exact {shown(errors[kind][0], n)}, within one frame {shown(near, n)}, {dict(without[kind])}")
        print("  errors (frames):", ", ".join(f"{d:+d}: {k}" for d, k in sorted(errors[kind].items())))
    ratios = np.array([ratio for ratio in sizes if ratio is not None])
    deviation = np.exp(np.abs(np.log(ratios / TYPICAL_RATIO)).max(1))
    print(
        f"sizes relative to those expected at their places, {len(ratios)} videos: median {np.median(ratios, 0).round(3)}"
    )
    print(f"  largest deviation {deviation.max():.3f}; above {MAX_RATIO}: {(deviation > MAX_RATIO).sum()}")


def event_frames(scene: RealScene, smoothed: SmoothedTracks) -> Iterator[tuple[tuple[str, str], list[int], list[int]]]:
    """For each object and kind of event: our frames and the true ones."""
    frames: dict[tuple[str, str], tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    true = [e for e in scene.truth.events if e.kind != "collision"]
    sides = (scene.states.objects, enter_exit_events(smoothed.visible)), (scene.truth.objects, true)
    for side, (objects, events) in enumerate(sides):
        for event in events:
            frames[objects[event.objects[0]].name, event.kind][side].append(event.frame)
    for key, (ours, theirs) in sorted(frames.items()):
        yield key, ours, theirs


def nearest(ours: list[int], theirs: list[int]) -> Iterator[tuple[int | None, int | None]]:
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
    return f"{count} of {total}, {percent(count, total, 2)} %"


def print_shifts(videos: Iterator[Video]) -> None:
    """Median, by border and shape, of what must be added to the depths so that objects cross at the true frame."""
    needed: dict[tuple[str, str], list[float]] = defaultdict(list)
    for scene, smoothed in videos:
        states, numbers = scene.states, {o.name: o.id for o in scene.states.objects}
        for event in scene.truth.events:
            i = numbers.get(scene.truth.objects[event.objects[0]].name)
            if event.kind == "collision" or i is None or not states.detected[i].any():
                continue
            seen, shape = np.flatnonzero(states.detected[i]), states.objects[i].shape
            end, around = int(seen[0 if event.kind == "in" else -1]), np.array([event.frame - 1, event.frame])
            location = smoothed.location_world[i]
            solid, seen_in = states.world.vocabulary.shape(shape), states.detected[i]
            middle = border_depths(solid, location, around, seen_in, end, states.box_xyxy_px[i], states.camera).mean(0)
            if np.isfinite(middle).all():
                border = int(np.abs(middle).argmin())
                needed[BORDERS[border], shape].append(-float(middle[border]))
    for (border, shape), shifts in sorted(needed.items()):
        low, median, high = np.quantile(shifts, [0.25, 0.5, 0.75])
        print(f"{border} {shape}: {len(shifts)} crossings, shift {median:.2f} px, quartiles {low:.2f} and {high:.2f}")
    for border in BORDERS:
        shifts = [s for key, values in needed.items() if key[0] == border for s in values]
        print(f"{border}: {np.median(shifts) if shifts else np.nan:.2f} px")


def perceive(folder: Path) -> None:
    """Print how many objects and collisions the pipeline finds in videos, and the errors of positions."""
    pipeline, counts, errors = Pipeline.from_pretrained(), Counter[str](), defaultdict[str, list[float]](list)
    for path in find_files(folder, "annotation_*.json"):
        annotation = read_annotation(path)
        videos = find_files(folder, f"video_{annotation['scene_index']:05d}.mp4")
        if not videos:
            continue
        true, perception = scene_from_annotation(annotation), pipeline.perceive(videos[0])
        names, found = {o.name for o in true.objects}, {o.name for o in perception.scene.objects}
        hits, found_hits = collision_frames(true), collision_frames(perception.scene)
        same = sum(abs(found_hits.get(pair, -100) - frame) <= SAME_EVENT_FRAMES for pair, frame in hits.items())
        counts.update({"videos": 1, "objects": len(names), "objects found": len(names & found)})
        counts.update({"objects too many": len(found - names), "collisions": len(hits), "collisions found": same})
        counts["collisions too many"] += len(found_hits.keys() - hits.keys())
        assert perception.tracks is not None
        for shape, distances in position_errors(perception.tracks, annotation["motion_trajectory"], true):
            errors[shape] += distances
    print(", ".join(f"{name}: {count}" for name, count in counts.items()))
    for shape, distances in sorted(errors.items()):
        median, high = np.percentile(distances, [50, 95])
        print(f"positions of {shape}s: median error {median:.3f}, 95th percentile {high:.3f} world units")


def position_errors(tracks: VideoTracks, frames: list, true: Scene) -> Iterator[tuple[str, list[float]]]:
    """Shape, and distances from the true positions (world units), of every track whose object is really there."""
    ids = {o.name: o.id for o in true.objects}
    for t in (t for t in tracks.tracks if t.object.name in ids):
        rows = ({o["object_id"]: o["location"] for o in frames[f]["objects"]} for f in t.frame_index)
        places = np.array([row[ids[t.object.name]][:2] for row in rows])
        yield t.object.shape, np.linalg.norm(t.location_world - places, axis=1).tolist()


def main() -> None:
    parser = parser_of(__doc__)
    if "--videos" in sys.argv:
        parser.add_argument("--videos", type=Path, required=True, help="folder with videos and their annotations")
        perceive(parser.parse_args().videos)
        return
    add_real_scenes(parser)
    parser.add_argument("--shifts", action="store_true", help="print the shifts at the borders instead")
    options = parser.parse_args()
    (print_shifts if options.shifts else print_errors)(smoothed_scenes(options))


if __name__ == "__main__":
    main()

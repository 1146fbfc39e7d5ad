"""Objects, collisions and ground-plane positions against annotations.

`python benchmarks/perception.py --annotations DIR --videos DIR` looks at `video_N.mp4` of every `annotation_N.json`;
with `--proposals FILE.npz ...` it takes compact mask proposals instead and measures positions alone.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nsdr import Pipeline, Scene, VideoTracks, track
from nsdr.clevrer.files.annotations import read_annotation
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.scenes import scene_from_annotation

TOLERANCE_FRAMES = 3


def position_errors(tracks: VideoTracks, annotation: dict[str, Any], true: Scene) -> Iterator[tuple[str, np.ndarray]]:
    """(shape, distances in world units) of every track whose object is really there."""
    ids = {o.name: o.id for o in true.objects}
    for t in tracks.tracks:
        if t.object.name in ids:
            frames = [annotation["motion_trajectory"][f]["objects"] for f in t.frame_index]
            positions = [
                next(o["location"][:2] for o in rows if o["object_id"] == ids[t.object.name]) for rows in frames
            ]
            yield t.object.shape, np.linalg.norm(t.location_world - np.array(positions), axis=1)


def hits(scene: Scene) -> dict[tuple[str, ...], int]:
    """Frame of each pair's collision, by the objects' names."""
    named = [
        (tuple(sorted(scene.objects[i].name for i in e.objects)), e) for e in scene.events if e.kind == "collision"
    ]
    return {names: e.frame for names, e in named}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--annotations", type=Path, required=True)
    parser.add_argument("--videos", type=Path)
    parser.add_argument("--proposals", type=Path, nargs="*", default=[])
    options = parser.parse_args()
    annotations = {
        a["scene_index"]: a for a in map(read_annotation, sorted(options.annotations.glob("annotation_*.json")))
    }
    errors: dict[str, list[float]] = defaultdict(list)
    if options.videos:
        pipeline = Pipeline.from_pretrained()
        counts: dict[str, int] = defaultdict(int)
        for index, annotation in annotations.items():
            video = options.videos / f"video_{index:05d}.mp4"
            if not video.exists():
                continue
            true, perception = scene_from_annotation(annotation), pipeline.perceive(video)
            names, found = {o.name for o in true.objects}, {o.name for o in perception.scene.objects}
            true_hits, found_hits = hits(true), hits(perception.scene)
            counts["videos"] += 1
            counts["objects"] += len(names)
            counts["objects found"] += len(names & found)
            counts["objects too many"] += len(found - names)
            counts["collisions"] += len(true_hits)
            counts["collisions found"] += sum(
                abs(found_hits.get(pair, -100) - frame) <= TOLERANCE_FRAMES for pair, frame in true_hits.items()
            )
            counts["collisions too many"] += len(found_hits.keys() - true_hits.keys())
            assert perception.tracks is not None
            for shape, distances in position_errors(perception.tracks, annotation, true):
                errors[shape] += distances.tolist()
        print(", ".join(f"{name}: {count}" for name, count in counts.items()))
    for path in options.proposals:
        for index, proposals in read_compact_proposals(path):
            if index in annotations:
                true = scene_from_annotation(annotations[index])
                for shape, distances in position_errors(track(proposals), annotations[index], true):
                    errors[shape] += distances.tolist()
    for shape, distances in sorted(errors.items()):
        median, high = np.percentile(distances, [50, 95])
        print(f"positions of {shape}s: median error {median:.3f}, 95th percentile {high:.3f} world units")


if __name__ == "__main__":
    main()

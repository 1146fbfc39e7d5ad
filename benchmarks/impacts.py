"""How often the report says rightly who hits whom, by the two thresholds of `nsdr.visualize.event_words`.

`python benchmarks/impacts.py FOLDER [--limit N] [--dynamics NAME]`

FOLDER: a generated data set's `proposal_S.json` and `truth_S.json` (`nsdr generate dataset`). The true velocities in the frame
before the contact say who came faster towards the other one. Collisions whose true approach speeds are within a factor of two
count as unclear. Takes about 10 seconds a video.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from nsdr.clevrer.files.proposals import read_proposals
from nsdr.pipeline import Pipeline
from nsdr.types import Event, Rollout
from nsdr.visualize import event_words as impacts

TRUE_RATIO = 0.5
"""Approach speeds with a larger ratio are unclear in truth."""
SLOWEST = (0.1, 0.2, 0.4, 0.8)
RATIOS = (0.2, 0.35, 0.5, 0.65, 0.8)
FRAMES_APART = 4
"""A found collision is the true one of the same objects within so many frames."""


def true_hitter(truth: dict, pair: list[int], frame: int) -> int | None:
    """Index in the pair of the object that came clearly faster towards the other one."""
    rows = {o["object_id"]: o for o in truth["frames"][max(frame - 1, 0)]["objects"]}
    towards = np.subtract(rows[pair[1]]["location"], rows[pair[0]]["location"])[:2]
    towards = towards / np.linalg.norm(towards)
    speeds = [np.array(rows[pair[0]]["velocity"][:2]) @ towards, -np.array(rows[pair[1]]["velocity"][:2]) @ towards]
    return None if min(speeds) > TRUE_RATIO * max(speeds) else int(np.argmax(speeds))


def measured(folder: Path, limit: int, dynamics: str) -> list[tuple[int | None, Rollout, Event]]:
    """(id of the true hitter or None, rollout, event), of every collision that was found."""
    pipeline = Pipeline.from_pretrained(dynamics=dynamics)
    rows = []
    for path in sorted(folder.glob("truth_*.json"))[: limit or None]:
        truth = json.loads(path.read_text())
        perception = pipeline.perceive(proposals=read_proposals(path.with_name(path.name.replace("truth", "proposal"))))
        assert perception.dynamics is not None
        ids = {o.name: o.id for o in perception.scene.objects}
        names = {o["object_id"]: f"{o['color']} {o['material']} {o['shape']}" for o in truth["objects"]}
        for collision in truth["collisions"]:
            pair = collision["object_ids"]
            found = [
                e
                for e in perception.scene.events
                if e.kind == "collision"
                and set(e.objects) == {ids.get(names[i]) for i in pair}
                and abs(e.frame - collision["frame_id"]) <= FRAMES_APART
            ]
            if found:
                true = true_hitter(truth, pair, collision["frame_id"])
                hitting = None if true is None else ids[names[pair[true]]]
                rows.append((hitting, perception.dynamics.observed, found[0]))
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", type=int, default=0)
    parser.add_argument("--dynamics", default="physics")
    options = parser.parse_args()
    rows = measured(options.folder, options.limit, options.dynamics)
    clear = sum(true is not None for true, *_ in rows)
    print(f"{len(rows)} collisions, {clear} with a clear hitter in truth")
    print("slowest  ratio  right  wrong  said although unclear  not said")
    for slowest in SLOWEST:
        for ratio in RATIOS:
            counts = dict.fromkeys(("right", "wrong", "unclear", "unsaid"), 0)
            impacts.MIN_APPROACH_WORLD_PER_S, impacts.CLEAR_RATIO = slowest, ratio
            for true, rollout, event in rows:
                said = impacts.hitter(rollout, event)
                if said is None:
                    counts["unsaid"] += true is not None
                else:
                    counts["unclear" if true is None else "right" if said == true else "wrong"] += 1
            numbers = f"{counts['right']:>6} {counts['wrong']:>6} {counts['unclear']:>22} {counts['unsaid']:>9}"
            print(f"{slowest:>7} {ratio:>6} {numbers}")


if __name__ == "__main__":
    main()

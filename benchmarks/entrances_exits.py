"""Entrances and exits after a video and without each object: the physics backend against Bullet, on generated scenes.

`python -m benchmarks.entrances_exits [--scenes 200] [--first 561000] [-o results/entrances_exits.md]`

Predictions are made from a fit to the true tracks of the video; Bullet simulates the same start without each object. An event
is predicted if it is more probable than not, and rightly if the same object does the same at most `SAME_EVENT_FRAMES` apart
("at any frame": at all). About 5 seconds of a core a scene.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.shared import load_default, made_by, parser_of, percent, show, table
from nsdr import Event, Rollout
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.scene import borders_of
from nsdr.evaluation.measures import calibration
from nsdr.generate.physics.scene import SimulatedScene, scene_without, simulate_scene
from nsdr.generate.scene_files import truth_document
from nsdr.tracking.tracker import tracks_from_annotation
from nsdr.tracking.visibility import in_image
from nsdr.types.events import SAME_EVENT_FRAMES, enter_exit_events
from nsdr.world.camera import CLEVRER_CAMERA

AFTER, WITHOUT = "after the video", "without an object"
NAMES = {"in": "entrances", "out": "exits"}
ANY_FRAME = 10**6
LOWEST = 0.005
"""Events that are less probable are not stated."""


def true_borders(scene: SimulatedScene) -> list[Event]:
    """Entrances and exits of the objects that Bullet simulated, by their ids, up to the horizon."""
    motion = scene.motion
    visible = [in_image(o.shape, motion.location_world[o.id], motion.orientation[o.id, :, 2]) for o in scene.objects]
    return enter_exit_events(np.array(visible))


def probabilities(rollout: Rollout) -> dict[Event, float]:
    """Probability of each entrance and exit of a rollout."""
    found = dict.fromkeys(borders_of(rollout), 1.0)
    found.update({u.event: u.probability for u in rollout.uncertain or () if u.event.kind != "collision"})
    return {event: p for event, p in found.items() if p >= LOWEST}


def measure(seed: int, backend: Any) -> Iterator[tuple[str, dict[Event, float], list[Event]]]:
    """After the video and without each object: probable and true entrances and exits."""
    made = simulate_scene(seed, removals=False)
    truth = truth_document(made, seed, CLEVRER_CAMERA)
    n_frames = truth["n_frames"]
    annotation = {"object_property": truth["objects"], "motion_trajectory": truth["frames"][:n_frames]}
    tracks = tracks_from_annotation(annotation)
    prediction = backend.explain(states_from_tracks(tracks)).prediction
    seen = {t.object.id for t in tracks.tracks}
    true = [e for e in true_borders(made) if e.frame >= n_frames and e.objects[0] in seen]
    found = {e: p for e, p in probabilities(prediction.observed).items() if e.frame >= n_frames}
    yield AFTER, found, true
    for removed, rollout in prediction.counterfactual.items():
        kept = [o.id for o in made.objects if o.id != removed]
        changed = [Event(e.kind, e.frame, (kept[e.objects[0]],)) for e in true_borders(scene_without(made, removed))]
        yield WITHOUT, probabilities(rollout), [e for e in changed if e.objects[0] in seen]


def is_there(event: Event, events: Sequence[Event], tolerance: float) -> bool:
    return any(
        e.kind == event.kind and e.objects == event.objects and abs(e.frame - event.frame) <= tolerance for e in events
    )


def happened(found: dict[Event, float], true: Sequence[Event]) -> list[bool]:
    """Whether each event of one kind came true at any frame: an object's second one if it truly did so twice."""
    right = []
    for event in found:
        which = sum(e.objects == event.objects and e.frame <= event.frame for e in found)
        right.append(sum(t.objects == event.objects for t in true) >= which)
    return right


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first", type=int, default=561_000, help="seed of the first scene")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    backend = load_default()
    results: dict[tuple[str, str], list[tuple[dict[Event, float], list[Event]]]] = defaultdict(list)
    for seed in tqdm(range(options.first, options.first + options.scenes), unit="scene"):
        for where, found, true in measure(seed, backend):
            for kind in NAMES:
                ours = {e: p for e, p in found.items() if e.kind == kind}
                results[where, kind].append((ours, [e for e in true if e.kind == kind]))
    rows, reliability = [], []
    for (where, kind), pairs in results.items():
        stated = [(p, event, true) for found, true in pairs for event, p in found.items()]
        told = [(event, true) for p, event, true in stated if p > 0.5]
        sought = [(event, [e for e, p in found.items() if p > 0.5]) for found, true in pairs for event in true]
        cells = [
            percent(sum(is_there(event, events, tolerance) for event, events in listed), len(listed))
            for tolerance in (SAME_EVENT_FRAMES, ANY_FRAME)
            for listed in (told, sought)
        ]
        name = f"{NAMES[kind]} {where}"
        rows.append((name, len(told), len(sought), *cells))
        if stated:
            c = calibration(
                [p for p, *_ in stated], [right for found, true in pairs for right in happened(found, true)]
            )
            reliability.append(
                (name, c["n"], f"{100 * c['ece']:.1f} %", f"{c['brier']:.3f}", c["sure"], c["sure_wrong"])
            )
    found = table(
        ("", "predicted", "true", "precision", "recall", "precision at any frame", "recall at any frame"), rows
    )
    stated_columns = ("at any frame", "statements", "calibration error", "Brier score", "sure", "sure and wrong")
    reliable = table(stated_columns, reliability)
    show(f"# Entrances and exits against Bullet\n\n{found}\n\n{reliable}\n\n{made_by()}", options.output)


if __name__ == "__main__":
    main()

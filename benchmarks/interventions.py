"""Collisions after interventions: the physics backend against Bullet, on generated scenes.

`python -m benchmarks.interventions [--scenes 200] [--first 560000] [-o results/interventions.md]`

Each scene is simulated in Bullet, and again from the frame of an intervention with the changed objects, for every kind of
intervention. Predictions are made from the true states and masses, and from a fit to the true tracks of the video. A collision
is predicted rightly if the same pair collides at most `SAME_EVENT_FRAMES` apart ("pairs": at any frame). The first collision of
each pair after the intervention counts, up to the horizon. "Nudged" is Bullet again, with every object shifted by a 400th of
its width: nobody who knows the states less precisely can expect to do better. About 7 seconds of a core a scene.
"""

import math
import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.shared import (
    Collisions,
    bullet_collisions,
    load_default,
    made_by,
    parser_of,
    planar_bodies,
    show,
    table,
)
from nsdr import Add, DataError, Event, Freeze, Move, Remove, SceneObject, SetMass, SetVelocity
from nsdr.dynamics import simulate
from nsdr.dynamics.interventions import changed_ids, with_added
from nsdr.dynamics.metrics import same_collisions
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.physics.changed_bodies import change_bodies
from nsdr.dynamics.physics.simulator import NO_CONTACT, Perturbations, simulate as simulate_bodies
from nsdr.evaluation.measures import ratio_interval
from nsdr.generate.physics.bullet import Simulator
from nsdr.generate.physics.disturbed import states_at
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.scene_files import truth_document
from nsdr.tracking.tracker import tracks_from_annotation
from nsdr.tracking.visibility import in_image
from nsdr.types.events import SAME_EVENT_FRAMES
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

COLORS, MATERIALS, SHAPES = CLEVRER.words.values()
RADIUS_WORLD = CLEVRER_WORLD.vocabulary.shapes[0].radius_world
LAST_START = 80
"""Interventions are at frame 0 to this one."""
CALM_FRAMES = 5
"""No two objects collide so soon before or after an intervention."""
FREE_WORLD = 2.9 * RADIUS_WORLD
"""Distance of placed objects from all others: cubes do not overlap at any yaw."""
AIM_DEGREES = 12.0
"""Standard deviation of headings from the direction to another object."""
NUDGE_WORLD = 0.001
"""Standard deviation of the shift of nudged objects (world units): a 400th of their width."""
RUNS = 30
"""Runs from known states, as many as the backend makes."""
END = CLEVRER_WORLD.timeline.horizon_frame(CLEVRER_WORLD.timeline.frames) + 1
ANY_FRAME = 10**6
TRIES = 200
SOURCES = ("known states", "fitted to the video", "Bullet, nudged")
Pair = tuple[list[Event], list[Event]]
"""Predicted and true collisions."""


class Draw:
    """Random interventions on a scene at a frame.

    Args:
        scene: what Bullet simulated.
        frame: of the interventions.
        rng: source of chance.
    """

    def __init__(self, scene: SimulatedScene, frame: int, rng: random.Random) -> None:
        self.scene, self.frame, self.rng = scene, frame, rng
        self.position = scene.motion.location_world[:, frame, :2]
        self.velocity = scene.motion.velocity[:, frame, :2]
        places, turns = scene.motion.location_world[:, frame, None], scene.motion.orientation[:, frame, None, 2]
        self.seen = [o.id for o in scene.objects if in_image(o.shape, places[o.id], turns[o.id]).all()]
        later = {i for c in scene.motion.contacts if c.frame > frame for i in c.bodies}
        self.active = [i for i in self.seen if i in later or np.hypot(*self.velocity[i]) > 0.5]

    def remove(self) -> list[Any]:
        return [Remove(self._active())]

    def mass(self) -> list[Any]:
        return [SetMass(self._active(), self.rng.choice([0.5, 2.0]))]

    def freeze(self) -> list[Any]:
        return [Freeze(self._active())]

    def velocity_of(self) -> list[Any]:
        i = self._active()
        if np.hypot(*self.velocity[i]) > 0.5 and self.rng.random() < 0.5:
            return [SetVelocity(i, factor=self.rng.choice([0.0, 0.5, 1.5, -1.0]))]
        speed, direction = self._aimed(self.position[i], i)
        return [SetVelocity(i, speed=speed, direction=direction)]

    def move(self) -> list[Any]:
        i = self._active()
        for _ in range(TRIES):
            dx, dy = (self.rng.uniform(-0.6, 0.6) for _ in range(2))
            if self._is_free(self.position[i] + (dx, dy), i):
                return [Move(i, dx=dx, dy=dy)]
        raise LookupError

    def add(self) -> list[Any]:
        names = {o.name for o in self.scene.objects}
        for _ in range(TRIES):
            words = tuple(self.rng.choice(known) for known in (COLORS, MATERIALS, SHAPES))
            angle, distance = self.rng.uniform(0, 2 * math.pi), self.rng.uniform(0.0, 3.0)
            x, y = distance * math.cos(angle), distance * math.sin(angle)
            if " ".join(words) in names or not self._is_free(np.array([x, y]), -1):
                continue
            speed, direction = self._aimed(np.array([x, y]), -1)
            speed = 0.0 if self.rng.random() < 0.3 else speed
            vx, vy = speed * math.cos(math.radians(direction)), speed * math.sin(math.radians(direction))
            yaw = self.rng.uniform(0, math.pi / 2) if words[2] == "cube" else 0.0
            return [Add(*words, x, y, vx, vy, yaw)]
        raise LookupError

    def several(self) -> list[Any]:
        for _ in range(TRIES):
            first, second = self.rng.sample([self.remove, self.mass, self.freeze, self.velocity_of, self.add], 2)
            changes = [*first(), *second()]
            named = [c.object for c in changes if not isinstance(c, Add)]
            if len(set(named)) == len(named):
                return changes
        raise LookupError

    def _active(self) -> int:
        """An object in the image that moves or will collide."""
        if not self.active:
            raise LookupError
        return self.rng.choice(self.active)

    def _aimed(self, start: Any, i: int) -> tuple[float, float]:
        """A speed, and a direction (degrees) near that to another object in the image."""
        others = [j for j in self.seen if j != i]
        if not others:
            raise LookupError
        dx, dy = self.position[self.rng.choice(others)] - start
        return self.rng.uniform(1.0, 3.0), math.degrees(math.atan2(dy, dx)) + self.rng.gauss(0, AIM_DEGREES)

    def _is_free(self, place: Any, i: int) -> bool:
        return all(np.hypot(*(p - place)) > FREE_WORLD for j, p in enumerate(self.position) if j != i)


KINDS: dict[str, Callable[[Draw], list[Any]]] = {
    "Remove": Draw.remove,
    "SetMass": Draw.mass,
    "SetVelocity": Draw.velocity_of,
    "Move": Draw.move,
    "Freeze": Draw.freeze,
    "Add": Draw.add,
    "two at once": Draw.several,
}


def draw_changes(scene: SimulatedScene, seed: int) -> Iterator[tuple[str, int, list[Any]]]:
    """For each kind: its name, a frame, and interventions at this frame."""
    rng = random.Random(f"interventions {seed}")
    hits = [c.frame for c in scene.motion.contacts]
    calm = [f for f in range(1, LAST_START + 1) if all(abs(f - hit) > CALM_FRAMES for hit in hits)]
    for kind, draw in KINDS.items():
        for _ in range(TRIES):
            frame = 0 if rng.random() < 0.5 else rng.choice(calm)
            try:
                changes = draw(Draw(scene, frame, rng))
            except LookupError:
                continue
            yield kind, frame, changes
            break


def by_bullet(
    objects: Sequence[SceneObject], states: np.ndarray, changes: list[Any], frame: int, simulator: Simulator
) -> list[Event]:
    """What Bullet finds after interventions on objects in the states of `states_at`."""
    shapes, rows = {o.id: o.shape for o in with_added(objects, changes)}, dict(enumerate(states.copy()))
    for i, change in zip(changed_ids(changes, objects), changes, strict=True):
        if isinstance(change, Remove):
            del rows[i], shapes[i]
        elif isinstance(change, Add):
            turn = (math.pi / 2 if change.shape == "cylinder" else 0.0, 0.0, change.yaw)
            place, velocity = (change.x, change.y, RADIUS_WORLD), (change.vx, change.vy, 0.0)
            rows[i] = np.array([*place, *turn, *velocity, 0.0, 0.0, 0.0, change.mass])
        elif isinstance(change, SetMass):
            rows[i][12] *= change.factor
        elif isinstance(change, Move):
            rows[i][:2] += change.dx, change.dy
        elif isinstance(change, Freeze):  # bodies without mass are fixed in Bullet
            rows[i][6:] = 0.0
        elif change.factor is not None:
            rows[i][6:9] *= change.factor
        else:
            angle = math.radians(change.direction)
            rows[i][6:9] = change.speed * math.cos(angle), change.speed * math.sin(angle), 0.0
    return first_of_pairs(bullet_collisions(shapes, np.array(list(rows.values())), frame, END, simulator))


def first_of_pairs(rows: Collisions) -> list[Event]:
    """The first collision of each pair."""
    first: dict[tuple[int, int], int] = {}
    for i, j, frame in sorted(rows, key=lambda row: row[2]):
        first.setdefault((i, j), frame)
    return [Event("collision", frame, pair) for pair, frame in first.items()]


def from_known_states(
    objects: Sequence[SceneObject], states: np.ndarray, changes: list[Any], frame: int
) -> list[Event]:
    """What the backend's simulator finds from the true states, in most of `RUNS` runs that are nudged a little."""
    changed = change_bodies(planar_bodies([o.shape for o in objects], states), objects, changes, CLEVRER_WORLD)
    n, rng = len(changed.exists), np.random.default_rng(0)
    nudges = np.zeros((RUNS - 1, n, 1, 6))
    nudges[..., 0, :2] = NUDGE_WORLD * rng.normal(size=(RUNS - 1, n, 2))
    runs = Perturbations(nudges, np.ones((RUNS - 1, n)))
    frames = simulate_bodies(changed.bodies, changed.exists, END, start=frame, perturbations=runs).contacts
    hit = frames != NO_CONTACT
    pairs = np.argwhere(np.triu(hit.mean(0) > 0.5, 1)).tolist()
    return [Event("collision", int(np.median(frames[hit[:, i, j], i, j])), (i, j)) for i, j in pairs]


def measure(seed: int, backend: Any, simulator: Simulator) -> Iterator[tuple[str, dict[str, Pair], bool]]:
    """Kind, collisions by source, and whether the backend refused, of each intervention on a scene."""
    made = simulate_scene(seed)
    truth = truth_document(made, seed, CLEVRER_CAMERA)
    annotation = {"object_property": truth["objects"], "motion_trajectory": truth["frames"][: truth["n_frames"]]}
    explanation = backend.explain(states_from_tracks(tracks_from_annotation(annotation)))
    rng = np.random.default_rng(seed)
    for kind, frame, changes in draw_changes(made, seed):
        states = states_at(truth, frame)
        nudged = states.copy()
        nudged[:, :2] += NUDGE_WORLD * rng.normal(size=(len(states), 2))
        true = by_bullet(made.objects, states, changes, frame, simulator)
        try:
            events = simulate(explanation, changes, frame).changed.collisions
            fitted, is_refused = [[*e.objects, e.frame] for e in events if e.frame > frame], False
        except DataError:
            fitted, is_refused = [], True
        found = (
            from_known_states(made.objects, states, changes, frame),
            first_of_pairs(fitted),
            by_bullet(made.objects, nudged, changes, frame, simulator),
        )
        yield kind, {name: (events, true) for name, events in zip(SOURCES, found, strict=True)}, is_refused


def f1(pairs: Sequence[Pair], tolerance: int) -> str:
    """F1 in % with its 95 % interval, of a bootstrap over scenes."""
    right = 2.0 * np.array([same_collisions(*pair, tolerance) for pair in pairs])
    total = np.array([len(found) + len(true) for found, true in pairs], float)
    if not total.any():
        return "-"
    low, high = ratio_interval(right, total)
    return f"{100 * right.sum() / total.sum():.1f} ({100 * low:.1f}-{100 * high:.1f})"


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first", type=int, default=560_000, help="seed of the first scene")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    backend, refused = load_default(), Counter[str]()
    results: dict[str, dict[str, list[Pair]]] = {kind: {name: [] for name in SOURCES} for kind in KINDS}
    with Simulator() as simulator:
        for seed in tqdm(range(options.first, options.first + options.scenes), unit="scene"):
            for kind, of_source, is_refused in measure(seed, backend, simulator):
                refused[kind] += is_refused
                for name, pair in of_source.items():
                    results[kind][name].append(pair)
    rows = []
    for kind, by_source in results.items():
        cells = [f1(pairs, tolerance) for pairs in by_source.values() for tolerance in (SAME_EVENT_FRAMES, ANY_FRAME)]
        known = by_source[SOURCES[0]]
        rows.append((kind, len(known), sum(len(true) for _, true in known), *cells, refused[kind]))
    columns = [column for name in SOURCES for column in (name, "pairs")]
    text = table(("intervention", "scenes", "collisions", *columns, "refused"), rows)
    show(
        f"# Interventions against Bullet\n\n{text}\n\nF1 of collisions in %, with 95 % intervals. {made_by()}",
        options.output,
    )


if __name__ == "__main__":
    main()

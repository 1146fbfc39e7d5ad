"""Collisions after interventions: our simulator against Bullet, on generated scenes.

`python benchmarks/interventions.py FOLDER [--scenes 200] [--first 560000] [-o table.md]`

Each scene is simulated in Bullet, and again from the frame of an intervention with the changed objects, for every kind of
intervention. FOLDER keeps what Bullet says, one file a scene, so a second call goes on. Predictions are made anew: from the
true states and masses, and from a fit to the true tracks of the video. A collision is predicted rightly if the same pair
collides at most `TOLERANCE_FRAMES` apart ("pairs": at any frame); of each pair, the first collision after the intervention
counts, up to the horizon. "Nudged" is Bullet again, with every object shifted by a 400th of its width: nobody who knows the
states less precisely can expect to do better. About 5 seconds of a core a scene, 7 with nudging.
"""

import argparse
import gzip
import json
import math
import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from nsdr import Add, DataError, Event, Freeze, Move, Remove, SceneObject, SetMass, SetVelocity, load_backend
from nsdr.dynamics.interventions import resolve
from nsdr.dynamics.metrics import same_collisions
from nsdr.dynamics.physics.changed_bodies import change_bodies
from nsdr.dynamics.physics.simulator import NO_CONTACT, BodyStates, Perturbations, simulate
from nsdr.generate.physics.bullet import Body, Simulator
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.scene_files import truth_document
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.files import atomic_path
from nsdr.tracking.tracker import tracks_from_annotation
from nsdr.tracking.visibility import in_image
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD, VIDEO_FRAMES, horizon_frame
from nsdr.world.vocabulary import COLORS, MATERIALS, SHAPES

TOLERANCE_FRAMES = 3
"""As in `nsdr.dynamics.metrics.collision_scores`."""
LAST_START = 80
"""Interventions are at frame 0 to this one."""
CALM_FRAMES = 5
"""No two objects collide so soon before or after an intervention."""
FREE_WORLD = 2.9 * OBJECT_RADIUS_WORLD
"""Distance of placed objects from all others: cubes do not overlap at any yaw."""
AIM_DEGREES = 12.0
"""Standard deviation of headings from the direction to another object."""
NUDGE_WORLD = 0.001
"""Standard deviation of the shift of nudged objects (world units): a 400th of their width."""
RUNS = 30
"""Runs from known states, as many as the backend makes."""
ANY_FRAME = 10**6
TRIES = 200
RESAMPLES = 2000
Case = dict[str, Any]
Pair = tuple[list[Event], list[Event]]


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


def make_cases(seed: int, simulator: Simulator) -> dict[str, Any]:
    """A scene's truth, and for each kind an intervention with the collisions that Bullet finds after it."""
    scene = simulate_scene(seed)
    rng = random.Random(f"interventions {seed}")
    hits = [c.frame for c in scene.motion.contacts]
    calm = [f for f in range(1, LAST_START + 1) if all(abs(f - hit) > CALM_FRAMES for hit in hits)]
    cases = []
    for kind, draw in KINDS.items():
        for _ in range(TRIES):
            frame = 0 if rng.random() < 0.5 else rng.choice(calm)
            try:
                changes = draw(Draw(scene, frame, rng))
            except LookupError:
                continue
            case = {
                "kind": kind,
                "frame": frame,
                "changes": [{"type": type(c).__name__, **asdict(c)} for c in changes],
                "states": states_of(scene, frame).tolist(),
                "collisions": truth_after(scene, changes, frame, simulator),
            }
            cases.append(case)
            break
    truth = truth_document(scene, seed, CLEVRER_CAMERA)
    return {"seed": seed, "truth": truth, "cases": cases}


def states_of(scene: SimulatedScene, frame: int) -> Any:
    """Rows (x, y, vx, vy, yaw, spin, mass) of the objects at a frame."""
    motion = scene.motion
    flat = [motion.location_world[:, frame, :2], motion.velocity[:, frame, :2]]
    is_cube = np.array([o.shape == "cube" for o in scene.objects])
    turn = np.where(is_cube, [motion.orientation[:, frame, 2], motion.angular_velocity[:, frame, 2]], 0.0)
    return np.concatenate([*flat, turn.T, scene.mass[:, None]], 1)


def truth_after(scene: SimulatedScene, changes: list[Any], frame: int, simulator: Simulator) -> list[list[int]]:
    """Rows (i, j, frame) of the first collision of each pair that Bullet finds after interventions."""
    motion, bodies = scene.motion, []
    state = (motion.location_world, motion.orientation, motion.velocity, motion.angular_velocity)
    for o in scene.objects:
        bodies.append(Body(o.shape, *(tuple(rows[o.id, frame]) for rows in state), mass=float(scene.mass[o.id])))
    return collisions_after(bodies, scene.objects, changes, frame, simulator)


def nudged(document: dict[str, Any], case: Case, simulator: Simulator) -> list[list[int]]:
    """What Bullet finds when all objects stand `NUDGE_WORLD` aside: how far its own answers depend on nothing visible."""
    rng, states, bodies = np.random.default_rng(document["seed"]), np.array(case["states"]), []
    states[:, :2] += NUDGE_WORLD * rng.normal(size=states[:, :2].shape)
    objects = objects_of(document)
    for o, (x, y, vx, vy, yaw, spin, mass) in zip(objects, states.tolist(), strict=True):
        turn = (math.pi / 2 if o.shape == "cylinder" else 0.0, 0.0, yaw)
        bodies.append(Body(o.shape, (x, y, OBJECT_RADIUS_WORLD), turn, (vx, vy, 0.0), (0.0, 0.0, spin), mass))
    return collisions_after(bodies, objects, changes_of(case), case["frame"], simulator)


def collisions_after(
    start: Sequence[Body], objects: Sequence[SceneObject], changes: list[Any], frame: int, simulator: Simulator
) -> list[list[int]]:
    """Rows (i, j, frame) of the first collision of each pair that Bullet finds after interventions on bodies."""
    bodies = dict(enumerate(start))
    for i, change in resolve(changes, objects, np.ones((len(objects), VIDEO_FRAMES), bool), frame).of:
        if isinstance(change, Remove):
            del bodies[i]
        elif isinstance(change, Add):
            turn = (math.pi / 2 if change.shape == "cylinder" else 0.0, 0.0, change.yaw)
            place = (change.x, change.y, OBJECT_RADIUS_WORLD)
            bodies[i] = Body(change.shape, place, turn, (change.vx, change.vy, 0.0), mass=change.mass)
        else:
            bodies[i] = changed_body(bodies[i], change)
    numbers = list(bodies)
    run = simulator.run([bodies[i] for i in numbers], horizon_frame(VIDEO_FRAMES) + 1 - frame)
    found: dict[tuple[int, int], int] = {}
    for contact in run.contacts:
        i, j = sorted(numbers[k] for k in contact.bodies)
        found.setdefault((i, j), contact.frame + frame)
    return [[i, j, at] for (i, j), at in found.items()]


def changed_body(body: Body, change: Any) -> Body:
    """A body of Bullet with an intervention."""
    x, y, z = body.location_world
    if isinstance(change, SetMass):
        return replace(body, mass=body.mass * change.factor)
    if isinstance(change, Move):
        return replace(body, location_world=(x + change.dx, y + change.dy, z))
    if isinstance(change, Freeze):  # bodies without mass are fixed in Bullet
        return replace(body, velocity=(0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 0.0), mass=0.0)
    if change.factor is not None:
        vx, vy, _ = (change.factor * v for v in body.velocity)
    else:
        angle = math.radians(change.direction)
        vx, vy = change.speed * math.cos(angle), change.speed * math.sin(angle)
    return replace(body, velocity=(vx, vy, 0.0))


def changes_of(case: Case) -> list[Any]:
    """The interventions of a case."""
    kinds = {kind.__name__: kind for kind in (Remove, SetMass, SetVelocity, Move, Freeze, Add)}
    return [kinds[row["type"]](**{k: v for k, v in row.items() if k != "type"}) for row in case["changes"]]


def objects_of(document: dict[str, Any]) -> list[SceneObject]:
    """Identities of a scene."""
    return [SceneObject(o["object_id"], o["color"], o["material"], o["shape"]) for o in document["truth"]["objects"]]


def known_state(document: dict[str, Any], case: Case) -> list[Event]:
    """Collisions by our simulator from the true states and masses, in most of `RUNS` runs that are nudged a little."""
    objects, frame, states = objects_of(document), case["frame"], np.array(case["states"])
    shapes = np.array([SHAPES.index(o.shape) for o in objects])
    bodies = BodyStates(shapes, states[:, :6], states[:, 6])
    changes = resolve(changes_of(case), objects, np.ones((len(objects), VIDEO_FRAMES), bool), frame)
    changed = change_bodies(bodies, changes)
    n, rng = len(changed.exists), np.random.default_rng(0)
    nudges = np.zeros((RUNS - 1, n, 1, 6))
    nudges[..., 0, :2] = NUDGE_WORLD * rng.normal(size=(RUNS - 1, n, 2))
    runs = Perturbations(nudges, np.ones((RUNS - 1, n)))
    total = horizon_frame(VIDEO_FRAMES) + 1
    frames = simulate(changed.bodies, changed.exists, total, start=frame, perturbations=runs).contacts
    hit = frames != NO_CONTACT
    pairs = np.argwhere(np.triu(hit.mean(0) > 0.5, 1)).tolist()
    return [Event("collision", int(np.median(frames[hit[:, i, j], i, j])), (i, j)) for i, j in pairs]


def fitted_video(document: dict[str, Any], backend: Any) -> Iterator[tuple[list[Event], bool]]:
    """For each case, collisions by the backend from the video's true tracks, and whether it refused the intervention."""
    truth = document["truth"]
    annotation = {"object_property": truth["objects"], "motion_trajectory": truth["frames"][: truth["n_frames"]]}
    tracks = tracks_from_annotation(annotation)
    for case in document["cases"]:
        try:
            simulation = backend.simulate(tracks, changes_of(case), case["frame"])
        except DataError:
            yield [], True
            continue
        first: dict[tuple[int, ...], Event] = {}
        for event in simulation.changed.collisions:
            if event.frame > case["frame"]:
                first.setdefault(event.objects, event)
        yield list(first.values()), False


def events_of(rows: list[list[int]]) -> list[Event]:
    """Collisions of rows (i, j, frame)."""
    return [Event("collision", frame, (i, j)) for i, j, frame in rows]


def interval(pairs: list[Pair], tolerance: int) -> str:
    """F1 in % with its 95 % interval, of a bootstrap over scenes."""
    counts = np.array([counted(*pair, tolerance) for pair in pairs], float)

    def f1(total: Any) -> Any:
        return 200 * total[..., 0] / np.maximum(total[..., 1] + total[..., 2], 1)

    drawn = np.random.default_rng(0).multinomial(len(counts), np.full(len(counts), 1 / len(counts)), RESAMPLES)
    low, high = np.quantile(f1(drawn @ counts), [0.025, 0.975])
    return f"{f1(counts.sum(0)):.1f} ({low:.1f}-{high:.1f})"


def counted(predicted: list[Event], true: list[Event], tolerance: int) -> tuple[int, int, int]:
    """Right, predicted and true collisions."""
    return same_collisions(predicted, true, tolerance), len(predicted), len(true)


def read_scene(path: Path, seed: int, simulator: Simulator, with_nudged: bool) -> dict[str, Any]:
    """A scene's document, made where it is missing."""
    document = json.loads(gzip.decompress(path.read_bytes())) if path.exists() else make_cases(seed, simulator)
    is_new = not path.exists()
    for case in document["cases"] if with_nudged else ():
        if "nudged" not in case:
            case["nudged"], is_new = nudged(document, case, simulator), True
    if is_new:
        with atomic_path(path) as temporary:
            temporary.write_bytes(gzip.compress(json.dumps(document).encode()))
    return document


def predict(documents: Sequence[dict[str, Any]]) -> tuple[dict[tuple[str, str], list[Pair]], Counter[str]]:
    """(predicted, true) collisions by kind and source, and the number of refused interventions of each kind."""
    backend = load_backend(find_checkpoint("default"), "physics")
    results: dict[tuple[str, str], list[Pair]] = {}
    refused: Counter[str] = Counter()
    for document in documents:
        for case, (fitted, is_refused) in zip(document["cases"], fitted_video(document, backend), strict=True):
            true, kind = events_of(case["collisions"]), case["kind"]
            refused[kind] += is_refused
            results.setdefault((kind, "known"), []).append((known_state(document, case), true))
            results.setdefault((kind, "fitted"), []).append((fitted, true))
            if "nudged" in case:
                results.setdefault((kind, "nudged"), []).append((events_of(case["nudged"]), true))
    return results, refused


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first", type=int, default=560_000, help="seed of the first scene")
    parser.add_argument("--nudged", type=int, default=50, help="number of scenes that Bullet also simulates nudged")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with Simulator() as simulator:
        documents = [
            read_scene(
                options.folder / f"{options.first + k}.json.gz", options.first + k, simulator, k < options.nudged
            )
            for k in range(options.scenes)
        ]
    results, refused = predict(documents)
    columns = ["intervention", "scenes", "collisions", "known states", "pairs", "fitted to the video", "pairs"]
    columns += ["Bullet, nudged", "pairs", "refused"]
    lines = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for kind in KINDS:
        sources = [results[kind, source] for source in ("known", "fitted", "nudged") if (kind, source) in results]
        cells = [interval(rows, t) for rows in sources for t in (TOLERANCE_FRAMES, ANY_FRAME)]
        cells += ["-"] * (6 - len(cells))
        total = sum(len(true) for _, true in sources[0])
        lines.append(f"| {kind} | {len(sources[0])} | {total} | {' | '.join(cells)} | {refused[kind]} |")
    print("\n".join(lines))
    if options.output:
        options.output.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()

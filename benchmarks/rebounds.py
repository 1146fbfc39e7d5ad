"""How strongly two objects rebound: Bullet's rule for one contact, and what Bullet does in space.

`python -m benchmarks.rebounds [--world FILE] [--hits 250] [--seed 1]`

Two objects collide in Bullet, at random speeds, offsets, yaws and masses, and again in our planar simulator with every rebound
of a grid; the one that comes closest to Bullet's velocities is the rebound that Bullet had. For each pair of shapes the script
prints how Bullet's rule for one contact predicts it, the line through it (`WALLS_REBOUND` and `WALLS_SLOPE` of
`nsdr.dynamics.physics.forces` are that of all pairs with upright walls), and the errors of the velocities after the
collision. About 2 minutes of a core. `pytest -m real_data -k rebound` compares with the eight such hits of the released
annotations: errors of 0.08 world units/s, 0.17 by the rule.
"""

import random
from itertools import combinations_with_replacement

import numpy as np

from benchmarks.shared import parser_of, table
from nsdr.dynamics.physics.bodies import body_records
from nsdr.dynamics.physics.body_state import VELOCITY
from nsdr.dynamics.physics.forces import approach, drift, slow_down, speed_after
from nsdr.dynamics.physics.simulator import BodyStates, simulate
from nsdr.generate.physics.bullet import Body, Simulator
from nsdr.io.worlds import read_world
from nsdr.types import SceneObject
from nsdr.world.vocabulary import Shape
from nsdr.world.world import CLEVRER_WORLD, World

FRAMES = 36
LATER_FRAMES = 4
"""Velocities are compared so many frames after the contact."""
REBOUNDS = np.arange(-0.1, 0.72, 0.03)
FASTEST_WORLD_PER_S, SLOWEST_WORLD_PER_S = 2.9, 0.3
MIN_APPROACH_WORLD_PER_S = 0.3
LOWEST_SHARE = -1.2
"""Contacts for which the rule gives less (share of the approach speed) are slow or distant, and left out of the line."""
CLOSE_WORLD_PER_S = 0.1
"""Hits that no rebound explains better than this are left out of the line: they touched a step earlier or later."""


def hit(shapes: tuple[Shape, Shape], world: World, rng: random.Random) -> tuple[BodyStates, list[Body]]:
    """Two objects of the first material on collision course, for the planar simulator and for Bullet."""
    heading, offset, distance = rng.uniform(0, 2 * np.pi), rng.uniform(-0.3, 0.3), rng.uniform(0.55, 0.75)
    size, fastest = sum(shape.half_width_world for shape in shapes) / 0.4, world.scales.speed
    offset, distance = size * offset, size * distance
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    position = np.array([across * offset - along * distance, [0.0, 0.0]])
    second = across * rng.uniform(-1, 1) if rng.random() < 0.4 else np.zeros(2)
    velocity = fastest * np.array([along * rng.uniform(SLOWEST_WORLD_PER_S, FASTEST_WORLD_PER_S), second])
    yaw = np.array([rng.uniform(0, np.pi / 2) for _ in shapes])
    mass = np.array([rng.uniform(*world.physics.mass_range) for _ in shapes])
    words = world.vocabulary
    objects = [SceneObject(i, words.colors[0].word, words.materials[0].word, s.word) for i, s in enumerate(shapes)]
    bodies = [
        Body(
            shape.word,
            (*position[i], shape.height_world),
            (np.pi / 2 if shape.solid == "cylinder" else 0.0, 0.0, yaw[i]),
            (*velocity[i], 0.0),
            mass=mass[i],
        )
        for i, shape in enumerate(shapes)
    ]
    return BodyStates(
        body_records(objects, world), np.column_stack([position, velocity, yaw, np.zeros(2)]), mass
    ), bodies


def rule(start: BodyStates) -> float | None:
    """The separation speed that Bullet's rule for one contact wants at the first one, as a share of the approach speed."""
    state, body = start.state.copy(), start.body.copy()
    body["is_sphere"] = True  # contacts of spheres follow the rule
    for _ in range(FRAMES * body["steps_per_frame"][0]):
        for i in (0, 1):
            slow_down(start.body[i], state, i)
        gap, apart, *_ = approach(start.body, state, 0, 1)
        if gap <= body["threshold"].min() and apart < -MIN_APPROACH_WORLD_PER_S:
            return float(speed_after(body[0], body[1], gap, apart) / -apart)
        for i in (0, 1):
            drift(state, i, body["step_seconds"][0])
    return None


def error(start: BodyStates, rebound: float, velocity: np.ndarray, frame: int) -> float:
    """Distance of the simulated velocities at a frame from Bullet's (2, 2), the larger of the two (world units/s)."""
    run = simulate(start, np.ones(2, bool), frame + 1, np.full((2, 2), rebound))
    return float(np.linalg.norm(run.states[:, frame, VELOCITY] - velocity, axis=1).max())


def measure(shapes: tuple[Shape, Shape], world: World, hits: int, rng: random.Random, bullet: Simulator) -> np.ndarray:
    """(hits, 4): the rule's share, Bullet's rebound, and the largest error of a velocity with that rebound and as simulated."""
    rows: list[tuple[float, ...]] = []
    while len(rows) < hits:
        start, bodies = hit(shapes, world, rng)
        share = rule(start)
        if share is None or share < LOWEST_SHARE:
            continue
        motion = bullet.run(bodies, FRAMES)
        if not motion.contacts or (frame := motion.contacts[0].frame + LATER_FRAMES) >= FRAMES:
            continue
        true = motion.velocity[:, frame, :2]
        errors = [error(start, rebound, true, frame) for rebound in REBOUNDS]
        rows.append((share, REBOUNDS[int(np.argmin(errors))], min(errors), error(start, np.nan, true, frame)))
    return np.array(rows)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--world", help="YAML; CLEVRER's if left out")
    parser.add_argument("--hits", type=int, default=250)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    world = read_world(options.world) if options.world else CLEVRER_WORLD
    rng, found, walls = random.Random(options.seed), {}, []
    with Simulator(world=world) as bullet:
        for shapes in combinations_with_replacement(world.vocabulary.shapes, 2):
            rows = found[" and ".join(s.word for s in shapes)] = measure(shapes, world, options.hits, rng, bullet)
            walls += [] if any(s.solid == "sphere" for s in shapes) else [rows]
    found["all with walls"] = np.concatenate(walls)
    columns = (
        "shapes",
        "line through Bullet's rebounds",
        "error of the rule",
        "of the line",
        "velocities as simulated",
        "best",
    )
    print(table(columns, [(shapes, *cells(rows)) for shapes, rows in found.items()]))
    print(
        "\nErrors of rebounds are root mean squares (shares of the approach speed), those of velocities means (world/s)."
    )


def cells(rows: np.ndarray) -> tuple[str, ...]:
    share, rebound, best, simulated = rows[rows[:, 2] < CLOSE_WORLD_PER_S].T
    slope, constant = np.polyfit(share, rebound, 1)
    errors = [np.sqrt(np.mean((p - rebound) ** 2)) for p in (np.maximum(share, 0), constant + slope * share)]
    numbers = (*errors, simulated.mean(), best.mean())
    return f"{constant:.2f} + {slope:.2f} rule", *(f"{number:.3f}" for number in numbers)


if __name__ == "__main__":
    main()

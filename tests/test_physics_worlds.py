"""The simulator that is fitted to videos in worlds of other sizes, materials, friction, steps and gravity."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from nsdr import Add, DataError, Event, Move, SetVelocity, Track, VideoTracks
from nsdr.dynamics import states_from_tracks
from nsdr.dynamics.interventions import check_changes
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.bodies import body_records, outline_of
from nsdr.dynamics.physics.body_state import POSITION
from nsdr.dynamics.physics.bullet_rules import HULL_MARGIN_WORLD
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.dynamics.physics.forces import pair_restitution
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.dynamics.physics.simulator import BodyStates, simulate
from nsdr.dynamics.sliding import slide, slide_one, sliding_law
from nsdr.generate.physics.bullet import Body, BulletMotion, Simulator
from nsdr.types import SceneObject
from nsdr.world.physics import Physics
from nsdr.world.shapes import surface_points
from nsdr.world.vocabulary import CLEVRER, Material, Shape
from nsdr.world.world import CLEVRER_WORLD, Scales, World

from .test_other_worlds import BRICK, DISCS

PLANK = Shape("plank", "box", (0.5, 0.25, 0.3), 0.03)
BRICKS = replace(DISCS, name="bricks", vocabulary=replace(DISCS.vocabulary, shapes=(BRICK, PLANK)))


def doubled(world: World) -> World:
    """The world with all lengths twice as large."""

    def twice(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(2 * value for value in values)

    shapes = tuple(replace(s, size_world=twice(s.size_world)) for s in world.vocabulary.shapes)
    physics, layout = world.physics, world.layout
    names = ("gravity", "table_half_width_world", "moving_speed_world_per_s")
    return replace(
        world,
        name=f"large {world.name}",
        vocabulary=replace(world.vocabulary, shapes=shapes),
        physics=replace(
            physics,
            start_speed_world_per_s=twice(physics.start_speed_world_per_s),
            **{name: 2 * getattr(physics, name) for name in names},
        ),
        camera=replace(world.camera, eye_world=twice(world.camera.eye_world)),
        layout=replace(
            layout,
            area_world=twice(layout.area_world),
            start_distance_world=twice(layout.start_distance_world),
            far_world=2 * layout.far_world,
        ),
    )


LARGE = doubled(CLEVRER_WORLD)
PAIRS = [
    (DISCS, ("disc", "disc"), "wood"),
    (DISCS, ("disc", "coin"), "steel"),
    (DISCS, ("coin", "brick"), "wood"),
    (BRICKS, ("brick", "plank"), "steel"),
    (LARGE, ("sphere", "cube"), "metal"),
    (LARGE, ("cylinder", "cylinder"), "rubber"),
]


def start_of(world: World, words: tuple[str, ...], material: str, state: np.ndarray) -> BodyStates:
    objects = [SceneObject(i, world.vocabulary.colors[i].word, material, word) for i, word in enumerate(words)]
    return BodyStates(body_records(objects, world), state, np.ones(len(words)))


def in_bullet(world: World, words: tuple[str, ...], material: str, state: np.ndarray, frames: int) -> BulletMotion:
    bodies = []
    for word, (x, y, vx, vy, yaw, _) in zip(words, state, strict=True):
        shape = world.vocabulary.shape(word)
        turned = (np.pi / 2, 0.0, 0.0) if shape.solid == "cylinder" else (0.0, 0.0, yaw)
        bodies.append(Body(word, (x, y, shape.height_world), turned, (vx, vy, 0.0), material=material))
    with Simulator(world=world) as simulator:
        return simulator.run(bodies, frames)


def hit(world: World, words: tuple[str, ...]) -> np.ndarray:
    """One object that moves towards another one, which rests."""
    size, speed = world.scales.size, world.scales.speed
    is_box = [world.vocabulary.shape(word).solid == "box" for word in words]
    return np.array([(-1.2 * size, 0.1 * size, 2.0 * speed, 0, 0.5 * is_box[0], 0), (0, 0, 0, 0, 0.3 * is_box[1], 0)])


def test_the_scales_of_clevrer_are_exactly_one() -> None:
    assert set(CLEVRER_WORLD.scales) == {1.0}
    assert LARGE.scales == Scales(size=2.0, speed=2.0, step=2.0, frame=2.0, px=1.0, gravity=2.0, rate=1.0)
    cube, sphere, _ = body_records([SceneObject(0, "red", "metal", s.word) for s in CLEVRER.shapes], CLEVRER_WORLD)
    assert (cube["corner"], cube["threshold"], pair_restitution(cube, sphere)) == (0.07, 0.02 * 0.348, 0.64)
    assert CLEVRER_WORLD.physics.log_mass_std == 0.17
    assert CLEVRER_WORLD.physics.contact_pause_steps == 70


@pytest.mark.parametrize("damping", [0.0, 0.04, 0.5])
@pytest.mark.parametrize("friction", [0.0, 0.0005, 0.01 / 9.81, 0.03])
def test_every_branch_of_the_law_of_sliding_is_that_of_small_steps(friction: float, damping: float) -> None:
    shape = Shape("disc", "cylinder", (0.4, 0.4, 0.4), friction)
    law = sliding_law(shape, Material("metal"), Physics(linear_damping=damping), CLEVRER_WORLD.scales)
    for speed, seconds in ((2.0, 1.4), (0.02, 5.0), (2.0, 20.0)):
        n = 20000
        distance, now, step = 0.0, speed, seconds / n
        for _ in range(n):
            later = max(now - step * (friction * 9.81 + damping * now * (1 + now)), 0.0)
            distance, now = distance + step * (now + later) / 2, later
        found, final, by_speed, final_by_speed = slide_one(law, speed, seconds)
        assert (found, final) == pytest.approx((distance, now), abs=2e-3)
        above, below = slide_one(law, speed + 1e-6, seconds), slide_one(law, speed - 1e-6, seconds)
        assert by_speed == pytest.approx((above[0] - below[0]) / 2e-6, rel=1e-3, abs=1e-4)
        assert final_by_speed == pytest.approx((above[1] - below[1]) / 2e-6, rel=1e-3, abs=1e-4)
        if final > 0.0:
            back, first = slide(law, np.array(final), np.array(-seconds))
            assert (float(back), float(first)) == pytest.approx((-found, speed), abs=1e-6)


@pytest.mark.parametrize(("world", "words", "material"), PAIRS)
def test_runs_follow_bullet(world: World, words: tuple[str, str], material: str) -> None:
    start, size = hit(world, words), world.scales.size
    planar = simulate(start_of(world, words, material, start), np.ones(2, bool), 30)
    true = in_bullet(world, words, material, start, 30)
    assert abs(planar.contacts[0, 0, 1] - true.contacts[0].frame) <= 1
    assert np.linalg.norm(planar.states[:, 28, POSITION] - true.location_world[:, 28, :2], axis=-1).max() < 0.15 * size


def test_long_boxes_touch_with_any_corner() -> None:
    """Here, with one that points away from the middle of the other box."""
    bar, c, s = Shape("bar", "box", (2.0, 0.1, 0.2), 0.03), np.cos(np.pi / 6), np.sin(np.pi / 6)
    layout = replace(DISCS.layout, objects=((2, 1.0),), participants=2, area_world=(-4.0, 4.0, -4.0, 4.0))
    world = replace(BRICKS, vocabulary=replace(BRICKS.vocabulary, shapes=(PLANK, bar)), layout=layout)
    lowest = (outline_of(PLANK) @ np.array([[c, -s], [s, c]]))[:, 1].min()
    state = np.array([(0.0, 0.0, 0.0, 0.0, -np.pi / 6, 0.0), (-0.8, lowest - 0.07, 0.0, 0.0, 0.0, 0.0)])
    gap, nx, ny, *_ = outline_gap(start_of(world, ("plank", "bar"), "wood", state).body, state, 0, 1)
    assert gap == pytest.approx(0.02 - 2 * HULL_MARGIN_WORLD, abs=1e-9)
    assert (nx, ny) == pytest.approx((0.0, -1.0))


def test_a_world_twice_as_large_has_the_same_collisions() -> None:
    rng, words, found = np.random.default_rng(0), ("cube", "sphere", "cylinder", "cube"), []
    for _ in range(40):
        angle = rng.uniform(0, 2 * np.pi, 4)
        away, across = np.stack([np.cos(angle), np.sin(angle)], 1), rng.uniform(-0.2, 0.2, (4, 2))
        speed = rng.uniform(1.5, 2.5, (4, 1)) * (np.arange(4) < 2)[:, None]
        turn = np.where([word == "cube" for word in words], rng.uniform(0, 1.5, 4), 0.0)
        state = np.column_stack([(1 + np.arange(4))[:, None] * 0.6 * away + across, -speed * away, turn, np.zeros(4)])
        large = state * [2, 2, 2, 2, 1, 1]
        both = [
            simulate(start_of(w, words, "metal", s), np.ones(4, bool), 60)
            for w, s in ((CLEVRER_WORLD, state), (LARGE, large))
        ]
        found += [(a, b) for a, b in zip(*(run.contacts[0][np.triu_indices(4, 1)] for run in both), strict=True)]
    met = [(a, b) for a, b in found if max(a, b) >= 0]
    assert len(met) > 25
    same = [min(a, b) >= 0 and abs(a - b) <= 3 for a, b in met]
    assert np.mean(same) > 0.9  # Bullet's margin and damping by the square of the speed are not twice as large


def tracks_of(world: World, words: tuple[str, ...], material: str, motion: BulletMotion, noise: float) -> VideoTracks:
    """What a perfect tracker would measure."""
    tracks, rng, frames = [], np.random.default_rng(0), np.arange(motion.location_world.shape[1])
    for i, word in enumerate(words):
        shape, o = world.vocabulary.shape(word), SceneObject(i, world.vocabulary.colors[i].word, material, word)
        yaw = motion.orientation[i, :, 2] * (shape.solid == "box")
        pixels = [world.camera.pixels(surface_points(shape, yaw[f]) + motion.location_world[i, f]) for f in frames]
        box = np.round([[*p.min(0), *p.max(0)] for p in pixels]).astype(int)
        place = motion.location_world[i, :, :2] + noise * rng.normal(size=(len(frames), 2))
        tracks.append(Track(o, frames, place, (box[:, :2] + box[:, 2:]) / 2, box, np.ones(len(frames))))
    return VideoTracks(len(frames), tuple(tracks), world)


class AnyPair:
    """Every pair may collide where it is nearest, or not."""

    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        found = []
        for i, j in combinations(range(len(states.objects)), 2):
            apart = np.linalg.norm(states.location_world[i] - states.location_world[j], axis=1)
            found.append((Event("collision", int(apart.argmin()), (i, j)), 0.5))
        return sorted(found, key=lambda one: one[0].frame)


def test_true_tracks_of_another_world_are_explained() -> None:
    words = ("disc", "brick", "coin")
    state = np.array([(-1.2, 0.1, 2.2, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 1.0, 0.0), (0.5, -0.9, 0.0, 0.0, 0.0, 0.0)])
    motion = in_bullet(DISCS, words, "wood", state, 40)
    states = states_from_tracks(tracks_of(DISCS, words, "wood", motion, 0.003))
    scene = PhysicsPredictor(AnyPair(), PhysicsConfig(runs=5)).explain(states)
    assert [e.objects for e in scene.observed.collisions] == [c.bodies for c in motion.contacts] == [(0, 1)]
    assert abs(scene.observed.collisions[0].frame - motion.contacts[0].frame) <= 1
    assert scene.observed.location_world.shape[1] == 57  # 1.4 times 40, and the last
    away = np.linalg.norm(scene.observed.location_world[:, :40] - motion.location_world[..., :2], axis=-1)
    assert np.median(away) < 0.01
    turned = scene.observed.yaw[1, 39] - motion.orientation[1, 39, 2]
    assert abs((turned + np.pi / 2) % np.pi - np.pi / 2) < 0.25  # a brick is the same after half a turn
    changed = scene.rollout([Move(2, x=-0.6, y=0.2)])
    assert changed.collisions[0].objects == (0, 2)


def test_what_can_be_set_depends_on_the_world() -> None:
    change = SetVelocity(0, speed=8.0)
    check_changes([change, Add("red", "metal", "cube", 20.0, 0.0)], LARGE)
    with pytest.raises(DataError, match="a speed of up to 5 world units per second, got 8"):
        check_changes([change], CLEVRER_WORLD)
    with pytest.raises(DataError, match=r"Move: expected a position on the ground, from -14\.7 to 14\.7, got"):
        check_changes([Move(0, x=14.75, y=0.0)], DISCS)

"""Interventions: which objects they mean, what is refused, and what changes in the simulated scene."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import jsonargparse
import numpy as np
import pytest
from jsonargparse.typing import NonNegativeInt

import nsdr
from nsdr import Add, DataError, Event, Executor, Freeze, Move, Remove, SceneObject, SetMass, SetVelocity, Simulation
from nsdr.apps.comparison import comparison_frames
from nsdr.clevrer.example import VIDEO
from nsdr.cli import simulate as command
from nsdr.dynamics import StoredExplanation, simulate, states_from_tracks
from nsdr.dynamics.interventions import resolve
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.body_state import POSITION, VELOCITY
from nsdr.dynamics.physics.changed_bodies import change_bodies
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.io.configuration import OptionParser
from nsdr.pipeline import Pipeline
from nsdr.types import Track, VideoTracks
from nsdr.types.interventions import intervention_text
from nsdr.types.tracks import find_object
from nsdr.world.camera import CLEVRER_CAMERA, on_ground
from nsdr.world.world import CLEVRER_WORLD

from .test_physics import bodies, run

OBJECTS = (
    SceneObject(0, "red", "metal", "sphere"),
    SceneObject(1, "blue", "rubber", "cylinder"),
    SceneObject(2, "red", "rubber", "cube"),
)
FRAMES = 60


class NoDetector:
    """Finds the collisions that it is given."""

    def __init__(self, *events: Event) -> None:
        self.events = events
        self.calls = 0

    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        self.calls += 1
        return [(event, 1.0) for event in self.events]


@pytest.fixture(scope="module")
def tracks() -> VideoTracks:
    """A red sphere hits a blue cylinder at rest, at about frame 16; a red cube rests behind it, on the cylinder's way."""
    start = bodies(("sphere", -1.5, 0.0, 2.5, 0.0), ("cylinder", 0.0, 0.02, 0.0, 0.0), ("cube", 1.0, 0.0, 0.0, 0.0))
    motion = run(start, FRAMES)
    return VideoTracks(FRAMES, tuple(_track(o, motion.states[o.id, :, POSITION]) for o in OBJECTS))


def _track(o: SceneObject, position: np.ndarray) -> Track:
    """The track of an object at positions (F, 2), seen in every frame."""
    centre = CLEVRER_CAMERA.pixels(on_ground(position))
    box = np.concatenate([centre - 18, centre + 18], 1).round().astype(int)
    return Track(o, np.arange(len(position)), position, centre, box, np.ones(len(position)))


@pytest.fixture(scope="module")
def backend(tracks: VideoTracks) -> PhysicsPredictor:
    start = bodies(("sphere", -1.5, 0.0, 2.5, 0.0), ("cylinder", 0.0, 0.02, 0.0, 0.0), ("cube", 1.0, 0.0, 0.0, 0.0))
    contact = run(start, FRAMES).contacts[0]
    events = [Event("collision", int(contact[i, j]), (i, j)) for i, j in ((0, 1), (1, 2))]
    return PhysicsPredictor(NoDetector(*events), PhysicsConfig(runs=5))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def simulated(backend: PhysicsPredictor, tracks: VideoTracks) -> Callable[..., Simulation]:
    explanation = backend.explain(states_from_tracks(tracks))
    return lambda *changes, from_frame=0: simulate(explanation, changes, from_frame)


def pairs(simulation: Simulation) -> list[tuple[int, ...]]:
    return [e.objects for e in simulation.changed.collisions]


def test_the_scene_as_it_is(simulated) -> None:
    simulation = simulated(SetMass(0, 1.0))
    assert [e.objects for e in simulation.original.collisions] == [(0, 1), (1, 2)]
    assert pairs(simulation) == [(0, 1), (1, 2)]
    assert simulation.differences() == ()
    np.testing.assert_array_equal(simulation.changed.location_world, simulation.original.location_world)
    assert simulation.changed.location_world.shape == (3, round(FRAMES * 7 / 5) + 1, 2)


def test_removal_from_the_start_is_the_counterfactual(backend: PhysicsPredictor, tracks: VideoTracks) -> None:
    explanation = backend.explain(states_from_tracks(tracks))
    for k in range(3):
        simulation, rollout = simulate(explanation, [Remove(k)]), explanation.counterfactual[k]
        assert simulation.changed.collisions == rollout.collisions
        np.testing.assert_array_equal(simulation.changed.location_world, rollout.location_world)
        np.testing.assert_array_equal(simulation.changed.visible, rollout.visible)
        found = [(d.event, d.probability) for d in simulation.changed.uncertain or ()]
        assert found == [(d.event, d.probability) for d in rollout.uncertain or ()]
    assert pairs(simulate(explanation, [Remove(0)])) == []


def test_a_removal_later_keeps_what_was_before(simulated) -> None:
    hit = simulated(SetMass(0, 1.0)).original.collisions[0].frame
    late, early = (
        simulated(Remove("cylinder"), from_frame=NonNegativeInt(hit + 4)),
        simulated(Remove("cylinder"), from_frame=hit - 4),
    )
    assert pairs(late) == [(0, 1)] + [(0, 2)] * ((0, 2) in pairs(late))
    assert (0, 1) not in pairs(early)
    assert np.isfinite(late.changed.location_world[1, : hit + 4]).all()
    assert np.isnan(late.changed.location_world[1, hit + 4 :]).all()
    assert not late.changed.visible[1, hit + 4 :].any()
    assert [e.kind for e in late.events if e.objects == (1,)] == []  # it does not exit, it is gone
    assert len(late.scene.objects) == 3
    assert [o.name for o in early.scene.objects] == [o.name for o in OBJECTS]
    assert [o.name for o in simulated(Remove("cylinder")).scene.objects] == ["red metal sphere", "red rubber cube"]


def test_a_collision_that_goes_on_is_not_a_second_one(simulated) -> None:
    hit = simulated(SetMass(0, 1.0)).original.collisions[0].frame
    assert pairs(simulated(Freeze("cylinder"), from_frame=hit + 1)) == [(0, 1)]


def test_a_pair_that_meets_again_without_interventions_too_is_nothing_new() -> None:
    start = bodies(
        ("sphere", -1.5, 0.0, 2.5, 0.0), ("cylinder", 0.0, 0.0, 0.0, 0.0), ("cube", 1.2, 0.0, 0.0, 0.0), yaw=0.0
    )
    motion = run(replace(start, mass=np.array([1.0, 1.0, 50.0])), FRAMES)
    hits = [Event("collision", int(motion.contacts[0][pair]), pair) for pair in ((0, 1), (1, 2))]
    end = hits[1].frame + 8  # the cylinder is on its way back to the sphere
    backend = PhysicsPredictor(NoDetector(*hits), PhysicsConfig(runs=5))  # type: ignore[arg-type]
    seen = VideoTracks(end, tuple(_track(o, motion.states[o.id, :end, POSITION]) for o in OBJECTS))
    explanation = backend.explain(states_from_tracks(seen))
    early, late = (simulate(explanation, [SetMass(0, 1.0)], frame) for frame in (0, hits[0].frame + 6))
    assert pairs(early) == [(0, 1), (1, 2)]
    assert pairs(late) == [(0, 1), (1, 2), (0, 1)]
    assert late.original.collisions == late.changed.collisions
    assert early.differences() == late.differences() == ()
    gone = simulate(explanation, [Remove(2)], hits[0].frame + 6).differences()
    assert [e.event.objects for e in gone if e.kind == "no longer" and e.event.frame > end] == [(0, 1)]


def test_masses_change_what_follows_a_collision(simulated) -> None:
    light, heavy = simulated(SetMass("metal", 0.2)), simulated(SetMass("metal", 5.0))
    hit = light.original.collisions[0].frame
    for simulation in (light, heavy):
        before = slice(0, hit - 1)
        np.testing.assert_allclose(
            simulation.changed.location_world[:, before], simulation.original.location_world[:, before]
        )
        assert simulation.changed.collisions[0].objects == (0, 1)
        assert abs(simulation.changed.collisions[0].frame - hit) <= 1
    x = [s.changed.location_world[1, hit + 10, 0] for s in (light, heavy)]
    assert x[1] > x[0] + 0.2


def test_velocities_are_set_scaled_and_turned(simulated) -> None:
    def moved(change: SetVelocity, frame: int = 5) -> Any:
        path = simulated(change, from_frame=frame).changed.location_world[0]
        return (path[frame + 5] - path[frame]) / (5 * 0.028)

    now = moved(SetVelocity(0, factor=1.0))
    assert now[0] == pytest.approx(2.4, abs=0.1)
    np.testing.assert_allclose(moved(SetVelocity(0, vx=0.0, vy=1.0)), (0.0, 1.0), atol=0.05)
    np.testing.assert_allclose(moved(SetVelocity(0, direction=90)), (0.0, np.hypot(*now)), atol=0.05)
    np.testing.assert_allclose(moved(SetVelocity(0, speed=1.0)), (1.0, 0.0), atol=0.05)
    np.testing.assert_allclose(moved(SetVelocity(0, speed=0.0)), (0.0, 0.0), atol=1e-6)
    np.testing.assert_allclose(moved(SetVelocity(0, factor=-0.5)), -now / 2, atol=0.05)
    assert pairs(simulated(SetVelocity(0, speed=0.0))) == []
    assert simulated(SetVelocity(1, factor=0)).changed.location_world[1, 10] == pytest.approx([0.0, 0.02], abs=0.05)


def test_given_velocities_are_exact() -> None:
    start = bodies(("sphere", -1.5, 0.0, 2.5, 0.0), ("cylinder", 0.0, 0.02, 0.0, 0.0), ("cube", 1.0, 0.0, 0.0, 0.0))
    for change, exact in (
        (SetVelocity(0, factor=0), True),
        (SetVelocity(0, speed=0), True),
        (SetVelocity(0, speed=1, direction=0), True),
        (SetVelocity(0, vx=0, vy=0), True),
        (SetVelocity(0, factor=0.5), False),
        (SetVelocity(0, speed=1), False),
    ):
        changes = resolve([change], OBJECTS, np.ones((3, 5), bool), 0, CLEVRER_WORLD)
        assert change_bodies(start, OBJECTS, changes, CLEVRER_WORLD).exact[:, VELOCITY].all(1).tolist() == [
            exact,
            False,
            False,
        ], change


def test_moved_objects_meet_others(simulated) -> None:
    assert pairs(simulated(Move("cylinder", dx=0.0, dy=1.0)))[:1] == [(0, 2)]
    simulation = simulated(Move("cube", x=-0.5, y=0.0), from_frame=3)
    assert pairs(simulation)[:1] == [(0, 2)]
    np.testing.assert_allclose(simulation.changed.location_world[2, 3], (-0.5, 0.0))
    np.testing.assert_allclose(simulation.changed.location_world[2, 2], (1.0, 0.0), atol=0.02)


def test_frozen_objects_stay(simulated) -> None:
    simulation = simulated(Freeze("cylinder"))
    path = simulation.changed.location_world
    np.testing.assert_allclose(path[1], np.broadcast_to(path[1, 0], path[1].shape), atol=1e-5)
    assert pairs(simulation) == [(0, 1)]
    assert path[0, -1, 0] < path[0, simulation.changed.collisions[0].frame, 0]  # the sphere rebounds
    pushed = simulated(SetVelocity("cylinder", speed=0.0)).changed.location_world
    assert pushed[1, -1, 0] > 0.5


def test_added_objects_take_part(simulated) -> None:
    new = Add("green", "metal", "cube", -0.6, 0.0)
    simulation = simulated(new)
    assert simulation.objects[3].name == "green metal cube"
    assert pairs(simulation)[0] == (0, 3)
    assert np.isnan(simulation.original.location_world[3]).all()
    assert len(simulation.scene.objects) == 4
    late = simulated(new, from_frame=5)
    assert np.isnan(late.changed.location_world[3, :5]).all()
    assert [e for e in late.events if e.objects == (3,) and e.frame == 5] == []
    several = simulated(Remove(1), Add("blue", "rubber", "cylinder", -0.6, 0.0, vx=1.0))
    assert [o.name for o in several.scene.objects].count("blue rubber cylinder") == 1


def test_questions_are_answered_in_the_changed_world(simulated) -> None:
    count = "events objects filter_collision count"
    assert Executor(simulated(SetMass(0, 1.0)).scene).answer(count).answer == 2
    assert Executor(simulated(Freeze(1)).scene).answer(count).answer == 1
    assert Executor(simulated(Remove(0)).scene).answer(count).answer == 0
    assert Executor(simulated(Remove(0)).scene).answer("objects count").answer == 2
    moving = "objects null filter_moving count"
    assert Executor(simulated(SetVelocity(0, speed=0.0)).scene).answer(moving).answer == 0


def test_differences_and_probabilities(simulated) -> None:
    simulation = simulated(Freeze("cylinder"))
    changes = {(c.kind, c.event.kind, c.event.objects): c for c in simulation.differences()}
    gone = changes["no longer", "collision", (1, 2)]
    assert gone.before == gone.event.frame
    assert gone.probability == 0.0
    assert simulation.probabilities is not None
    assert simulation.probabilities[simulation.changed.collisions[0]] == 1.0
    assert simulated(SetMass(0, 1.0)).differences() == ()
    slower = simulated(SetVelocity(0, factor=0.6))
    assert ("other frame", "collision", (0, 1)) in {
        (c.kind, c.event.kind, c.event.objects) for c in slower.differences()
    }


def test_simulations_and_rollouts_are_printed_in_words(simulated) -> None:
    simulation = simulated(Freeze("cylinder"))
    head, *lines = str(simulation).splitlines()
    assert head == "from frame 0: the blue rubber cylinder fixed to the ground"
    assert lines == [f"  {simulation.describe(change)}" for change in simulation.differences()]
    gone = next(e for e in simulation.original.collisions if e.objects == (1, 2))
    said = f"  no longer: the blue rubber cylinder and the red rubber cube collide (frame {gone.frame}, <1 %)"
    assert said in lines
    assert str(simulated(SetMass(0, 1.0))).splitlines()[1:] == ["  nothing else changes"]
    rollout = simulation.original
    assert str(rollout).splitlines()[0] == "85 frames, 3 objects"
    assert f"  object 1 and object 2 collide (frame {gone.frame})" in str(rollout).splitlines()


@pytest.mark.parametrize(
    ("changes", "from_frame", "message"),
    [
        ([], 0, "at least one"),
        ([Remove("red")], 0, "'red': 2 objects fit.*0 red metal sphere, 1 blue rubber cylinder, 2 red rubber cube"),
        ([Remove("gray cube")], 0, "'gray cube': no object fits.*0 red metal sphere"),
        ([Remove("")], 0, "no object fits"),
        ([Remove(3)], 0, "object 3: expected an id"),
        ([Remove(0)], 60, "from_frame: expected a frame of the video, 0 to 59, got 60"),
        ([Remove(0)], 1.5, "from_frame"),
        ([Remove(0)], True, "from_frame"),
        (["red cube"], 0, "expected instances of Remove"),
        ([Remove(0), SetMass("metal", 2)], 0, "red metal sphere: Remove and SetMass contradict"),
        ([SetMass(0, 3), SetMass("metal", 2)], 0, "SetMass and SetMass contradict"),
        ([Freeze(0), SetVelocity(0, factor=2)], 0, "Freeze and SetVelocity contradict"),
        ([Move(0, x=1, y=1), Move(0, dx=1, dy=1)], 0, "Move and Move contradict"),
        ([Remove(0), Remove(1), Remove(2)], 0, "all 3 objects are removed"),
        ([Add("red", "rubber", "cube", 1, 1)], 0, "Add red rubber cube: the scene has one already"),
        ([Remove(2), Add("red", "rubber", "cube", 1, 1)], 4, "has one already"),
        (
            [Move(2, x=0.1, y=0.1)],
            0,
            r"red rubber cube at \(0.10, 0.10\): would overlap the blue rubber cylinder at .* by 0.3",
        ),
        ([Add("gray", "metal", "cube", 1.1, 0)], 0, "would overlap the red rubber cube"),
        (
            [Move(0, dx=14.9, dy=0), Move(1, dx=14.9, dy=0)],
            20,
            r"Move .*position on the ground, from -14.8 to 14.8, got",
        ),
        ([Move(0, dx=99.0, dy=0.0)], 0, "expected dx and dy of up to 29.6"),
        ([Move(0, x=15, y=0)], 0, "on the ground"),
        ([Add("gray", "metal", "cube", 0, 15)], 0, "on the ground"),
        ([SetVelocity(0, vx=4, vy=4)], 0, "speed of up to 5"),
        ([SetVelocity(0, speed=6)], 0, "speed of up to 5"),
        ([SetVelocity(1, speed=1.0)], 0, "it is at rest"),
        ([SetVelocity(0, factor=3)], 0, "speed of up to 5 world units per second, got 7"),
    ],
)
def test_impossible_interventions_are_refused(simulated, changes: list[Any], from_frame: Any, message: str) -> None:
    with pytest.raises(DataError, match=message):
        simulated(*changes, from_frame=from_frame)


def test_one_intervention_without_a_list_is_refused(simulated) -> None:
    with pytest.raises(DataError, match=r"interventions: expected a list, such as .*, got Remove\(object=0\)"):
        resolve(Remove(0), OBJECTS, np.ones((3, 60), bool), 0, CLEVRER_WORLD)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SetMass(0, 0), "SetMass: .*factor"),
        (lambda: SetMass(0, float("nan")), "SetMass: .*factor"),
        (lambda: SetMass(0, None), "SetMass: .*factor"),
        (lambda: find_object(OBJECTS, True), "object True: expected an id"),
        (lambda: SetVelocity(0), "expected vx and vy, or speed"),
        (lambda: SetVelocity(0, vx=1.0), "got vx"),
        (lambda: SetVelocity(0, vx=1.0, vy=0.0, factor=2), "got vx, vy, factor"),
        (lambda: SetVelocity(0, speed=-1), "speed"),
        (lambda: Move(0, x=1.0), "expected x and y, or dx and dy, got x"),
        (lambda: Add("red", "Wood!", "cube", 0, 0), "Add: material: "),
        (lambda: Add("red", "metal", "cube", "1", 0), "Add: x: "),
        (lambda: Add("red", "metal", "cube", 0, 0, mass=0), "Add: .*mass"),
    ],
)
def test_malformed_interventions_are_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        make()


def test_words_of_added_objects_are_checked_before_the_video_is_looked_at() -> None:
    pipeline = Pipeline(None, None, None)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="Add red metal pyramid: shape: expected one of cube, sphere, cylinder"):
        pipeline.simulate("no_such_video.mp4", [Add("red", "metal", "pyramid", 1, 0)])


def test_added_objects_have_words_of_the_world() -> None:
    added = [Add("red", "wood", "cube", 0, 0)]
    with pytest.raises(DataError, match="Add red wood cube: material: expected one of metal, rubber, got 'wood'"):
        resolve(added, OBJECTS, np.ones((3, 5), bool), 0, CLEVRER_WORLD)


def test_objects_that_are_not_in_the_image_yet_or_any_more() -> None:
    visible = np.ones((3, 20), bool)
    visible[0, :5] = visible[1, 12:] = visible[2] = False
    assert resolve([Remove(0), SetMass(1, 2)], OBJECTS, visible, 0, CLEVRER_WORLD) == (
        Remove(0),
        SetMass(1, 2),
    )
    with pytest.raises(
        DataError, match="SetVelocity red metal sphere: it is not in the image at frame 2, it enters at frame 5"
    ):
        resolve([SetVelocity(0, speed=1)], OBJECTS, visible, 2, CLEVRER_WORLD)
    with pytest.raises(DataError, match="it leaves after frame 11; expected a from_frame from 0 to 11"):
        resolve([Remove(1)], OBJECTS, visible, 12, CLEVRER_WORLD)
    with pytest.raises(DataError, match="Freeze red rubber cube: it is never in the image"):
        resolve([Freeze(2)], OBJECTS, visible, 0, CLEVRER_WORLD)


def test_words_name_objects() -> None:
    assert find_object(OBJECTS, "the cylinder") == 1
    assert find_object(OBJECTS, "red sphere") == find_object(OBJECTS, "Metal") == find_object(OBJECTS, 0) == 0


def test_backends_without_interventions_remove_one_object(backend: PhysicsPredictor, tracks: VideoTracks) -> None:
    class Other:
        def explain(self, states, collisions=None):
            return StoredExplanation(backend.explain(states, collisions).prediction)

    pipeline = Pipeline(None, Other(), None)  # type: ignore[arg-type]
    simulation = pipeline.simulate(tracks, [Remove("metal")])
    assert pairs(simulation) == []
    np.testing.assert_array_equal(
        simulation.changed.location_world, backend.explain(states_from_tracks(tracks)).counterfactual[0].location_world
    )
    assert len(simulation.scene.objects) == 2
    for changes, from_frame in (([Freeze(0)], 0), ([Remove(0)], 3), ([Remove(0), Remove(1)], 0)):
        with pytest.raises(
            DataError, match="stored predictions can only remove one object from frame 0; use the backend physics"
        ):
            pipeline.simulate(tracks, changes, from_frame)
    with pytest.raises(DataError, match="no object fits"):
        pipeline.simulate(tracks, [Remove("gray")])


def test_a_pipeline_simulates_with_its_backend(backend: PhysicsPredictor, tracks: VideoTracks) -> None:
    pipeline = Pipeline(None, backend, None)  # type: ignore[arg-type]
    simulation = pipeline.simulate(tracks, [Freeze("cylinder")])
    assert simulation.changed.visible.shape[1] == 85
    longer = pipeline.simulate(tracks, [Freeze("cylinder")], frames=200)
    assert longer.original.visible.shape == longer.changed.visible.shape == (3, 200)
    assert simulation.interventions == (Freeze("blue rubber cylinder"),)
    alone = simulate(backend.explain(states_from_tracks(tracks)), [Freeze(1)])
    assert (simulation.events, simulation.changed) == (alone.events, alone.changed)


def test_simulations_are_saved_and_loaded(simulated, tmp_path) -> None:
    simulation = simulated(Freeze(1), SetMass(0, 2), SetVelocity(2, vx=1, vy=0), Add("gray", "metal", "sphere", 2, 1))
    nsdr.save(tmp_path / "s.json", simulation)
    assert nsdr.load(tmp_path / "s.json", Simulation) == simulation


def test_interventions_in_words() -> None:
    said = {
        "without the red cube": Remove("red cube"),
        "object 2 0.5 times as heavy": SetMass(2, 0.5),
        "the cube 2 times as fast": SetVelocity("cube", factor=2),
        "the cube with velocity (1, -0.5)": SetVelocity("cube", vx=1, vy=-0.5),
        "the cube with speed 1 in direction 90°": SetVelocity("cube", speed=1, direction=90),
        "the cube at (1, 2)": Move("cube", x=1, y=2),
        "the cube moved by (0, 0.5)": Move("cube", dx=0, dy=0.5),
        "the cube fixed to the ground": Freeze("cube"),
        "with a red metal cube at (1, 2), velocity (1, 0)": Add("red", "metal", "cube", 1, 2, 1),
        "with an ivory clay crate at (0.5, 0.9)": Add("ivory", "clay", "crate", 0.5, 0.9),
    }
    assert [intervention_text(change) for change in said.values()] == list(said)


def test_the_comparison_shows_both_worlds(simulated) -> None:
    simulation = simulated(Remove("cylinder"), from_frame=10)
    total = simulation.changed.visible.shape[1]
    black = np.zeros((320, 480, 3), np.uint8)
    frames = list(comparison_frames(simulation, [black] * total, [black + 9] * total))
    assert len(frames) == total
    assert frames[0].shape == (688, 960, 3)
    assert (frames[0][48:366, :478] == 0).all()
    assert (frames[0][48:366, 482:] == 9).all()
    left, right = frames[40][-320:, :478], frames[40][-320:, 482:]
    blue = [(image == (42, 75, 215)).all(-1).sum() for image in (left, right)]
    assert blue[0] > 100 > blue[1]


def options(*arguments: str, video: str = "clip.mp4") -> Any:
    parser = OptionParser(exit_on_error=False)
    command.simulate_options(parser)
    return parser.parse_args([video, *arguments])


def test_options_name_interventions() -> None:
    given = options(
        *("--remove", "red cube", "--mass", "blue sphere=2", "--velocity", "3=1.5,0", "--velocity", "cube=x0.5"),
        *(
            "--move",
            "gray cube=1,2",
            "--shift",
            "gray cube=0,-0.4",
            "--freeze",
            "4",
            "--add",
            "red metal cube=1,0,-2,0.5",
        ),
    )
    assert command._interventions(given, CLEVRER_WORLD) == [
        Remove("red cube"),
        SetMass("blue sphere", 2),
        SetVelocity(3, vx=1.5, vy=0),
        SetVelocity("cube", factor=0.5),
        Move("gray cube", x=1, y=2),
        Move("gray cube", dx=0, dy=-0.4),
        Freeze(4),
        Add("red", "metal", "cube", 1, 0, -2, 0.5),
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--mass", "blue sphere"], "--mass blue sphere: expected OBJECT=NUMBER"),
        (["--mass", "cube=0"], "--mass cube=0: .*SetMass: .*factor"),
        (["--velocity", "cube=1"], "--velocity cube=1: expected OBJECT=2 numbers with commas"),
        (
            ["--remove", "zebra"],
            "--remove zebra: expected the words of one object, such as 'red metal cube', or its id",
        ),
        (["--remove", ""], "--remove : expected the words of one object"),
        (["--freeze", "red cube sphere"], "--freeze red cube sphere: expected the words of one object"),
        (["--freeze", "the red one"], "--freeze the red one: expected the words of one object"),
        (["--shift", "cube=99,0"], "--shift cube=99,0: Move: expected dx and dy of up to"),
        (["--add", "red cube=1,0"], "color, material and shape"),
        (["--add", "red metal cube=1,0,2"], "expected OBJECT=2 or 4 numbers"),
        (
            ["--add", "red metal pyramid=1,0"],
            "--add red metal pyramid=1,0: .*shape: expected one of cube, sphere, cylinder",
        ),
    ],
)
def test_options_that_are_no_intervention_are_refused(arguments: list[str], message: str) -> None:
    with pytest.raises(DataError, match=message):
        command._interventions(options(*arguments), CLEVRER_WORLD)


def test_frames_after_the_end_are_refused_before_the_work(monkeypatch) -> None:
    monkeypatch.setattr(command, "make_pipeline", lambda options, asks: pytest.fail("looked at the video"))
    given = ["--remove", "cube", "--from-frame"]
    with pytest.raises(DataError, match=r"--from-frame 129: expected a frame of .*mp4, which has 128 at 25 a second"):
        command.simulate(options(*given, "129", video=str(VIDEO)))
    with pytest.raises(jsonargparse.ArgumentError, match="--from-frame: expected a whole number"):
        options(*given, "-1")


def test_the_simulated_scene_knows_motion_in_the_image(backend: PhysicsPredictor, tracks: VideoTracks) -> None:
    explanation = backend.explain(states_from_tracks(tracks))
    scene = simulate(explanation, [Freeze(1)]).scene
    assert scene.motion_px is not None
    assert Executor(scene).run("objects sphere filter_shape unique query_image_direction")
    assert simulate(StoredExplanation(explanation.prediction), [Remove(0)]).scene.motion_px is not None


def test_the_command_writes_a_report_a_video_and_json(
    backend: PhysicsPredictor, tracks: VideoTracks, tmp_path, monkeypatch, capsys
) -> None:
    simulation = simulate(backend.explain(states_from_tracks(tracks)), [Freeze(1)])
    frames = [np.zeros((320, 480, 3), np.uint8)] * FRAMES

    class Made:
        world = CLEVRER_WORLD

        def simulate(self, video, interventions, from_frame, frames):
            assert (interventions, from_frame, frames) == ([Freeze("cylinder")], 0, None)
            return simulation

        def frames(self, video, note):
            return iter(frames)

    monkeypatch.setattr(command, "make_pipeline", lambda options, asks: Made())
    video, document = tmp_path / "out.mp4", tmp_path / "out.json"
    given = options("--freeze", "cylinder", "-o", str(video), "-o", str(document))
    assert command.simulate(given) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "from frame 0: the blue rubber cylinder fixed to the ground"
    assert any(
        line.startswith("  no longer: the blue rubber cylinder and the red rubber cube collide (frame") for line in said
    )
    content = json.loads(document.read_text())
    assert [e["objects"] for e in content["events"] if e["kind"] == "collision"] == [[0, 1]]
    assert content["interventions"] == [{"type": "Freeze", "object": "blue rubber cylinder"}]
    capture = cv2.VideoCapture(str(video))
    size = [capture.get(p) for p in (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)]
    assert size == [85, 688, 960]
    assert command.simulate(options("--freeze", "cylinder", "--json")) == 0
    assert json.loads(capsys.readouterr().out) == content
    with pytest.raises(DataError, match="no intervention: expected --remove"):
        command.simulate(options())
    with pytest.raises(DataError, match=r"expected a name ending in \.mp4"):
        command.simulate(options("--remove", "cube", "-o", "out.avi"))

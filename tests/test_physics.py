"""The planar simulator, its fits, the backends built on them, and the paper's patch network."""

from dataclasses import replace

import jsonargparse
import numpy as np
import pytest
import torch

from nsdr import CheckpointError, DataError, Event, PropNetPredictor, Remove
from nsdr.dynamics import states_from_tracks
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics import collision_search
from nsdr.dynamics.physics.bodies import body_records
from nsdr.dynamics.physics.body_state import POSITION, VELOCITY, YAW
from nsdr.dynamics.physics.collision_search import CollisionEvidence, closest_gap, log_odds, search_collisions
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.dynamics.physics.simulator import NO_CONTACT, BodyStates, PrescribedMotion, SimulatedMotion, simulate
from nsdr.dynamics.physics.trajectory_fit import fit_trajectories
from nsdr.dynamics.propnet.patch_model import PatchPropNet, PatchPropNetConfig, box_scale
from nsdr.dynamics.propnet.patch_predictor import PatchPropNetPredictor
from nsdr.dynamics.propnet.patches import patch_boxes
from nsdr.dynamics.propnet.state_model import PropNet, PropNetConfig
from nsdr.dynamics.registry import BackendConfig, backend_settings, load_backend, weights_folder
from nsdr.dynamics.velocity_events import VelocityEvents, collisions_from_motion
from nsdr.io.checkpoint import find_checkpoint
from nsdr.types import DynamicsPrediction, Rollout, SceneObject, Track, VideoTracks
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.world import CLEVRER_WORLD

from .test_dynamics import tracks

COLORS = ("red", "blue", "green", "gray")


def bodies(*rows: tuple[str, float, float, float, float], yaw: float = 0.3) -> BodyStates:
    """Rows of (shape, x, y, vx, vy); masses 1."""
    body = body_records([SceneObject(0, "red", "metal", r[0]) for r in rows], CLEVRER_WORLD)
    numbers = np.array([r[1:] for r in rows], float)
    n = len(rows)
    turn = np.where(body["is_box"], yaw, 0.0)
    return BodyStates(body, np.column_stack([numbers, turn, np.zeros(n)]), np.ones(n))


def run(start: BodyStates, n_frames: int = 128, **options: object) -> SimulatedMotion:
    return simulate(start, np.ones(len(start.body), bool), n_frames, **options)  # type: ignore[arg-type]


def seen(motion: SimulatedMotion, body: np.ndarray, noise: float = 0.003) -> MotionStates:
    """What a tracker would measure of a run, boxes left out (zero width)."""
    rng = np.random.default_rng(0)
    n, frames = motion.states.shape[:2]
    words = ["cube" if b["is_box"] else "sphere" if b["is_sphere"] else "cylinder" for b in body]
    objects = tuple(SceneObject(i, COLORS[i], "metal", word) for i, word in enumerate(words))
    position = motion.states[..., POSITION] + rng.normal(size=(n, frames, 2)) * noise
    all_frames = np.ones((n, frames), bool)
    return MotionStates(objects, position, all_frames, all_frames, all_frames, np.zeros((n, frames, 4)))


TWO = bodies(("sphere", -1.5, 0.05, 2.4, 0.0), ("cylinder", 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("shapes", [("sphere", "sphere"), ("cylinder", "sphere"), ("sphere", "cube"), ("cube", "cube")])
def test_runs_follow_bullet(shapes: tuple[str, str]) -> None:
    from nsdr.generate.physics.bullet import Body, Simulator

    start = bodies((shapes[0], -1.2, 0.12, 2.0, 0.0), (shapes[1], 0.0, 0.0, 0.0, 0.0))
    planar = run(start, 50)
    turn = [
        (np.pi / 2, 0.0, 0.0) if s == "cylinder" else (0.0, 0.0, float(start.state[i, YAW]))
        for i, s in enumerate(shapes)
    ]
    positions = [(*start.state[i, POSITION], 0.2) for i in range(2)]
    with Simulator() as simulator:
        solid = [Body(s, positions[i], turn[i], (*start.state[i, VELOCITY], 0.0)) for i, s in enumerate(shapes)]
        true = simulator.run(solid, 50)
    assert abs(planar.contacts[0, 0, 1] - true.contacts[0].frame) <= 1
    assert np.linalg.norm(planar.states[:, 40, POSITION] - true.location_world[:, 40, :2], axis=-1).max() < 0.12


def test_cylinders_rebound_as_in_bullet_wherever_in_a_step_they_meet() -> None:
    from nsdr.generate.physics.bullet import Body, Simulator

    errors = []
    with Simulator() as simulator:
        for distance in np.linspace(1.2, 1.25, 12):
            start = bodies(("cylinder", -distance, 0.05, 2.0, 0.0), ("cylinder", 0.0, 0.0, 0.0, 0.0))
            places = [((*start.state[i, POSITION], 0.2), (*start.state[i, VELOCITY], 0.0)) for i in range(2)]
            true = simulator.run([Body("cylinder", at, (np.pi / 2, 0.0, 0.0), v) for at, v in places], 40)
            errors.append(np.abs(run(start, 40).states[:, 30, VELOCITY] - true.velocity[:, 30, :2]).max())
    assert np.mean(errors) < 0.08  # by the rule for one contact: 0.12


def test_momentum_is_kept_and_a_given_rebound_is_met() -> None:
    start = replace(TWO, body=TWO.body[[0, 0]])  # two spheres: no friction
    for rebound in (0.0, 0.5):
        motion = run(start, 30, rebound=np.full((2, 2), rebound))
        hit = int(motion.contacts[0, 0, 1])
        before, after = motion.states[:, hit - 1, VELOCITY], motion.states[:, hit + 1, VELOCITY]
        np.testing.assert_allclose(before.sum(0), after.sum(0), atol=0.02)
        normal = motion.states[1, hit, POSITION] - motion.states[0, hit, POSITION]
        normal = normal / np.linalg.norm(normal)
        assert (after[1] - after[0]) @ normal == pytest.approx(rebound * (before[0] - before[1]) @ normal, abs=0.06)


def test_motion_is_a_smooth_function_of_the_start_with_given_rebounds() -> None:
    def end(shift: float) -> np.ndarray:
        moved = replace(TWO, state=TWO.state + shift * np.eye(2, 6))
        moved.state[1] = TWO.state[1]
        return run(moved, 60, rebound=np.full((2, 2), 0.4)).states[:, -1, POSITION]

    ends = np.array([end(s) for s in np.linspace(0, 0.02, 41)])
    assert np.abs(np.diff(ends, axis=0)).max() < 0.003


def test_prescribed_objects_keep_their_motion_until_something_meets_them() -> None:
    free = run(TWO, 60)
    alone = run(bodies(("sphere", 3.0, 3.0, 0.0, 0.0), ("cylinder", 0.0, 0.0, 0.0, 0.0)), 60)
    prescribed = PrescribedMotion(
        np.stack([free.states[0], alone.states[1]]),
        np.array([False, True]),
        np.array([59, 59]),
        np.zeros((0, 3), np.int64),
    )
    motion = run(TWO, 60, prescribed=prescribed)
    np.testing.assert_allclose(motion.states, free.states, atol=1e-9)
    assert motion.free_from[0, 1] == pytest.approx(free.contacts[0, 0, 1], abs=1)


def test_without_its_partner_a_prescribed_collision_does_not_happen() -> None:
    free = run(TWO, 60)
    hit = int(free.contacts[0, 0, 1])
    prescribed = PrescribedMotion(free.states, np.ones(2, bool), np.array([59, 59]), np.array([[0, 1, hit]]))
    both = run(TWO, 60, prescribed=prescribed)
    assert both.contacts[0, 0, 1] == hit
    assert (both.free_from == 59).all()
    alone = simulate(TWO, np.array([True, False]), 60, None, prescribed)
    assert alone.contacts[0, 0, 1] == NO_CONTACT
    assert alone.states[0, 50, 0] > 1.0  # it goes on past the other's position


def test_a_fit_finds_masses_and_rebounds_through_noise() -> None:
    start = replace(TWO, mass=np.array([1.2, 0.8]))
    motion = run(start, rebound=np.full((2, 2), 0.5))
    hit = int(motion.contacts[0, 0, 1])
    fit = fit_trajectories(seen(motion, start.body), [Event("collision", hit, (0, 1))])
    assert np.abs(fit.states[..., POSITION] - motion.states[..., POSITION]).max() < 0.006
    assert fit.bodies.mass[0] / fit.bodies.mass[1] == pytest.approx(1.5, abs=0.2)
    assert fit.rebound[0, 1] == pytest.approx(0.5, abs=0.05)
    assert fit.contact[0, 1] == pytest.approx(hit, abs=1)


def test_collisions_that_explain_nothing_are_dropped_and_needed_ones_found() -> None:
    three = bodies(("sphere", -1.5, 0.05, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0), ("sphere", 0.3, 0.9, 0.0, 0.0))
    motion = run(three)
    hit = int(motion.contacts[0, 0, 1])
    states = seen(motion, three.body)
    candidates = [(Event("collision", hit, (0, 1)), 0.3), (Event("collision", hit + 20, (1, 2)), 0.7)]
    found, fit, judged = search_collisions(states, candidates)
    assert [e.objects for e in found] == [(0, 1)]
    assert fit.cost < 0.2
    assert [event for event, _ in judged] == [event for event, _ in candidates]
    assert judged[0][1] > 0.5 > 0.1 > judged[1][1]  # by all evidence
    untried = search_collisions(states, candidates, PhysicsConfig(trials=0))
    assert untried.candidates == candidates  # the detector's


def test_gaps_are_those_of_outlines_at_the_closest_approach() -> None:
    passing = bodies(
        ("cube", -1.5, 0.5, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0), ("sphere", 0.0, -2.0, 0.0, 0.0), yaw=0.0
    )
    motion = run(passing)
    fit = fit_trajectories(seen(motion, passing.body), [])
    fit = replace(fit, states=motion.states, contact=motion.contacts[0])
    assert closest_gap(fit, (0, 1), 1.0) == pytest.approx(
        0.1, abs=0.03
    )  # 0.5 between the centres, 0.2 to the edges of each
    assert closest_gap(fit, (0, 2), 2.0) == 0.3  # no more than that is said
    meeting = bodies(("cube", -1.5, 0.1, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0))
    motion = run(meeting)
    assert (
        closest_gap(replace(fit, bodies=meeting, states=motion.states, contact=motion.contacts[0]), (0, 1), 1.0) == 0.0
    )


def test_evidence_of_fits_that_fail_or_do_not_meet() -> None:
    three = bodies(("sphere", -1.5, 0.05, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0))
    motion = run(three)
    good = replace(fit_trajectories(seen(motion, three.body), []), states=motion.states, contact=motion.contacts[0])
    met = replace(good, cost=0.2)
    assert CollisionEvidence.of((0, 1), 1.0, met, 1.0) == CollisionEvidence(12.0, 0.0)
    moved = good.states.copy()
    moved[1, :, 1] += 5.0
    apart = replace(good, states=moved, contact=np.full((2, 2), NO_CONTACT), cost=0.2)
    assert CollisionEvidence.of((0, 1), 0.5, apart, 1.0) == CollisionEvidence(0.0, pytest.approx(0.3 / (1 + 0.5**2)))
    assert CollisionEvidence.of((0, 1), 0.5, replace(apart, cost=20.0), 1.0).gap == pytest.approx(0, abs=0.001)
    assert log_odds(0.5) == 0.0


def test_evidence_adds_up() -> None:
    odds = 0.623 + 0.636 * 2.0 - 42.6 * 0.1
    assert CollisionEvidence(2.0, 0.1).probability == pytest.approx(1 / (1 + np.exp(-odds)))


def test_sure_candidates_are_not_tried_both_ways(monkeypatch) -> None:
    start = bodies(("sphere", -1.5, 0.05, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0), ("sphere", 0.3, 0.9, 0.0, 0.0))
    motion = run(start)
    states, calls = seen(motion, start.body), []
    monkeypatch.setattr(
        collision_search, "fit_trajectories", lambda *args: calls.append(args[1]) or fit_trajectories(*args)
    )
    candidates = [
        (Event("collision", int(motion.contacts[0, 0, 1]), (0, 1)), 1.0),
        (Event("collision", 60, (1, 2)), 0.0),
    ]
    found, _, _ = search_collisions(states, candidates)
    assert [e.objects for e in found] == [(0, 1)]
    assert len(calls) == 1


def test_the_fit_is_that_of_the_chosen_collisions(monkeypatch) -> None:
    """A rejected trial may cost a little less than what is chosen."""
    three = bodies(("sphere", -1.5, 0.05, 0.0, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0))
    motion = run(three)
    states = seen(motion, three.body)
    real, fits = collision_search.fit_trajectories, []

    def fitted(states, collisions, *options):
        cost = 0.9 if collisions else 1.0  # cheaper with a collision, but the bodies stay apart
        fit = real(states, collisions, *options)
        fits.append(replace(fit, states=motion.states, contact=np.full((2, 2), NO_CONTACT), cost=cost))
        return fits[-1]

    monkeypatch.setattr(collision_search, "fit_trajectories", fitted)
    found, fit, _ = search_collisions(states, [(Event("collision", 40, (0, 1)), 0.3)])
    assert found == []
    assert fit is fits[0]
    assert len(fits) == 2


@pytest.fixture
def observer() -> PropNetPredictor:
    torch.manual_seed(0)
    return PropNetPredictor(PropNet(PropNetConfig(hidden=16, collision_threshold=0.999)))


@pytest.fixture
def paper() -> PatchPropNetPredictor:
    torch.manual_seed(0)
    return PatchPropNetPredictor(PatchPropNet(PatchPropNetConfig(hidden=16, collision_threshold=0.9)))


def _first_detection(track: Track) -> Track:
    """As if the video were one image."""
    names = ("location_world", "centroid_px", "box_xyxy_px", "score")
    return replace(track, frame_index=np.zeros(1, int), **{name: getattr(track, name)[:1] for name in names})


@pytest.mark.parametrize("name", ["physics", "propnet", "propnet_patches", "velocity"])
def test_backends_keep_the_contract(name: str, observer: PropNetPredictor, paper: PatchPropNetPredictor) -> None:
    physics = PhysicsPredictor(observer, PhysicsConfig(runs=3))
    backend = {"propnet_patches": paper, "propnet": observer, "velocity": VelocityEvents(physics)}.get(name, physics)
    video = tracks(60)
    prediction = backend.explain(states_from_tracks(video)).prediction
    assert prediction.observed.location_world.shape == (3, 85, 2)
    assert sorted(prediction.counterfactual) == [0, 1, 2]
    for k, rollout in prediction.counterfactual.items():
        assert np.isnan(rollout.location_world[k]).all()
        assert not rollout.visible[k].any()
        assert all(k not in e.objects for e in rollout.collisions)
    again = backend.explain(states_from_tracks(video))
    np.testing.assert_array_equal(again.observed.location_world, prediction.observed.location_world)
    empty = backend.explain(states_from_tracks(VideoTracks(20, ()))).prediction
    assert isinstance(empty, DynamicsPrediction)
    assert empty.objects == ()
    image = replace(video, n_frames=1, tracks=tuple(_first_detection(t) for t in video.tracks))
    assert len(backend.explain(states_from_tracks(image)).observed.location_world) == 3


def test_physics_predicts_a_meeting_after_the_video(observer: PropNetPredictor) -> None:
    start = bodies(("sphere", -3.6, 0.0, 1.0, 0.0), ("sphere", 0.5, 0.0, 0.0, 0.0), ("sphere", 0.0, -1.5, 0.0, 0.0))
    explanation = PhysicsPredictor(observer, PhysicsConfig(runs=10)).explain(seen(run(start), start.body))
    rollout = explanation.rollout(frames=180)
    assert [e.objects for e in rollout.collisions] == [(0, 1)]
    assert rollout.collisions[0].frame == pytest.approx(run(start, 180).contacts[0, 0, 1], abs=2)
    assert rollout.predicted_scores is not None
    assert rollout.predicted_scores[0, 1] > 0.8 > 0.1 > rollout.predicted_scores[0, 2] > 0


class Detector:
    """Finds what it was told."""

    def __init__(self, *candidates: tuple[Event, float]) -> None:
        self.candidates = list(candidates)

    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        return self.candidates


def test_uncertain_observed_collisions_hold_without_other_objects_too() -> None:
    start = bodies(("sphere", -1.5, 0.05, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0), ("sphere", 0.3, 0.9, 0.0, 0.0))
    motion = run(start)
    hit, graze = Event("collision", int(motion.contacts[0, 0, 1]), (0, 1)), Event("collision", 70, (1, 2))
    # No trials: the detector's probabilities stay.
    config = PhysicsConfig(runs=5, trials=0)
    predictor = PhysicsPredictor(Detector((hit, 0.9), (graze, 0.2)), config)
    scene = predictor.explain(seen(motion, start.body))
    observed = scene.rollout()
    assert observed.collisions == (hit,)
    assert [(d.event, d.probability, d.removed) for d in observed.uncertain] == [(hit, 0.9, None), (graze, 0.2, None)]
    without = scene.rollout([Remove(2)])
    assert [e.objects for e in without.collisions] == [(0, 1)]
    assert [(d.event.objects, d.probability) for d in without.uncertain] == [((0, 1), 0.9)]
    assert [d.event for d in scene.rollout([Remove(0)]).uncertain] == [graze]
    sure = PhysicsPredictor(Detector((hit, 0.9999)), config).explain(seen(motion, start.body))
    assert sure.rollout().uncertain == ()
    assert sure.rollout([Remove(2)]).uncertain == ()


@pytest.mark.parametrize("first", [0, 30])
def test_given_collisions_are_kept_at_the_first_frame_and_of_pairs_that_meet_twice(first: int) -> None:
    start = bodies(("sphere", -1.5, 0.05, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0), ("sphere", 0.3, 1.9, 0.0, 0.0))
    given = [Event("collision", frame, (0, 1)) for frame in (first, 70)]
    predictor = PhysicsPredictor(Detector(*[(event, 1.0) for event in given]), PhysicsConfig(runs=3))
    scene = predictor.explain(seen(run(start), start.body))
    assert list(scene.rollout().collisions) == given
    assert list(scene.rollout([Remove(2)]).collisions) == given
    assert scene.rollout([Remove(1)]).collisions == ()
    for from_frame in (0, 40):
        assert list(scene.rollout(from_frame=from_frame).collisions) == given


def test_uncertain_predicted_collisions_are_shares_of_runs() -> None:
    start = bodies(("sphere", -1.5, 0.33, 1.0, 0.0), ("sphere", 0.3, 0.0, 0.0, 0.0))  # a near miss or a graze
    config = PhysicsConfig(runs=40, position_noise_world=0.15)
    states = seen(run(start, 40), start.body)
    rollout = PhysicsPredictor(Detector(), config).explain(states).rollout(frames=151)
    [one] = [u for u in rollout.uncertain if u.event.kind == "collision"]
    assert 0.05 < one.probability < 0.95
    assert one.probability * 40 == pytest.approx(round(one.probability * 40))
    assert one.event.frame >= 40
    assert (one.event in rollout.collisions) == (one.probability > 0.5)


def test_what_was_seen_briefly_is_known_less_exactly() -> None:
    """Errors of states are those of a line by least squares: of N frames in a row, N (N² - 1) / 12 is the spread."""
    start = bodies(("sphere", -1.5, 1.0, 1.0, 0.0), ("cylinder", 1.0, -1.0, 0.0, 0.0), ("sphere", -1.5, -1.0, 1.0, 0.0))
    states, config = seen(run(start, 60), start.body), PhysicsConfig(runs=1000)
    detected = states.detected.copy()
    detected[2, :50] = False
    scene = PhysicsPredictor(Detector(), config).explain(replace(states, detected=detected))
    errors = scene.perturbations.state  # (R, n, F, 6)

    def scale(values: np.ndarray) -> float:
        """Of Student's t with 4 degrees of freedom, by its median."""
        return float(np.median(abs(values))) / 0.741

    noise = config.position_noise_world
    for i, n in ((0, 60), (2, 10)):
        velocity = noise / (CLEVRER_WORLD.physics.frame_seconds * np.sqrt(n * (n**2 - 1) / 12))
        assert scale(errors[:, i, 0, VELOCITY]) == pytest.approx(velocity, rel=0.15)
        last = np.hypot(noise / np.sqrt(n), velocity * CLEVRER_WORLD.physics.frame_seconds * (n - 1) / 2)
        assert scale(errors[:, i, -1, POSITION]) == pytest.approx(last, rel=0.2)
    assert not errors[:, 1, :, VELOCITY].any()  # it rests
    assert scale(errors[:, 1, 0, POSITION]) == pytest.approx(noise / np.sqrt(60), rel=0.15)


def test_collisions_from_velocity_alone() -> None:
    motion = run(TWO)
    rollout = Rollout(motion.states[..., POSITION], np.ones((2, 128), bool), ())
    found = collisions_from_motion(rollout, CLEVRER_CAMERA)
    assert [e.objects for e in found] == [(0, 1)]
    assert found[0].frame == pytest.approx(motion.contacts[0, 0, 1], abs=5)
    position = motion.states[..., POSITION].copy()
    position[:, :4] = np.nan  # seen from frame 4 on
    assert collisions_from_motion(replace(rollout, location_world=position), CLEVRER_CAMERA) == found


def test_patch_boxes_ignore_what_hides_an_object_and_reach_back_before_the_video() -> None:
    position = np.zeros((1, 20, 2))
    position[0, :, 1] = np.linspace(-0.5, 0.45, 20)  # along the image's rows, to the right
    box = np.full((1, 20, 4), 40.0)
    reliable = np.ones((1, 20), bool)
    box[0, 5:10, 2], reliable[0, 5:10] = 10.0, False  # half hidden
    found = patch_boxes(position, 0.2, box, reliable, 4, CLEVRER_WORLD)[0] * np.array(box_scale(CLEVRER_WORLD))
    assert found.shape == (24, 4)
    np.testing.assert_allclose(found[:, 2:], 40.0)
    np.testing.assert_allclose(np.diff(found[:, 0]), found[1, 0] - found[0, 0], atol=1e-6)
    np.testing.assert_allclose(found[14, 0], 0.0, atol=0.1 * abs(found[-1, 0]))


class Clock(torch.nn.Module):
    """A patch network that reads the time from where object 0 is (100 frames cross the image), and sees one collision
    at frame 60, but only after it; all keep their speed."""

    def __init__(self) -> None:
        super().__init__()
        self.config = PatchPropNetConfig()

    def forward(
        self, boxes: torch.Tensor, static: torch.Tensor, exists: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        now = 50 * (boxes[:, 0, -1, 0] + 1)
        logits = torch.full((*boxes.shape[:2], boxes.shape[1], 3), -9.0)
        for k in (1, 2):
            logits[(now - 5 * k < 60) & (now - 5 * k >= 55), ..., k] = 9.0
        return 2 * boxes[:, :, -1] - boxes[:, :, -2], logits


def clock_states(first_seen: int) -> MotionStates:
    """Object 0 crosses the image, object 1, not seen before a frame, goes the other way."""
    columns = np.stack([np.arange(100) * 4.8, 480 - np.arange(100) * 4.8])
    pixels = np.stack([columns, np.full((2, 100), 200.0)], -1)
    present = np.ones((2, 100), bool)
    present[1, :first_seen] = False
    objects = tuple(SceneObject(i, COLORS[i], "metal", "sphere") for i in range(2))
    box = np.concatenate([pixels, np.full((2, 100, 2), 40.0)], -1)
    return MotionStates(objects, CLEVRER_CAMERA.ground(pixels), present, present, present, box)


def test_the_papers_observer_sees_collisions_by_what_comes_after_them() -> None:
    events = PatchPropNetPredictor(Clock()).observed_collisions(clock_states(0))  # type: ignore[arg-type]
    assert [e.objects for e in events] == [(0, 1)]
    assert events[0].frame == pytest.approx(60, abs=3)


def test_late_objects_enter_the_papers_rollouts_from_observation() -> None:
    states = clock_states(31)
    removals = PatchPropNetPredictor(Clock()).explain(states).counterfactual  # type: ignore[arg-type]
    without_0, without_1 = removals[0], removals[1]
    assert np.isnan(without_0.location_world[1, :31]).all()
    assert np.isnan(without_1.location_world[1]).all()
    np.testing.assert_allclose(without_0.location_world[1, 31:100], states.location_world[1, 31:], atol=1e-3)
    np.testing.assert_allclose(without_1.location_world[0, :100], states.location_world[0], atol=1e-3)


def test_the_patch_network_is_permutation_equivariant_and_draws_masks() -> None:
    torch.manual_seed(0)
    model = PatchPropNet(PatchPropNetConfig(hidden=16))
    boxes, static = torch.rand(1, 4, 3, 4) * 0.5, torch.rand(1, 4, 5)
    exists, order = torch.ones(1, 4, dtype=torch.bool), torch.tensor([2, 0, 3, 1])
    positions, logits = model(boxes, static, exists)
    positions_2, logits_2 = model(boxes[:, order], static[:, order], exists)
    torch.testing.assert_close(positions_2, positions[:, order])
    torch.testing.assert_close(logits_2, logits[:, order][:, :, order])
    masks = model._masks(boxes, boxes[:, :, -1, :2])
    area = boxes[..., -1, 2] * boxes[..., -1, 3] * 50 * 50 / 4.0**2
    torch.testing.assert_close(masks[:, :, 2].sum((-1, -2)), area)


def test_backends_are_found_by_name_or_file(tmp_path) -> None:
    folder = find_checkpoint()
    assert isinstance(load_backend("physics", folder), PhysicsPredictor)
    assert isinstance(load_backend("propnet", folder), PropNetPredictor)
    file = tmp_path / "mine.yaml"
    file.write_text("backend: propnet\ncollisions: velocity\n")
    backend = load_backend(file, folder)
    assert isinstance(backend, VelocityEvents)
    assert isinstance(backend.backend, PropNetPredictor)
    assert load_backend("configs/dynamics/physics.yaml", folder).config == PhysicsConfig()  # type: ignore[attr-defined]
    file.write_text("backend: physics\nphysics: {runs: 7}\n")
    physics = load_backend(file, folder)
    assert isinstance(physics, PhysicsPredictor)
    assert physics.config.runs == 7
    with pytest.raises(DataError, match="'magic': expected one of physics, propnet, propnet_patches"):
        load_backend("magic", folder)
    with pytest.raises(DataError, match=r"collisions: Expected one of predicted, velocity, got "):
        load_backend(BackendConfig(collisions="none"), folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("physics: {smoothing: {min_frames: 5}}", "smoothing"),
        ("backend: propnet\nphysics: {runs: 5}", "physics would do nothing with dynamics 'propnet'"),
    ],
)
def test_settings_that_would_do_nothing_are_refused(tmp_path, text: str, message: str) -> None:
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises((DataError, jsonargparse.ArgumentError), match=message):
        backend_settings(tmp_path / "mine.yaml")


def test_the_papers_backend_takes_the_checkpoint_it_is_given(paper: PatchPropNetPredictor, tmp_path) -> None:
    paper.save_pretrained(tmp_path)
    config = BackendConfig("propnet_patches")
    assert load_backend(config, tmp_path).config == paper.config  # type: ignore[attr-defined]
    assert weights_folder(tmp_path, config) == tmp_path
    default = find_checkpoint()
    assert load_backend(config, default).config.hidden == 512  # type: ignore[attr-defined]
    assert weights_folder(default, config) == find_checkpoint("propnet_patches")


def test_weights_of_ones_own_need_no_shipped_ones(paper: PatchPropNetPredictor, tmp_path, monkeypatch) -> None:
    paper.save_pretrained(tmp_path)

    monkeypatch.setattr("nsdr.io.checkpoint.shipped_folders", lambda _: [])
    assert load_backend("propnet_patches", tmp_path).config == paper.config  # type: ignore[attr-defined]


def test_checkpoints_of_another_network_are_named(
    observer: PropNetPredictor, paper: PatchPropNetPredictor, tmp_path
) -> None:
    observer.save_pretrained(tmp_path / "propnet")
    paper.save_pretrained(tmp_path / "propnet_patches")
    with pytest.raises(
        CheckpointError, match=r"propnet/dynamics\.json: expected a network of PatchPropNetConfig.*side_steps"
    ):
        load_backend("propnet_patches", tmp_path / "propnet")
    with pytest.raises(
        CheckpointError, match=r"propnet_patches/dynamics\.json: expected a network of PropNetConfig.*patch_cells"
    ):
        load_backend("propnet", tmp_path / "propnet_patches")
    description = tmp_path / "propnet" / "dynamics.json"
    for old, new, reason in (
        ('"hidden": 16', '"hidden": 8', "size mismatch"),
        ('"hidden": 8', '"hidden": "x"', "hidden"),
    ):
        description.write_text(description.read_text().replace(old, new))
        with pytest.raises(CheckpointError, match=rf"dynamics\.json: .*{reason}"):
            PropNetPredictor.from_checkpoint(tmp_path / "propnet")


def test_too_short_a_past_is_refused() -> None:
    assert PropNet(PropNetConfig(hidden=4, past_steps=4)).config.past_steps == 4
    with pytest.raises(DataError, match=r"past_steps"):
        PropNetConfig(past_steps=3)

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from nsdr import DataError, Event, Explanation, PropNetPredictor, Rollout
from nsdr.clevrer.files.annotations import read_truth
from nsdr.dynamics import StoredExplanation
from nsdr.dynamics.metrics import collision_scores, rollout_errors
from nsdr.dynamics.motion_states import MotionStates, extrapolate, states_from_tracks
from nsdr.dynamics.propnet.data import read_motion_dataset
from nsdr.dynamics.propnet.layers import PropagationNetwork, mlp
from nsdr.dynamics.propnet.state_model import PropNet, PropNetConfig
from nsdr.dynamics.sliding import law_of, slide
from nsdr.dynamics.stretch import fit_stretch
from nsdr.dynamics.track_smoothing import frames_in_image, smooth_tracks
from nsdr.tracking.localization import outline
from nsdr.tracking.tracker import track
from nsdr.tracking.visibility import in_image
from nsdr.types import DynamicsPrediction, SceneObject, Track, VideoTracks
from nsdr.world.camera import CLEVRER_CAMERA, on_ground
from nsdr.world.shapes import extent, surface_points
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

from .test_frame_parser import BLUE, GREEN, RED, as_proposals, moving

LAWS = {shape: law_of(SceneObject(0, "red", "metal", shape), CLEVRER_WORLD) for shape in CLEVRER.words["shape"]}

SMALL = PropNetConfig(hidden=16)


def explained(predictor: PropNetPredictor, video: VideoTracks) -> DynamicsPrediction:
    return predictor.explain(states_from_tracks(video)).prediction


@pytest.fixture
def predictor() -> PropNetPredictor:
    torch.manual_seed(0)
    return PropNetPredictor(PropNet(SMALL))


def test_propnet_is_permutation_equivariant() -> None:
    torch.manual_seed(0)
    net = PropagationNetwork(mlp(4, 16, 16), mlp(3, 16, 16), 2, 1, hidden=16)
    objects, relations = torch.randn(1, 5, 4), torch.randn(1, 5, 5, 3)
    exists = torch.ones(1, 5, dtype=torch.bool)
    order = torch.tensor([3, 1, 4, 0, 2])
    motion, pairs = net(objects, relations, exists)
    motion_2, pairs_2 = net(objects[:, order], relations[:, order][:, :, order], exists)
    torch.testing.assert_close(motion_2, motion[:, order])
    torch.testing.assert_close(pairs_2, pairs[:, order][:, :, order])


def test_absent_objects_have_no_influence() -> None:
    torch.manual_seed(0)
    net = PropagationNetwork(mlp(4, 16, 16), mlp(3, 16, 16), 2, 1, hidden=16)
    objects, relations = torch.randn(1, 3, 4), torch.randn(1, 3, 3, 3)
    exists = torch.tensor([[True, True, False]])
    motion, _ = net(objects, relations, exists)
    objects[0, 2] += 5
    relations[0, :, 2] += 5
    motion_2, _ = net(objects, relations, exists)
    torch.testing.assert_close(motion[:, :2], motion_2[:, :2])


def tracks(n_frames: int = 40) -> VideoTracks:
    rows = moving(range(n_frames), RED, 50, 4) + moving(range(n_frames), BLUE, 300, 0)
    rows += moving(range(12, n_frames), GREEN, 400, -0.4)
    return track(as_proposals(rows, n_frames))


def test_states_interpolate_and_continue_in_a_straight_line() -> None:
    rows = moving([f for f in range(5, 30) if f not in (15, 16)], RED, 50, 4)
    states = states_from_tracks(track(as_proposals(rows)))
    assert states.present[0].sum() == 25
    assert not states.detected[0, 15]
    step = np.diff(states.location_world[0], axis=0)
    assert abs(step[14:17] - step[13]).max() < 0.01
    assert abs(step[32:] - step[28]).max() < 0.02


def test_a_hidden_object_is_not_reliable() -> None:
    rows = moving(range(40), RED, 300, 0)
    near = [
        (f, a, s, (x, y + 20), [b[0], b[1] + 20, b[2], b[3] + 20])
        for f, a, s, (x, y), b in moving(range(40), BLUE, 200, 4)
    ]
    states = states_from_tracks(track(as_proposals(rows + near)))
    red = next(o.id for o in states.objects if o.color == "red")
    assert states.reliable[red, :15].all()
    assert not states.reliable[red, 25]
    assert states.reliable[1 - red].all()


def test_prediction_has_every_rollout_and_keeps_the_observed_motion(predictor: PropNetPredictor) -> None:
    prediction = explained(predictor, tracks())
    assert prediction.observed.location_world.shape == (3, CLEVRER_WORLD.timeline.horizon_frame(40) + 1, 2)
    assert not np.isnan(prediction.observed.location_world).any()
    assert set(prediction.counterfactual) == {0, 1, 2}
    for removed, rollout in prediction.counterfactual.items():
        assert np.isnan(rollout.location_world[removed]).all()
        assert not rollout.visible[removed].any()
        assert all(removed not in e.objects for e in rollout.collisions)
    expected = states_from_tracks(tracks()).location_world
    # The third object is left out: it enters more slowly than any object in CLEVRER.
    np.testing.assert_allclose(prediction.observed.location_world[:2, :39], expected[:2, :39], atol=0.02)


def test_prediction_is_deterministic_and_survives_saving(predictor, tmp_path) -> None:
    from nsdr.io.checkpoint import save_checkpoint

    save_checkpoint(tmp_path, "dynamics", predictor.model.state_dict(), SMALL, {})
    first, second = explained(predictor, tracks()), explained(PropNetPredictor.from_checkpoint(tmp_path), tracks())
    np.testing.assert_array_equal(first.observed.location_world, second.observed.location_world)
    assert first.observed.collisions == second.observed.collisions


def test_a_video_with_one_object_or_none(predictor: PropNetPredictor) -> None:
    one = explained(predictor, track(as_proposals(moving(range(40), RED, 50, 4))))
    assert one.observed.collisions == ()
    none = explained(predictor, VideoTracks(128, ()))
    assert none.objects == ()
    assert dict(none.counterfactual) == {}


class _Script(PropNet):
    """Moves every object in a straight line; a pair collides when its centres are closer than a diameter."""

    def predict(self, window, reliable, static, exists):
        position = 2 * window[:, :, -1] - window[:, :, -2]
        return position, 50 * (0.4 - torch.cdist(position, position))

    def observe(self, window, reliable, static, exists):
        middle = window[:, :, self.config.side_steps]
        return 50 * (0.4 - torch.cdist(middle, middle))


def test_removal_changes_only_what_depends_on_the_removed_object() -> None:
    # Red hits blue at about frame 36, and green rests far away. Without blue, red moves on; without green, nothing changes.
    speed, n = 4, 60
    rows = [r for r in moving(range(n), RED, 100, speed) if r[0] < 45] + moving(range(45, n), RED, 280, 0)
    rows += moving(range(n), BLUE, 300, 0) + moving(range(n), GREEN, 30, 0)
    video = track(as_proposals(rows, n))
    ids = {t.object.color: t.object.id for t in video.tracks}
    prediction = explained(PropNetPredictor(_Script(SMALL)), video)
    hits = [e.objects for e in prediction.observed.collisions if e.frame < n]
    assert hits == [tuple(sorted((ids["red"], ids["blue"])))]
    without_green = prediction.counterfactual[ids["green"]]
    assert [e.objects for e in without_green.collisions if e.frame < n] == hits
    np.testing.assert_allclose(
        without_green.location_world[ids["red"], :n], prediction.observed.location_world[ids["red"], :n]
    )
    without_blue = prediction.counterfactual[ids["blue"]]
    assert all(ids["blue"] not in e.objects for e in without_blue.collisions)
    red = without_blue.location_world[ids["red"]]
    assert np.linalg.norm(red[n - 1] - prediction.observed.location_world[ids["red"], n - 1]) > 0.1


def test_collision_scores() -> None:
    true = [Event("collision", 20, (0, 1)), Event("collision", 40, (1, 2))]
    predicted = [Event("collision", 22, (0, 1)), Event("collision", 60, (1, 2)), Event("collision", 5, (0, 2))]
    scores = collision_scores([(predicted, true)])
    assert scores == {
        "collision_precision": pytest.approx(1 / 3),
        "collision_recall": 0.5,
        "collision_f1": pytest.approx(0.4),
    }


def test_collisions_of_a_pair_that_meets_twice_count_one_by_one() -> None:
    twice = [Event("collision", 20, (0, 1)), Event("collision", 90, (0, 1))]
    assert set(collision_scores([(twice, twice)]).values()) == {1.0}
    assert collision_scores([(twice[:1], twice)])["collision_recall"] == 0.5
    near = [Event("collision", 21, (0, 1)), Event("collision", 22, (0, 1))]
    assert collision_scores([(near, twice)])["collision_precision"] == 0.5


def test_motion_data(tiny_motion) -> None:
    data = read_motion_dataset(*tiny_motion)
    assert len(data) == 4
    states, events = data.states(0)
    assert len(states.objects) == 2
    assert [e.frame for e in events] == [40]
    with pytest.raises(DataError, match="not a readable JSON file"):
        read_truth(tiny_motion[0])


def test_rollout_errors_are_small_for_straight_motion() -> None:
    states = states_from_tracks(tracks(n_frames=60))
    errors = rollout_errors(PropNetPredictor(_Script(SMALL)), [states], starts=(40,))
    assert errors["rollout_error_10"] < 0.08
    assert np.isnan(errors["rollout_error_50"])


def test_rollouts_are_measured_from_what_was_known_at_their_start() -> None:
    """Red is hidden at the start, and when it is seen again it has turned; green comes later."""
    frames = [f for f in range(60) if not 25 <= f < 45]
    rows = [(f, a, s, (x, y + max(f - 45, 0)), b) for f, a, s, (x, y), b in moving(frames, RED, 50, 4)]
    shown = []

    class Remembers:
        def explain(self, states: MotionStates, collisions: Sequence[Event] | None = None) -> Explanation:
            shown.append(states)
            still = Rollout(np.zeros((1, 90, 2)), np.zeros((1, 90), bool), ())
            return StoredExplanation(DynamicsPrediction(states.objects, states.n_frames, still))

    video = track(as_proposals(rows + moving(range(46, 60), GREEN, 400, -0.4), 60))
    states = states_from_tracks(video)
    patches = np.broadcast_to(np.arange(60, dtype=np.uint8)[:, None, None, None], (2, 60, 4, 1, 1))
    rollout_errors(Remembers(), [replace(states, patches=patches)], starts=(40,))
    [known] = shown
    early = track(as_proposals([row for row in rows if row[0] < 40], 40))
    expected = states_from_tracks(early)
    assert known.objects == expected.objects
    for name in ("location_world", "detected", "reliable", "present", "box_px"):
        np.testing.assert_array_equal(getattr(known, name), getattr(expected, name))
    assert known.patches is not None
    assert known.patches.max() == 24


def test_positions_continue_in_straight_lines_beyond_the_video() -> None:
    positions = np.stack([np.arange(20.0), np.zeros(20)], 1)[None]
    longer = extrapolate(positions, 3)
    np.testing.assert_allclose(longer[0, :, 0], np.arange(-3.0, 23.0))
    assert extrapolate(positions[:, :1], 2).shape == (1, 5, 2)
    assert extrapolate(positions, 0).shape == positions.shape


@pytest.mark.parametrize("shape", ["cube", "cylinder", "sphere"])
def test_free_sliding_follows_the_law_of_deceleration(shape: str) -> None:
    friction = 0.0 if shape == "sphere" else 0.03 * 9.81
    expected_distance, expected_speed = 0.0, 1.2
    for _ in range(7000):  # 1.4 s in steps of 0.2 ms
        deceleration = friction + 0.04 * expected_speed + 0.04 * expected_speed**2
        expected_speed = max(expected_speed - deceleration * 2e-4, 0.0)
        expected_distance += expected_speed * 2e-4
    distance, final_speed = slide(LAWS[shape], np.array(1.2), np.array(1.4))
    assert float(distance) == pytest.approx(expected_distance, abs=2e-3)
    assert float(final_speed) == pytest.approx(expected_speed, abs=2e-3)
    distance_back, initial_speed = slide(LAWS[shape], final_speed, np.array(-1.4))
    assert float(initial_speed) == pytest.approx(1.2, abs=5e-3)
    assert float(distance_back) == pytest.approx(-expected_distance, abs=5e-3)


def test_objects_with_friction_stop_and_stay() -> None:
    distance, speed = slide(LAWS["cube"], np.array(0.2), np.array([0.5, 2.0, 9.0]))
    assert speed.tolist()[1:] == [0.0, 0.0]
    assert distance[1] == distance[2]


def test_free_sliding_is_fitted_through_noise_and_outliers() -> None:
    rng = np.random.default_rng(0)
    frames = np.arange(40)
    distance, _ = slide(LAWS["cylinder"], np.array(2.0), frames * CLEVRER_WORLD.physics.frame_seconds)
    positions = np.array([-1.0, 0.5]) + distance[:, None] * np.array([0.6, 0.8]) + rng.normal(size=(40, 2)) * 0.006
    positions[10:14] += 0.3
    stretch = fit_stretch(LAWS["cylinder"], frames, positions, np.ones(40))
    np.testing.assert_allclose(stretch.motion, [-1.0, 0.5, 1.2, 1.6], atol=0.03)
    assert stretch.median_residual < 0.02
    np.testing.assert_allclose(stretch.position_at(np.array([39.0])), positions[39:], atol=0.03)


def states_of(shape: str, positions: np.ndarray, seen: np.ndarray) -> MotionStates:
    """One object at positions (F, 2), detected in some frames."""
    present = np.zeros(len(positions), bool)
    present[np.flatnonzero(seen)[0] : np.flatnonzero(seen)[-1] + 1] = True
    o = SceneObject(0, "red", "metal", shape)
    return MotionStates(
        (o,), positions[None].copy(), seen[None], seen[None], present[None], np.zeros((1, len(seen), 4))
    )


def test_a_resting_object_has_no_speed_until_it_is_hit() -> None:
    rng = np.random.default_rng(1)
    distance, _ = slide(
        LAWS["cube"], np.array(0.5), np.maximum(np.arange(128) - 50, 0) * CLEVRER_WORLD.physics.frame_seconds
    )
    positions = np.stack([distance, 0 * distance], 1) + rng.normal(size=(128, 2)) * 0.005
    motion = smooth_tracks(states_of("cube", positions, np.ones(128, bool)), [Event("collision", 50, (0, 1))])
    moving = np.linalg.norm(motion.velocity_world_per_s[0], axis=1) > 0.02
    assert not moving[:50].any()
    assert moving[52:95].all()
    assert not moving[115:].any()  # it has slid to a stop
    assert motion.visible.all()


def boxes_in_image(shape: str, positions: np.ndarray, yaw: float) -> np.ndarray:
    """(F, 4) left, top, right and bottom of the parts of outlines at positions (F, 2) that are in the image."""
    outlines = [outline(shape, x, y, yaw) for x, y in positions]
    sides = np.array([[*np.round(o.min(0)), *np.round(o.max(0))] for o in outlines])
    return np.clip(sides, 0, [480, 320, 480, 320])


def boxed_states(shape: str, positions: np.ndarray, seen: np.ndarray, box_xyxy_px: np.ndarray) -> MotionStates:
    centre, size = (box_xyxy_px[:, :2] + box_xyxy_px[:, 2:]) / 2, box_xyxy_px[:, 2:] - box_xyxy_px[:, :2]
    return replace(states_of(shape, positions, seen), box_px=np.concatenate([centre, size], 1)[None])


@pytest.mark.parametrize(
    ("shape", "yaw", "x"),
    [("sphere", 0.0, 0.0), ("cylinder", 0.0, 1.0), *(("cube", yaw, 0.6) for yaw in (0.0, 0.5, 0.8, 1.2))],
)
def test_objects_enter_and_exit_with_the_first_and_last_bit_of_their_outline(shape: str, yaw: float, x: float) -> None:
    distance, _ = slide(LAWS[shape], np.array(2.8), np.arange(128) * CLEVRER_WORLD.physics.frame_seconds)
    positions = np.stack([x + 0 * distance, -3.2 + distance], 1)  # from the left to the right
    shown = in_image(shape, on_ground(positions), np.full(128, yaw))
    first, last = np.flatnonzero(shown)[[0, -1]]
    seen = shown.copy()
    seen[: first + 2] = seen[last - 1 :] = False  # detected late, lost early
    box = boxes_in_image(shape, positions, yaw)
    motion = smooth_tracks(boxed_states(shape, positions, seen, box), [])
    assert first > 0
    assert np.flatnonzero(motion.visible[0]).tolist() == np.arange(first, last + 1).tolist()


@pytest.mark.parametrize("shape", ["cube", "sphere", "cylinder"])
def test_the_extent_of_a_shape_is_that_of_its_surface(shape: str) -> None:
    rng = np.random.default_rng(3)
    direction, yaw = rng.normal(size=(40, 3)), rng.uniform(-4, 4, 12)
    expected = np.stack([(surface_points(shape, angle) @ direction.T).max(0) for angle in yaw])
    found = np.broadcast_to(extent(shape, direction, yaw), expected.shape)
    np.testing.assert_allclose(found, expected, rtol=0.005)  # the points of a round surface lie beside its extremes
    assert (found > expected - 1e-12).all()


def test_an_object_whose_box_shrinks_at_the_border_leaves_although_the_fit_rests() -> None:
    location = np.tile(CLEVRER_CAMERA.ground([5.0, 150.0]), (60, 1))
    detected = np.arange(60) < 40
    box = np.tile([0.0, 130.0, 20.0, 170.0], (60, 1))
    box[30:40, 2] = np.arange(12, 2, -1)
    visible = frames_in_image(CLEVRER.shape("sphere"), location, detected, box, CLEVRER_CAMERA)
    assert visible[:42].all()
    assert not visible[48:].any()
    box[30:40, 2] = 3.0
    assert frames_in_image(CLEVRER.shape("sphere"), location, detected, box, CLEVRER_CAMERA).all()


def test_masks_that_are_cut_at_the_top_do_not_delay_an_entrance() -> None:
    distance, _ = slide(LAWS["sphere"], np.array(2.8), np.arange(128) * CLEVRER_WORLD.physics.frame_seconds)
    positions = np.stack([distance - 8, 0 * distance], 1)
    shown = in_image("sphere", on_ground(positions), np.zeros(128))
    first = int(shown.argmax())
    seen = np.arange(128) >= first + 8
    box = boxes_in_image("sphere", positions, 0.0) - [0, 0, 0, 4]
    motion = smooth_tracks(boxed_states("sphere", positions, seen, box), [])
    assert first > 0
    assert abs(int(motion.visible[0].argmax()) - first) <= 1


def test_an_object_at_the_border_at_the_end_does_not_leave(predictor: PropNetPredictor) -> None:
    (x, y) = CLEVRER_CAMERA.ground([471.0, 150.0])
    u, v = CLEVRER_CAMERA.pixels([x, y, 0.2])
    box = np.tile([int(u) - 17, int(v) - 17, 480, int(v) + 17], (128, 1))
    centroid = np.tile([475.0, 150.0], (128, 1))
    o = SceneObject(0, "red", "metal", "sphere")
    track = Track(o, np.arange(128), np.tile([x, y], (128, 1)), centroid, box, np.ones(128))
    prediction = explained(predictor, VideoTracks(128, (track,)))
    assert prediction.observed.visible[0, :128].all()

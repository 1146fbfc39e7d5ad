import numpy as np
import pytest
import torch

from nsdr import DataError, DynamicsPredictor, Event
from nsdr.dynamics.data import read_motion_data, read_truth
from nsdr.dynamics.metrics import collision_scores, rollout_errors
from nsdr.dynamics.model import DynamicsConfig, DynamicsModel
from nsdr.dynamics.predictor import UNSEEN_FRAMES, in_picture
from nsdr.dynamics.propnet import PropNet
from nsdr.dynamics.states import extended, states_from_tracks, visible_frames
from nsdr.frame_parser.tracker import track
from nsdr.types import VideoTracks

from .test_frame_parser import BLUE, GREEN, RED, as_proposals, moving

SMALL = DynamicsConfig(hidden=16)


@pytest.fixture
def predictor() -> DynamicsPredictor:
    torch.manual_seed(0)
    return DynamicsPredictor(DynamicsModel(SMALL))


def test_propnet_is_permutation_equivariant() -> None:
    torch.manual_seed(0)
    net = PropNet(4, 3, 2, 1, hidden=16)
    objects, relations = torch.randn(1, 5, 4), torch.randn(1, 5, 5, 3)
    exists = torch.ones(1, 5, dtype=torch.bool)
    order = torch.tensor([3, 1, 4, 0, 2])
    motion, pairs = net(objects, relations, exists)
    motion_2, pairs_2 = net(objects[:, order], relations[:, order][:, :, order], exists)
    torch.testing.assert_close(motion_2, motion[:, order])
    torch.testing.assert_close(pairs_2, pairs[:, order][:, :, order])


def test_absent_objects_have_no_influence() -> None:
    torch.manual_seed(0)
    net = PropNet(4, 3, 2, 1, hidden=16)
    objects, relations = torch.randn(1, 3, 4), torch.randn(1, 3, 3, 3)
    exists = torch.tensor([[True, True, False]])
    motion, _ = net(objects, relations, exists)
    objects[0, 2] += 5
    relations[0, :, 2] += 5
    motion_2, _ = net(objects, relations, exists)
    torch.testing.assert_close(motion[:, :2], motion_2[:, :2])


def tracks(n_frames: int = 40) -> VideoTracks:
    rows = moving(range(n_frames), RED, 50, 4) + moving(range(n_frames), BLUE, 300, 0)
    rows += moving(range(12, n_frames), GREEN, 400, -1)
    return track(as_proposals(rows, n_frames))


def test_states_interpolate_and_continue_in_a_straight_line() -> None:
    rows = moving([f for f in range(5, 30) if f not in (15, 16)], RED, 50, 4)
    states = states_from_tracks(track(as_proposals(rows)))
    assert states.present[0].sum() == 25
    assert not states.detected[0, 15]
    step = np.diff(states.location_world[0], axis=0)
    assert abs(step[14:17] - step[13]).max() < 0.01
    assert abs(step[32:] - step[28]).max() < 0.02


def test_visible_frames_reach_a_little_beyond_the_detections() -> None:
    rows = moving(range(5, 30), RED, 50, 4) + moving(range(1, 40), BLUE, 300, 0)
    states = states_from_tracks(track(as_proposals(rows)))
    visible = visible_frames(states)
    by_color = {o.color: visible[o.id] for o in states.objects}
    assert np.flatnonzero(by_color["red"])[[0, -1]].tolist() == [4, 31]
    assert by_color["blue"].all()


def test_a_covered_object_is_not_reliable() -> None:
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


def test_prediction_has_every_rollout_and_keeps_the_observed_motion(predictor: DynamicsPredictor) -> None:
    prediction = predictor.predict(tracks())
    assert prediction.observed.location_world.shape == (3, 40 + UNSEEN_FRAMES, 2)
    assert not np.isnan(prediction.observed.location_world).any()
    assert set(prediction.counterfactual) == {0, 1, 2}
    for removed, rollout in prediction.counterfactual.items():
        assert np.isnan(rollout.location_world[removed]).all()
        assert not rollout.visible[removed].any()
        assert all(removed not in e.objects for e in rollout.collisions)
    expected = states_from_tracks(tracks()).location_world
    np.testing.assert_allclose(prediction.observed.location_world[:, :39], expected[:, :39])


def test_prediction_is_the_same_twice_and_survives_saving(predictor, tmp_path) -> None:
    from nsdr.checkpoint import save_checkpoint

    save_checkpoint(tmp_path, "dynamics", predictor.model.state_dict(), SMALL, {})
    first, second = predictor.predict(tracks()), DynamicsPredictor.from_checkpoint(tmp_path).predict(tracks())
    np.testing.assert_array_equal(first.observed.location_world, second.observed.location_world)
    assert first.observed.collisions == second.observed.collisions


def test_a_video_with_one_object_or_none(predictor: DynamicsPredictor) -> None:
    one = predictor.predict(track(as_proposals(moving(range(40), RED, 50, 4))))
    assert one.observed.collisions == ()
    none = predictor.predict(VideoTracks(128, ()))
    assert none.objects == ()
    assert dict(none.counterfactual) == {}


class _Script(DynamicsModel):
    """Goes straight on; hits when centres come closer than a diameter."""

    def predict(self, window, reliable, static, exists):
        place = 2 * window[:, :, -1] - window[:, :, -2]
        return place, 50 * (0.4 - torch.cdist(place, place))

    def observe(self, window, reliable, static, exists):
        middle = window[:, :, self.config.side_steps]
        return 50 * (0.4 - torch.cdist(middle, middle))


def test_removal_changes_only_what_depends_on_the_removed_object() -> None:
    # Red runs into blue at frame ~36; green rests far away. Without blue, red goes on; without green, nothing changes.
    speed, n = 4, 60
    rows = [r for r in moving(range(n), RED, 100, speed) if r[0] < 45] + moving(range(45, n), RED, 280, 0)
    rows += moving(range(n), BLUE, 300, 0) + moving(range(n), GREEN, 30, 0)
    video = track(as_proposals(rows, n))
    ids = {t.object.color: t.object.id for t in video.tracks}
    prediction = DynamicsPredictor(_Script(SMALL)).predict(video)
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


def test_in_picture() -> None:
    assert in_picture(np.array([[0.0, 0.0], [0.0, 9.0], [30.0, 0.0]])).tolist() == [True, False, False]


def test_collision_scores() -> None:
    true = [Event("collision", 20, (0, 1)), Event("collision", 40, (1, 2))]
    predicted = [Event("collision", 22, (0, 1)), Event("collision", 60, (1, 2)), Event("collision", 5, (0, 2))]
    scores = collision_scores([(predicted, true)])
    assert scores == {
        "collision_precision": pytest.approx(1 / 3),
        "collision_recall": 0.5,
        "collision_f1": pytest.approx(0.4),
    }


def test_motion_data(tiny_motion, tmp_path) -> None:
    data = read_motion_data(*tiny_motion, cache=tmp_path / "cache.npz")
    assert len(data) == 4
    states, events = data.states(0)
    assert len(states.objects) == 2
    assert [e.frame for e in events] == [40]
    again = read_motion_data("not there", "nor there", cache=tmp_path / "cache.npz")
    np.testing.assert_array_equal(again.location_world, data.location_world)
    with pytest.raises(DataError, match="not a file of ground-truth blocks"):
        read_truth(tiny_motion[0])


def test_rollout_errors_are_small_for_straight_motion() -> None:
    states = states_from_tracks(tracks(n_frames=60))
    errors = rollout_errors(DynamicsPredictor(_Script(SMALL)), [states], starts=(40,))
    assert errors["rollout_error_10"] < 0.08
    assert np.isnan(errors["rollout_error_50"])


def test_places_continue_in_straight_lines_beyond_the_video() -> None:
    places = np.stack([np.arange(20.0), np.zeros(20)], 1)[None]
    longer = extended(places, 3)
    np.testing.assert_allclose(longer[0, :, 0], np.arange(-3.0, 23.0))
    assert extended(places[:, :1], 2).shape == (1, 5, 2)
    assert extended(places, 0).shape == places.shape

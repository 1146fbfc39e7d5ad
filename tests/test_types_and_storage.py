import numpy as np
import pytest

from nsdr import DataError, DynamicsPrediction, Event, Rollout, Scene, SceneObject, VideoProposals, load, save
from nsdr.tracking.tracker import track
from nsdr.types import VideoTracks


def proposals(n: int = 20) -> VideoProposals:
    frames = np.arange(n)
    box = np.tile([[100, 100, 140, 140]], (n, 1))
    centroid = np.tile([[120.0, 120.0]], (n, 1))
    return VideoProposals(n, frames, np.full(n, 7), np.full(n, 0.99), centroid, np.full(n, 1200), box)


def test_unknown_attribute_names_the_value() -> None:
    with pytest.raises(DataError, match="unknown color 'pink'"):
        SceneObject(0, "pink", "metal", "cube")


def test_wrong_shape_names_expected_and_actual() -> None:
    p = proposals()
    with pytest.raises(DataError, match=r"score: expected shape \(20,\), got \(3,\)"):
        VideoProposals(20, p.frame_index, p.attribute, p.score[:3], p.centroid_px, p.area_px, p.box_xyxy_px)


def test_frames_outside_the_video_are_refused() -> None:
    p = proposals()
    with pytest.raises(DataError, match="outside 0-9"):
        VideoProposals(10, p.frame_index, p.attribute, p.score, p.centroid_px, p.area_px, p.box_xyxy_px)


def test_the_same_attribute_triple_twice_is_refused() -> None:
    objects = (SceneObject(0, "red", "metal", "cube"), SceneObject(1, "red", "metal", "cube"))
    with pytest.raises(DataError, match="more than one red metal cube"):
        Scene(objects, 5, np.ones((2, 5), bool), None, ())


def test_an_event_beyond_the_objects_is_refused() -> None:
    with pytest.raises(DataError, match="names an object beyond"):
        Scene((SceneObject(0, "red", "metal", "cube"),), 5, np.ones((1, 5), bool), None, (Event("in", 1, (3,)),))


def test_collision_needs_two_ascending_objects() -> None:
    with pytest.raises(DataError, match="2 ascending object ids"):
        Event("collision", 1, (3, 1))


def test_dataclasses_are_frozen(small_scene: Scene) -> None:
    with pytest.raises(AttributeError):
        small_scene.n_frames = 3  # type: ignore[misc]


@pytest.mark.parametrize("ending", [".json", ".npz"])
def test_scene_survives_a_round_trip(small_scene: Scene, tmp_path, ending) -> None:
    save(small_scene, tmp_path / f"scene{ending}")
    back = load(Scene, tmp_path / f"scene{ending}")
    assert back.objects == small_scene.objects
    assert back.events == small_scene.events
    assert back.counterfactual == small_scene.counterfactual
    assert np.array_equal(back.visible, small_scene.visible)
    assert back.moving is not None
    assert np.array_equal(back.moving, small_scene.moving)


@pytest.mark.parametrize("ending", [".json", ".npz"])
def test_arrays_with_gaps_survive_a_round_trip(tmp_path, ending) -> None:
    location = np.zeros((1, 4, 2))
    location[0, 2] = np.nan
    rollout = Rollout(location, np.ones((1, 4), bool), ())
    prediction = DynamicsPrediction((SceneObject(0, "red", "metal", "cube"),), 3, rollout, {0: rollout})
    save(prediction, tmp_path / f"p{ending}")
    back = load(DynamicsPrediction, tmp_path / f"p{ending}")
    np.testing.assert_array_equal(back.observed.location_world, location)
    np.testing.assert_array_equal(back.counterfactual[0].location_world, location)


def test_proposals_and_tracks_survive_a_round_trip(tmp_path) -> None:
    p = proposals()
    save(p, tmp_path / "p.npz")
    np.testing.assert_array_equal(load(VideoProposals, tmp_path / "p.npz").centroid_px, p.centroid_px)
    tracks = track(p)
    save(tracks, tmp_path / "t.json")
    np.testing.assert_array_equal(
        load(VideoTracks, tmp_path / "t.json").tracks[0].location_world, tracks.tracks[0].location_world
    )


def test_loading_names_the_broken_file(tmp_path, small_scene: Scene) -> None:
    with pytest.raises(DataError, match=r"missing\.json: no such file"):
        load(Scene, tmp_path / "missing.json")
    (tmp_path / "half.json").write_text('{"type": "Scene", "objects"')
    with pytest.raises(DataError, match=r"half\.json: not a readable JSON"):
        load(Scene, tmp_path / "half.json")
    (tmp_path / "x.npz").write_bytes(b"nothing")
    with pytest.raises(DataError, match=r"x\.npz: not a readable NPZ"):
        load(Scene, tmp_path / "x.npz")
    save(small_scene.objects[0], tmp_path / "object.json")
    with pytest.raises(DataError, match="holds SceneObject; expected a Scene"):
        load(Scene, tmp_path / "object.json")


def test_other_endings_are_refused(tmp_path, small_scene: Scene) -> None:
    with pytest.raises(DataError, match=r"expected \.json or \.npz"):
        save(small_scene, tmp_path / "scene.txt")

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

from nsdr import DataError, Event, Rollout, Scene, SceneObject, VideoProposals, load, save
from nsdr.tracking.tracker import track
from nsdr.types import DynamicsPrediction, VideoTracks


def proposals(n: int = 20) -> VideoProposals:
    frames = np.arange(n)
    box = np.tile([[100, 100, 140, 140]], (n, 1))
    centroid = np.tile([[120.0, 120.0]], (n, 1))
    return VideoProposals(n, frames, np.full(n, 7), np.full(n, 0.99), centroid, np.full(n, 1200), box)


def test_unknown_attribute_names_the_value() -> None:
    pink = SceneObject(0, "pink", "metal", "cube")
    with pytest.raises(DataError, match=r"Scene: object 0: color: expected one of gray, .*yellow, got .*pink"):
        Scene((pink,), 5, np.ones((1, 5), bool), None, ())


def test_wrong_shape_names_expected_and_actual() -> None:
    p = proposals()
    with pytest.raises(DataError, match=r"score: expected the shape \(20,\), got \(3,\)"):
        VideoProposals(20, p.frame_index, p.attribute, p.score[:3], p.centroid_px, p.area_px, p.box_xyxy_px)


def test_frames_outside_the_video_are_rejected() -> None:
    p = proposals()
    with pytest.raises(DataError, match="expected frames from 0 to 9, got 0 to 19"):
        VideoProposals(10, p.frame_index, p.attribute, p.score, p.centroid_px, p.area_px, p.box_xyxy_px)


def test_repeated_attribute_triples_are_rejected() -> None:
    objects = (SceneObject(0, "red", "metal", "cube"), SceneObject(1, "red", "metal", "cube"))
    with pytest.raises(DataError, match="expected unique attribute triples, got red metal cube, red metal cube"):
        Scene(objects, 5, np.ones((2, 5), bool), None, ())


def test_events_of_unknown_objects_are_rejected() -> None:
    with pytest.raises(DataError, match="expected objects from 0 to 0 at a frame"):
        Scene((SceneObject(0, "red", "metal", "cube"),), 5, np.ones((1, 5), bool), None, (Event("in", 1, (3,)),))


def test_collision_needs_two_ascending_objects() -> None:
    with pytest.raises(DataError, match=r"collision: expected two different ids in ascending order, such as .*3, 1"):
        Event("collision", 1, (3, 1))


def test_dataclasses_are_frozen(small_scene: Scene) -> None:
    with pytest.raises(AttributeError):
        small_scene.n_frames = 3  # type: ignore[misc]


def rollout(x: float = 0.0) -> Rollout:
    location = np.full((1, 4, 2), x)
    location[0, 2] = np.nan
    return Rollout(location, np.ones((1, 4), bool), ())


def prediction(x: float = 0.0) -> DynamicsPrediction:
    return DynamicsPrediction((SceneObject(0, "red", "metal", "cube"),), 3, rollout(), {0: rollout(x)})


def test_types_with_arrays_are_compared_by_value(small_scene: Scene) -> None:
    assert proposals() == proposals()
    assert proposals() != proposals(21)
    assert track(proposals()) == track(proposals())
    assert rollout() == rollout()
    assert rollout() != rollout(1.0)
    assert replace(rollout(), predicted_scores=np.zeros((1, 1))) != rollout()
    assert prediction() == prediction()
    assert prediction() != prediction(1.0)
    assert small_scene == replace(small_scene, visible=small_scene.visible.copy())
    assert small_scene != replace(small_scene, visible=~small_scene.visible)
    assert small_scene != replace(small_scene, moving=None)
    assert small_scene != replace(small_scene, counterfactual=None)
    assert small_scene != "a scene"
    with pytest.raises(TypeError, match="unhashable type: 'Scene'"):
        hash(small_scene)


def test_arrays_are_read_only_and_the_callers_stay_writable() -> None:
    location = np.zeros((1, 4, 2))
    stored = Rollout(location, np.ones((1, 4), bool), ())
    with pytest.raises(ValueError, match="read-only"):
        stored.location_world[0, 0] = 1.0
    assert location.flags.writeable


def test_pickling_and_copying_keep_values_and_read_only_arrays(small_scene: Scene) -> None:
    for value in (proposals(), track(proposals()), prediction(), small_scene):
        for twin in (pickle.loads(pickle.dumps(value)), copy.copy(value), copy.deepcopy(value)):
            assert twin == value
    twin = pickle.loads(pickle.dumps(small_scene))
    assert not twin.visible.flags.writeable


def test_long_fields_are_printed_by_their_size() -> None:
    assert repr(Rollout(np.zeros((1, 4, 2)), np.ones((1, 4), bool), ())).startswith(
        "Rollout(location_world=float64[1, 4, 2], visible=bool[1, 4], collisions=(), "
    )
    events = tuple(Event("collision", frame, (0, 1)) for frame in range(20))
    pair = (SceneObject(0, "red", "metal", "cube"), SceneObject(1, "blue", "metal", "cube"))
    assert "events=<20 of Event>" in repr(Scene(pair, 128, np.ones((2, 128), bool), None, events))


def test_scene_survives_a_round_trip(small_scene: Scene, tmp_path) -> None:
    save(tmp_path / "scene.json", small_scene)
    back = load(tmp_path / "scene.json", Scene)
    assert back == small_scene


def test_arrays_with_nan_survive_a_round_trip(tmp_path) -> None:
    save(tmp_path / "p.json", prediction())
    assert load(tmp_path / "p.json", DynamicsPrediction) == prediction()


def test_proposals_and_tracks_survive_a_round_trip(tmp_path) -> None:
    p = proposals()
    save(tmp_path / "p.json", p)
    assert load(tmp_path / "p.json", VideoProposals) == p
    tracks = track(p)
    save(tmp_path / "t.json", tracks)
    assert load(tmp_path / "t.json", VideoTracks) == tracks


def test_loading_names_the_malformed_file(tmp_path, small_scene: Scene) -> None:
    with pytest.raises(DataError, match=r"missing\.json: no such file"):
        load(tmp_path / "missing.json", Scene)
    (tmp_path / "truncated.json").write_text('{"type": "Scene", "objects"')
    with pytest.raises(DataError, match=r"truncated\.json: not a readable JSON"):
        load(tmp_path / "truncated.json", Scene)
    save(tmp_path / "object.json", small_scene.objects[0])
    with pytest.raises(DataError, match="holds SceneObject; expected a Scene"):
        load(tmp_path / "object.json", Scene)


def test_other_extensions_are_rejected(tmp_path, small_scene: Scene) -> None:
    with pytest.raises(DataError, match=r"expected a name ending in \.json"):
        save(tmp_path / "scene.txt", small_scene)


def test_what_was_not_saved_is_refused_with_what_reads_it(tmp_path) -> None:
    """An annotation in place of a saved scene; and a value of another kind names the types that can be saved alone."""
    path = tmp_path / "annotation_00003.json"
    path.write_text('{"scene_index": 3, "motion_trajectory": []}')
    with pytest.raises(DataError, match=r"annotation_00003\.json: .*scene_from_annotation"):
        load(path, Scene)
    with pytest.raises(DataError, match="cannot save a str; expected one of Add, Answer"):
        save(tmp_path / "a.json", "text")


def test_the_path_comes_first(tmp_path) -> None:
    scene = Scene((), 5, np.ones((0, 5), bool), None, ())
    with pytest.raises(DataError, match=r"save\(path, value\); got a Scene as the path"):
        save(scene, str(tmp_path / "x.json"))  # type: ignore[arg-type]

import importlib
import inspect
import json
import pkgutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import nsdr.clevrer
from nsdr import DataError, Event, Rollout, SceneObject
from nsdr.clevrer.example import QUESTIONS
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.proposals import proposals_document, proposals_from_rows, read_proposals
from nsdr.clevrer.files.questions import read_questions
from nsdr.clevrer.files.scenes import (
    scene_from_annotation,
    scene_from_ground_truth,
)
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.types import DynamicsPrediction
from nsdr.types.events import collisions_in_view, enter_exit_events
from nsdr.world import camera
from nsdr.world.vocabulary import CLEVRER


def test_attribute_index_and_back() -> None:
    assert CLEVRER.index("gray", "metal", "cube") == 0
    assert [CLEVRER.index(*CLEVRER.triple(i)) for i in range(48)] == list(range(48))


def test_camera_looks_at_the_origin() -> None:
    np.testing.assert_allclose(camera.CLEVRER_CAMERA.pixels([0, 0, 0]), [240, 160], atol=1e-3)


def test_camera_matches_the_released_matrix() -> None:
    u, v = camera.CLEVRER_CAMERA.pixels([1.0, -0.5, 0.2])
    w = -0.866025 * 1 - 0.5 * 0.2 + 5
    assert u == pytest.approx((-207.846 * 1 + 525 * -0.5 - 120 * 0.2 + 1200) / w, abs=0.01)
    assert v == pytest.approx((123.936 * 1 - 534.663 * 0.2 + 800) / w, abs=0.01)


def test_ground_and_pixels_are_inverse() -> None:
    positions = np.random.default_rng(0).uniform(-2, 2, (50, 2))
    world = np.concatenate([positions, np.full((50, 1), camera.CENTRE_WORLD)], 1)
    np.testing.assert_allclose(camera.CLEVRER_CAMERA.ground(camera.CLEVRER_CAMERA.pixels(world)), positions, atol=1e-6)


def test_points_behind_the_camera_have_no_pixel() -> None:
    assert np.isnan(camera.CLEVRER_CAMERA.pixels([9.0, 0.0, 0.2])).all()


def test_grid_is_rows_then_columns() -> None:
    np.testing.assert_allclose(camera.grid_from_pixels([480, 320]), [100, 150])
    np.testing.assert_allclose(camera.pixels_from_grid(camera.grid_from_pixels([[12.0, 34.0]])), [[12, 34]])


def test_entering_and_leaving() -> None:
    visible = np.array([[1, 1, 1, 1], [0, 1, 1, 0]], bool)
    assert enter_exit_events(visible) == [Event("in", 1, (1,)), Event("out", 3, (1,))]


def test_collisions_out_of_view_are_dropped_or_delayed() -> None:
    visible = np.ones((3, 10), bool)
    visible[1, :4] = False
    visible[2, :] = False
    hits = [Event("collision", 2, (0, 1)), Event("collision", 3, (0, 2)), Event("collision", 1, (1, 2))]
    assert collisions_in_view(hits, visible) == [Event("collision", 4, (0, 1))]


def annotation() -> dict:
    frames = []
    for f in range(4):
        moving = {"object_id": 0, "velocity": [0.5, 0, 0], "inside_camera_view": f > 0}
        resting = {"object_id": 1, "velocity": [0.01, 0, 3], "inside_camera_view": True}
        frames.append({"frame_id": f, "objects": [moving, resting]})
    properties = [
        {"object_id": 0, "color": "red", "material": "metal", "shape": "cube"},
        {"object_id": 1, "color": "red", "material": "metal", "shape": "sphere"},
    ]
    collisions = [{"object_ids": [1, 0], "frame_id": 2, "location": [0, 0, 0]}]
    return {"object_property": properties, "motion_trajectory": frames, "collision": collisions}


def test_scene_of_an_annotation() -> None:
    scene = scene_from_annotation(annotation())
    assert scene.events == (Event("in", 1, (0,)), Event("collision", 2, (0, 1)))
    assert scene.moving is not None
    assert scene.moving[0].all()
    assert not scene.moving[1].any()


def test_other_content_is_rejected() -> None:
    with pytest.raises(DataError, match="not an annotation"):
        scene_from_annotation({"frames": []})
    with pytest.raises(DataError, match="not a ground-truth block"):
        scene_from_ground_truth({})


def test_scene_of_a_ground_truth_block() -> None:
    block = {
        "objects": [
            {"id": 0, "color": "red", "material": "metal", "shape": "cube"},
            {"id": 1, "color": "blue", "material": "metal", "shape": "cube"},
        ],
        "in_outs": [{"frame": 5, "object": 1, "type": "in"}, {"frame": 90, "object": 1, "type": "out"}],
        "collisions": [{"type": "collision", "object": [1, 0], "frame": 30}],
    }
    scene = scene_from_ground_truth(block)
    last = max(e.frame for e in scene.events)
    assert scene_from_ground_truth(block, last).n_frames == last + 1  # as in CLEVRER's irregular videos
    assert scene.visible[0].all()
    assert np.flatnonzero(np.diff(scene.visible[1].astype(int))).tolist() == [4, 89]
    assert scene.moving is None
    assert [e.kind for e in scene.events] == ["in", "collision", "out"]


def test_scene_of_a_prediction() -> None:
    location = np.zeros((2, 180, 2))
    location[0, :, 0] = np.arange(180) * 0.01  # 0.36 world units/s
    visible = np.ones((2, 180), bool)
    visible[0, :10] = False
    collisions = (Event("collision", 50, (0, 1)), Event("collision", 150, (0, 1)))
    rollout = Rollout(location, visible, collisions)
    objects = (SceneObject(0, "red", "metal", "cube"), SceneObject(1, "blue", "metal", "cube"))
    scene = scene_from_prediction(DynamicsPrediction(objects, 128, rollout, {1: Rollout(location, visible, ())}))
    assert scene.events == (Event("in", 10, (0,)), Event("collision", 50, (0, 1)))
    assert scene.predicted == (Event("collision", 150, (0, 1)),)
    assert scene.counterfactual == {1: (Event("in", 10, (0,)),)}
    assert not scene.collisions_only
    assert scene.moving is not None
    assert scene.moving[0].all()
    assert not scene.moving[1].any()


def square(x: int, y: int) -> str:
    from pycocotools import mask as rle

    mask = np.zeros((320, 480), np.uint8)
    mask[y : y + 10, x : x + 20] = 1
    return rle.encode(np.asfortranarray(mask))["counts"].decode()


def test_proposals_round_trip_in_the_official_format(tmp_path) -> None:
    rows = [(0, 7, 0.99, square(5, 6)), (2, 20, 0.5, square(100, 100))]
    proposals = proposals_from_rows(3, rows)
    document = proposals_document(proposals, "video_00012.mp4")
    assert "notes" not in document
    proposals = replace(proposals, notes=("3 frames, CLEVRER's videos have 128",))
    document = proposals_document(proposals, "video_00012.mp4")
    assert [len(f["objects"]) for f in document["frames"]] == [1, 0, 1]
    (tmp_path / "p.json").write_text(json.dumps(document))
    back = read_proposals(tmp_path / "p.json")
    assert back.n_frames == 3
    np.testing.assert_array_equal(back.box_xyxy_px, proposals.box_xyxy_px)
    np.testing.assert_array_equal(back.attribute, proposals.attribute)
    assert back.notes == proposals.notes


def test_compact_proposals(tiny_motion) -> None:
    videos = list(read_compact_proposals(tiny_motion[0]))
    assert [v for v, _ in videos] == [0, 1, 2, 3]
    assert len(videos[0][1]) == 256
    with pytest.raises(DataError, match="not a readable NPZ file"):
        list(read_compact_proposals(tiny_motion[1]))


def test_questions_of_the_example() -> None:
    (scene,) = read_questions(QUESTIONS)
    assert scene.scene_index == 500002
    assert {q.type for q in scene.questions} == {"descriptive", "explanatory", "predictive", "counterfactual"}


def test_every_public_name_is_exported_by_the_package() -> None:
    from nsdr import CLEVRER
    from nsdr.clevrer import download, read_annotation

    assert callable(download)
    assert read_annotation.__module__ == "nsdr.clevrer.files.annotations"
    assert CLEVRER.__module__ == "nsdr.clevrer.dataset"
    internal = {"answer_forms", "layout", "schema", "velocity_rule", "example"}
    found = pkgutil.walk_packages(nsdr.clevrer.__path__, "nsdr.clevrer.")
    files = [m.name for m in found if not m.ispkg and m.name.rpartition(".")[2] not in internal]
    public = {name for file in files for name in importlib.import_module(file).__all__}
    assert {*nsdr.clevrer.__all__, "CLEVRER"} == public == {*dir(nsdr.clevrer), "CLEVRER"}
    for name in nsdr.clevrer.__all__:
        assert not inspect.ismodule(getattr(nsdr.clevrer, name)), name
    with pytest.raises(AttributeError, match="nothing"):
        nsdr.clevrer.nothing  # noqa: B018


def test_importing_the_package_loads_no_heavy_module() -> None:
    code = "import nsdr.clevrer, sys; sys.exit(any(m in sys.modules for m in ('torch', 'cv2', 'numpy')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_annotations_become_the_tracks_of_a_perfect_tracker() -> None:
    from nsdr.tracking.tracker import tracks_from_annotation

    def row(x: float, shown: bool) -> dict[str, object]:
        return {"object_id": 0, "location": [x, 0.0, 0.2], "orientation": [0.0, 0.0, 0.0], "inside_camera_view": shown}

    annotation = {
        "object_property": [{"object_id": 0, "color": "red", "material": "metal", "shape": "cube"}],
        "motion_trajectory": [{"objects": [row(-0.1 * f, f >= 3)]} for f in range(10)],
    }
    tracks = tracks_from_annotation(annotation)
    assert tracks.n_frames == 10
    assert tracks.tracks[0].frame_index.tolist() == list(range(3, 10))
    np.testing.assert_allclose(tracks.tracks[0].location_world[:, 0], -0.1 * np.arange(3, 10))
    left, top, right, bottom = tracks.tracks[0].box_xyxy_px[0]
    assert left < 240 < right
    assert 30 < bottom - top < 70

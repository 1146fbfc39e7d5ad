"""Clips with the truth about every frame: `nsdr.datasets`."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

import nsdr.clevrer.example
from nsdr import CLEVRER, DataError, VideoDataset
from nsdr.clevrer import scene_from_annotation
from nsdr.datasets import NEAREST, STATE, _resized
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.render.geometry import Solid, instance_ids, optical_flow
from nsdr.generate.render.view import RenderConfig
from nsdr.io.configuration import parse_config
from nsdr.io.files import write_json
from nsdr.io.video import sample_frames, window_frames, write_video
from nsdr.world.camera import CLEVRER_CAMERA, Camera
from nsdr.world.world import CLEVRER_WORLD

SUITES = sorted((Path(__file__).parent.parent / "configs" / "generate" / "suites").glob("*.yaml"))


@pytest.fixture(scope="module")
def root(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    scene = SceneConfig(objects={3: 1.0}, n_frames=40)
    render = RenderConfig(width=120, height=80, camera_jitter=0.3)
    common = {"first_scene": 500300, "scene": scene, "render": render, "masks": False, "workers": 1}
    generate_dataset(DatasetConfig(str(folder), 3, questions=None, counterfactual_videos=1, **common))
    return folder


def test_items_hold_what_the_files_say(root) -> None:
    data = VideoDataset(root, "train", length=10, step=2, flow=True)
    assert data.clips == [(0, 0), (0, 19), (1, 0), (1, 19)]
    item = data[1]
    assert {name: tuple(value.shape) for name, value in item.items()} == {
        "frames": (10,),
        "scene_index": (),
        "video": (10, 3, 80, 120),
        "masks": (10, 80, 120),
        "flow": (10, 2, 80, 120),
        "states": (10, 8, 13),
        "visible": (10, 8),
        "contacts": (10, 8, 8),
        "attributes": (8, 3),
        "mass": (8,),
        "present": (8,),
    }
    assert item["frames"].tolist() == list(range(19, 39, 2))
    assert item["present"].tolist() == [True] * 3 + [False] * 5
    scene = scene_from_annotation(CLEVRER(root).split("train").annotation(0))
    assert (item["visible"][:, :3].numpy() == scene.visible[:, 19:39:2].T).all()
    whole = VideoDataset(root, "train", masks=False)[0]
    truth = json.loads((root / "truth" / "train" / "truth_00000.json").read_text())
    pairs = [(c["frame_id"], c["object_ids"]) for c in truth["collisions"] if c["frame_id"] < 40]
    assert pairs
    found = whole["contacts"].nonzero().tolist()
    assert sorted(found) == sorted([f, *p] for f, (a, b) in pairs for p in ((a, b), (b, a)))
    assert whole["mass"][:3].tolist() == pytest.approx([o["mass"] for o in truth["objects"]])


def test_no_contact_is_lost_between_frames(root) -> None:
    every = VideoDataset(root, "train", images=False, masks=False)[0]
    coarse = VideoDataset(root, "train", step=5, images=False, masks=False)[0]
    assert coarse["contacts"].sum() == every["contacts"][:36].sum()


def test_masks_are_where_the_objects_are(root) -> None:
    item = VideoDataset(root, "test", image_size=(64, 64))[0]
    assert item["video"].shape == (40, 3, 64, 64)
    shades = item["video"].float().mean((0, 2, 3))
    assert ((shades > 30) & (shades < 220)).all()
    on_objects = item["masks"] > 0
    moved = (item["video"].float() - item["video"].float().median(0).values).abs().sum(1)
    seen = [r for r in range(3) if item["visible"][20, r]]
    assert set(item["masks"][20].unique().tolist()) <= {0, *(r + 1 for r in seen)}
    assert moved[on_objects].mean() > 3 * moved[~on_objects].mean()


def test_worlds_without_an_object_have_the_camera_of_their_scene(root) -> None:
    world = root / "counterfactual" / "1"
    assert CLEVRER(world).split("train").n_frames == 40
    without, whole = (VideoDataset(folder, "train", image_size=(80, 120))[0] for folder in (world, root))
    truth = json.loads((world / "truth" / "train" / "truth_00000.json").read_text())
    kept = [i for i in range(3) if i != truth["removed"]]
    as_before = (without["states"][:, :2] == whole["states"][:, kept]).all((1, 2))
    pixels = 0
    for row, i in enumerate(kept):
        here, there = (item["masks"][as_before] == n for item, n in ((whole, i + 1), (without, row + 1)))
        assert (here <= there).all()  # what the removed object hid is seen
        pixels += int(here.sum())
    assert pixels > 100
    assert without["present"].sum() == 2


def test_truth_without_its_manifest_is_refused(root, tmp_path) -> None:
    shutil.copytree(root / "counterfactual" / "1", tmp_path / "1", ignore=shutil.ignore_patterns("manifest.json"))
    with pytest.raises(DataError, match=r"has no manifest\.json"):
        VideoDataset(tmp_path / "1", "train")


@pytest.mark.parametrize("fps", [25, 50])
def test_a_late_window_shows_what_the_whole_video_does(tmp_path, fps: int) -> None:
    rng = np.random.default_rng(0)
    frames = [cv2.resize(rng.integers(0, 255, (8, 12, 3), np.uint8), (120, 80)) for _ in range(60)]
    write_video(tmp_path / "v.mp4", iter(frames), fps)
    whole = sample_frames(tmp_path / "v.mp4", 60 / fps, 1).frames
    assert len(whole) == 60 * 25 / fps
    for start, stop in ((0, 3), (7, 8), (20, 28)):
        np.testing.assert_array_equal(window_frames(tmp_path / "v.mp4", start, stop, CLEVRER_WORLD), whole[start:stop])
    assert len(window_frames(tmp_path / "v.mp4", len(whole) - 2, len(whole) + 4, CLEVRER_WORLD)) == 2


def test_a_late_window_of_a_folder_of_frames(tmp_path) -> None:
    frames = np.random.default_rng(0).integers(0, 255, (9, 80, 120, 3), np.uint8)
    for k, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"{k}.png"), frame[..., ::-1])
    np.testing.assert_array_equal(window_frames(tmp_path, 4, 7, CLEVRER_WORLD), frames[4:7])


def test_flow_follows_the_surface() -> None:
    camera = Camera()
    angle = 0.1
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    now = [Solid("sphere", np.array([0.5, 0.3, 0.2]), np.eye(3)), Solid("cube", np.array([-1.0, -0.5, 0.2]), np.eye(3))]
    following = [
        Solid("sphere", np.array([0.6, 0.2, 0.2]), np.eye(3)),
        Solid("cube", np.array([-1.0, -0.5, 0.2]), turn),
    ]
    flow, ids = optical_flow(now, following, camera), instance_ids(now, camera)
    assert (flow[ids < 0] == 0).all()
    shift = CLEVRER_CAMERA.pixels([0.6, 0.2, 0.2]) - CLEVRER_CAMERA.pixels([0.5, 0.3, 0.2])
    assert flow[ids == 0].mean(0) == pytest.approx(shift, rel=0.1)
    rows, columns = np.nonzero(ids == 1)
    landed = np.stack([rows, columns], 1) + np.rint(flow[rows, columns][:, ::-1]).astype(int)
    after = instance_ids(following, camera)
    assert (after[landed[:, 0], landed[:, 1]] == 1).mean() > 0.95  # a turning cube covers nearly the same pixels
    assert np.abs(flow[ids == 1]).max() > 1


def test_clips_are_batched_by_workers(root) -> None:
    data = VideoDataset(root, "train", length=4, hop=12, image_size=(16, 24))
    batch = next(iter(DataLoader(data, 3, num_workers=1)))
    assert batch["video"].shape == (3, 4, 3, 16, 24)
    assert torch.equal(batch["states"][2], data[2]["states"])
    speed = batch["states"][..., STATE["velocity"]].norm(dim=-1)
    assert speed.max() > 1


def test_the_release_has_annotations_in_place_of_truth(tmp_path) -> None:
    example = Path(nsdr.clevrer.example.__file__).parent
    (tmp_path / "videos" / "train").mkdir(parents=True)
    (tmp_path / "videos" / "train" / "video_00007.mp4").symlink_to(next(example.glob("*.mp4")))
    (tmp_path / "annotations" / "train").mkdir(parents=True)
    with pytest.raises(DataError, match="no train videos with annotations"):
        VideoDataset(tmp_path, "train")
    with pytest.raises(DataError, match=r"no validation videos with annotations; it has videos of: train$"):
        VideoDataset(tmp_path, "validation")
    places = [[[0.01 * f - 1, -0.5, 0.2], [0, 0.7, 0.2]] for f in range(128)]
    zero = {"orientation": [0, 0, 0], "velocity": [0, 0, 0], "angular_velocity": [0, 0, 0], "inside_camera_view": True}
    annotation = {
        "scene_index": 7,
        "video_filename": "video_00007.mp4",
        "object_property": [
            {"object_id": 0, "color": "red", "material": "metal", "shape": "cube"},
            {"object_id": 1, "color": "blue", "material": "rubber", "shape": "sphere"},
        ],
        "motion_trajectory": [
            {"frame_id": f, "objects": [{"object_id": i, "location": p, **zero} for i, p in enumerate(row)]}
            for f, row in enumerate(places)
        ],
        "collision": [{"object_ids": [0, 1], "frame_id": 60, "location": [0, 0, 0.2]}],
    }
    write_json(tmp_path / "annotations" / "train" / "annotation_00007.json", annotation)
    short = {**annotation, "scene_index": 7648, "motion_trajectory": annotation["motion_trajectory"][:104]}
    write_json(tmp_path / "annotations" / "train" / "annotation_07648.json", short)
    assert VideoDataset(tmp_path, "train", images=False, masks=False).clips == [(7, 0)]
    item = VideoDataset(tmp_path, "train", length=64, hop=64, image_size=(80, 120), flow=True)[1]
    assert item["mass"].isnan().all()
    assert item["flow"][-1].abs().max() == 0 < item["flow"][0].abs().max()
    assert item["masks"].unique().tolist() == [0, 1, 2]
    assert item["contacts"].sum() == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"length": 41}, "41 frames with step 1 span 41; the videos have 40"),
        ({"step": 0}, "step"),
        ({"image_size": (0, 4)}, "image_size"),
        ({"images": False}, "image_size: masks and flow without images need a size"),
        ({"split": "dev"}, "split is 'dev'"),
        ({"length": 1.5}, "length"),
        ({"hop": None}, "hop"),
        ({"image_size": "ab"}, "image_size"),
        ({"image_size": (1.5, 4)}, "image_size"),
        ({"image_size": (1, 10**6)}, r"image_size \(1, 1000000\).*image_pixels"),
    ],
)
def test_options_that_do_not_fit_are_refused(root, options, message) -> None:
    with pytest.raises(DataError, match=message):
        VideoDataset(root, **options)


def test_more_objects_than_rows_are_refused(root) -> None:
    with pytest.raises(DataError, match="video 0 has 3 objects; max_objects is 2"):
        VideoDataset(root, "train", max_objects=2)[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(seed="x"), "truth_00000.json: .*seed`"),
        (lambda d: d["objects"][1].update(mass=-1.0), r"objects\[1\].mass"),
        (
            lambda d: d["frames"][2]["objects"][0].pop("orientation"),
            r"`orientation`.*frames\[2\].objects\[0\]`",
        ),
        (lambda d: d.update(scene_index=7), "truth_00000.json: scene_index: expected 0, got 7"),
    ],
)
def test_damaged_truth_files_are_named(root, tmp_path, change, message) -> None:
    file = Path("truth/train/truth_00000.json")
    document = json.loads((root / file).read_text())
    change(document)
    write_json(tmp_path / file, document)
    (tmp_path / "manifest.json").write_text((root / "manifest.json").read_text())
    with pytest.raises(DataError, match=message):
        VideoDataset(tmp_path, "train", images=False, masks=False)[0]


def test_damaged_manifests_are_named(root, tmp_path) -> None:
    manifest = json.loads((root / "manifest.json").read_text())
    manifest["config"]["render"]["width"] = "x"
    write_json(tmp_path / "manifest.json", manifest)
    with pytest.raises(DataError, match=r"manifest\.json: config\.render: .*width.*x"):
        VideoDataset(tmp_path, "train")


def test_a_split_without_videos_is_refused(tmp_path) -> None:
    with pytest.raises(DataError, match="no train videos"):
        VideoDataset(tmp_path, "train")


@pytest.mark.parametrize("file", SUITES, ids=lambda path: path.stem)
def test_the_suites_differ_from_training_in_one_thing(file) -> None:
    config = parse_config(DatasetConfig, ["--config", str(file), "--output", "x"], "test")
    assert config.questions is None
    if file.stem == "train":
        assert config.first_scene + config.videos <= 500_000
        assert len(SUITES) == 8
    else:
        assert config.first_scene >= 500_000
        assert config.first_scene + config.videos <= 600_000
        same = parse_config(DatasetConfig, ["--config", str(file.with_name("same.yaml")), "--output", "x"], "test")
        changed = [name for name in ("scene", "render") if getattr(config, name) != getattr(same, name)]
        assert len(changed) == (file.stem != "same")


def test_masks_are_what_is_at_the_centre_of_larger_pixels() -> None:
    columns = np.tile(np.arange(9, dtype=np.uint8), (6, 1))
    assert _resized(columns, (2, 3), NEAREST).tolist() == [[1, 4, 7]] * 2

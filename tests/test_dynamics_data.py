"""Training data of the dynamics networks: conversion from official and generated files, held-out scenes, and what is kept."""

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from pycocotools import mask as rle

from nsdr import DataError
from nsdr.clevrer.compact_files import write_compact_files
from nsdr.clevrer.files.annotations import read_truth, truth_block, write_annotation
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.proposals import read_proposals
from nsdr.clevrer.files.scenes import scene_from_ground_truth
from nsdr.cli.main import main
from nsdr.dynamics.propnet import data as motion_data
from nsdr.dynamics.propnet.data import read_motion_dataset
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.io.files import write_json
from nsdr.io.reading import read_json
from nsdr.training.dynamics import PropNetTask
from nsdr.training.track_task import DynamicsTraining
from nsdr.world.camera import CLEVRER_CAMERA

OBJECTS = [
    {"id": 0, "color": "red", "material": "metal", "shape": "sphere"},
    {"id": 1, "color": "blue", "material": "rubber", "shape": "cube"},
]
COLLISION_FRAME = 40
STEP = ["--loop.steps", "1", "--loop.batch-size", "2", "--loop.device", "cpu", "--model.hidden", "8"]


def locations(frame: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Object 0 runs into object 1, which rests until then."""
    hit = frame >= COLLISION_FRAME
    return (0.0 if hit else -1.6 + 0.04 * frame, 0.0), (0.4 + 0.02 * (frame - COLLISION_FRAME) * hit, 0.0)


def proposal_file(path: Path, index: int, ground_truth: bool) -> None:
    """The released code's `sim_N.json`, or `proposal_N.json` without a ground-truth block."""
    frames = []
    for frame in range(128):
        rows = []
        for o, location in zip(OBJECTS, locations(frame), strict=True):
            u, v = (int(x) for x in CLEVRER_CAMERA.pixels([*location, 0.2]))
            mask = np.zeros((320, 480), np.uint8, order="F")
            mask[max(v - 18, 0) : v + 18, max(u - 18, 0) : u + 18] = 1
            words = {name: o[name] for name in ("color", "material", "shape")}
            rows.append(
                {"mask": {"size": [320, 480], "counts": rle.encode(mask)["counts"].decode()}, **words, "score": 0.99}
            )
        frames.append({"frame_index": frame, "objects": rows})
    content = {"video_index": index, "frames": frames}
    if ground_truth:
        collision = {"type": "collision", "object": [0, 1], "frame": COLLISION_FRAME}
        content["ground_truth"] = {"objects": OBJECTS, "in_outs": [], "collisions": [collision]}
    path.parent.mkdir(parents=True, exist_ok=True)
    data = json.dumps(content).encode()
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)


def annotation_file(path: Path, index: int) -> None:
    frames = []
    for frame in range(128):
        rows = [
            {"object_id": i, "location": [*xy, 0.2], "inside_camera_view": True}
            | {name: [0.0, 0.0, 0.0] for name in ("orientation", "velocity", "angular_velocity")}
            for i, xy in enumerate(locations(frame))
        ]
        frames.append({"frame_id": frame, "objects": rows})
    words = [{"object_id": o["id"], **{k: o[k] for k in ("color", "material", "shape")}} for o in OBJECTS]
    collision = [{"object_ids": [0, 1], "frame_id": COLLISION_FRAME, "location": [0.2, 0.0, 0.2]}]
    content = {"scene_index": index, "video_filename": f"video_{index:05d}.mp4", "object_property": words}
    write_annotation(path, content | {"motion_trajectory": frames, "collision": collision})


@pytest.fixture(scope="module")
def official(tmp_path_factory) -> Path:
    """Videos 0 and 41 of train with processed proposals, and one of validation."""
    root = tmp_path_factory.mktemp("official")
    for index, end in ((0, ""), (41, ".gz"), (10000, "")):
        proposal_file(root / "processed_proposals" / f"sim_{index:05d}.json{end}", index, True)
    return root


def convert_and_train(root: Path, folder: Path) -> tuple[Path, Path]:
    assert main(["data", "motion", str(root), "--split", "train", "-o", str(folder), "--workers", "1"]) == 0
    files = folder / "proposals.npz", folder / "truth.json.gz"
    inputs = ["--proposals", str(files[0]), "--truth", str(files[1]), "--run-dir", str(folder / "run")]
    assert main(["train", "dynamics", *inputs, *STEP]) == 0
    assert (folder / "run/checkpoint/dynamics.safetensors").exists()
    return files


def test_official_processed_proposals_train_the_dynamics(official, tmp_path, capsys) -> None:
    files = convert_and_train(official, tmp_path)
    assert f"{tmp_path}: proposals.npz and truth.json.gz of 2 videos" in capsys.readouterr().out
    data = read_motion_dataset(*files)
    assert data.scene.tolist() == [0, 41]  # not the validation split's
    states, events = data.states(1)
    assert [(e.frame, len(states.objects)) for e in events] == [(COLLISION_FRAME, 2)]
    (_, compact), _ = read_compact_proposals(files[0])
    original = read_proposals(official / "processed_proposals/sim_00000.json")
    np.testing.assert_array_equal(compact.box_xyxy_px, original.box_xyxy_px)
    np.testing.assert_array_equal(compact.attribute, original.attribute)
    np.testing.assert_array_equal(compact.area_px, original.area_px)
    np.testing.assert_allclose(compact.centroid_px, original.centroid_px, atol=0.5 / 64)
    np.testing.assert_allclose(compact.score, original.score, atol=0.5 / 255)


def test_official_proposals_with_annotations_train_the_dynamics(tmp_path) -> None:
    root = tmp_path / "clevrer"
    for index in (0, 1):
        proposal_file(root / "derender_proposals" / f"proposal_{index:05d}.json", index, False)
        annotation_file(root / f"annotations/train/annotation_00000-01000/annotation_{index:05d}.json", index)
    files = convert_and_train(root, tmp_path / "motion")
    blocks = read_truth(files[1])
    assert [[c["frame"] for c in blocks[i]["collisions"]] for i in (0, 1)] == [[COLLISION_FRAME]] * 2


def test_generated_data_sets_train_the_dynamics(tmp_path) -> None:
    scene = SceneConfig(objects={2: 1.0}, participants=2)
    config = DatasetConfig(
        str(tmp_path / "set"), 2, splits={"train": 1}, renderer="none", questions=None, scene=scene, workers=1
    )
    root = generate_dataset(config)
    (root / "annotations/train/annotation_00000-01000/annotation_00000.json").unlink()  # the truth file takes its place
    blocks = read_truth(convert_and_train(root, tmp_path / "motion")[1])
    for i in (0, 1):
        truth = read_json(root / f"truth/train/truth_{i:05d}.json")
        assert [o["color"] for o in blocks[i]["objects"]] == [o["color"] for o in truth["objects"]]
        assert all(c["frame"] < 128 for c in blocks[i]["collisions"])


def test_truth_blocks_of_scenes(small_scene) -> None:
    again = scene_from_ground_truth(truth_block(small_scene), small_scene.n_frames)
    assert again.objects == small_scene.objects
    assert sorted(again.events, key=lambda e: e.frame) == sorted(small_scene.events, key=lambda e: e.frame)
    np.testing.assert_array_equal(again.visible, small_scene.visible)


def test_conversion_resumes_and_follows_its_input(official, tmp_path, monkeypatch) -> None:
    root = tmp_path / "root"
    shutil.copytree(official, root)
    write_compact_files(root, tmp_path / "motion", workers=1)
    kept = tmp_path / "motion/videos/00000.npz", tmp_path / "motion/videos/00041.npz"
    before = [path.stat().st_mtime_ns for path in kept]
    path = root / "processed_proposals/sim_00000.json"
    content = read_json(path)
    content["ground_truth"]["collisions"] = []
    write_json(path, content)
    write_compact_files(root, tmp_path / "motion", workers=1)
    assert [p.stat().st_mtime_ns == then for p, then in zip(kept, before, strict=True)] == [False, True]
    assert read_truth(tmp_path / "motion/truth.json.gz")[0]["collisions"] == []
    with pytest.raises(DataError, match=r"00000\.npz: was made from .*root.*sim_00000\.json; .* choose another folder"):
        write_compact_files(official, tmp_path / "motion", workers=1)


def test_conversion_errors_name_the_file(official, tmp_path, capsys) -> None:
    root = tmp_path / "root"
    (root / "derender_proposals").mkdir(parents=True)
    with pytest.raises(DataError, match=r"root: has no mask proposals .* of train"):
        write_compact_files(root, tmp_path / "motion")
    shutil.copy(official / "processed_proposals/sim_00000.json", root / "derender_proposals")
    proposal_file(root / "derender_proposals/proposal_00003.json", 3, False)
    with pytest.raises(DataError, match=r"1 of 2 failed: video 3: .*proposal_00003.json: has no ground_truth, and"):
        write_compact_files(root, tmp_path / "motion", workers=1)
    assert main(["data", "motion", str(root)]) == 2
    assert "nsdr data motion: --output must be given" in capsys.readouterr().err
    assert main(["data", "verify", str(root), "--split", "train"]) == 2
    assert "unrecognized arguments: --split train" in capsys.readouterr().err


def renumbered(tiny_motion: tuple[Path, Path], numbers: list[int]) -> tuple[Path, Path]:
    """The four scenes under other indices."""
    proposals, truth = tiny_motion
    with np.load(proposals) as content:
        arrays = dict(content)
    arrays["video"] = np.array(numbers)[arrays["video"]]
    blocks = [block | {"video": numbers[i]} for i, block in read_truth(truth).items()]
    np.savez(proposals.with_name("other.npz"), **arrays)
    truth.with_name("other.json.gz").write_bytes(gzip.compress(json.dumps(blocks).encode()))
    return proposals.with_name("other.npz"), truth.with_name("other.json.gz")


def test_the_index_of_a_scene_decides_whether_it_is_held_out(tiny_motion, tmp_path) -> None:
    proposals, truth = renumbered(tiny_motion, [3, 40, 79, 80])

    def split(limit: int, run: str = "run") -> tuple[list[int], list[int]]:
        task = PropNetTask(DynamicsTraining(str(proposals), str(truth), str(tmp_path / run), limit=limit))
        return task.data.scene.tolist(), task.held_out.scene.tolist()

    assert split(0) == ([3, 79], [40, 80])
    assert split(3) == ([3, 79], [40])  # in the same folder: the kept tracks are of another limit
    assert split(2) == ([3], [40])
    with pytest.raises(DataError, match=r"other.npz: expected scenes whose index is divisible by 40.*got 0 and 1"):
        split(1)


def test_kept_tracks_are_valid_for_their_inputs_only(tiny_motion, tmp_path, monkeypatch) -> None:
    calls = []
    track = motion_data.track
    monkeypatch.setattr(motion_data, "track", lambda proposals: calls.append(1) or track(proposals))
    cache = tmp_path / "motion.npz"
    data = read_motion_dataset(*tiny_motion, cache)
    again = read_motion_dataset(*tiny_motion, cache)
    assert len(calls) == 4
    np.testing.assert_array_equal(again.location_world, data.location_world)
    assert len(read_motion_dataset(*tiny_motion, cache, limit=2)) == 2
    assert read_motion_dataset(*renumbered(tiny_motion, [5, 6, 7, 8]), cache).scene.tolist() == [5, 6, 7, 8]
    cache.write_bytes(cache.read_bytes()[:100])
    assert len(read_motion_dataset(*tiny_motion, cache)) == 4
    with pytest.raises(DataError, match=r"not-there\.npz: no such file"):
        read_motion_dataset("not-there.npz", tiny_motion[1], cache)


def test_data_that_do_not_fit_are_rejected(tiny_motion, tmp_path) -> None:
    other = renumbered(tiny_motion, [0, 1, 2, 9])
    with pytest.raises(DataError, match=r"truth.json.gz: has no video 9, which .*other.npz has"):
        read_motion_dataset(other[0], tiny_motion[1])
    short = [block | {"n_frames": 150} for block in read_truth(tiny_motion[1]).values()]
    tiny_motion[1].write_bytes(gzip.compress(json.dumps(short).encode()))
    with pytest.raises(DataError, match=r"proposals.npz: holds no video of 128 frames with 2 to 7 objects"):
        read_motion_dataset(*tiny_motion)


@pytest.mark.real_data
def test_official_files_become_the_shared_compact_files(shared, tmp_path) -> None:
    for index in (0, 1000, 7648):
        target = tmp_path / "root/processed_proposals" / f"sim_{index:05d}.json.gz"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(shared / "real/proposals" / target.name, target)
    assert write_compact_files(tmp_path / "root", tmp_path, workers=1) == 3
    expected: dict[str, list[np.ndarray]] = {}
    for part in ("train", "dev"):
        with np.load(shared / f"real/proposals_{part}.npz") as arrays:
            rows = np.isin(arrays["video"], (0, 1000, 7648))
            for name in arrays:
                expected.setdefault(name, []).append(arrays[name][rows])
    order = np.argsort(np.concatenate(expected["video"]), kind="stable")
    with np.load(tmp_path / "proposals.npz") as arrays:
        for name in arrays:
            np.testing.assert_array_equal(arrays[name], np.concatenate(expected[name])[order])
    truth = {**read_truth(shared / "real/truth_train.json.gz"), **read_truth(shared / "real/truth_dev.json.gz")}
    blocks = read_truth(tmp_path / "truth.json.gz")
    for index in (0, 1000):  # the irregular 7648 lacks frames, so its length is counted in two ways
        assert {name: blocks[index][name] for name in truth[index]} == truth[index]

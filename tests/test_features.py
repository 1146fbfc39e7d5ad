"""Features of videos for the baselines, and the training of their backbone."""

import json
import urllib.error
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from torchvision import models

from nsdr import DataError
from nsdr.baselines.features import extraction
from nsdr.baselines.features.backbone import BackboneConfig, FrameClassifier, image_batch, load_backbone
from nsdr.baselines.features.extraction import (
    FeatureExtraction,
    FeatureExtractor,
    extract_features,
    region_features,
)
from nsdr.baselines.features.files import FeatureCache, FeatureConfig, TruthConfig, feature_file
from nsdr.baselines.features.truth import truth_features
from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.errors import CheckpointError
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.render.view import RenderConfig
from nsdr.io.checkpoint import save_checkpoint
from nsdr.io.configuration import parse_config
from nsdr.io.video import spaced, write_video
from nsdr.training import backbone
from nsdr.training.backbone import (
    BackboneTask,
    BackboneTraining,
    Frame,
    decode_videos,
    frame_targets,
)
from nsdr.types import VideoProposals
from nsdr.world.vocabulary import ATTRIBUTES

from .conftest import draw_frame
from .second_device import second_device
from .test_devices import step

pytestmark = pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128:UserWarning")


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> str:
    """A checkpoint of a backbone with random weights."""
    folder = tmp_path_factory.mktemp("backbone")
    torch.manual_seed(0)
    config = BackboneConfig("resnet18")
    save_checkpoint(folder, "backbone", FrameClassifier(config).state_dict(), config, {}, half=True)
    return str(folder)


@pytest.fixture
def config(weights) -> FeatureConfig:
    return FeatureConfig("resnet18", weights, 3, (32, 48), grid=(1, 3), kinds=("pooled", "maps"), precision="float32")


def moving(shift: float, count: int = 8) -> list[np.ndarray]:
    """Frames of a drawn sphere that moves."""
    return [draw_frame([("red", "metal", "sphere", 0.0, shift + 0.1 * i)])[0] for i in range(count)]


@pytest.fixture
def videos(tmp_path: Path) -> Path:
    folder = tmp_path / "videos"
    folder.mkdir()
    write_video(folder / "video_00003.mp4", moving(-0.5))
    write_video(folder / "video_00012.mp4", moving(0.5))
    return folder


def test_the_command_writes_what_the_extractor_makes(videos, config, tmp_path, capsys) -> None:
    settings = tmp_path / "features.yaml"
    fields = {"frames": 3, "image_size": [32, 48], "grid": [1, 3], "kinds": ["pooled", "maps"], "precision": "float32"}
    settings.write_text(json.dumps({"features": {"backbone": "resnet18", "weights": config.weights, **fields}}))
    arguments = ["extract-features", "--config", str(settings), "--root", str(videos), "-o", str(tmp_path / "out")]
    assert main([*arguments, "--workers", "1"]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'out'}: features of 2 videos\n"
    cache = FeatureCache(tmp_path / "out")
    cache.check(config)
    made = FeatureExtractor(config, "cpu")(extraction.frames_of(videos / "video_00012.mp4"))
    found = cache.get(12, {"pooled", "maps", "program"})
    assert {name: value.shape for name, value in found.items()} == {"pooled": (3, 512), "maps": (3, 256, 1, 3)}
    for name, value in found.items():
        assert value.dtype == np.float32
        np.testing.assert_array_equal(value, made[name].astype(np.float32))
    assert np.abs(found["maps"][0] - found["maps"][-1]).max() > 0
    assert FeatureCache(tmp_path / "out", {"maps"}).grid == (1, 3)


def test_a_folder_has_features_of_one_precision(videos, config, tmp_path, monkeypatch) -> None:
    auto = replace(config, precision="auto")
    run = FeatureExtraction(str(videos), str(tmp_path / "out"), features=auto, workers=1)
    monkeypatch.setattr(extraction, "resolve_precision", lambda *_: torch.float32)
    extract_features(run)
    cache = FeatureCache(tmp_path / "out")
    assert cache.manifest["features"]["precision"] == "float32"
    monkeypatch.setattr(extraction, "resolve_precision", lambda *_: torch.bfloat16)  # as on another machine
    assert extract_features(run) == 2
    assert FeatureCache(tmp_path / "out").manifest == cache.manifest
    with pytest.raises(DataError, match="precision float32 in place of bfloat16"):
        extract_features(replace(run, features=replace(config, precision="bfloat16")))


def test_channels_are_those_of_what_is_read(videos, config, tmp_path) -> None:
    extract_features(FeatureExtraction(str(videos), str(tmp_path / "out"), features=config, workers=1))
    assert FeatureCache(tmp_path / "out", {"pooled"}).channels == 512
    assert FeatureCache(tmp_path / "out", {"maps", "program"}).channels == 256
    assert FeatureCache(tmp_path / "out", set()).channels == 0
    with pytest.raises(DataError, match=r"as many channels of each kind, got {'pooled': 512, 'maps': 256}"):
        FeatureCache(tmp_path / "out", {"pooled", "maps"})
    with pytest.raises(DataError, match="has pooled, maps and no objects"):
        FeatureCache(tmp_path / "out", {"objects"})


def test_a_killed_extraction_goes_on_where_it_stopped(videos, config, tmp_path, monkeypatch) -> None:
    run = FeatureExtraction(str(videos), str(tmp_path / "out"), features=config, workers=1)
    read = extraction.frames_of
    looked: list[str] = []

    def killed(video: Path) -> list[np.ndarray]:
        looked.append(video.name)
        if len(looked) == 2:
            raise KeyboardInterrupt
        return read(video)

    monkeypatch.setattr(extraction, "frames_of", killed)
    with pytest.raises(KeyboardInterrupt):
        extract_features(run)
    missing = {3, 12} - {int(p.stem) for p in (tmp_path / "out").glob("*.safetensors")}
    assert len(missing) == 1
    with pytest.raises(
        DataError, match=f"{missing.copy().pop():05d}.safetensors: no such file; run `nsdr extract-features`"
    ):
        FeatureCache(tmp_path / "out").get(missing.pop(), {"maps"})
    assert extract_features(run) == 2
    assert len(looked) == 3  # the first video was not looked at again
    before = FeatureCache(tmp_path / "out").fingerprint
    assert extract_features(run) == 2
    assert len(looked) == 3
    assert FeatureCache(tmp_path / "out").fingerprint == before
    write_video(videos / "video_00003.mp4", moving(0.0))
    assert extract_features(run) == 2
    assert looked[3:] == ["video_00003.mp4"]
    assert FeatureCache(tmp_path / "out").fingerprint != before


def test_features_of_other_settings_are_refused(videos, config, weights, tmp_path) -> None:
    out = str(tmp_path / "out")
    extract_features(FeatureExtraction(str(videos), out, features=config, workers=1))
    other = replace(config, grid=(2, 3))
    message = (
        r"its features have other settings \(grid \[1, 3\] in place of \[2, 3\]\); choose another folder, or delete"
    )
    with pytest.raises(DataError, match=message):
        extract_features(FeatureExtraction(str(videos), out, features=other, workers=1))
    with pytest.raises(DataError, match=message):
        FeatureCache(out).check(other)
    FeatureCache(out).check(replace(config, max_objects=3))  # of objects, which there are none of
    state = {name: value + 1 for name, value in FrameClassifier(BackboneConfig()).state_dict().items()}
    save_checkpoint(tmp_path / "trained", "backbone", state, BackboneConfig(), {})
    with pytest.raises(DataError, match=r"other settings \(weights_fingerprint \w+ in place of \w+\)"):
        FeatureCache(out).check(replace(config, weights=str(tmp_path / "trained")))


def test_damaged_and_missing_files_are_named(videos, config, tmp_path) -> None:
    out = tmp_path / "out"
    with pytest.raises(DataError, match="holds no features; `nsdr extract-features --root DATA"):
        FeatureCache(out)
    extract_features(FeatureExtraction(str(videos), str(out), features=config, workers=1))
    path = feature_file(out, 3)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(DataError, match=r"00003.safetensors: damaged .* delete it"):
        FeatureCache(out).get(3, {"maps"})
    path.unlink()
    extract_features(
        FeatureExtraction(str(videos), str(out), features=config, workers=1)
    )  # what the message says helps
    assert FeatureCache(out).get(3, {"maps"})["maps"].shape == config.shape("maps")
    save_file({"maps": np.zeros((3, 256, 2, 2), np.float16)}, path)
    with pytest.raises(DataError, match=r"maps: expected \(3, 256, 1, 3\), got \(3, 256, 2, 2\)"):
        FeatureCache(out).get(3, {"maps"})
    (out / "features.json").write_text("[1]")
    with pytest.raises(DataError, match="not the manifest of a folder of features"):
        FeatureCache(out)
    with pytest.raises(DataError, match=r"holds no video_N.mp4"):
        extract_features(FeatureExtraction(str(out), str(tmp_path / "more"), features=config))


def test_the_grid_has_the_means_of_the_maps(config) -> None:
    frames = moving(0.0)
    full = FeatureExtractor(replace(config, grid=None), "cpu")(frames)["maps"]
    pooled = FeatureExtractor(config, "cpu")(frames)["maps"]
    assert full.shape == (3, 256, 2, 3)
    np.testing.assert_allclose(pooled, full.astype(np.float32).mean(2, keepdims=True), atol=0.02)
    with pytest.raises(DataError, match=r"grid is \[3, 3\]; expected at most the maps' 2 and 3"):
        replace(config, grid=(3, 3))


def proposals(rows: list[tuple[int, float, tuple[int, int, int, int]]], n_frames: int, attribute=0) -> VideoProposals:
    frame, score, box = (list(column) for column in zip(*rows, strict=True))
    zeros = np.zeros(len(rows))
    return VideoProposals(
        n_frames, np.array(frame), zeros.astype(int) + attribute, np.array(score), np.c_[zeros, zeros],
        zeros.astype(int) + 50, np.array(box)
    )  # fmt: skip


def test_detections_with_the_same_attributes_are_one_object() -> None:
    boxes = [(0, 0.95, (0, 0, 240, 160)), (0, 0.99, (240, 0, 480, 160)), (1, 0.92, (0, 160, 480, 320))]
    found = proposals([*boxes, (2, 0.9, (0, 0, 20, 20))], 3, attribute=[7, 3, 3, 7])  # a score of 0.9 is not above it
    often, once = extraction.linked_boxes(found, 2).swapaxes(0, 1)
    np.testing.assert_allclose(often, [[0.5, 0, 1, 0.5], [0, 0.5, 1, 1], [0, 0, 0, 0]])
    np.testing.assert_allclose(once, [[0, 0, 0.5, 0.5], [0, 0, 0, 0], [0, 0, 0, 0]])
    assert extraction.linked_boxes(found, 1).tolist() == often[:, None].tolist()


def test_of_two_detections_of_an_object_the_better_one_stays() -> None:
    found = proposals([(0, 0.99, (0, 0, 240, 160)), (0, 0.95, (240, 0, 480, 160))], 1)
    np.testing.assert_allclose(extraction.linked_boxes(found, 1), [[[0, 0, 0.5, 0.5]]])


def test_the_frame_parser_finds_the_objects(config, tmp_path) -> None:
    c = replace(config, kinds=("objects",), frames=2)
    (tmp_path / "clip").mkdir()
    (tmp_path / "clip" / VIDEO.name).symlink_to(VIDEO)
    extract_features(FeatureExtraction(str(tmp_path / "clip"), str(tmp_path / "out"), features=c, workers=1))
    found = FeatureCache(tmp_path / "out").get(500002, {"objects"})
    assert found["has_object"].shape == (2, 10)
    assert found["has_object"][-1].sum() > 1
    boxes = found["objects"][found["has_object"]][:, -4:]
    assert (boxes >= 0).all()
    assert (boxes <= 1).all()
    assert (boxes[:, 2:] > boxes[:, :2]).all()
    assert not found["objects"][~found["has_object"]].any()


def test_a_region_has_the_mean_of_its_part_of_the_map() -> None:
    maps = torch.zeros(1, 2, 4, 8)
    maps[0, 0, :, :4], maps[0, 1, :, 4:] = 3, 5
    left, right = [0, 0, 0.4, 1], [0.6, 0, 1, 1]
    features = region_features(maps, np.array([[left, right, [0] * 4]], np.float32))[0]
    torch.testing.assert_close(features[:2], torch.tensor([[3, 0, *left], [0, 5, *right]]))
    assert not features[2].any()
    assert not region_features(maps, np.zeros((1, 3, 4), np.float32)).any()


@pytest.fixture(scope="module")
def annotated(tmp_path_factory) -> Path:
    """A data set of two annotated scenes without videos."""
    folder = tmp_path_factory.mktemp("annotated")
    config = DatasetConfig(
        str(folder), 2, splits={"train": 1.0}, renderer="none", masks=False, questions=None, workers=1
    )
    generate_dataset(config)
    return folder


def test_truth_is_extracted_by_the_command_line(annotated, tmp_path, capsys) -> None:
    out = str(tmp_path / "out")
    given = ["extract-features", "--from", "truth", "--root", str(annotated), "-o", out, "--workers", "1"]
    assert main([*given, "--features.frames", "4"]) == 0
    assert "features of 2 videos" in capsys.readouterr().out
    cache = FeatureCache(out, {"maps"})
    assert (cache.channels, cache.grid) == (17, (8, 12))
    found = cache.get(1, {"maps", "objects", "pooled"})
    assert {kind: value.shape for kind, value in found.items()} == {
        "maps": (4, 17, 8, 12), "objects": (4, 10, 17), "pooled": (4, 17 * 24), "has_object": (4, 10)
    }  # fmt: skip
    (annotation,) = (annotated / "annotations").rglob("annotation_00001.json")
    for kind, value in truth_features(json.loads(annotation.read_text()), TruthConfig(4)).items():
        np.testing.assert_allclose(found[kind], value, atol=1e-3)
    assert main([*given, "--features.frames", "5"]) == 2  # other features are in the folder
    assert "frames 4 in place of 5" in capsys.readouterr().err
    assert main([*given[:-2], "--features.backbone", "resnet18"]) == 2  # there is no network
    assert main([*given, "--from", "pixels"]) == 2
    assert main([*given[:-3], str(tmp_path / "other"), "--features.pooled_grid", "[3, 6]"]) == 2
    assert "pooled_grid is [3, 6]; expected divisors of the grid's [8, 12]" in capsys.readouterr().err


def test_features_of_truth_are_words_and_boxes() -> None:
    def state(index: int, place: tuple[float, float], seen: bool) -> dict:
        return {"object_id": index, "location": [*place, 0.2], "orientation": [0.0] * 3, "inside_camera_view": seen}

    things = [
        {"object_id": 0, "color": "red", "material": "metal", "shape": "sphere"},
        {"object_id": 1, "color": "blue", "material": "rubber", "shape": "cube"},
    ]
    motion = [{"objects": [state(0, (0, -1), True), state(1, (0, 1), seen)]} for seen in (True, False)]
    config = TruthConfig(frames=2, max_objects=3)
    found = truth_features({"object_property": things, "motion_trajectory": motion}, config)
    words = [word for known in ATTRIBUTES.values() for word in known]
    objects, maps = found["objects"], found["maps"]
    assert {words[i] for i in np.flatnonzero(objects[0, 0, :-4])} == {"red", "metal", "sphere"}
    assert {words[i] for i in np.flatnonzero(objects[0, 1, :-4])} == {"blue", "rubber", "cube"}
    assert not objects[1, 1:].any()  # not seen, and no third object
    left, top, right, bottom = objects[0, 0, -4:]
    assert 0 < left < right < 0.5 < objects[0, 1, -4]  # y is to the right
    red = maps[0, words.index("red")]
    assert red.sum() == pytest.approx(
        (right - left) * 12 * (bottom - top) * 8, rel=1e-6
    )  # the covered share of each cell
    row, column = np.unravel_index(red.argmax(), red.shape)
    box = maps[0, -4:, row, column] / red.max() / [12, 8, 12, 8] + np.tile([(column + 0.5) / 12, (row + 0.5) / 8], 2)
    np.testing.assert_allclose(box, objects[0, 0, -4:])
    pooled = found["pooled"].reshape(2, 17, 4, 6)
    np.testing.assert_allclose(pooled[0, words.index("red"), 0, 0], red[:2, :2].mean())
    np.testing.assert_allclose(pooled[0, words.index("red")].mean(), red.mean())


def test_frames_are_evenly_spaced() -> None:
    assert spaced(128, 5).tolist() == [0, 32, 64, 95, 127]
    assert spaced(2, 4).tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"backbone": "vgg"}, "backbone: expected one of resnet18,.*, got 'vgg'"),
        ({"kinds": ("maps", "maps")}, "each once"),
        ({"kinds": ()}, "one or more of pooled, maps, objects"),
        ({"frames": 0}, "frames: expected a whole number from 1 to 65536, got 0"),
    ],
)
def test_settings_out_of_range_are_refused(values, message) -> None:
    with pytest.raises(DataError, match=message):
        FeatureConfig(**values)


def test_weights_that_cannot_be_had_are_named(weights, monkeypatch) -> None:
    with pytest.raises(CheckpointError, match="expected a resnet50, got a resnet18"):
        load_backbone("resnet50", weights)

    def without_network(name: str, weights: str) -> None:
        raise urllib.error.URLError("no route")

    monkeypatch.setattr(models, "get_model", without_network)
    with pytest.raises(CheckpointError, match=r"cannot be downloaded .*no route.*; connect .* `nsdr train backbone`"):
        load_backbone("resnet50", "imagenet")


def test_images_are_scaled_and_normalised() -> None:
    images = image_batch([np.full((320, 480, 3), 255, np.uint8)], (32, 48))
    assert images.shape == (1, 3, 32, 48)
    expected = (1 - torch.tensor([0.485, 0.456, 0.406])) / torch.tensor([0.229, 0.224, 0.225])
    torch.testing.assert_close(images[0, :, 5, 7], expected)


def test_targets_say_where_objects_are_and_how_they_look() -> None:
    """The camera projects objects 0 and 1 to the middle of the image; 2 and 3 are not in it."""

    def row(number: int, location: list[float], inside: bool = True) -> dict:
        return {"object_id": number, "location": location, "inside_camera_view": inside}

    words = [("gray", "metal", "cylinder"), ("blue", "metal", "cube"), *[("red", "rubber", "sphere")] * 2]
    names = [dict(zip(ATTRIBUTES, w, strict=True)) | {"object_id": i} for i, w in enumerate(words)]
    rows = [row(0, [0, 0, 0]), row(1, [0.1, 0, 0]), row(2, [0, 0.5, 0.2], False), row(3, [0, 9.0, 0.2])]
    for objects in (rows, rows[::-1]):
        annotation = {"object_property": names, "motion_trajectory": [{"objects": objects}]}
        targets = frame_targets(annotation, 0, (5, 3))
        assert torch.argwhere(targets["centre"]).tolist() == [[2, 1]]
        assert targets["attributes"][:, 2, 1].tolist() == [2, 0, 0]  # the nearest one's
        assert torch.where(targets["present"])[0].tolist() == [0, 2, 8, 10, 12]
        assert targets["number"] == 2


def drawn_frames() -> list[Frame]:
    """Two frames of 32x48 px, with one red metal sphere left, then two further objects."""
    images = np.full((2, 32, 48, 3), 128, np.uint8)
    images[:, 4:12, 4:12] = (173, 35, 35)
    images[1, 20:28, 36:44] = (42, 75, 215)
    targets = []
    for objects in ([(0, 0, 1, 0, 1)], [(0, 0, 1, 0, 1), (1, 2, 2, 1, 0)]):
        centre, attributes = torch.zeros(2, 3, dtype=torch.bool), torch.zeros(3, 2, 3, dtype=torch.int64)
        present = torch.zeros(13, dtype=torch.bool)
        for y, x, color, material, shape in objects:
            centre[y, x] = True
            attributes[:, y, x] = torch.tensor([color, material, shape])
            present[[color, 8 + material, 10 + shape]] = True
        number = torch.tensor(len(objects))
        targets.append({"centre": centre, "attributes": attributes, "present": present, "number": number})
    return list(map(Frame, images, targets))


def test_the_backbone_learns_a_few_frames(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(backbone, "decode_videos", lambda *_: {1: drawn_frames(), 2: drawn_frames()})
    loop = ["--loop.steps", "25", "--loop.batch_size", "8", "--loop.learning_rate", "3e-3", "--loop.device", "cpu"]
    sizes = ["--image_size", "[32, 48]", "--frames_per_video", "2", "--held_out_every", "2"]
    output = backbone.main(["--root", str(tmp_path), "--run_dir", str(tmp_path / "run"), *sizes, *loop])
    metrics = json.loads((tmp_path / "run" / "metrics.jsonl").read_text().splitlines()[-1])
    assert metrics["right"] == 1
    assert metrics["count"] == 1
    assert metrics["false_centres"] == 0
    features = FeatureExtractor(FeatureConfig("resnet18", output, 2, (32, 48), kinds=("pooled",)), "cpu")
    assert features([frame.image for frame in drawn_frames()])["pooled"].shape == (2, 512)


def test_the_backbone_is_trained_and_used_where_its_weights_are(config, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(backbone, "decode_videos", lambda *_: {1: drawn_frames(), 2: drawn_frames()})
    task = BackboneTask(
        BackboneTraining("data", str(tmp_path), image_size=(32, 48), frames_per_video=2, held_out_every=2)
    )
    start = {name: value.clone() for name, value in task.model.state_dict().items()}
    expected = step(task, "cpu")
    task.model.load_state_dict(start)
    frames, c = moving(0.0), replace(config, precision="float32")
    features = FeatureExtractor(c, "cpu")(frames)
    with second_device() as device:
        for ours, theirs in zip(step(task, device), expected, strict=True):
            assert ours == pytest.approx(theirs, rel=1e-3, abs=1e-5)
        moved = FeatureExtractor(c, str(device))(frames)
    for kind, values in features.items():
        np.testing.assert_allclose(moved[kind].astype(np.float32), values.astype(np.float32), atol=0.02)


def test_flipped_frames_have_flipped_targets(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(backbone, "decode_videos", lambda *_: {1: drawn_frames(), 2: drawn_frames()})
    task = BackboneTask(
        BackboneTraining("data", str(tmp_path), image_size=(32, 48), frames_per_video=2, held_out_every=2)
    )
    plain, flipped = (task.collate([(0, 1, flip)]) for flip in (False, True))
    for name in ("images", "centre", "attributes"):
        assert torch.equal(plain[name].flip(-1), flipped[name])
        assert not torch.equal(plain[name], flipped[name])


def test_videos_are_decoded_once(tmp_path, monkeypatch) -> None:
    scene, render = SceneConfig(objects={2: 1.0}, n_frames=20), RenderConfig(width=48, height=32)
    root = str(tmp_path / "data")
    config = DatasetConfig(root, 2, first_scene=500300, scene=scene, render=render, splits={"train": 1}, workers=1)
    generate_dataset(replace(config, questions=None, masks=False))
    monkeypatch.setattr("nsdr.training.backbone.run_jobs", in_this_process)
    first = decode_videos(root, tmp_path / "frames", (32, 48), 3)
    assert {index: [f.image.shape for f in frames] for index, frames in first.items()} == dict.fromkeys(
        (0, 1), [(32, 48, 3)] * 3
    )
    assert all(frame.targets["number"] <= 2 for frame in first[0])
    monkeypatch.setattr("nsdr.training.backbone.frames_of", lambda _: pytest.fail("decoded again"))
    again = decode_videos(root, tmp_path / "frames", (32, 48), 3, limit=1)
    assert list(again) == [0]
    np.testing.assert_array_equal(again[0][1].image, first[0][1].image)
    with pytest.raises(DataError, match="has no training videos with annotations"):
        decode_videos(tmp_path, tmp_path / "frames", (32, 48), 3)


def in_this_process(*arguments, **options):
    from nsdr.io.jobs import run_jobs

    return run_jobs(*arguments, **{**options, "workers": 1})


CONFIGS = Path(__file__).parent.parent / "configs" / "baselines"


def test_the_settings_in_the_repository_are_valid() -> None:
    paper, small = (
        parse_config(FeatureExtraction, ["--config", str(CONFIGS / name), "--root", "data", "--output", "out"], "test")
        for name in ("features.yaml", "reference/features.yaml")
    )
    assert paper.features == FeatureConfig()
    training = parse_config(BackboneTraining, ["--config", str(CONFIGS / "backbone.yaml")], "test")
    assert (small.features.backbone, small.features.image_size) == (training.model.name, training.image_size)

"""Features of videos for the baselines."""

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
from nsdr.baselines.features.backbone import image_batch
from nsdr.baselines.features.extraction import (
    FeatureExtraction,
    FeatureExtractor,
    extract_features,
    region_features,
)
from nsdr.baselines.features.files import KINDS, FeatureCache, FeatureConfig, WordConfig, check_settings, feature_file
from nsdr.baselines.features.words import detected_features, linked_boxes, recolored, truth_features
from nsdr.clevrer.example import VIDEO
from nsdr.clevrer.files.compact_proposals import compact_rows
from nsdr.cli.main import main
from nsdr.errors import CheckpointError
from nsdr.frame_parser.model import FrameParserConfig, build_frame_parser
from nsdr.frame_parser.parser import FrameParser
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.io.configuration import parse_config
from nsdr.io.reading import read_json
from nsdr.io.video import spaced, write_video
from nsdr.types import VideoProposals
from nsdr.world.vocabulary import CLEVRER

from .conftest import draw_frame
from .second_device import second_device

pytestmark = pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128:UserWarning")


@pytest.fixture(autouse=True)
def imagenet(monkeypatch) -> None:
    """torchvision's networks have random weights in place of ImageNet's."""
    get_model = models.get_model

    def untrained(name: str, weights: str) -> torch.nn.Module:
        torch.manual_seed(0)
        return get_model(name, weights=None)

    monkeypatch.setattr(models, "get_model", untrained)
    extraction._extractor.cache_clear()


@pytest.fixture
def config() -> FeatureConfig:
    return FeatureConfig("resnet18", 3, (32, 48), grid=(1, 3), kinds=("pooled", "maps"), precision="float32")


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
    settings.write_text(json.dumps({"features": {"backbone": "resnet18", **fields}}))
    arguments = ["data", "features", "--config", str(settings), "--root", str(videos), "-o", str(tmp_path / "out")]
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

    def killed(video: Path, *note: object) -> list[np.ndarray]:
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
        DataError, match=f"{missing.copy().pop():05d}.safetensors: no such file; run `nsdr data features`"
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


def test_features_of_other_settings_are_refused(videos, config, tmp_path) -> None:
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


def test_damaged_and_missing_files_are_named(videos, config, tmp_path) -> None:
    out = tmp_path / "out"
    with pytest.raises(DataError, match="holds no features; `nsdr data features --root DATA"):
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
    attribute, boxes = linked_boxes(found, 2)
    assert attribute.tolist() == [3, 7]
    often, once = boxes.swapaxes(0, 1)
    np.testing.assert_allclose(often, [[0.5, 0, 1, 0.5], [0, 0.5, 1, 1], [0, 0, 0, 0]])
    np.testing.assert_allclose(once, [[0, 0, 0.5, 0.5], [0, 0, 0, 0], [0, 0, 0, 0]])
    assert linked_boxes(found, 1)[1].tolist() == often[:, None].tolist()


def test_of_two_detections_of_an_object_the_better_one_stays() -> None:
    found = proposals([(0, 0.99, (0, 0, 240, 160)), (0, 0.95, (240, 0, 480, 160))], 1)
    np.testing.assert_allclose(linked_boxes(found, 1)[1], [[[0, 0, 0.5, 0.5]]])


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


def test_a_region_has_the_mean_of_its_part_of_each_map() -> None:
    maps = torch.zeros(1, 2, 4, 8)
    maps[0, 0, :, :4], maps[0, 1, :, 4:] = 3, 5
    coarse = torch.full((1, 1, 2, 2), 7.0)
    left, right = [0, 0, 0.4, 1], [0.6, 0, 1, 1]
    features = region_features([maps, coarse], np.array([[left, right, [0] * 4]], np.float32))[0]
    torch.testing.assert_close(features[:2], torch.tensor([[3, 0, 7, *left], [0, 5, 7, *right]]))
    assert not features[2].any()
    assert not region_features([maps], np.zeros((1, 3, 4), np.float32)).any()


def test_the_frame_parser_is_a_backbone(tmp_path) -> None:
    c = FeatureConfig("frame_parser", 2, (320, 480), (4, 6), (1, 2), KINDS, precision="float32")
    found = FeatureExtractor(c, "cpu")(extraction.frames_of(VIDEO))
    assert {kind: value.shape for kind, value in found.items()} == {kind: c.shape(kind) for kind in c.kinds}
    assert c.shape("maps") == (2, 192, 4, 6)
    halves = found["maps"].astype(np.float32).reshape(2, 192, 4, 2, 3).mean((2, 4))
    np.testing.assert_allclose(found["pooled"].reshape(2, 192, 2), halves, atol=0.02)
    settings = c.manifest()
    assert "max_objects" not in replace(c, kinds=("maps",)).manifest()["features"]
    assert found["objects"][-1, 0, :-4].any()
    small = FrameParserConfig(widths=(16, 16, 16, 16), blocks=1, fpn_channels=16, box_features=16, mask_channels=16)
    FrameParser(build_frame_parser(small)).save_pretrained(tmp_path / "other")
    other = replace(c, detector=str(tmp_path / "other"))
    assert other.shape("maps") == (2, 48, 4, 6)
    with pytest.raises(DataError, match=r"detector_fingerprint \w+ in place of \w+"):
        check_settings(other.manifest()["features"], settings["features"], {"maps"}, "")
    for wrong in ({"grid": None}, {"image_size": (224, 224)}):
        with pytest.raises(DataError, match=r"backbone frame_parser needs a grid, and image_size \[320, 480\]"):
            replace(c, **wrong)
    with pytest.raises(DataError, match=r"pooled_grid is \[5, 1\]; expected at most 4 and 6"):
        replace(c, pooled_grid=(5, 1))
    with pytest.raises(DataError, match=r"pooled_grid is \[8, 8\]; expected at most 7 and 7"):
        FeatureConfig(pooled_grid=(8, 8))


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
    given = ["data", "features", "--from", "truth", "--root", str(annotated), "-o", out, "--workers", "1"]
    assert main([*given, "--features.frames", "4"]) == 0
    assert "features of 2 videos" in capsys.readouterr().out
    cache = FeatureCache(out, {"maps"})
    assert (cache.channels, cache.grid) == (17, (8, 12))
    found = cache.get(1, {"maps", "objects", "pooled"})
    assert {kind: value.shape for kind, value in found.items()} == {
        "maps": (4, 17, 8, 12), "objects": (4, 10, 17), "pooled": (4, 17 * 24), "has_object": (4, 10)
    }  # fmt: skip
    (annotation,) = (annotated / "annotations").rglob("annotation_00001.json")
    for kind, value in truth_features(json.loads(annotation.read_text()), WordConfig(4)).items():
        np.testing.assert_allclose(found[kind], value, atol=1e-3)
    assert main([*given, "--features.frames", "5"]) == 2  # other features are in the folder
    assert "frames 4 in place of 5" in capsys.readouterr().err
    assert main([*given[:-2], "--features.backbone", "resnet18"]) == 2  # there is no network
    assert main([*given, "--from", "pixels"]) == 2
    assert main([*given, "--features.source=proposals"]) == 2
    assert "--from says what features are made from" in capsys.readouterr().err
    assert main([*given[:-3], str(tmp_path / "other"), "--features.pooled-grid", "[3, 6]"]) == 2
    assert "pooled_grid is [3, 6]; expected divisors of the grid's [8, 12]" in capsys.readouterr().err


def test_features_of_truth_are_words_and_boxes() -> None:
    def state(index: int, place: tuple[float, float], seen: bool) -> dict:
        return {"object_id": index, "location": [*place, 0.2], "orientation": [0.0] * 3, "inside_camera_view": seen}

    things = [
        {"object_id": 0, "color": "red", "material": "metal", "shape": "sphere"},
        {"object_id": 1, "color": "blue", "material": "rubber", "shape": "cube"},
    ]
    motion = [{"objects": [state(0, (0, -1), True), state(1, (0, 1), seen)]} for seen in (True, False)]
    config = WordConfig(frames=2, max_objects=3)
    found = truth_features({"object_property": things, "motion_trajectory": motion}, config)
    words = list(CLEVRER.attributes)
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


def test_features_of_proposals_are_those_of_the_truth_where_all_is_seen(tmp_path, capsys) -> None:
    """Exact masks in place of a frame parser's: an object that nothing hides has the same words and nearly the same box."""
    generate_dataset(
        DatasetConfig(str(tmp_path / "data"), 1, splits={"train": 1.0}, renderer="none", questions=None, workers=1)
    )
    given = ["data", "features", "--root", str(tmp_path / "data"), "--workers", "1", "--features.frames", "13"]
    for source in ("truth", "proposals"):
        assert main([*given, "--from", source, "-o", str(tmp_path / source)]) == 0
    capsys.readouterr()
    true, found = (FeatureCache(tmp_path / name).get(0, {"objects"})["objects"] for name in ("truth", "proposals"))
    rows = {tuple(row[:-4].tolist()): k for k, row in enumerate(true.max(0)) if row.any()}
    assert rows.keys() >= {tuple(row[:-4].tolist()) for row in found.max(0) if row.any()}
    off = [
        np.abs(frame[k] - true[f, rows[tuple(frame[k, :-4].tolist())]]).max()
        for f, frame in enumerate(found) for k in np.flatnonzero(frame.any(1))
    ]  # fmt: skip
    assert len(off) > 13
    assert np.median(off) < 2 / 320
    assert main([*given, "--from", "truth", "-o", str(tmp_path / "proposals")]) == 2  # of the other source
    assert "from proposals in place of truth" in capsys.readouterr().err


def test_compact_proposals_give_the_same_features(tmp_path, capsys) -> None:
    boxes = [(0, 1.0, (0, 0, 240, 160)), (1, 1.0, (0, 160, 480, 320))]
    many = replace(proposals(boxes, 128, attribute=[3, 3]), centroid_px=np.full((2, 2), 100.0))
    np.savez(tmp_path / "many.npz", **compact_rows(12, many))
    assert main(["data", "features", "--from", "proposals", "--root", str(tmp_path / "many.npz"), "-o", str(tmp_path / "out"),
                 "--workers", "1"]) == 0  # fmt: skip
    stored = FeatureCache(tmp_path / "out").get(12, set(KINDS))
    for kind, value in detected_features(many, WordConfig()).items():
        np.testing.assert_allclose(stored[kind], value, atol=1e-3)
    assert (
        main(["data", "features", "--from", "proposals", "--root", str(tmp_path / "none"), "-o", str(tmp_path / "a")])
        == 2
    )
    assert "no such file or folder" in capsys.readouterr().err
    (tmp_path / "proposal_last.json").write_text("{}")
    assert main(["data", "features", "--from", "proposals", "--root", str(tmp_path), "-o", str(tmp_path / "a")]) == 2
    assert "expected a name that ends with the video's index" in capsys.readouterr().err


def test_frames_are_chosen_among_those_that_were_processed() -> None:
    found = replace(
        proposals([(0, 1.0, (0, 0, 240, 160)), (4, 1.0, (240, 0, 480, 160))], 6), processed=np.array([0, 4])
    )
    left = detected_features(found, WordConfig(frames=2, max_objects=1))["objects"][:, 0, -4]
    assert left.tolist() == [0, 0.5]


def test_frames_are_evenly_spaced() -> None:
    assert spaced(128, 5).tolist() == [0, 32, 64, 95, 127]
    assert spaced(2, 4).tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"backbone": "vgg"}, "backbone"),
        ({"kinds": ("maps", "maps")}, "each once"),
        ({"kinds": ()}, "one or more of pooled, maps, objects"),
        ({"frames": 0}, "frames"),
    ],
)
def test_settings_out_of_range_are_refused(values, message) -> None:
    with pytest.raises(DataError, match=message):
        FeatureConfig(**values)


def test_weights_that_cannot_be_had_are_named(config, monkeypatch) -> None:
    def without_network(name: str, weights: str) -> None:
        raise urllib.error.URLError("no route")

    monkeypatch.setattr(models, "get_model", without_network)
    with pytest.raises(
        CheckpointError, match=r"cannot be downloaded .*no route.*; connect .* backbone to frame_parser"
    ):
        FeatureExtractor(config, "cpu")


def test_images_are_scaled_and_normalised() -> None:
    images = image_batch([np.full((320, 480, 3), 255, np.uint8)], (32, 48))
    assert images.shape == (1, 3, 32, 48)
    expected = (1 - torch.tensor([0.485, 0.456, 0.406])) / torch.tensor([0.229, 0.224, 0.225])
    torch.testing.assert_close(images[0, :, 5, 7], expected)


@pytest.mark.parametrize("backbone", ["resnet18", "frame_parser"])
def test_features_are_the_same_on_another_device(backbone, config) -> None:
    size = {"image_size": (320, 480), "kinds": KINDS} if backbone == "frame_parser" else {}
    frames, c = extraction.frames_of(VIDEO), replace(config, backbone=backbone, frames=2, **size)
    features = FeatureExtractor(c, "cpu")(frames)
    with second_device() as device:
        moved = FeatureExtractor(c, str(device))(frames)
    for kind, values in features.items():
        np.testing.assert_allclose(moved[kind].astype(np.float32), values.astype(np.float32), atol=0.02)


CONFIGS = Path(__file__).parent.parent / "configs" / "baselines"


def test_the_settings_in_the_repository_are_valid() -> None:
    paper, small = (
        parse_config(FeatureExtraction, ["--config", str(CONFIGS / name), "--root", "data", "--output", "out"], "test")
        for name in ("features_paper.yaml", "features.yaml")
    )
    assert paper.features == FeatureConfig()
    assert sum(np.prod(small.features.shape(kind)) * 2 for kind in small.features.kinds) < 1e6


def test_recolored_features_of_the_truth_are_those_of_the_recolored_video(tmp_path) -> None:
    config = WordConfig(frames=4, grid=(4, 6), pooled_grid=(2, 3), max_objects=3)
    generate_dataset(DatasetConfig(str(tmp_path / "data"), videos=1, renderer="none", questions=None))
    annotation = read_json(next((tmp_path / "data").rglob("annotation_*.json")))
    colors = (3, 0, 2, 1, 7, 6, 4, 5)
    found = recolored(truth_features(annotation, config), colors, 13)
    for thing in annotation["object_property"]:
        thing["color"] = CLEVRER.words["color"][colors[CLEVRER.words["color"].index(thing["color"])]]
    expected = truth_features(annotation, config)
    for kind, value in expected.items():
        np.testing.assert_array_equal(found[kind], value, err_msg=kind)

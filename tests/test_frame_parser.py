import json
import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from pycocotools import mask as rle
from torch.utils.data import DataLoader

from nsdr import CheckpointError, DataError, VideoError, VideoProposals
from nsdr.clevrer.files.masks import ObjectRuns, numbers_of_runs
from nsdr.clevrer.files.proposals import proposals_document, proposals_from_rows
from nsdr.frame_parser.dataset import AugmentConfig, FrameDataset, collate
from nsdr.frame_parser.metrics import average_precision, detection_scores
from nsdr.frame_parser.model import FrameParserConfig, TorchvisionBackbone, build_frame_parser
from nsdr.frame_parser.parser import FrameParser
from nsdr.frame_parser.pasting import mask_changes
from nsdr.frame_parser.roi_heads import AttributePredictor, JointAttributePredictor, attribute_probabilities
from nsdr.frame_parser.training_frames import write_frames
from nsdr.io.checkpoint import load_checkpoint, world_of_checkpoint
from nsdr.io.files import write_json
from nsdr.io.video import read_video, write_video
from nsdr.io.worlds import store_world, stored_world
from nsdr.tracking.localization import ground_location, outline
from nsdr.tracking.tracker import TrackerConfig, track
from nsdr.tracking.visibility import cut_sides, hidden_sides
from nsdr.training.frame_parser import FrameParserTask, FrameParserTraining
from nsdr.training.loop import LoopConfig, train_part
from nsdr.world.camera import CLEVRER_CAMERA, Camera
from nsdr.world.layout import Layout
from nsdr.world.physics import Timeline
from nsdr.world.vocabulary import CLEVRER, Color, Material, Shape, Vocabulary
from nsdr.world.world import CLEVRER_WORLD, World

TINY = FrameParserConfig(
    widths=(16, 16, 16, 32), blocks=1, fpn_channels=16, box_features=32, mask_channels=16, mask_layers=1
)

SIZES = {name: len(words) for name, words in CLEVRER_WORLD.vocabulary.words.items()}


@pytest.fixture(scope="module")
def tiny_parser() -> FrameParser:
    torch.manual_seed(0)
    # In bfloat16, detections of an untrained network, all of them doubtful, depend on the rounding of the batch's size.
    return FrameParser(build_frame_parser(TINY), batch_size=2, precision="float32")


def test_widths_that_crash_the_backend_are_rejected() -> None:
    with pytest.raises(DataError, match=r"widths: expected multiples of 16, got \(8, 16, 16, 16\)"):
        FrameParserConfig(widths=(8, 16, 16, 16))


@pytest.mark.parametrize("backbone", ["resnet18", "resnet50"])
def test_torchvision_backbones_have_the_levels_of_the_slim_one(backbone: str) -> None:
    network = TorchvisionBackbone(backbone, 16)
    levels = network(torch.rand(1, 3, 64, 96))
    assert {name: tuple(level.shape) for name, level in levels.items()} == {
        "0": (1, 16, 16, 24),
        "1": (1, 16, 8, 12),
        "2": (1, 16, 4, 6),
    }


def test_unknown_backbones_and_heads_are_rejected() -> None:
    with pytest.raises(DataError, match=r"backbone"):
        FrameParserConfig(backbone="vgg")
    with pytest.raises(DataError, match="attributes"):
        FrameParserConfig(attributes="two")


def test_both_kinds_of_heads_give_probabilities_that_agree() -> None:
    torch.manual_seed(0)
    features = torch.rand(5, 16)
    for predictor in (AttributePredictor(16, SIZES), JointAttributePredictor(16, SIZES)):
        found = attribute_probabilities(predictor(features), SIZES)
        assert {name: tuple(p.shape) for name, p in found.items()} == {
            "color": (5, 8),
            "material": (5, 2),
            "shape": (5, 3),
            "attribute": (5, 48),
        }
        for probability in found.values():
            torch.testing.assert_close(probability.sum(1), torch.ones(5))
        table = found["attribute"].view(5, 8, 2, 3)
        torch.testing.assert_close(table.sum((1, 2)), found["shape"])


def test_the_papers_joint_label_is_learned(tiny_frames) -> None:
    torch.manual_seed(0)
    model = build_frame_parser(replace(TINY, attributes="joint")).train()
    image, target = FrameDataset(tiny_frames, "train")[0]
    losses = model([image], [target])
    assert "loss_attribute" in losses
    assert "loss_color" not in losses
    assert all(torch.isfinite(v) for v in losses.values())


def test_a_stride_skips_frames_but_not_the_last(tiny_parser: FrameParser, looked_at) -> None:
    parser = FrameParser(tiny_parser.model, batch_size=2, stride=4)
    frames = np.arange(11, dtype=np.uint8)[:, None, None, None] * np.ones((1, 320, 480, 3), np.uint8)
    assert parser.parse(frames).n_frames == 11
    assert [int(frame[0, 0, 0]) for frame in looked_at] == [0, 4, 8, 10]
    with pytest.raises(DataError, match="stride 0: expected at least 1"):
        FrameParser(tiny_parser.model, stride=0)


def test_videos_with_proposals_become_frames(tmp_path, tiny_frames) -> None:
    record = FrameDataset(tiny_frames, "all").records[0]
    image = cv2.imread(str(tiny_frames / "images" / record["file_name"]), cv2.IMREAD_COLOR_RGB)
    videos, proposals = tmp_path / "videos", tmp_path / "proposals"
    write_video(videos / "video_00007.mp4", [image] * 20)
    rows = [
        (f, CLEVRER.index(o["color"], o["material"], o["shape"]), 1.0, o["segmentation"]["counts"])
        for f in range(20)
        for o in record["objects"]
    ]
    write_json(proposals / "proposal_00007.json", proposals_document(proposals_from_rows(20, rows), "video_00007.mp4"))
    with pytest.warns(UserWarning, match="20 frames"):
        assert write_frames(videos, proposals, tmp_path / "out", every=8) == 3
    assert write_frames(videos, proposals, tmp_path / "out", every=8) == 3  # kept
    frames = FrameDataset(tmp_path / "out", "all")
    image, target = frames[1]
    assert frames.records[1]["frame"] == 8
    assert image.shape == (3, 320, 480)
    assert len(target["boxes"]) == len(record["objects"])
    with pytest.raises(DataError, match=r"holds no video_N\.mp4 with a proposal"):
        write_frames(videos, tmp_path / "empty", tmp_path / "out2")


def test_losses_are_finite_even_without_objects(tiny_frames) -> None:
    torch.manual_seed(0)
    model = build_frame_parser(TINY).train()
    dataset = FrameDataset(tiny_frames, "train")
    image, target = dataset[0]
    nothing = {name: value[:0] for name, value in target.items()}
    losses = model([image, image], [target, nothing])
    assert {"loss_classifier", "loss_color", "loss_material", "loss_shape", "loss_mask"} <= set(losses)
    assert all(torch.isfinite(v) for v in losses.values())
    assert all(torch.isfinite(v) for v in model([image], [nothing]).values())


def test_boxes_are_float32_in_mixed_precision(tiny_frames, monkeypatch) -> None:
    model = build_frame_parser(TINY).train()
    image, target = FrameDataset(tiny_frames, "train")[0]
    given = []
    monkeypatch.setattr(model.rpn, "assign_targets_to_anchors", lambda anchors, targets: given.extend(anchors) or 1 / 0)
    decode = model.rpn.box_coder.decode
    monkeypatch.setattr(
        model.rpn.box_coder, "decode", lambda d, a: given.append(d) or given.append(decode(d, a)) or given[-1]
    )
    with pytest.raises(ZeroDivisionError), torch.autocast("cpu", torch.bfloat16):
        model([image], [target])
    assert {value.dtype for value in given} == {torch.float32}
    assert len(given) == 3


def test_network_learns_a_tiny_batch(tiny_frames) -> None:
    torch.manual_seed(0)
    model = build_frame_parser(TINY).train()
    dataset = FrameDataset(tiny_frames, "train")
    images, targets = zip(*(dataset[i] for i in range(2)), strict=True)
    optimizer = torch.optim.Adam(model.parameters(), 3e-3)
    history = []
    for step in range(25):
        torch.manual_seed(step)
        loss = sum(model(list(images), list(targets)).values())
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        history.append(float(loss.detach()))
    assert np.mean(history[-3:]) < 0.6 * history[0]


def test_batches_give_what_single_frames_give(tiny_parser: FrameParser) -> None:
    frames = np.random.default_rng(0).integers(0, 255, (3, 320, 480, 3), dtype=np.uint8)
    tiny_parser.model.roi_heads.score_thresh = 0.3
    together = tiny_parser.parse(frames)
    alone = FrameParser(tiny_parser.model, batch_size=1, precision="float32").parse(frames)
    tiny_parser.model.roi_heads.score_thresh = 0.5
    assert together.n_frames == alone.n_frames == 3
    np.testing.assert_array_equal(together.frame_index, alone.frame_index)
    np.testing.assert_allclose(together.centroid_px, alone.centroid_px, atol=1.0)


def test_frames_without_objects_give_no_proposals(tiny_parser: FrameParser) -> None:
    tiny_parser.model.roi_heads.score_thresh = 1.1
    found = tiny_parser.parse(np.zeros((2, 320, 480, 3), np.uint8))
    tiny_parser.model.roi_heads.score_thresh = 0.5
    assert len(found) == 0
    assert track(found).tracks == ()


def test_dataset_splits_by_scene_and_augments(tiny_frames) -> None:
    assert len(FrameDataset(tiny_frames, "train")) == 4
    assert len(FrameDataset(tiny_frames, "evaluation")) == 2
    plain = FrameDataset(tiny_frames, "train").get(0, np.random.default_rng(1))
    config = AugmentConfig(flip=1.0, blur=1.0, jpeg=1.0)
    changed = FrameDataset(tiny_frames, "train", config).get(0, np.random.default_rng(1))
    again = FrameDataset(tiny_frames, "train", config).get(0, np.random.default_rng(1))
    assert torch.equal(changed[0], again[0])
    assert not torch.equal(plain[0], changed[0])
    assert torch.equal(plain[1]["masks"].flip(2), changed[1]["masks"])
    assert changed[1]["boxes"][0, 0] == 480 - plain[1]["boxes"][0, 2]


def test_augmentation_is_drawn_anew_or_from_a_given_generator(tiny_frames) -> None:
    dataset = FrameDataset(tiny_frames, "train", AugmentConfig())
    image = dataset.get(1, np.random.default_rng(3))[0]
    assert torch.equal(image, dataset.get(1, np.random.default_rng(3))[0])
    assert not torch.equal(image, dataset.get(1, np.random.default_rng(4))[0])
    torch.manual_seed(5)
    first, second = dataset[1][0], dataset[1][0]
    torch.manual_seed(5)
    assert torch.equal(first, dataset[1][0])
    assert not torch.equal(first, second)
    assert not torch.equal(dataset[1][0], dataset[1][0])
    with pytest.raises(IndexError):
        dataset[4]


@pytest.mark.parametrize("workers", [0, 1])
def test_dataset_works_with_a_data_loader(tiny_frames, workers: int) -> None:
    dataset = FrameDataset(tiny_frames, "train")
    batches = list(DataLoader(dataset, batch_size=2, collate_fn=collate, num_workers=workers))
    assert len(batches) == 2
    loaded = [item for images, targets in batches for item in zip(images, targets, strict=True)]
    for index, (image, target) in enumerate(loaded):
        expected_image, expected_target = dataset[index]
        assert torch.equal(image, expected_image)
        assert all(torch.equal(target[name], value) for name, value in expected_target.items())
    torch.manual_seed(0)
    losses = build_frame_parser(TINY).train()(*batches[0])
    assert all(torch.isfinite(v) for v in losses.values())


def test_dataset_errors_name_the_file(tiny_frames, tmp_path) -> None:
    with pytest.raises(DataError, match="no frames for part 'all'"):
        FrameDataset(tmp_path / "empty", "all")
    with pytest.raises(DataError, match="expected train, evaluation or all"):
        FrameDataset(tiny_frames, "test")
    (tiny_frames / "images" / "0.png").unlink()
    with pytest.raises(DataError, match=r"0\.png: no readable image"):
        FrameDataset(tiny_frames, "train")[0]
    (tiny_frames / "annotations_0.jsonl").write_text("{}\n")
    with pytest.raises(DataError, match=r"line 1: .*`file_name`"):
        FrameDataset(tiny_frames, "all")


def test_a_saved_parser_gives_the_same_proposals(tiny_parser: FrameParser, tmp_path) -> None:
    tiny_parser.save_pretrained(tmp_path, {"metrics": {"f1": 0.5}})
    again = FrameParser.from_pretrained(tmp_path, device="cpu", batch_size=2, precision="float32")
    assert again.model.config == TINY
    assert load_checkpoint(tmp_path, "frame_parser")[1]["metrics"] == {"f1": 0.5}
    frames = np.random.default_rng(0).integers(0, 255, (3, 320, 480, 3), dtype=np.uint8)
    results = []
    for parser in (tiny_parser, again):
        parser.model.roi_heads.score_thresh = 0.3
        results.append(parser.parse(frames))
        parser.model.roi_heads.score_thresh = 0.5
    assert len(results[0]) > 0
    assert results[0].masks == results[1].masks
    np.testing.assert_array_equal(results[0].score, results[1].score)
    np.testing.assert_array_equal(results[0].attribute, results[1].attribute)
    with pytest.raises(CheckpointError, match="expected a network of build_frame_parser, got _Perfect"):
        FrameParser(_Perfect([])).save_pretrained(tmp_path)


def test_a_parser_moves_to_a_device_or_says_why_not(tiny_parser: FrameParser, tmp_path) -> None:
    assert tiny_parser.to("cpu") is tiny_parser
    assert next(tiny_parser.model.parameters()).device.type == "cpu"
    with pytest.raises(DataError, match="device 'abacus'"):
        tiny_parser.to("abacus")
    tiny_parser.save_pretrained(tmp_path)
    with pytest.raises(DataError, match="device 'abacus'"):
        FrameParser.from_pretrained(tmp_path, device="abacus")
    with pytest.raises(CheckpointError, match="no checkpoint"):
        FrameParser.from_pretrained(tmp_path / "none")


class _Perfect(torch.nn.Module):
    """Returns the targets of a dataset, in order, as detections."""

    def __init__(self, targets) -> None:
        super().__init__()
        self.anything = torch.nn.Parameter(torch.zeros(1))
        self.targets = iter(targets)

    def forward(self, images):
        target = next(self.targets)
        label = (target["color"] * 2 + target["material"]) * 3 + target["shape"]
        found = {"attribute": torch.nn.functional.one_hot(label, 48).float(), "labels": target["labels"]}
        found |= {name: torch.nn.functional.one_hot(target[name], size).float() for name, size in SIZES.items()}
        scores = torch.ones(len(target["boxes"]))
        return [{"boxes": target["boxes"], "scores": scores, "masks": target["masks"][:, None].float(), **found}]


def test_the_heads_have_the_words_of_a_world(tmp_path) -> None:
    world = World(
        "mine",
        Vocabulary(
            (Color("orange", (255, 140, 0)),),
            tuple(map(Material, ("wood", "steel", "glass"))),
            (Shape("puck", "cylinder"), Shape("die", "box")),
        ),
    )
    network = build_frame_parser(TINY, world)
    features = torch.zeros(2, TINY.box_features)
    assert {k: v.shape[1] for k, v in network.roi_heads.attribute_predictor(features).items()} == {
        "color": 1,
        "material": 3,
        "shape": 2,
    }
    with pytest.raises(DataError, match="was trained on the color words orange; the world CLEVRER has gray, red"):
        FrameParser(network, world=CLEVRER_WORLD)
    FrameParser(network).save_pretrained(tmp_path)
    again = FrameParser.from_pretrained(tmp_path, device="cpu")
    assert again.parse(np.zeros((1, 320, 480, 3), np.uint8)).world.name == "mine"


def test_training_takes_words_and_colors_of_the_frames_world(tmp_path) -> None:
    world = World(
        "mine",
        Vocabulary((Color("orange", (255, 140, 0)),), (Material("wood"),), CLEVRER_WORLD.vocabulary.shapes),
        timeline=Timeline(20, 60),
        camera=Camera(width=256, height=200),
        layout=Layout(((2, 1.0),), 2),
    )
    image, mask = np.full((200, 256, 3), 51, np.uint8), np.zeros((200, 256), np.uint8, order="F")
    mask[80:120, 100:150] = 1
    segmentation = {"size": [200, 256], "counts": rle.encode(mask)["counts"].decode()}
    rows = [
        {
            "file_name": f"{scene}.png",
            "scene": scene,
            "objects": [{"color": "orange", "material": "wood", "shape": "cube", "segmentation": segmentation}],
        }
        for scene in (0, 1)
    ]
    (tmp_path / "frames" / "images").mkdir(parents=True)
    for row in rows:
        cv2.imwrite(str(tmp_path / "frames" / "images" / row["file_name"]), image)
    (tmp_path / "frames" / "annotations_00000.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    store_world(tmp_path / "frames", world)
    with pytest.raises(
        DataError, match=r"world.json: is another world than CLEVRER, in vocabulary.colors, .*timeline.fps"
    ):
        store_world(tmp_path / "frames", CLEVRER_WORLD)

    loop = LoopConfig(steps=1, batch_size=1, warmup_steps=0, device="cpu")
    initial = Path("checkpoints/default").resolve()
    config = FrameParserTraining(str(tmp_path / "frames"), str(tmp_path / "run"), initial=str(initial), loop=loop)
    task = FrameParserTask(config)
    assert task.model_config.image_mean == (0.2, 0.2, 0.2)
    stored, _ = load_checkpoint(initial, "frame_parser")
    heads = task.model.roi_heads.attribute_predictor.heads
    torch.testing.assert_close(
        heads["shape"].weight.detach(), stored["roi_heads.attribute_predictor.heads.shape.weight"]
    )
    assert heads["color"].weight.shape[0] == 1

    folder = train_part("frame_parser", task, config, task.model_config, stored_world(world))
    assert world_of_checkpoint(Path(folder)) == world
    found = FrameParser.from_pretrained(folder, device="cpu").parse(np.full((3, 200, 256, 3), 51, np.uint8))
    assert found.world == world
    with pytest.raises(DataError, match="frame 0: expected an array \\(200, 256, 3\\) of uint8"):
        FrameParser.from_pretrained(folder, device="cpu").parse(iter([np.zeros((320, 480, 3), np.uint8)]))


def test_scores_of_perfect_and_wrong_detections(tiny_frames) -> None:
    dataset = FrameDataset(tiny_frames, "train")
    items = [dataset[i] for i in range(len(dataset))]
    perfect = detection_scores(_Perfect([t for _, t in items]), items)
    assert perfect["f1"] == perfect["mask_iou"] == 1.0
    precision = average_precision(_Perfect([t for _, t in items]), items)
    assert precision == pytest.approx({"mask_ap": 1.0, "mask_ap50": 1.0, "box_ap": 1.0, "box_ap50": 1.0})
    wrong = [{**t, "color": (t["color"] + 1) % 8} for _, t in items]
    scores = detection_scores(_Perfect(wrong), items)
    assert scores["f1"] == 0.0
    assert scores["color_accuracy"] == 0.0
    assert scores["shape_accuracy"] == 1.0


@pytest.mark.parametrize("shape", ["cube", "sphere", "cylinder"])
@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (-2.0, 1.5), (1.5, -0.8)])
def test_outline_centroid_gives_the_position(shape: str, x: float, y: float) -> None:
    mask = np.zeros((320, 480), np.uint8)
    cv2.fillPoly(mask, [np.round(outline(shape, x, y, 0.4) * 16).astype(np.int32)], 1, shift=4)
    rows, columns = np.nonzero(mask)
    centroid = np.array([[columns.mean() + 0.5, rows.mean() + 0.5]])
    box = np.array([[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]])
    np.testing.assert_allclose(
        ground_location(shape, centroid, box, hidden_sides(box, CLEVRER_CAMERA))[0], [x, y], atol=0.03
    )


def test_the_visible_sides_give_the_position_of_an_outline_cut_by_the_border() -> None:
    expected = CLEVRER_CAMERA.ground([474.0, 160.0])
    polygon = outline("sphere", *expected)
    centroid = np.array([[470.0, 160.0]])  # of the visible part, too far left
    box = np.array([[polygon[:, 0].min(), polygon[:, 1].min(), 480, polygon[:, 1].max()]]).round().astype(int)
    assert abs(ground_location("sphere", centroid, box, hidden_sides(box, CLEVRER_CAMERA))[0] - expected).max() < 0.05


def moving(frames, attribute: int, x0: float, speed: float, score: float = 0.99):
    """Rows of one object that moves to the right in the image, at a speed in pixels per frame."""
    rows = []
    for f in frames:
        x = x0 + speed * f
        rows.append((f, attribute, score, (x, 150.0), [int(x) - 15, 135, int(x) + 15, 165]))
    return rows


def as_proposals(rows, n_frames: int = 40) -> VideoProposals:
    rows = sorted(rows, key=lambda r: r[0])
    frame, attribute, score, centroid, box = zip(*rows, strict=True)
    area = np.full(len(rows), 900)
    return VideoProposals(
        n_frames, np.array(frame), np.array(attribute), np.array(score), np.array(centroid), area, np.array(box)
    )


RED, BLUE, GREEN = (CLEVRER.index(c, "rubber", "sphere") for c in ("red", "blue", "green"))


def test_tracks_follow_objects_and_bridge_gaps() -> None:
    rows = moving([f for f in range(40) if not 12 <= f < 18], RED, 50, 4) + moving(range(5, 40), BLUE, 300, 0)
    video = track(as_proposals(rows))
    assert [t.object.name for t in video.tracks] == ["red rubber sphere", "blue rubber sphere"]
    assert len(video.tracks[0].frame_index) == 34
    assert video.tracks[1].frame_index[0] == 5


def test_a_wrong_label_in_single_frames_is_outvoted() -> None:
    rows = moving(range(40), RED, 50, 4)
    rows[20] = (20, GREEN, *rows[20][2:])
    video = track(as_proposals(rows))
    assert [t.object.color for t in video.tracks] == ["red"]
    assert len(video.tracks[0].frame_index) == 40


def test_an_object_that_enters_in_the_last_frames_is_kept() -> None:
    def at(frames, x: float):
        return as_proposals(moving(frames, RED, x - 4 * frames[0], 4.0), 128)

    (late,) = track(at(range(122, 128), 16)).tracks
    assert late.frame_index.tolist() == list(range(122, 128))
    assert len(track(at(range(127, 128), 16)).tracks) == 1
    assert len(track(at(range(125, 127), 16)).tracks) == 1  # in two of the last three frames
    assert track(at(range(100, 106), 16)).tracks == ()  # not until the end
    assert track(at(range(122, 128), 200)).tracks == ()  # not from the border


def test_rare_and_uncertain_identities_are_dropped() -> None:
    rows = moving(range(40), RED, 50, 4) + moving(range(12), BLUE, 300, 0) + moving(range(40), GREEN, 200, 0, score=0.8)
    assert [t.object.color for t in track(as_proposals(rows)).tracks] == ["red"]
    rows += moving(range(12, 13), BLUE, 300, 0)
    assert len(track(as_proposals(rows)).tracks) == 2
    assert len(track(as_proposals(rows), TrackerConfig(score=0.7)).tracks) == 3


def test_a_tracklet_that_goes_over_to_another_object_is_cut() -> None:
    """The second object appears where the first one is hidden, and the link between frames takes it for the first."""
    other = CLEVRER.index("green", "metal", "sphere")
    rows = moving(range(60), RED, 50, 2) + moving(range(60, 75), other, 50, 2)
    video = track(as_proposals(rows, 75))
    assert [(t.object.color, int(t.frame_index[0]), len(t.frame_index)) for t in video.tracks] == [
        ("red", 0, 60),
        ("green", 60, 15),
    ]
    wrong_label = moving(range(60), RED, 50, 2) + moving(range(60, 75), BLUE, 50, 2)  # one word alone
    assert len(track(as_proposals(wrong_label, 75)).tracks) == 1
    alternating = moving(range(0, 40, 2), RED, 50, 4) + moving(range(1, 40, 2), other, 50, 4)
    assert len(track(as_proposals(alternating)).tracks) == 1


def test_an_object_that_enters_is_one_whatever_it_was_taken_for_at_first() -> None:
    """Half outside at the top, far from the camera: a wider box shifts the place by more than objects move."""
    metal = CLEVRER.index("red", "metal", "sphere")
    rows = [(f, metal, 0.99, (358.0, 9.0), [343, 1, 373, 17]) for f in range(14)]
    rows += [(f, RED, 0.99, (359.0, 10.0), [343, 1, 375, 24]) for f in range(14, 60)]
    video = track(as_proposals(rows, 60))
    boxes = np.array([rows[0][4], rows[14][4]])
    places = ground_location("sphere", np.array([rows[0][3], rows[14][3]]), boxes, cut_sides(boxes, CLEVRER_CAMERA))
    assert np.hypot(*(places[0] - places[1])) > 0.35
    assert [(t.object.name, len(t.frame_index)) for t in video.tracks] == [("red rubber sphere", 60)]


def test_the_rest_of_a_hidden_object_is_no_second_one() -> None:
    fragment = [(f, BLUE, 0.99, (50.0, 150.0), [35, 135, 48, 165]) for f in range(20)]
    whole = moving(range(40), RED, 50, 0)
    assert [t.object.color for t in track(as_proposals(whole + fragment)).tracks] == ["red"]


@pytest.mark.parametrize("missing", [(), (20,)])
@pytest.mark.parametrize("better", [RED, BLUE])
def test_of_two_labels_for_one_object_the_surer_one_stays(better: int, missing: tuple[int, ...]) -> None:
    other = BLUE if better == RED else RED
    frames = [f for f in range(40) if f not in missing]
    rows = moving(range(40), better, 50, 0, score=0.99) + moving(frames, other, 51, 0, score=0.95)
    assert [t.object.color for t in track(as_proposals(rows)).tracks] == ["red" if better == RED else "blue"]


def test_two_tracklets_of_one_triple_become_one_track() -> None:
    rows = moving(range(40), RED, 50, 4) + moving(range(10, 30), RED, 300, 0)
    video = track(as_proposals(rows))
    assert len(video.tracks) == 1
    assert len(np.unique(video.tracks[0].frame_index)) == 40


def test_proposals_from_empty_masks_are_left_out() -> None:
    from pycocotools import mask as rle

    empty = rle.encode(np.zeros((320, 480), np.uint8, order="F"))["counts"].decode()
    assert len(proposals_from_rows(1, [(0, 1, 0.9, empty)])) == 0


def draw_video(path, frames: int = 128, size=(480, 320), rate: float = 25.0) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), rate, size)
    for f in range(frames):
        image = np.full((size[1], size[0], 3), 120, np.uint8)
        cv2.circle(image, (size[0] // 2, size[1] // 2), 10 + f % 20, (0, 0, 255), -1)
        writer.write(image)
    writer.release()


def test_a_normal_video_is_read_without_warning(tmp_path) -> None:
    draw_video(tmp_path / "v.mp4")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_video(tmp_path / "v.mp4").shape == (128, 320, 480, 3)


def test_other_sizes_keep_their_aspect(tmp_path) -> None:
    draw_video(tmp_path / "v.mp4", size=(320, 320))
    with pytest.warns(UserWarning, match="320x320 px, resized"):
        frames = read_video(tmp_path / "v.mp4")
    assert frames.shape == (128, 320, 480, 3)
    red = frames[19, :, :, 0].astype(int) - frames[19, :, :, 1] > 60
    rows, columns = np.nonzero(red)
    assert abs((rows.max() - rows.min()) - (columns.max() - columns.min())) <= 3


def test_other_frame_rates_are_resampled(tmp_path) -> None:
    draw_video(tmp_path / "v.mp4", frames=256, rate=50)
    with pytest.warns(UserWarning, match="50 frames per second, resampled to 25"):
        assert len(read_video(tmp_path / "v.mp4")) == 128
    draw_video(tmp_path / "slow.mp4", frames=64, rate=12.5)
    with pytest.warns(UserWarning, match="resampled"):
        assert len(read_video(tmp_path / "slow.mp4")) in (127, 128)


def test_short_videos_are_read_with_a_warning(tmp_path) -> None:
    draw_video(tmp_path / "v.mp4", frames=30)
    with pytest.warns(UserWarning, match=r"30 frames, CLEVRER's videos have 128"):
        assert len(read_video(tmp_path / "v.mp4")) == 30


def test_broken_videos_are_named(tmp_path) -> None:
    with pytest.raises(VideoError, match=r"none\.mp4: no such file"):
        read_video(tmp_path / "none.mp4")
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(VideoError, match=r"text\.mp4: is a text file"):
        read_video(tmp_path / "text.mp4")
    np.savez(tmp_path / "scene.npz", np.zeros(1))
    with pytest.raises(VideoError, match=r"scene\.npz: is an archive \(ZIP or NPZ\); expected a video$"):
        read_video(tmp_path / "scene.npz")
    draw_video(tmp_path / "empty.mp4", frames=0)
    with pytest.raises(VideoError, match=r"empty\.mp4: (is|not) .*video"):
        read_video(tmp_path / "empty.mp4")


def test_masks_are_pasted_where_training_samples_them() -> None:
    """The RoIAlign of a true mask, pasted back, has the mask's centroid to a tenth of a pixel for any box position."""
    from torchvision.ops import roi_align

    image = np.zeros((320, 480), np.uint8)
    cv2.ellipse(image, (200, 120), (31, 24), 20, 0, 360, 1, -1)
    rows, columns = np.nonzero(image)
    for shift in (0.0, 0.3, 0.7):
        box = torch.tensor([[0.0, 165 + shift, 90 - shift, 238 - shift, 152 + shift]])
        small = roi_align(torch.from_numpy(image)[None, None].float(), box, (28, 28), 1.0)[0, 0]
        mask, start, stop = (
            mask_changes(small[None], box[:, 1:], (320, 480)).numpy()[row, k::2] for row, k in ((0, 0), (1, 0), (1, 1))
        )
        centroid = numbers_of_runs(ObjectRuns(mask, start, stop), 320).centroid_px[0]
        np.testing.assert_allclose(centroid - 0.5, [columns.mean(), rows.mean()], atol=0.1)


def test_a_partly_hidden_object_is_localized_by_its_visible_sides() -> None:
    whole = np.array([outline("cylinder", -0.5, 0.1).min(0), outline("cylinder", -0.5, 0.1).max(0)]).ravel()
    near = np.array([outline("cylinder", 0.3, 0.25).min(0), outline("cylinder", 0.3, 0.25).max(0)]).ravel()
    seen = whole.copy()
    seen[2] = near[0]  # the nearer object hides its right side
    boxes = np.round(np.stack([seen, near])).astype(int)
    hidden = hidden_sides(boxes, CLEVRER_CAMERA)
    assert hidden[0].tolist() == [False, False, True, False]
    assert not hidden[1].any()
    both = hidden_sides(np.stack([boxes, boxes[::-1]]), CLEVRER_CAMERA)
    np.testing.assert_array_equal(both, [hidden, hidden_sides(boxes[::-1], CLEVRER_CAMERA)])
    centroid = np.array([[(seen[0] + seen[2]) / 2, (seen[1] + seen[3]) / 2]])
    by_centroid = ground_location("cylinder", centroid, boxes[:1], np.zeros((1, 4), bool))[0]
    by_sides = ground_location("cylinder", centroid, boxes[:1], hidden[:1])[0]
    assert np.hypot(*(by_sides - [-0.5, 0.1])) < 0.03 < np.hypot(*(by_centroid - [-0.5, 0.1]))


def test_sides_at_the_border_are_hidden() -> None:
    assert hidden_sides(np.array([[0, 50, 30, 90]]), CLEVRER_CAMERA)[0].tolist() == [True, False, False, False]
    assert hidden_sides(np.array([[440, 280, 480, 320]]), CLEVRER_CAMERA)[0].tolist() == [False, False, True, True]
    assert hidden_sides(np.zeros((0, 4), int), CLEVRER_CAMERA).shape == (0, 4)

"""The prepared network finds what the network itself finds."""

import warnings

import numpy as np
import pytest
import torch
from torch.profiler import ProfilerActivity, profile

from nsdr import DataError
from nsdr.clevrer.example import VIDEO
from nsdr.frame_parser.dataset import image_tensor
from nsdr.frame_parser.model import FrameParserConfig, build_frame_parser
from nsdr.frame_parser.parser import MIN_OBJECTNESS, Detector, FrameParser
from nsdr.io.device import CPU_CHECK, limit_threads, resolve_precision
from nsdr.io.video import read_frames

CPU = torch.device("cpu")
OBJECTS = {"boxes": 0.01, "scores": 1e-4, "masks": 1e-3, "attribute": 1e-3}
"""What is compared, and how far it may differ in float32."""


@pytest.fixture(scope="module")
def frames() -> list[np.ndarray]:
    return [frame for i, frame in enumerate(read_frames(VIDEO)) if i in (10, 70)]


@pytest.fixture(scope="module")
def parser() -> FrameParser:
    return FrameParser.from_pretrained(device="cpu")


@torch.no_grad()
def own(model: torch.nn.Module, frames: list[np.ndarray]) -> list[dict[str, torch.Tensor]]:
    """Detections by torchvision's own way through the network, with masks in their boxes."""
    images, _ = model.transform([image_tensor(frame) for frame in frames])
    levels = model.backbone(images.tensors)
    return model.roi_heads(levels, model.rpn(images, levels)[0], images.image_sizes)[0]


@limit_threads(1)
@torch.no_grad()
def detected(model: torch.nn.Module, frames: list[np.ndarray], precision: torch.dtype) -> list[dict[str, torch.Tensor]]:
    found = Detector(model, precision)(frames)
    return [{k: v[found["image"] == i] for k, v in found.items()} for i in range(len(frames))]


def test_in_float32_detections_are_those_of_the_network(parser: FrameParser, frames) -> None:
    for found, expected in zip(detected(parser.model, frames, torch.float32), own(parser.model, frames), strict=True):
        assert len(expected["scores"]) > 2
        for name, tolerance in OBJECTS.items():
            torch.testing.assert_close(found[name], expected[name], atol=tolerance, rtol=1e-3)


def test_in_bfloat16_objects_masks_and_attributes_are_the_same(parser: FrameParser, frames) -> None:
    single, half = (detected(parser.model, frames, dtype) for dtype in (torch.float32, torch.bfloat16))
    for found, expected in zip(half, single, strict=True):
        for side in (found, expected):  # doubtful detections may come and go
            sure = side["scores"] > 0.9
            side.update({name: value[sure] for name, value in side.items()})
            order = side["boxes"][:, 0].argsort()
            side.update({name: value[order] for name, value in side.items()})
        torch.testing.assert_close(found["boxes"], expected["boxes"], atol=1.0, rtol=0)
        assert torch.equal(found["attribute"].argmax(1), expected["attribute"].argmax(1))
        assert float(((found["masks"] > 0.5) != (expected["masks"] > 0.5)).float().mean()) < 0.01


@pytest.mark.parametrize("backbone", ["resnet18", "resnet50"])
def test_batch_normalisation_of_every_backbone_goes_into_its_convolutions(backbone: str) -> None:
    torch.manual_seed(0)
    config = FrameParserConfig(backbone=backbone, fpn_channels=16, box_features=32, mask_channels=16, mask_layers=1)
    model = build_frame_parser(config)
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.running_mean, -0.1, 0.1)
            torch.nn.init.uniform_(module.running_var, 0.5, 2)
    model.eval()
    fused = Detector(model, torch.float32).backbone
    assert not any(isinstance(module, torch.nn.BatchNorm2d) for module in fused.modules())
    images = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        for name, level in model.backbone(images).items():
            torch.testing.assert_close(fused(images)[name], level, atol=1e-3, rtol=1e-3)
    assert any(isinstance(module, torch.nn.BatchNorm2d) for module in model.modules())


def test_regions_of_low_objectness_are_not_proposed(parser: FrameParser, frames, monkeypatch) -> None:
    seen: list[int] = []
    monkeypatch.setattr(
        parser.model.roi_heads, "detections", lambda levels, boxes, sizes: seen.append(sum(map(len, boxes))) or {}
    )
    for min_objectness in (0.0, MIN_OBJECTNESS, 1.1):
        with torch.no_grad():
            assert Detector(parser.model, torch.float32, min_objectness)(frames) == {}
    assert seen[0] == 2 * parser.model.config.proposals
    assert 10 < seen[1] < seen[0]
    assert seen[2] == 0


def test_frames_in_which_nothing_is_proposed_have_no_detections(parser: FrameParser) -> None:
    blank = np.full((320, 480, 3), 128, np.uint8)
    with torch.no_grad():
        found = Detector(parser.model, torch.float32, min_objectness=1.1)([blank, blank])
    assert found["boxes"].shape == (0, 4)
    assert len(parser.parse([blank])) == 0


def test_launches_and_synchronisations_do_not_grow_with_the_batch(frames) -> None:
    def counted(size: int) -> dict[str, int]:
        parser = FrameParser.from_pretrained(device="cpu", precision="float32", batch_size=size)
        shown = [frame.copy() for frame in frames * (size // 2)]
        parser.parse(shown)
        with warnings.catch_warnings(action="ignore"), profile(activities=[ProfilerActivity.CPU]) as profiled:
            found = parser.parse(shown)
        assert len(np.unique(found.frame_index)) == size
        return {event.key: event.count for event in profiled.key_averages()}

    few, many = counted(2), counted(8)
    # On a GPU, each of these waits for the work that was started before.
    for name in ("torchvision::nms", "aten::nonzero", "aten::_local_scalar_dense", "aten::bincount"):
        assert 1 < few[name] == many[name] <= 12, name
    for name in ("aten::index", "aten::_to_copy", "aten::cat", "aten::topk", "torchvision::roi_align"):
        assert few[name] == many[name], name
    assert sum(many.values()) < 1.05 * sum(few.values())


@torch.no_grad()
def test_a_changed_network_is_prepared_again(frames) -> None:
    parser = FrameParser.from_pretrained(device="cpu", precision="float32")
    before = parser.parse(frames)
    parser.model.backbone.stem[0].weight.mul_(0.5)
    changed = parser.parse(frames)
    assert changed.score.tolist() != before.score.tolist()
    parser.model.backbone.stem[0].weight.mul_(2)
    np.testing.assert_array_equal(parser.parse(frames).score, before.score)


def test_precision_is_that_of_the_processor_or_the_chosen_one(monkeypatch) -> None:
    monkeypatch.setattr(torch.cpu, CPU_CHECK, lambda: False, raising=False)
    assert resolve_precision("auto", CPU) is torch.float32
    assert resolve_precision("bfloat16", CPU) is torch.bfloat16
    monkeypatch.setattr(torch.cpu, CPU_CHECK, lambda: True, raising=False)
    assert resolve_precision("auto", CPU) is torch.bfloat16
    assert resolve_precision("float32", CPU) is torch.float32
    with pytest.raises(DataError, match="precision is 'half'; expected one of auto, float32, bfloat16"):
        resolve_precision("half", CPU)
    with pytest.raises(DataError, match="precision is 'half'"):
        FrameParser(build_frame_parser(), precision="half")

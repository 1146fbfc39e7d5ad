"""The paper's frame parser: ResNet-50, one label for the 48 combinations, from COCO weights."""

import json
from pathlib import Path
from urllib.error import URLError

import pytest
import torch
from torchvision.models.detection import MaskRCNN_ResNet50_FPN_Weights, maskrcnn_resnet50_fpn

from nsdr import DataError
from nsdr.frame_parser.model import FrameParserConfig, build_frame_parser
from nsdr.io.checkpoint import load_checkpoint
from nsdr.training import frame_parser
from nsdr.training.frame_parser import load_coco_weights
from nsdr.world.vocabulary import CLEVRER

CONFIG = Path(__file__).parent.parent / "configs" / "frame_parser" / "paper.yaml"
NARROW = FrameParserConfig(backbone="resnet50", attributes="joint", fpn_channels=256, box_features=16, mask_channels=16)


@pytest.fixture
def coco(monkeypatch) -> dict[str, torch.Tensor]:
    """Random weights in place of COCO's."""
    state = maskrcnn_resnet50_fpn(weights=None, weights_backbone=None).state_dict()
    state = {name: value for name, value in state.items() if not name.endswith("num_batches_tracked")}
    monkeypatch.setattr(MaskRCNN_ResNet50_FPN_Weights, "get_state_dict", lambda *_, **__: state)
    return state


def test_coco_weights_are_copied_where_they_fit(coco) -> None:
    model = build_frame_parser(NARROW)
    copied = load_coco_weights(model)
    ours = model.state_dict()
    for prefix in ("backbone.body.", "backbone.fpn.", "rpn.head."):
        names = [name for name in coco if name.startswith(prefix)]
        assert names
        for name in names:
            assert torch.equal(ours[name.replace("backbone.", "backbone.pyramid.")], coco[name]), name
    assert not [name for name in copied if "predictor" in name]  # the outputs for COCO's classes


def test_coco_weights_need_the_network_and_the_file(monkeypatch, tiny_frames, tmp_path) -> None:
    with pytest.raises(DataError, match=r"needs model\.backbone resnet50 with 256 fpn_channels; got slim with 64"):
        load_coco_weights(build_frame_parser())

    def offline(*_, **__):
        raise URLError("no network")

    monkeypatch.setattr(MaskRCNN_ResNet50_FPN_Weights, "get_state_dict", offline)
    arguments = ["--config", str(CONFIG), "--frames", str(tiny_frames), "--run-dir", str(tmp_path / "run")]
    with pytest.raises(DataError, match=r"cannot be had from https://.* put that file into .*or give --pretrained ''"):
        frame_parser.main(arguments)
    with pytest.raises(DataError, match="both start the weights; give one"):
        frame_parser.main([*arguments, "--initial", "default"])


@pytest.mark.robustness  # 20 s of CPU time
def test_the_papers_recipe_trains(coco, tiny_frames, tmp_path) -> None:
    """One step of one frame with the paper's network."""
    arguments = ["--config", str(CONFIG), "--frames", str(tiny_frames), "--run-dir", str(tmp_path / "run")]
    few = ["--loop.steps", "1", "--loop.batch-size", "1", "--evaluation-frames", "1", "--loop.device", "cpu"]
    output = frame_parser.main([*arguments, *few])
    state, card = load_checkpoint(output, "frame_parser")
    assert card["training"]["pretrained"] == "coco"
    assert any(value.shape[:1] == (CLEVRER.n_triples,) for value in state.values())
    (line,) = (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()
    assert json.loads(line)["loss/loss_attribute"] > 0

"""Baselines that attend: MAC (V), MAC (V+), Memory and TVQA+."""

from dataclasses import fields, replace
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.baselines.base import BASELINES, Baseline, Batch, Sizes
from nsdr.baselines.systems import mac, memory, tvqa
from nsdr.baselines.systems.layers import MapEncoder, masked_softmax, time_encoding
from nsdr.errors import DataError
from nsdr.io.configuration import config_of
from nsdr.io.reading import read_yaml
from nsdr.training.loop import LoopConfig
from nsdr.world.vocabulary import CLEVRER

SIZES = Sizes(words=12, answers=5, channels=6, grid=(2, 3), objects=CLEVRER)
CONFIGS = {
    "mac": mac.MacConfig(embedding=8, width=16, steps=3, dropout=0.0),
    "mac_objects": mac.MacConfig(embedding=8, width=16, steps=3, dropout=0.0),
    "memory": memory.MemoryConfig(embedding=8, hidden=16, slots=4, steps=2, dropout=0.0),
    "tvqa": tvqa.TvqaConfig(embedding=8, hidden=16, head=16, dropout=0.0),
}
OF_OBJECTS = ["mac_objects", "tvqa"]
OTHER_VALUES = {
    "mac": {"embedding": 10, "width": 18, "steps": 4, "dropout": 0.5},
    "memory": {"embedding": 10, "hidden": 18, "slots": 5, "steps": 3, "dropout": 0.5},
    "tvqa": {"embedding": 10, "hidden": 18, "head": 17, "dropout": 0.5},
}
OPTIONS = [(name, option) for name in CONFIGS for option in OTHER_VALUES[name.removesuffix("_objects")]]


def network(name: str, **options: object) -> Baseline:
    torch.manual_seed(0)
    return BASELINES[name](replace(CONFIGS[name], **options), SIZES)  # type: ignore[type-var]


def batch(videos: int = 2, frames: int = 4) -> Batch:
    """Three texts of 6, 3 and 1 words about two of the videos."""
    torch.manual_seed(1)
    words = torch.tensor([[1, 2, 3, 11, 4, 5], [6, 7, 8, 0, 0, 0], [9, 0, 0, 0, 0, 0]])
    has_object = torch.tensor([[1, 1, 0], [1, 0, 0], [0, 0, 0], [1, 0, 1]]).bool()[:frames].repeat(videos, 1, 1)
    objects = torch.rand(videos, frames, 3, 10) * has_object[..., None]
    pooled, maps = torch.rand(videos, frames, 6), torch.rand(videos, frames, 6, 2, 3)
    return Batch(words, torch.tensor([1, 0, 1]), pooled, maps, objects, has_object)


def scores(model: nn.Module, inputs: Batch) -> Tensor:
    with torch.no_grad():
        result: Tensor = model.eval()(inputs)
    return result


@pytest.mark.parametrize("name", CONFIGS)
def test_needs_are_all_that_is_read(name: str) -> None:
    model, inputs = network(name), batch()
    read = model.needs | ({"has_object"} if "objects" in model.needs else set())
    unread = {key: None for key in ("pooled", "maps", "objects", "has_object") if key not in read}
    result = scores(model, inputs._replace(**unread))  # type: ignore[arg-type]
    assert result.shape == (3, 5)
    assert torch.isfinite(result).all()


@pytest.mark.parametrize("name", CONFIGS)
def test_batched_equals_single(name: str) -> None:
    model, inputs = network(name), batch()
    together = scores(model, inputs)
    for i, length in enumerate([6, 3, 1]):
        v = int(inputs.video[i])
        videos = {key: getattr(inputs, key)[v : v + 1] for key in ("pooled", "maps", "objects", "has_object")}
        alone = scores(model, Batch(inputs.words[i : i + 1, :length], torch.tensor([0]), **videos))
        torch.testing.assert_close(together[i : i + 1], alone, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", OF_OBJECTS)
def test_absent_objects_do_not_matter(name: str) -> None:
    model, inputs = network(name), batch()
    assert inputs.objects is not None
    assert inputs.has_object is not None
    other = torch.where(inputs.has_object[..., None], inputs.objects, torch.full_like(inputs.objects, 9.0))
    torch.testing.assert_close(scores(model, inputs._replace(objects=other)), scores(model, inputs))
    wider = F.pad(other, (0, 0, 0, 2), value=7.0), F.pad(inputs.has_object, (0, 2))
    torch.testing.assert_close(
        scores(model, inputs._replace(objects=wider[0], has_object=wider[1])), scores(model, inputs)
    )
    present = torch.where(inputs.has_object[..., None], inputs.objects + 1, inputs.objects)
    assert not torch.allclose(scores(model, inputs._replace(objects=present)), scores(model, inputs))


@pytest.mark.parametrize("name", OF_OBJECTS)
def test_video_without_objects(name: str) -> None:
    model, inputs = network(name), batch()
    assert inputs.objects is not None
    assert inputs.has_object is not None
    none = inputs.has_object.clone()
    none[1] = False
    result = model(inputs._replace(has_object=none))
    result.sum().backward()
    assert torch.isfinite(result).all()
    assert all(torch.isfinite(p.grad).all() for p in model.parameters() if p.grad is not None)
    other = inputs.objects.clone()
    other[1] += 5
    torch.testing.assert_close(scores(model, inputs._replace(has_object=none, objects=other)), result)


def test_order_of_the_objects_of_a_frame_does_not_matter_to_mac() -> None:
    model, inputs = network("mac_objects"), batch()
    assert inputs.objects is not None
    assert inputs.has_object is not None
    flipped = inputs._replace(objects=inputs.objects.flip(2), has_object=inputs.has_object.flip(2))
    torch.testing.assert_close(scores(model, flipped), scores(model, inputs))


@pytest.mark.parametrize("name", CONFIGS)
def test_order_of_frames_matters(name: str) -> None:
    model, inputs = network(name), batch(frames=2)
    flipped = inputs._replace(
        pooled=inputs.pooled.flip(1),  # type: ignore[union-attr]
        maps=inputs.maps.flip(1),  # type: ignore[union-attr]
        objects=inputs.objects.flip(1),  # type: ignore[union-attr]
        has_object=inputs.has_object.flip(1),  # type: ignore[union-attr]
    )
    assert (scores(model, flipped) - scores(model, inputs)).abs().amin(0).max() > 1e-6


@pytest.mark.parametrize(("name", "option"), OPTIONS)
def test_every_option_has_an_effect(name: str, option: str) -> None:
    inputs = batch()
    changed = network(name, **{option: OTHER_VALUES[name.removesuffix("_objects")][option]})
    torch.manual_seed(2)
    before = network(name).train()(inputs)
    torch.manual_seed(2)
    assert not torch.allclose(changed.train()(inputs), before)


def test_every_option_is_tested() -> None:
    for name, values in OTHER_VALUES.items():
        assert set(values) == {f.name for f in fields(CONFIGS[name])}


@pytest.mark.parametrize("name", CONFIGS)
def test_overfits_eight_texts_about_four_videos(name: str) -> None:
    """Each question has another answer for each video, so neither the text nor the video is enough."""
    model = network(name)
    torch.manual_seed(3)
    objects, has_object = torch.randn(4, 3, 2, 10), torch.ones(4, 3, 2, dtype=torch.bool)
    words = torch.tensor([[1, 2, 3], [1, 4, 0]]).repeat(4, 1)
    video = torch.arange(4).repeat_interleave(2)
    inputs = Batch(words, video, torch.randn(4, 3, 6), torch.randn(4, 3, 6, 2, 3), objects, has_object)
    answers = torch.tensor([0, 1, 1, 2, 2, 3, 3, 4])
    optimizer = torch.optim.Adam(model.parameters(), 1e-2)
    for _ in range(150):
        loss = F.cross_entropy(model(inputs), answers)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        if loss < 0.05:
            break
    assert scores(model, inputs).argmax(1).tolist() == answers.tolist()
    assert F.cross_entropy(scores(model, inputs), answers) < 0.1


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (lambda: mac.MacConfig(steps=0), r"steps"),
        (lambda: mac.MacConfig(width=1), r"width"),
        (lambda: memory.MemoryConfig(slots=0), r"slots"),
        (lambda: tvqa.TvqaConfig(dropout=1.5), r"dropout"),
    ],
)
def test_values_out_of_range(config: object, message: str) -> None:
    with pytest.raises(DataError, match=message):
        config()  # type: ignore[operator]


@pytest.mark.parametrize("name", CONFIGS)
def test_configurations(name: str) -> None:
    """The file of the paper's settings spells out the defaults; that of the small ones is usable."""
    kind = BASELINES[name].Config
    folder = Path(__file__).parents[1] / "configs" / "baselines"
    paper, small = read_yaml(folder / f"{name}.yaml"), read_yaml(folder / "small" / f"{name}.yaml")
    assert paper["system"] == small["system"] == name
    assert set(paper["model"]) == {f.name for f in fields(kind)}
    assert config_of(kind, paper["model"]) == kind()
    assert config_of(kind, small["model"]) != kind()
    for content in (paper, small):
        config_of(LoopConfig, content["loop"])


@pytest.mark.parametrize("name", CONFIGS)
def test_odd_widths_work(name: str) -> None:
    width = {"width": 15} if name.startswith("mac") else {"hidden": 15}
    assert scores(network(name, **width, embedding=7), batch()).shape == (3, 5)


def test_dropout_is_no_motion_to_memory() -> None:
    model = network("memory", dropout=0.5).train()
    read: list[Tensor] = []
    model.motion.register_forward_pre_hook(lambda _, inputs: read.append(inputs[0]))  # type: ignore[union-attr]
    inputs = batch()
    model(inputs._replace(pooled=torch.ones(2, 4, 6)))
    assert not read[0].any()


def test_masked_softmax() -> None:
    mask = torch.tensor([[True, False, True], [False, False, False]])
    weights = masked_softmax(torch.tensor([[0.0, 9.0, 0.0], [1.0, 2.0, 3.0]]), mask)
    torch.testing.assert_close(weights, torch.tensor([[0.5, 0.0, 0.5], [0.0, 0.0, 0.0]]))


def test_time_encoding() -> None:
    encoding = time_encoding(25, 6, torch.zeros(1))
    assert encoding.shape == (25, 6)
    torch.testing.assert_close(encoding[:, 0], torch.arange(25).float().sin())
    distances = torch.cdist(encoding, encoding) + torch.eye(25)
    assert distances.min() > 0.1  # all frames differ
    assert time_encoding(3, 5, torch.zeros(1)).shape == (3, 5)


def test_the_scale_of_maps_does_not_matter() -> None:
    torch.manual_seed(0)
    maps, encode = torch.rand(3, 4, 5, 6, 7), MapEncoder(5, 8)
    assert torch.allclose(encode(maps), encode(10 * maps - 3), atol=1e-2)

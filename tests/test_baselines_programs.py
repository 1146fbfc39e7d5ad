"""The baselines that a program assembles: IEP and TbD-net."""

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from nsdr.baselines.base import BASELINES, Batch, Sizes
from nsdr.baselines.data import PAD, PROGRAM_SEPARATOR
from nsdr.baselines.systems.modular import Modular, ModularConfig, TbdConfig
from nsdr.baselines.systems.program_graph import MALFORMED, Node, instructions, program_graph
from nsdr.errors import DataError
from nsdr.io.configuration import config_of
from nsdr.io.reading import read_yaml
from nsdr.question_parser.tokenizer import decoder_tokens
from nsdr.training.loop import LoopConfig
from nsdr.world.vocabulary import CLEVRER

CONFIGS = Path(__file__).parents[1] / "configs/baselines"

COUNT_RED = "objects red filter_color count"
COUNT_BLUE = "objects blue filter_color count"
MOVING_RED = "objects red filter_color start get_frame filter_moving exist"
RED = "objects red filter_color unique"
PARTNER = f"events {RED} filter_collision unique {RED} get_col_partner query_shape"
EXPLANATORY = f"events events {RED} filter_in unique filter_ancestor belong_to negate"
COUNTERFACTUAL = "all_events objects cube filter_shape unique get_counterfact belong_to"
FIRST_IN = "events objects filter_in first filter_order"
ORDER = f"events {FIRST_IN} filter_after objects filter_out last filter_order get_object query_color"
CHOICE = "objects cyan filter_color unique"
EVENT_CHOICE = f"all_events {CHOICE} filter_collision objects cube filter_shape unique filter_collision unique"
TEXTS = [
    (COUNT_RED, None),
    (COUNT_BLUE, None),
    (MOVING_RED, None),
    (PARTNER, None),
    (ORDER, None),
    (EXPLANATORY, CHOICE),
    (EXPLANATORY, EVENT_CHOICE),
    (COUNTERFACTUAL, EVENT_CHOICE),
    ("unseen_events belong_to", EVENT_CHOICE),
]
FRAMES, CHANNELS, GRID, ANSWERS = 5, 6, (3, 4), 7
NAMES = ["iep", "tbd"]


def tokens(question: str, choice: str | None = None) -> list[int]:
    indices = [decoder_tokens(CLEVRER).index(token) for token in question.split()]
    return indices if choice is None else [*indices, PROGRAM_SEPARATOR, *tokens(choice)]


def batch(programs: list[list[int]], video: list[int], maps: Tensor) -> Batch:
    longest = max(map(len, programs))
    padded = torch.tensor([[*p, *[PAD] * (longest - len(p))] for p in programs])
    return Batch(torch.ones(len(programs), 1, dtype=torch.int64), torch.tensor(video), maps=maps, program=padded)


def maps(videos: int) -> Tensor:
    return torch.rand(videos, FRAMES, CHANNELS, *GRID, generator=torch.Generator().manual_seed(1))


def network(name: str, **settings: Any) -> Modular:
    torch.manual_seed(0)
    kind = BASELINES[name]
    config = kind.Config(**{"width": 8, "frames": 4, "projection": 8, "hidden": 16, **settings})
    built = kind(config, Sizes(10, ANSWERS, CHANNELS, GRID, CLEVRER))
    assert isinstance(built, Modular)
    return built.eval()


def scores(name: str, *programs: str) -> Tensor:
    with torch.no_grad():
        return network(name)(batch([tokens(*p.split(" | ")) for p in programs], [0] * len(programs), maps(1)))


def test_defaults_are_the_papers() -> None:
    assert ModularConfig() == ModularConfig(width=128, frames=25, projection=512, hidden=1024)
    assert TbdConfig().dilations == (1, 2, 4, 8, 1)


@pytest.mark.parametrize("name", NAMES)
def test_configurations_fit(name: str) -> None:
    kind = BASELINES[name].Config
    settings = [read_yaml(CONFIGS / part / f"{name}.yaml") for part in (".", "small")]
    assert [content["system"] for content in settings] == [name, name]
    assert config_of(kind, settings[0]["model"]) == kind()
    assert config_of(kind, settings[1]["model"]).width == 32
    for content in settings:
        config_of(LoopConfig, content["loop"])


def test_words_belong_to_their_modules() -> None:
    graph = program_graph(torch.tensor([tokens(COUNT_RED)]), torch.tensor([3]), CLEVRER)
    assert graph.nodes == [Node("objects", 3, ()), Node("filter_color red", 3, (0,)), Node("count", 3, (1,))]
    assert graph.texts == [[0, 1, 2]]
    assert instructions(CLEVRER)["filter_order last"] == 1
    assert instructions(CLEVRER)["filter_before"] == 2
    assert "filter_color" not in instructions(CLEVRER)


def test_an_options_program_is_judged_by_the_questions() -> None:
    program = torch.tensor([tokens("unseen_events belong_to negate", "objects unique")])
    graph = program_graph(program, torch.tensor([0]), CLEVRER)
    assert [(n.instruction, n.inputs) for n in graph.nodes] == [
        ("objects", ()),
        ("unique", (0,)),
        ("unseen_events", ()),
        ("belong_to", (1, 2)),
        ("negate", (3,)),
    ]


def test_equal_steps_about_one_video_are_one_node() -> None:
    programs = torch.tensor([tokens(COUNT_RED), tokens(COUNT_BLUE), tokens(COUNT_RED), tokens(COUNT_RED)])
    graph = program_graph(programs, torch.tensor([0, 0, 0, 1]), CLEVRER)
    assert graph.texts[0] == graph.texts[2] == [0, 1, 2]
    assert graph.texts[1][0] == 0
    assert len(graph.nodes) == 3 + 2 + 3


@pytest.mark.parametrize(
    "program",
    [
        "",
        "objects red filter_color",
        "objects red",
        "red filter_color count",
        "objects objects count",
        "objects red count",
        "events red filter_color count",
        "objects <other> count",
        "unseen_events belong_to",
        f"{COUNT_RED} | {CHOICE}",
        "unseen_events belong_to | objects count",
        "unseen_events belong_to | ",
        f"unseen_events belong_to | {CHOICE} <end> {CHOICE}",
        f"<start> {COUNT_RED}",
        "objects <pad> count",
    ],
)
def test_a_malformed_program_is_a_module_of_its_own(program: str) -> None:
    question, *choice = program.split("|")
    row = tokens(question, *choice) or [PAD]
    assert program_graph(torch.tensor([row]), torch.tensor([2]), CLEVRER).nodes == [Node(MALFORMED, 2, ())]


@pytest.mark.parametrize("name", NAMES)
def test_a_malformed_program_leaves_the_others_alone(name: str) -> None:
    alone = scores(name, COUNT_RED)
    together = scores(name, "objects red", COUNT_RED, "count count")
    torch.testing.assert_close(together[1:2], alone)
    assert torch.equal(together[0], together[2])
    assert not torch.allclose(together[0], together[1])


@pytest.mark.parametrize("name", NAMES)
def test_batched_is_single_whatever_the_padding(name: str) -> None:
    model, videos = network(name), [i % 3 for i in range(len(TEXTS))]
    programs = [tokens(*text) for text in TEXTS]
    with torch.no_grad():
        together = model(batch(programs, videos, maps(3)))
        alone = [model(batch([p], [0], maps(3)[v : v + 1])) for p, v in zip(programs, videos, strict=True)]
    assert together.shape == (len(TEXTS), ANSWERS)
    torch.testing.assert_close(together, torch.cat(alone), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_another_program_or_video_gives_other_scores(name: str) -> None:
    model = network(name)
    with torch.no_grad():
        of_programs = model(batch([tokens(*text) for text in TEXTS], [0] * len(TEXTS), maps(1)))
        of_videos = model(batch([tokens(COUNT_RED)] * 2, [0, 1], maps(2)))
    assert torch.pdist(of_programs).min() > 1e-6
    assert torch.pdist(of_videos).min() > 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_the_order_of_frames_matters(name: str) -> None:
    one = maps(1)
    with torch.no_grad():
        forwards = network(name)(batch([tokens(MOVING_RED)], [0], one))
        backwards = network(name)(batch([tokens(MOVING_RED)], [0], one.flip(1)))
    assert not torch.allclose(forwards, backwards)


@pytest.mark.parametrize("name", NAMES)
def test_overfits_what_depends_on_video_and_program(name: str) -> None:
    """Two colours, whose objects are bright places of a channel: the answer is the number of a colour's objects."""
    generator = torch.Generator().manual_seed(0)
    counts = torch.tensor([[0, 1], [1, 0], [2, 1], [1, 2]])
    videos = 0.1 * torch.rand(len(counts), FRAMES, CHANNELS, *GRID, generator=generator)
    for video, of_colors in zip(videos, counts.tolist(), strict=True):
        for color, count in enumerate(of_colors):
            places = torch.randperm(GRID[0] * GRID[1], generator=generator)[:count]
            video[:, color].flatten(1)[:, places] += 1
    programs = [tokens(COUNT_RED), tokens(COUNT_BLUE)] * len(counts)
    texts = batch(programs, [i // 2 for i in range(2 * len(counts))], videos)
    model = network(name, width=16).train()
    optimizer = torch.optim.Adam(model.parameters(), 5e-3)
    for _ in range(100):
        optimizer.zero_grad()
        loss = functional.cross_entropy(model(texts), counts.flatten())
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    assert torch.equal(model(texts).argmax(1), counts.flatten())


def test_every_instruction_runs_and_learns() -> None:
    """Each module of both networks gets gradients from some text."""
    words = {"filter_color": "gray red blue green brown cyan purple yellow", "filter_material": "metal rubber"}
    words["filter_shape"] = "cube sphere cylinder"
    filters = [f"objects {word} {module} count" for module, of in words.items() for word in of.split()]
    orders = [f"events {word} filter_order get_object query_material" for word in ("first", "second", "last")]
    more = [
        "objects end get_frame filter_stationary exist",
        "objects null filter_moving exist negate",
        "events end filter_before count",
        "events start filter_after count",
        "objects",  # malformed
    ]
    programs = [tokens(p) for p in (*filters, *orders, *more)] + [tokens(*text) for text in TEXTS]
    for name in NAMES:
        model = network(name).train()
        model(batch(programs, [0] * len(programs), maps(1))).sum().backward()
        assert [n for n, p in model.named_parameters() if p.grad is None] == []


def test_large_activations_do_not_close_a_mask() -> None:
    module = network("tbd").program_modules["filter_after"]
    with torch.no_grad():
        for layer in module.modules():
            if isinstance(layer, torch.nn.Conv2d):
                layer.weight *= 3
        mask = module(torch.randn(2, 4, *GRID, 8, generator=torch.Generator().manual_seed(1)))
    assert mask.min() > 1e-3
    assert mask.max() < 1 - 1e-3


def test_few_frames_are_repeated() -> None:
    with torch.no_grad():
        found = network("iep", frames=9)(batch([tokens(COUNT_RED)], [0], maps(1)))
    assert found.isfinite().all()


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(DataError, match="dilations"):
        TbdConfig(dilations=(1, 0))

"""Every training and inference path on a second device (`tests.second_device`), with the results of the CPU."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from accelerate.utils import send_to_device

from nsdr.clevrer.example import VIDEO
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.cli.main import main
from nsdr.dynamics.collisions.network import CollisionNetworkConfig, TrackCollisionDetector
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.propnet.patch_model import PatchPropNetConfig
from nsdr.dynamics.propnet.patch_predictor import PatchPropNetPredictor
from nsdr.dynamics.propnet.state_model import PropNetConfig
from nsdr.dynamics.propnet.state_predictor import PropNetPredictor
from nsdr.errors import DataError
from nsdr.frame_parser.model import FrameParserConfig
from nsdr.frame_parser.parser import FrameParser
from nsdr.io.device import workers_on
from nsdr.question_parser.model import QuestionParserConfig
from nsdr.question_parser.network import QuestionParser
from nsdr.tracking.tracker import track
from nsdr.training import loop
from nsdr.training.collisions import CollisionTask, CollisionTraining
from nsdr.training.dynamics import PropNetTask
from nsdr.training.frame_parser import FrameParserTask, FrameParserTraining
from nsdr.training.loop import LoopConfig, Task
from nsdr.training.patch_dynamics import PatchPropNetTask
from nsdr.training.question_parser import QuestionParserTask, QuestionParserTraining
from nsdr.training.track_task import DynamicsTraining
from tests.conftest import draw_frame
from tests.second_device import second_device

SMALL_DETECTOR = FrameParserConfig(
    widths=(16, 16, 16, 32), blocks=1, fpn_channels=16, box_features=32, mask_channels=16, mask_layers=1
)


def dynamics_training(tiny_motion: tuple[Path, Path], folder: Path, network: str) -> DynamicsTraining:
    return DynamicsTraining(
        proposals=str(tiny_motion[0]),
        truth=str(tiny_motion[1]),
        run_dir=str(folder),
        network=network,
        rollout_steps=2,
        model=PropNetConfig(hidden=16),
        patches=PatchPropNetConfig(hidden=16),
    )


def make_task(name: str, tiny_motion: tuple[Path, Path], tiny_frames: Path, folder: Path) -> Task:
    if name == "propnet":
        return PropNetTask(dynamics_training(tiny_motion, folder, name))
    if name == "propnet_patches":
        return PatchPropNetTask(dynamics_training(tiny_motion, folder, name))
    if name == "question-parser":
        texts = QuestionParserConfig(embedding=8, hidden=16, max_tokens=10)
        return QuestionParserTask(QuestionParserTraining(str(folder), evaluation_texts=3, model=texts))
    if name == "collisions":
        small = CollisionNetworkConfig(width=8)
        return CollisionTask(CollisionTraining(*map(str, tiny_motion), str(folder), evaluation_scenes=1, model=small))
    return FrameParserTask(
        FrameParserTraining(str(tiny_frames), str(folder), evaluation_frames=1, model=SMALL_DETECTOR)
    )


@pytest.fixture(params=["propnet", "propnet_patches", "collisions", "question-parser", "frame-parser"])
def task(request, tiny_motion, tiny_frames, tmp_path) -> Task:
    return make_task(request.param, tiny_motion, tiny_frames, tmp_path)


def step(task: Task, device: Any) -> tuple[dict[str, float], dict[str, float]]:
    """Losses of a step, and metrics after it."""
    task.model.to(device)
    optimizer = torch.optim.AdamW(task.model.parameters(), 1e-3)
    task.model.train()
    torch.manual_seed(0)
    batch = send_to_device(task.collate(task.draw(2, np.random.default_rng(0), 0)), device)
    means = {name: term.total / term.items for name, term in task.losses(task.model, batch).items()}
    torch.stack(list(means.values())).sum().backward()
    optimizer.step()
    metrics = task.evaluate(task.model)
    return {name: mean.item() for name, mean in means.items()}, metrics


def test_training_and_evaluation_run_where_the_weights_are(task) -> None:
    start = {name: value.clone() for name, value in task.model.state_dict().items()}
    on_cpu = step(task, "cpu")
    task.model.load_state_dict(start)
    with second_device() as device:
        on_second = step(task, device)
    for ours, expected in zip(on_second, on_cpu, strict=True):
        assert ours == pytest.approx(expected, rel=1e-4, abs=1e-6, nan_ok=True)


@pytest.mark.parametrize(
    ("kind", "checkpoint"),
    [(PropNetPredictor, "default"), (PatchPropNetPredictor, "propnet_patches")],
    ids=["propnet", "propnet_patches"],
)
def test_dynamics_predictors_run_where_their_weights_are(kind, checkpoint, tiny_motion) -> None:
    _, proposals = next(iter(read_compact_proposals(tiny_motion[0])))
    tracks = track(proposals)
    predictor = kind.from_pretrained(checkpoint, "cpu")
    expected = predictor.explain(states_from_tracks(tracks)).prediction
    with second_device() as device:
        assert_same_motion(predictor.to(str(device)).explain(states_from_tracks(tracks)).prediction, expected)


def test_the_collision_network_runs_where_its_weights_are(tiny_motion) -> None:
    _, proposals = next(iter(read_compact_proposals(tiny_motion[0])))
    states = states_from_tracks(track(proposals))
    detector = TrackCollisionDetector.from_pretrained(device="cpu")
    ((expected, probability),) = detector.collision_candidates(states)
    with second_device() as device:
        ((found, of_second),) = detector.to(str(device)).collision_candidates(states)
    assert found == expected
    assert of_second == pytest.approx(probability, abs=1e-6)


def assert_same_motion(prediction: Any, expected: Any) -> None:
    rollouts = [prediction.observed, *prediction.counterfactual.values()]
    for ours, theirs in zip(rollouts, [expected.observed, *expected.counterfactual.values()], strict=True):
        np.testing.assert_allclose(ours.location_world, theirs.location_world, atol=1e-4)
        assert ours.collisions == theirs.collisions


def test_the_question_parser_runs_where_its_weights_are() -> None:
    parser = QuestionParser.from_pretrained(device="cpu")
    with second_device() as device:
        parser.to(str(device))
        assert str(parser.parse("How many cubes enter the scene?")).endswith("count")


def test_the_frame_parser_runs_where_its_weights_are() -> None:
    image, _ = draw_frame([("red", "rubber", "cube", -1.0, -0.8), ("cyan", "metal", "sphere", 0.5, 0.6)])
    parser = FrameParser.from_pretrained(device="cpu", precision="float32")
    expected = parser.parse([image])
    with second_device() as device:
        found = parser.to(str(device)).parse([image])
    assert found.attribute.tolist() == expected.attribute.tolist()
    np.testing.assert_allclose(found.score, expected.score, atol=1e-3)


MAKERS: list[Callable[..., Any]] = [FrameParser, QuestionParser, PropNetPredictor]


@pytest.mark.parametrize("part", MAKERS)
def test_a_device_that_is_not_there_is_refused(part) -> None:
    with pytest.raises(DataError, match=r"device 'cuda:77' cannot be used \(.*\); expected auto, cpu, cuda or cuda:N"):
        part.from_pretrained(device="cuda:77")


def test_a_gpu_gets_no_more_processes_than_its_memory_is_enough_for(monkeypatch) -> None:
    def workers(gib: float, asked: int) -> int:
        monkeypatch.setattr(
            torch.cuda, "get_device_properties", lambda _: SimpleNamespace(total_memory=int(gib * 2**30))
        )
        return workers_on(torch.device("cuda:1"), asked)

    monkeypatch.setattr("nsdr.io.device.available_cores", lambda: 16)
    assert [workers(gib, 0) for gib in (1, 8, 141)] == [1, 4, 16]
    assert workers(8, 12) == 12  # what was asked for
    assert workers_on(torch.device("cpu"), 0) == 0


@pytest.mark.parametrize("name", ["propnet", "propnet_patches", "question-parser"])
def test_metrics_are_those_of_the_model_that_is_handed_over(name, tiny_motion, tiny_frames, tmp_path) -> None:
    """With averaged weights, these are evaluated: the weights that the optimizer works on must not matter."""
    import copy

    task = make_task(name, tiny_motion, tiny_frames, tmp_path)
    average = copy.deepcopy(task.model)
    expected = task.evaluate(average)
    for value in task.model.parameters():
        value.data.fill_(float("nan"))
    assert task.evaluate(average) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"steps": 0}, "steps"),
        ({"batch_size": -1}, "batch_size"),
        ({"save_every": 0}, "save_every"),
        ({"learning_rate": float("nan")}, "learning_rate"),
        ({"ema": 1.0}, "ema"),
        ({"optimizer": "odd"}, "optimizer"),
        ({"schedule": "odd"}, "schedule"),
        ({"precision": "int3"}, "precision: Expected one of auto, float32, bfloat16"),
    ],
)
def test_settings_of_the_loop_are_checked(option, message) -> None:
    with pytest.raises(DataError, match=message):
        LoopConfig(**option)


def test_bfloat16_is_refused_on_processors_without_it(monkeypatch) -> None:
    monkeypatch.setattr(loop, "has_bfloat16", lambda: False)
    with pytest.raises(
        DataError, match=r"precision is 'bfloat16', which this processor lacks .* expected float32 or auto"
    ):
        loop._accelerator(LoopConfig(precision="bfloat16", device="cpu"))


@pytest.mark.parametrize(
    "command",
    [
        ["answer", str(VIDEO), "How many collisions happen?"],
        ["program", "Cube how many sphere?", "--question-parser", "network"],
        ["parse", str(VIDEO), "-o", "scene.json"],
        ["parse", str(VIDEO.parent), "-o", "scenes"],
        ["parse", "PROPOSALS", "-o", "predictions", "--form", "predictions"],
        ["visualize", str(VIDEO), "-o", "a.html"],
        ["demo", "-o", "demo.png"],
        ["train", "question-parser", "--run-dir", "run"],
    ],
    ids=lambda command: command[0],
)
def test_every_command_with_networks_takes_a_device(command, tiny_motion, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = [str(tiny_motion[0]) if a == "PROPOSALS" else a for a in command]
    assert main([*arguments, "--device", "cuda:77"]) == 2
    assert "device 'cuda:77' cannot be used" in capsys.readouterr().err

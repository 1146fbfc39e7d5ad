"""A run that is resumed with other settings: made longer, logged differently, or refused."""

import json
import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nsdr import DataError, Pipeline, QuestionParser
from nsdr.cli.main import main
from nsdr.training import question_parser
from nsdr.training.loop import LoopConfig, LossTerm, Task, train

CONFIG = LoopConfig(
    steps=4, batch_size=2, learning_rate=0.1, schedule="constant", log_every=2, save_every=2, device="cpu"
)


class Line(Task):
    """Fits y = w x."""

    def __init__(self) -> None:
        torch.manual_seed(0)
        self.model = torch.nn.Linear(1, 1)

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[float]:
        return rng.normal(size=count).tolist()

    def collate(self, examples: Sequence[float]) -> torch.Tensor:
        return torch.tensor(examples)[:, None]

    def losses(self, model: torch.nn.Module, batch: torch.Tensor) -> dict[str, LossTerm]:
        return {"fit": LossTerm((model(batch) - 3 * batch).square().sum(), len(batch))}

    def evaluate(self, model: torch.nn.Module) -> dict[str, float]:
        return {"weight": model.weight.item()}


def weight(run: Path, config: LoopConfig = CONFIG, **more: object) -> float | None:
    settings = {"loop": {k: v for k, v in vars(config).items() if k != "device"}, **more}
    return train(Line(), config, run, settings)["weight"]


def test_a_finished_run_is_made_longer_and_equals_one_of_that_length(tmp_path) -> None:
    longer = replace(CONFIG, steps=10)
    short = weight(tmp_path / "run")
    assert weight(tmp_path / "run", longer) == weight(tmp_path / "whole", longer) != short
    written = json.loads((tmp_path / "run" / "config.json").read_text())
    assert written["config"]["loop"]["steps"] == 10
    assert written["changes"] == [{"step": 4, "setting": "loop.steps", "before": 4}]
    steps = [json.loads(line)["step"] for line in (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()]
    assert steps == [2, 4, 6, 8, 10]


def test_a_longer_cosine_schedule_is_that_of_the_new_length(tmp_path, caplog) -> None:
    cosine = replace(CONFIG, schedule="cosine", log_every=1)
    weight(tmp_path / "run", cosine)
    with caplog.at_level(logging.WARNING):
        weight(tmp_path / "run", replace(cosine, steps=8))
    assert "the learning rate goes from 0.015 to 0.05 at step 4" in caplog.text
    lines = [json.loads(line) for line in (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()]
    assert lines[4]["learning_rate"] == pytest.approx(0.05)
    assert lines[-1]["learning_rate"] == pytest.approx(0.1 * 0.5 * (1 + np.cos(np.pi * 7 / 8)))


def test_a_run_that_is_made_longer_in_its_warm_up_is_one_of_that_length(tmp_path, caplog) -> None:
    warming = replace(CONFIG, schedule="cosine", warmup_steps=6)
    weight(tmp_path / "run", warming)
    with caplog.at_level(logging.WARNING):
        longer = weight(tmp_path / "run", replace(warming, steps=8))
    assert longer == weight(tmp_path / "whole", replace(warming, steps=8))
    assert "cosine" not in caplog.text


def test_a_run_is_resumed_with_other_intervals(tmp_path) -> None:
    weight(tmp_path / "run")
    other = replace(CONFIG, steps=8, log_every=1, evaluate_every=1, save_every=3)
    assert weight(tmp_path / "run", other) == weight(tmp_path / "whole", replace(CONFIG, steps=8))


def test_a_run_is_not_made_shorter_than_it_is(tmp_path) -> None:
    weight(tmp_path / "run")
    with pytest.raises(DataError, match=r"has made 4 steps already; expected at least as many as loop\.steps, got 3"):
        weight(tmp_path / "run", replace(CONFIG, steps=3))
    assert json.loads((tmp_path / "run" / "config.json").read_text())["config"]["loop"]["steps"] == 4


@pytest.mark.parametrize(
    ("changed", "more", "message"),
    [
        ({"seed": 1}, {}, "loop.seed: 0 before, 1 now"),
        ({"batch_size": 4, "steps": 8}, {}, "loop.batch_size: 2 before, 4 now"),
        ({}, {"model": {"hidden": 8}}, "model.hidden: 16 before, 8 now"),
        ({}, {"frames": "b"}, "frames: a before, b now"),
    ],
)
def test_what_changes_steps_that_were_made_is_refused_with_both_values(tmp_path, changed, more, message) -> None:
    settings = {"model": {"hidden": 16}, "frames": "a"}
    weight(tmp_path / "run", **settings)
    with pytest.raises(DataError) as error:
        weight(tmp_path / "run", replace(CONFIG, **changed), **settings | more)
    assert f"was started with another configuration ({message}); use a new run_dir" in str(error.value)


def test_the_commands_short_options_lengthen_a_run(tmp_path) -> None:
    few = ["--batch-size", "2", "--lr", "0.01", "--seed", "3", "--loop.schedule", "constant", "--evaluation-texts", "2"]
    few += ["--model.embedding", "8", "--model.hidden", "16", "--run-dir", str(tmp_path / "run")]
    question_parser.main([*few, "--steps", "2", "--device", "auto"])
    question_parser.main([*few, "--steps", "4", "--device", "cpu", "--loop.log-every", "1"])
    loop = json.loads((tmp_path / "run" / "config.json").read_text())["config"]["loop"]
    assert (loop["steps"], loop["batch_size"], loop["learning_rate"], loop["seed"]) == (4, 2, 0.01, 3)
    few[3] = "0.02"
    with pytest.raises(DataError, match=r"loop\.learning_rate: 0\.01 before, 0\.02 now"):
        question_parser.main([*few, "--steps", "4", "--device", "cpu"])


def test_the_command_says_how_to_use_the_weights(tmp_path, capsys) -> None:
    few = [
        "--model.embedding",
        "8",
        "--model.hidden",
        "16",
        "--evaluation-texts",
        "2",
        "--batch-size",
        "2",
        "--device",
        "cpu",
    ]
    assert main(["train", "question-parser", "--run-dir", str(tmp_path / "run"), "--steps", "1", *few]) == 0
    folder, use = capsys.readouterr().out.splitlines()
    assert f'--checkpoint {folder}, or Pipeline.from_pretrained("{folder}")' in use
    with pytest.warns(UserWarning, match="has no frame_parser, dynamics; the shipped ones are used"):
        pipeline = Pipeline.from_pretrained(folder, device="cpu")
    assert isinstance(pipeline.question_parser, QuestionParser)  # and not the grammar

"""The trainings on a GPU, for `benchmarks/gpu.py`: a step beside the CPU's, resumed runs, two processes, and rates."""

import json
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from itertools import count, repeat
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from accelerate.utils import send_to_device
from torch import nn
from torch.utils.data import DataLoader, Dataset

from benchmarks.gpu_results import CONFIGS, Result, Setting, nsdr
from nsdr.baselines.base import BASELINES
from nsdr.baselines.features.files import KINDS
from nsdr.cli.train import PARTS
from nsdr.training.baselines import BaselineTask, BaselineTraining
from nsdr.training.collisions import CollisionTask, CollisionTraining
from nsdr.training.dynamics import StateModelTask
from nsdr.training.frame_parser import FrameParserTask, FrameParserTraining
from nsdr.training.loop import LoopConfig, Task, train
from nsdr.training.patch_dynamics import ImageModelTask, PatchModelTask
from nsdr.training.question_parser import QuestionParserTask, QuestionParserTraining
from nsdr.training.run_folder import parse_training
from nsdr.training.track_task import DynamicsTraining

LOSS, SAMPLED_LOSS = 0.01, 0.05
"""Largest relative difference of a loss from the CPU's; the larger one for the frame parser, which samples regions by scores
that differ by rounding."""
RESUMED_LOSS = 1e-3
"""Largest relative difference of the losses of two runs on one device: some sums have no fixed order on CUDA."""
SMALL_LOSS = 0.01
"""Differences of losses below this are relative to it."""
STEPS = 4
"""Steps of a resumed run, and of two processes."""
WORKERS = 4
"""Worker processes that make batches."""
RANDPERM = torch.randperm


def trainings() -> dict[str, list[str]]:
    """Part, configuration and other arguments of `nsdr train`; DATA stands for the folder of `Setting.data`."""
    motion = "--proposals DATA/motion/proposals.npz --truth DATA/motion/truth.json.gz --evaluation_scenes 1"
    lines = {
        "frame-parser": "frame-parser frame_parser/default --frames DATA/frames --evaluation_frames 2",
        "collisions": f"collisions dynamics/collisions {motion}",
        "question-parser": "question-parser question_parser/default --evaluation_texts 4",
        "dynamics on states": f"dynamics dynamics/state {motion}",
        "dynamics on masks": f"dynamics dynamics/paper_fast {motion}",
        "dynamics on images": "dynamics dynamics/paper --data DATA/set --evaluation_scenes 1",
    }
    questions = "--questions DATA/set/questions/train.json --validation DATA/set/questions/train.json --plain_steps 0"
    for name in BASELINES.names():
        features = "--features DATA/features" if BASELINES[name].needs & set(KINDS) else ""
        lines[f"baseline {name}"] = f"baseline baselines/small/{name} {questions} {features}"
    return {name: line.split() for name, line in lines.items()}


def arguments_of(setting: Setting, name: str, folder: Path, steps: int) -> list[str]:
    """Arguments of `nsdr train` for a few steps in an empty folder, with a checkpoint in the middle."""
    shutil.rmtree(folder, ignore_errors=True)
    part, config, *rest = trainings()[name]
    data = str(setting.data()) if any("DATA" in argument for argument in rest) else ""
    loop = f"--loop.steps {steps} --loop.save_every {steps // 2} --loop.log_every 1 --loop.evaluate_every 0"
    loop += " --loop.batch_size 2" if setting.small else ""
    where = ["--run_dir", str(folder), "--loop.device", setting.real, *loop.split()]
    return [part, "--config", f"{CONFIGS}/{config}.yaml", *(x.replace("DATA", data) for x in rest), *where]


def task_of(arguments: Sequence[str]) -> tuple[Task, LoopConfig]:
    """What `nsdr train` with these arguments trains, and how."""
    of_network: dict[str, Callable[[DynamicsTraining], Task]]
    of_network = {"state": StateModelTask, "paper": PatchModelTask, "paper_images": ImageModelTask}
    kinds: dict[str, tuple[type[Any], Callable[[Any], Task]]] = {
        "frame-parser": (FrameParserTraining, FrameParserTask),
        "collisions": (CollisionTraining, CollisionTask),
        "question-parser": (QuestionParserTraining, QuestionParserTask),
        "dynamics": (DynamicsTraining, lambda config: of_network[config.network](config)),
        "baseline": (BaselineTraining, BaselineTask),
    }
    part, *options = arguments
    kind, make = kinds[part]
    config = parse_training(kind, options, part)
    return make(config), config.loop


def one_step(setting: Setting, name: str) -> Result:
    """Losses before and after a step in float32, without dropout."""
    task, loop = task_of(arguments_of(setting, name, setting.work / "step" / name.replace(" ", "_"), STEPS))
    for module in task.model.modules():
        if isinstance(module, nn.Dropout):
            module.p = 0.0
        if isinstance(module, nn.RNNBase):
            module.dropout = 0.0
    start = {key: value.clone() for key, value in task.model.state_dict().items()}
    batch = task.collate(task.draw(loop.batch_size, np.random.default_rng(0), 0))

    def losses(device: str) -> list[float]:
        model, moved, found = task.model.to(device).train(), send_to_device(batch, device), list[float]()
        optimizer = torch.optim.AdamW(model.parameters(), 1e-4)
        for _ in range(2):
            # The frame parser's samples are drawn on the device, whose random numbers are others.
            with patch("torch.randperm", lambda n, device=None, **_: RANDPERM(n).to(device)):
                torch.manual_seed(0)
                means = [term.total / term.items for term in task.losses(model, moved).values()]
            total = torch.stack(means).sum()
            optimizer.zero_grad()
            total.backward()
            optimizer.step()
            found.append(total.item())
        return found

    expected = losses("cpu")
    task.model.load_state_dict(start)
    with setting.there() as device:
        found = losses(device)
    apart = most_apart(found, expected)
    text = f"losses {found[0]:.4g} and {found[1]:.4g}, within {apart:.1g} of the CPU's"
    return text, apart <= (SAMPLED_LOSS if name == "frame-parser" else LOSS)


def most_apart(found: Sequence[float], expected: Sequence[float]) -> float:
    """The largest difference, relative to the loss or to `SMALL_LOSS`."""
    return max(abs(a - b) / max(abs(b), SMALL_LOSS) for a, b in zip(found, expected, strict=True))


def losses_in(folder: Path) -> list[float]:
    """The loss of each step of a run."""
    return [json.loads(line)["loss"] for line in (folder / "metrics.jsonl").read_text().splitlines()]


def resumed(setting: Setting, name: str) -> Result:
    """Losses of a run that goes on from the checkpoint in its middle, beside those of the uninterrupted one."""
    folder = setting.work / "resumed" / name.replace(" ", "_")
    part, *options = arguments_of(setting, name, folder, STEPS)
    run = import_module(f"nsdr.training.{PARTS[part][0]}").main
    run(options)
    expected = losses_in(folder)
    for path in folder.glob(f"step_{STEPS:07d}.*"):
        path.unlink()
    run(options)
    apart = most_apart(losses_in(folder), expected)
    return f"losses of {STEPS} steps within {apart:.1g}", apart <= RESUMED_LOSS


def two_processes(setting: Setting, name: str) -> Result:
    """Losses of two processes, beside those of one with batches of twice the size."""
    on_cpu, folder = setting.real == "cpu", setting.work / "two"
    if not on_cpu and torch.cuda.device_count() < 2:
        return "not run: one device", True
    found = []
    for processes in (2, 1):
        arguments = arguments_of(setting, name, folder, STEPS)
        loop = (
            f"--loop.device {'cpu' if on_cpu else 'auto'} --loop.batch_size {8 // processes} --loop.precision float32"
        )
        launcher = ["-m", "torch.distributed.run", "--standalone", "--nproc_per_node", str(processes)]
        nsdr("train", *arguments, *loop.split(), launcher=launcher)
        found.append(losses_in(folder))
    apart = most_apart(*found)
    return f"losses of {STEPS} steps within {apart:.1g} of one process with twice the batch", apart <= RESUMED_LOSS


class Batches(Dataset[Any]):
    """The batches of a task by step."""

    def __init__(self, task: Task, size: int) -> None:
        self.task, self.size = task, size

    def __getitem__(self, step: int) -> Any:
        return self.task.collate(self.task.draw(self.size, np.random.default_rng((0, step)), step))


class Fed(Task):
    """A task whose batches come from elsewhere; keeps the times at which its steps begin (s)."""

    def __init__(self, task: Task, batches: Iterator[Any]) -> None:
        self.task, self.model, self.batches, self.times = task, task.model, batches, list[float]()

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[Any]:
        return []

    def collate(self, examples: Sequence[Any]) -> Any:
        return next(self.batches)

    def losses(self, model: nn.Module, batch: Any) -> Any:
        self.times.append(time.perf_counter())
        return self.task.losses(model, batch)

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        return {}


def rates(setting: Setting, name: str) -> Result:
    """Milliseconds a step with batches that are ready, made by one thread as `nsdr train` does, and by worker processes."""
    first, steps = (1, 2) if setting.small else (10, 30)  # the first ones use up what was made before the start
    arguments, folder = arguments_of(setting, name, setting.work / "data_of_rate", STEPS), setting.work / "rate"

    def milliseconds(feed: Callable[[Batches], Iterator[Any]]) -> str:
        shutil.rmtree(folder, ignore_errors=True)
        task, loop = task_of(arguments)
        fed = Fed(task, feed(Batches(task, loop.batch_size)))
        short = LoopConfig(steps=first + steps + 1, precision=loop.precision, ema=loop.ema, device=loop.device)
        train(fed, short, folder, {})
        return f"{1000 * (fed.times[-1] - fed.times[first]) / steps:.1f}"

    def by_processes(workers: int) -> Callable[[Batches], Iterator[Any]]:
        options: dict[str, Any] = {"num_workers": workers, "prefetch_factor": 1, "multiprocessing_context": "fork"}
        return lambda batches: iter(DataLoader(batches, None, sampler=range(first + steps + 2), **options))

    workers = 1 if setting.small else WORKERS
    ready, thread = milliseconds(lambda b: repeat(b[0])), milliseconds(lambda b: map(b.__getitem__, count()))
    by = milliseconds(by_processes(workers))
    text = f"{ready} ms a step with batches that are ready; {thread} by one thread, as now; {by} by {workers} processes"
    return text, True

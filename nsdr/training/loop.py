"""The training loop that all parts share: Accelerate for devices and precision, resumable at any kill.

Every step is a function of the weights, the optimiser's state and the step's number alone: batches and random
numbers are drawn from (seed, step, process). So a resumed run goes on exactly as an uninterrupted one.
"""

import json
import logging
import math
import shutil
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from accelerate import Accelerator
from numpy.typing import NDArray
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from tqdm import tqdm

from nsdr.errors import DataError
from nsdr.io.files import read_json, write_json
from nsdr.io.fingerprint import code_revision

__all__ = ["LoopConfig", "Task", "train"]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LoopConfig:
    """How to optimise.

    Attributes:
        steps: optimiser steps.
        batch_size: examples a step (per process).
        optimizer: "adam" or "sgd" (momentum 0.9).
        learning_rate: its peak.
        weight_decay: L2 penalty (decoupled for Adam).
        warmup_steps: linear rise from 0 to the peak.
        schedule: "constant", "cosine" (to 0) or "step" (× `step_factor` every `step_size` steps).
        step_size: steps between drops of the "step" schedule.
        step_factor: factor of each drop.
        clip_norm: largest gradient norm.
        ema: decay of the weights' exponential moving average, which is evaluated and kept; 0 for none.
        precision: "no" (float32), "bf16" or "fp16".
        seed: of the weights, the batches and the augmentation.
        log_every: steps between lines of `metrics.jsonl`.
        evaluate_every: steps between evaluations; 0 evaluates only at the end.
        save_every: steps between checkpoints.
        device: "auto", or "cpu" to leave an accelerator alone.
    """

    steps: int = 1000
    batch_size: int = 8
    optimizer: str = "adam"
    learning_rate: float = 1e-3
    weight_decay: float = 0.0
    warmup_steps: int = 0
    schedule: str = "cosine"
    step_size: int = 1000
    step_factor: float = 0.3
    clip_norm: float = 5.0
    ema: float = 0.0
    precision: str = "no"
    seed: int = 0
    log_every: int = 20
    evaluate_every: int = 0
    save_every: int = 200
    device: str = "auto"


class Task(Protocol):
    """What is trained: batches, losses and the measure."""

    model: nn.Module

    def batch(self, size: int, rng: np.random.Generator) -> Any:
        """A batch of `size` examples, drawn by `rng` alone."""

    def losses(self, model: nn.Module, batch: Any) -> Mapping[str, Tensor]:
        """Scalar loss terms by name; their sum is minimised."""

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Measures on held-out data."""

    def images(self, model: nn.Module) -> Mapping[str, NDArray[np.uint8]]:
        """Images (H, W, 3) RGB for TensorBoard, by name; none where there is nothing to see."""
        return {}


def learning_rate_at(step: int, config: LoopConfig) -> float:
    """Learning rate of a step (0-based)."""
    if step < config.warmup_steps:
        return config.learning_rate * (step + 1) / config.warmup_steps
    if config.schedule == "cosine":
        progress = (step - config.warmup_steps) / max(config.steps - config.warmup_steps, 1)
        return config.learning_rate * 0.5 * (1 + math.cos(math.pi * progress))
    if config.schedule == "step":
        return config.learning_rate * config.step_factor ** (step // config.step_size)
    if config.schedule == "constant":
        return config.learning_rate
    raise DataError(f"schedule is {config.schedule!r}; expected constant, cosine or step")


def train(task: Task, config: LoopConfig, run_dir: str | Path, resolved: Mapping[str, Any]) -> dict[str, float]:
    """Train `task.model`, or go on where `run_dir` left off; returns the last evaluation.

    `run_dir` gets `config.json` (the resolved configuration and code revision), `metrics.jsonl`, TensorBoard events and the
    newest checkpoint under `step_N`. The model holds the trained weights at the end.

    Raises:
        FloatingPointError: a loss term is not finite; names the term and the step.
        DataError: `run_dir` was started with another configuration.
    """
    run_dir = Path(run_dir)
    run_dir.mkdir(parents=True, exist_ok=True)
    # num_workers etc. are ours: Accelerate only positions, casts and synchronises.
    accelerator = Accelerator(mixed_precision=config.precision, cpu=config.device == "cpu")
    _check_same_run(run_dir, resolved, accelerator.is_main_process)
    model, optimizer = accelerator.prepare(task.model, _optimizer(task.model, config))
    average = (
        AveragedModel(task.model, multi_avg_fn=get_ema_multi_avg_fn(config.ema), use_buffers=True)
        if config.ema
        else None
    )
    start = _restore(run_dir, task.model, optimizer, average)
    writer = _tensorboard(run_dir) if accelerator.is_main_process else None

    def draw(step: int) -> Any:
        return task.batch(config.batch_size, np.random.default_rng((config.seed, step, accelerator.process_index)))

    metrics: dict[str, float] = {}
    with ThreadPoolExecutor(1) as pool, open(run_dir / "metrics.jsonl", "a") as lines:
        upcoming: Future[Any] | None = pool.submit(draw, start) if start < config.steps else None
        bar = tqdm(
            range(start, config.steps), initial=start, total=config.steps, disable=not accelerator.is_main_process
        )
        for step in bar:
            assert upcoming is not None
            batch = upcoming.result()
            upcoming = pool.submit(draw, step + 1) if step + 1 < config.steps else None
            torch.manual_seed(config.seed * 1_000_003 + step)
            rate = learning_rate_at(step, config)
            for group in optimizer.param_groups:
                group["lr"] = rate
            model.train()
            with accelerator.autocast():
                losses = task.losses(model, batch)
            total = torch.stack([term.float() for term in losses.values()]).sum()
            if not torch.isfinite(total):
                bad = [name for name, term in losses.items() if not torch.isfinite(term)]
                raise FloatingPointError(f"step {step}: loss is not finite ({', '.join(bad) or 'sum'})")
            accelerator.backward(total)
            accelerator.clip_grad_norm_(model.parameters(), config.clip_norm)
            optimizer.step()
            optimizer.zero_grad()
            if average is not None:
                average.update_parameters(accelerator.unwrap_model(model))

            done = step + 1
            last = done == config.steps
            record: dict[str, float] = {}
            if done % config.log_every == 0 or last:
                record |= {"loss": total.item(), "learning_rate": rate}
                record |= {f"loss/{name}": term.item() for name, term in losses.items()}
                bar.set_postfix(loss=f"{record['loss']:.4g}")
            if last or (config.evaluate_every and done % config.evaluate_every == 0):
                measured = accelerator.unwrap_model(model) if average is None else average.module
                metrics = task.evaluate(measured)
                record |= metrics
                if writer is not None:
                    for name, image in task.images(measured).items():
                        writer.add_image(name, image, done, dataformats="HWC")
                log.info("step %d: %s", done, metrics)
            if record and accelerator.is_main_process:
                lines.write(json.dumps({"step": done, **record}) + "\n")
                lines.flush()
                if writer is not None:
                    for name, value in record.items():
                        writer.add_scalar(name, value, done)
            if accelerator.is_main_process and (last or done % config.save_every == 0):
                _save(run_dir, done, task.model, optimizer, average, metrics)
    if average is not None:
        task.model.load_state_dict(average.module.state_dict())
    if writer is not None:
        writer.close()
    return metrics or _last_metrics(run_dir)


def _optimizer(model: nn.Module, config: LoopConfig) -> torch.optim.Optimizer:
    if config.optimizer == "adam":
        return torch.optim.AdamW(model.parameters(), config.learning_rate, weight_decay=config.weight_decay)
    if config.optimizer == "sgd":
        return torch.optim.SGD(model.parameters(), config.learning_rate, momentum=0.9, weight_decay=config.weight_decay)
    raise DataError(f"optimizer is {config.optimizer!r}; expected adam or sgd")


def _check_same_run(run_dir: Path, resolved: Mapping[str, Any], write: bool) -> None:
    path = run_dir / "config.json"
    resolved = json.loads(json.dumps(resolved))
    if path.exists():
        before = read_json(path)["config"]
        changed = sorted(k for k in {*before, *resolved} if before.get(k) != resolved.get(k))
        if changed:
            raise DataError(
                f"{run_dir}: was started with another configuration ({', '.join(changed)}); use a new run_dir"
            )
    elif write:
        write_json(path, {"config": resolved, "revision": code_revision(), "torch": torch.__version__}, indent=1)


def _newest(run_dir: Path) -> Path | None:
    complete = [p for p in run_dir.glob("step_*") if (p / "state.json").exists()]
    return max(complete, default=None, key=lambda p: int(p.name.removeprefix("step_")))


def _save(
    run_dir: Path,
    step: int,
    model: nn.Module,
    optimizer: Any,
    average: AveragedModel | None,
    metrics: Mapping[str, float],
) -> None:
    """Write `step_N`; its `state.json` comes last and marks it complete, then older ones go."""
    folder = run_dir / f"step_{step:07d}"
    folder.mkdir(exist_ok=True)
    state = optimizer.state_dict()["state"]
    flat = {f"{i}.{name}": torch.as_tensor(value) for i, values in state.items() for name, value in values.items()}
    save_file({k: v.detach().cpu().contiguous() for k, v in model.state_dict().items()}, folder / "model.safetensors")
    save_file({k: v.detach().cpu().contiguous() for k, v in flat.items()}, folder / "optimizer.safetensors")
    if average is not None:
        # A copy: safetensors refuses weights that share memory.
        averaged = {k: v.detach().cpu().clone() for k, v in average.state_dict().items()}
        save_file(averaged, folder / "average.safetensors")
    write_json(folder / "state.json", {"step": step, "metrics": metrics})
    for old in run_dir.glob("step_*"):
        if old != folder:
            shutil.rmtree(old)


def _restore(run_dir: Path, model: nn.Module, optimizer: Any, average: AveragedModel | None) -> int:
    folder = _newest(run_dir)
    if folder is None:
        return 0
    model.load_state_dict(load_file(folder / "model.safetensors"))
    if average is not None:
        average.load_state_dict(load_file(folder / "average.safetensors"))
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in load_file(folder / "optimizer.safetensors").items():
        index, name = key.split(".", 1)
        state.setdefault(int(index), {})[name] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    step = int(read_json(folder / "state.json")["step"])
    log.info("%s: goes on at step %d", run_dir, step)
    return step


def _last_metrics(run_dir: Path) -> dict[str, float]:
    folder = _newest(run_dir)
    return dict(read_json(folder / "state.json")["metrics"]) if folder else {}


def _tensorboard(run_dir: Path) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter  # heavy; only where something is trained
    except ImportError:
        log.warning("TensorBoard is not installed (pip install 'nsdr[train]'); metrics.jsonl has the same numbers")
        return None
    return SummaryWriter(str(run_dir))

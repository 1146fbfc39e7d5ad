"""The training loop of every part, on Accelerate; a run that is killed at any moment can be resumed.

Each step depends only on the weights, the optimizer's state and the step's number: batches and random numbers are seeded with
(seed, step, process). A resumed run therefore gives the same result as an uninterrupted one.
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

SGD_MOMENTUM = 0.9
"""Momentum of the "sgd" optimizer."""
SEED_STRIDE = 1_000_003
"""Torch's seed at a step is `seed * SEED_STRIDE + step`: the stride exceeds any number of steps, so that no two are equal."""


@dataclass(frozen=True)
class LoopConfig:
    """Settings of the optimisation.

    Attributes:
        steps: number of optimizer steps.
        batch_size: examples per step and process.
        optimizer: "adam" (AdamW) or "sgd" (momentum 0.9).
        learning_rate: peak learning rate.
        weight_decay: weight decay, decoupled for "adam" and an L2 penalty for "sgd".
        warmup_steps: steps of the linear rise to the peak.
        schedule: learning rate after the warm-up: "constant", "cosine" (falls to 0) or "step" (× `step_factor` every
            `step_size` steps).
        step_size: steps between two drops of the "step" schedule.
        step_factor: factor of each drop of the "step" schedule.
        clip_norm: maximum norm of the gradient; larger gradients are scaled down.
        ema: decay per step of an exponential moving average of the weights, which is evaluated and saved instead of them; 0
            for none.
        precision: "no" (float32), "bf16" or "fp16" mixed precision.
        seed: seed of the initial weights, the batches and the augmentation.
        log_every: steps between two lines of losses in `metrics.jsonl`.
        evaluate_every: steps between two evaluations; 0 evaluates after the last step only.
        save_every: steps between two checkpoints.
        device: "auto" (an accelerator where there is one) or "cpu".
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
    """What is trained: a model, its batches, its losses and its evaluation."""

    model: nn.Module

    def batch(self, size: int, rng: np.random.Generator) -> Any:
        """A batch of `size` examples, drawn with `rng` and no other source of randomness."""

    def losses(self, model: nn.Module, batch: Any) -> Mapping[str, Tensor]:
        """Scalar loss terms by name; their sum is minimised."""

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Metrics on held-out data, by name."""

    def images(self, model: nn.Module) -> Mapping[str, NDArray[np.uint8]]:
        """RGB images (H, W, 3) for TensorBoard, by name; none by default."""
        return {}


def learning_rate_at(step: int, config: LoopConfig) -> float:
    """Learning rate of a step (0-based).

    Raises:
        DataError: an unknown schedule.
    """
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
    """Train `task.model`, resuming the run in `run_dir` if there is one; at the end the model holds the trained weights.

    The folder `run_dir` gets `config.json` (the resolved configuration and the code's revision), `metrics.jsonl`, TensorBoard
    events and the newest checkpoint, `step_N`.

    Args:
        task: what to train.
        config: settings of the optimisation.
        run_dir: folder of the run.
        resolved: the whole configuration as plain values; a run is resumed only with the configuration it was started with.

    Returns:
        The metrics of the last evaluation.

    Raises:
        FloatingPointError: a loss is not finite; the message names the step and the terms.
        DataError: `run_dir` was started with another configuration, or an unknown optimizer or schedule.
    """
    run_dir = Path(run_dir)
    run_dir.mkdir(parents=True, exist_ok=True)
    # Accelerate moves the model, casts and synchronises; batches are made here.
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
            torch.manual_seed(config.seed * SEED_STRIDE + step)
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
                evaluated = accelerator.unwrap_model(model) if average is None else average.module
                metrics = task.evaluate(evaluated)
                record |= metrics
                if writer is not None:
                    for name, image in task.images(evaluated).items():
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
        return torch.optim.SGD(
            model.parameters(), config.learning_rate, momentum=SGD_MOMENTUM, weight_decay=config.weight_decay
        )
    raise DataError(f"optimizer is {config.optimizer!r}; expected adam or sgd")


def _check_same_run(run_dir: Path, resolved: Mapping[str, Any], write: bool) -> None:
    """Compare the configuration with that of `run_dir/config.json`, which is written for a new run if `write`."""
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
    """The newest complete checkpoint."""
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
    """Write `step_N`, with `state.json` last, which marks it as complete, and then delete the older checkpoints."""
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
    """Load the newest complete checkpoint, if there is one; returns the number of finished steps."""
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
    log.info("%s: resumes at step %d", run_dir, step)
    return step


def _last_metrics(run_dir: Path) -> dict[str, float]:
    folder = _newest(run_dir)
    return dict(read_json(folder / "state.json")["metrics"]) if folder else {}


def _tensorboard(run_dir: Path) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter  # heavy
    except ImportError:
        log.warning("TensorBoard is not installed (pip install 'nsdr[train]'); metrics.jsonl has the same numbers")
        return None
    return SummaryWriter(str(run_dir))

"""The training loop of every part, on Accelerate; a run that is killed at any moment can be resumed.

Each step depends only on the weights, the optimizer's state and the step's number. A resumed run therefore gives the same
result as an uninterrupted one, and n processes with batches of B the same as one process with batches of n B; on CUDA up to
rounding, as some sums have no fixed order there.
"""

import logging
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import numpy as np
import torch
from accelerate import Accelerator, DistributedDataParallelKwargs
from accelerate.state import AcceleratorState, PartialState
from accelerate.utils import send_to_device
from msgspec import Meta
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from nsdr.errors import DataError, MachineError, NsdrError
from nsdr.io.checkpoint import save_checkpoint, start_from
from nsdr.io.device import PRECISIONS, has_bfloat16, resolve_device, resolve_precision
from nsdr.io.files import locked
from nsdr.training.run_folder import RunFolder, TrainingState, described, resolved
from nsdr.validation import Count, NotNegative, Positive, PositiveCount, Settings, one_of

log = logging.getLogger(__name__)

SGD_MOMENTUM = 0.9
"""Momentum of the "sgd" optimizer."""


@dataclass(frozen=True)
class LoopConfig(Settings):
    """Settings of the optimisation.

    Attributes:
        steps: number of optimizer steps; more of them make a run longer. A "cosine" schedule is then that of the new length.
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
        precision: "float32", "bfloat16" (mixed), or "auto": "bfloat16" where the device multiplies matrices of it fast.
        seed: seed of the initial weights, the batches and the augmentation.
        log_every: steps between two lines of losses in `metrics.jsonl`.
        evaluate_every: steps between two evaluations; 0 evaluates after the last step only.
        save_every: steps between two checkpoints.
        workers: processes that make batches ahead; 0 makes them in a thread, which is enough where a step takes longer than a
            batch, as on a CPU.
        device: "auto" (CUDA where there is one, else the CPU), "cpu", "cuda" or "cuda:N". With several processes
            (`torchrun`, `accelerate launch`), "auto" or "cpu": the launcher assigns the devices.
    """

    steps: PositiveCount = 1000
    batch_size: PositiveCount = 8
    optimizer: Literal["adam", "sgd"] = "adam"
    learning_rate: Positive = 1e-3
    weight_decay: NotNegative = 0.0
    warmup_steps: Count = 0
    schedule: Literal["constant", "cosine", "step"] = "cosine"
    step_size: PositiveCount = 1000
    step_factor: Positive = 0.3
    clip_norm: Positive = 5.0
    ema: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    precision: Annotated[str, one_of(PRECISIONS)] = "float32"
    seed: Count = 0
    log_every: PositiveCount = 20
    evaluate_every: Count = 0
    save_every: PositiveCount = 200
    workers: Count = 0
    device: str = "auto"


class LossTerm(NamedTuple):
    """A loss before the division by the number of its items, which may differ between processes.

    Attributes:
        total: the sum over the items of this process's batch, a scalar.
        items: their number, or the sum of their weights.
    """

    total: Tensor
    items: float | Tensor


class Task(Protocol):
    """What is trained: a model, its batches, its losses and its evaluation."""

    model: nn.Module

    def draw(self, count: int, rng: np.random.Generator, step: int) -> Sequence[Any]:
        """The random choices of `count` examples, such as their indices, by `rng` and no other source of randomness.

        `step` counts the steps before, for a curriculum. Every process draws the examples of all processes and collates its
        own, so this should be cheap.
        """

    def collate(self, examples: Sequence[Any]) -> Any:
        """A batch from some of the examples that were drawn: tensors on the CPU, in lists, tuples or dictionaries."""

    def losses(self, model: nn.Module, batch: Any) -> Mapping[str, LossTerm]:
        """Loss terms by name; the sum of their means is minimised. `batch` is on the device of `model`."""

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Metrics of `model` on held-out data, by name."""


class _Losses(nn.Module):
    """The forward pass from a batch to the loss terms, as one module: gradients of all that it calls are synchronised."""

    def __init__(self, task: Task) -> None:
        super().__init__()
        self.model, self.losses = task.model, task.losses

    def forward(self, batch: Any) -> dict[str, Tensor]:
        """Total and number of items (2,) of each term."""
        terms = self.losses(self.model, batch)
        counts = (torch.as_tensor(term.items, device=term.total.device) for term in terms.values())
        return {k: torch.stack([terms[k].total.float(), n.float()]) for k, n in zip(terms, counts, strict=True)}


class _Batches(Dataset[Any]):
    """This process's part of the batch of each step, by the step's number; our own errors are returned in place of it."""

    def __init__(self, task: Task, config: LoopConfig, rank: int, processes: int) -> None:
        self.task, self.config, self.rank, self.processes = task, config, rank, processes

    def __getitem__(self, step: int) -> Any:
        rng = np.random.default_rng((self.config.seed, step))
        try:
            examples = self.task.draw(self.config.batch_size * self.processes, rng, step)
            return self.task.collate(examples[self.rank :: self.processes])
        except (NsdrError, MachineError) as e:  # worker processes would hide its message in a traceback
            return e


def learning_rate_at(step: int, config: LoopConfig) -> float:
    """Learning rate of a step (0-based). As it depends on nothing else, there is no scheduler to save."""
    if step < config.warmup_steps:
        return config.learning_rate * (step + 1) / config.warmup_steps
    if config.schedule == "cosine":
        progress = (step - config.warmup_steps) / max(config.steps - config.warmup_steps, 1)
        return config.learning_rate * 0.5 * (1 + math.cos(math.pi * progress))
    if config.schedule == "step":
        return config.learning_rate * config.step_factor ** (step // config.step_size)
    return config.learning_rate


def train(task: Task, config: LoopConfig, run_dir: str | Path, resolved: Mapping[str, Any]) -> dict[str, float | None]:
    """Train `task.model`, resuming the run in `run_dir` if there is one; at the end the model holds the trained weights.

    Args:
        task: what to train.
        config: settings of the optimisation.
        run_dir: folder of the run; see `RunFolder`.
        resolved: the whole configuration as plain values; a run is resumed with the configuration it was started with, but
            for `MAY_CHANGE` in `run_folder`. A run that is made longer has the learning rates of the new length from then on.

    Returns:
        The metrics of the last evaluation: those of the averaged weights, where `config.ema` asks for them. None stands for
        what is not finite.

    Raises:
        FloatingPointError: a loss or a gradient is not finite; the message names the step, and the terms of the loss. The run
            can be resumed from its last checkpoint.
        DataError: `run_dir` was started with another configuration or has made more steps, another process writes to it, or
            the device cannot be used.
        MachineError: `run_dir` cannot be written.
    """
    accelerator = _accelerator(config)
    with locked(run_dir) if accelerator.is_main_process else nullcontext():
        folder = RunFolder(run_dir, resolved, accelerator.is_main_process)
        return _Training(task, config, folder, accelerator).run()


class _Training:
    """A training in one of its processes."""

    def __init__(self, task: Task, config: LoopConfig, folder: RunFolder, accelerator: Accelerator) -> None:
        self.task, self.config, self.folder, self.accelerator = task, config, folder, accelerator
        parameters, rate, decay = task.model.parameters(), config.learning_rate, config.weight_decay
        optimizer: torch.optim.Optimizer = (
            torch.optim.AdamW(parameters, rate, weight_decay=decay)
            if config.optimizer == "adam"
            else torch.optim.SGD(parameters, rate, momentum=SGD_MOMENTUM, weight_decay=decay)
        )
        self.losses, self.optimizer = accelerator.prepare(_Losses(task), optimizer)
        self.average = _average(task.model, config.ema) if config.ema else None

    def run(self) -> dict[str, float | None]:
        """All steps that are left; returns the last metrics."""
        config, folder = self.config, self.folder
        state = TrainingState(self.task.model, self.optimizer, self.average)
        start, record = folder.restore(state)
        self._accept_changes(start)
        if start and folder.metrics(start) is None:  # killed after the checkpoint, before its line was written
            self._finish(start, record)
        is_shown, steps = self.accelerator.is_main_process, range(start, config.steps)
        bar = tqdm(steps, initial=start, total=config.steps, disable=not is_shown)
        for step, batch in zip(bar, self._batches(steps), strict=True):
            if isinstance(batch, Exception):
                raise batch
            means = self._step(step, send_to_device(batch, self.accelerator.device, non_blocking=True))
            record, done, last = {}, step + 1, step + 1 == config.steps
            if done % config.log_every == 0 or last:
                record = {"loss": sum(means.values()), "learning_rate": learning_rate_at(step, config)}
                record |= {f"loss/{name}": mean for name, mean in means.items()}
                bar.set_postfix(loss=f"{record['loss']:.4g}")
            if last or done % config.save_every == 0:
                folder.save(state, done, record)
            self._finish(done, record)
        if self.average is not None:
            self.task.model.load_state_dict(self.average.module.state_dict())
        return folder.metrics(config.steps) or {}

    def _accept_changes(self, start: int) -> None:
        """Go on with other settings than before, and say what a longer cosine schedule does."""
        config, folder = self.config, self.folder
        if start > config.steps:
            made = f"{folder.path}: the run has made {start} steps already"
            raise DataError(f"{made}; expected at least as many as loop.steps, got {config.steps}")
        folder.accept_changes(start)
        if "loop.steps" not in folder.changed or not 0 < start < config.steps:
            return
        rate = learning_rate_at(start - 1, replace(config, steps=folder.changed["loop.steps"][0]))
        if rate != learning_rate_at(start - 1, config):
            log.warning(
                "%s: the cosine schedule is now that of %d steps: the learning rate goes from %.2g to %.2g at step %d. The "
                "result is not that of a run of this length from the start; schedule constant or step avoids the difference",
                *(folder.path, config.steps, rate, learning_rate_at(start, config), start),
            )

    def _batches(self, steps: range) -> Iterator[Any]:
        """The batches of steps, made ahead."""
        accelerator = self.accelerator
        batches = _Batches(self.task, self.config, accelerator.process_index, accelerator.num_processes)
        if self.config.workers:
            # Forked processes share the data of the task.
            context = "fork" if sys.platform == "linux" else None
            is_pinned = accelerator.device.type == "cuda"
            options: Any = {
                "num_workers": self.config.workers,
                "multiprocessing_context": context,
                "pin_memory": is_pinned,
            }
            yield from DataLoader(batches, None, sampler=steps, **options)
            return
        with ThreadPoolExecutor(1) as pool:
            upcoming = None
            for step in steps:
                batch = upcoming.result() if upcoming else batches[step]
                upcoming = pool.submit(batches.__getitem__, step + 1) if step + 1 in steps else None
                yield batch

    def _step(self, step: int, batch: Any) -> dict[str, float]:
        """Take a step; returns the means of the loss terms over the batches of all processes."""
        accelerator, model = self.accelerator, self.task.model
        seed = np.random.SeedSequence((self.config.seed, step, accelerator.process_index))
        torch.manual_seed(int(seed.generate_state(1)[0]))
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate_at(step, self.config)
        model.train()
        terms = self.losses(batch)
        totals, counts = torch.stack(list(terms.values()), 1)
        all_totals, all_counts = accelerator.reduce(torch.stack([totals.detach(), counts]), "sum")
        all_counts = all_counts.clamp(min=1)
        # Gradients are averaged over processes, while the means are over the items of all of them.
        accelerator.backward((totals / all_counts).sum() * accelerator.num_processes)
        norm = torch.as_tensor(accelerator.clip_grad_norm_(model.parameters(), self.config.clip_norm))
        # Waits for the device, so not before all its work is launched.
        *values, length = torch.cat([all_totals / all_counts, norm.detach().reshape(1)]).tolist()
        means = dict(zip(terms, values, strict=True))
        bad = [name for name, mean in means.items() if not math.isfinite(mean)]
        if bad:
            raise FloatingPointError(f"step {step}: loss is not finite ({', '.join(bad)})")
        if not math.isfinite(length):
            raise FloatingPointError(
                f"step {step}: the gradient is not finite, though the loss is; the last checkpoint is from before. A lower "
                "learning_rate may help, or float32 in place of bfloat16"
            )
        self.optimizer.step()
        self.optimizer.zero_grad()
        if self.average is not None:
            self.average.update_parameters(model)
        return means

    def _finish(self, step: int, record: dict[str, float]) -> None:
        """Evaluate after a step where it is time to, and write what there is to write."""
        every = self.config.evaluate_every
        if step == self.config.steps or (every and step % every == 0):
            metrics = self.task.evaluate(self.task.model if self.average is None else self.average.module)
            record = record | metrics
            log.info("step %d: %s", step, metrics)
        if record:
            self.folder.write(step, record)


def _average(model: nn.Module, decay: float) -> AveragedModel:
    """An exponential moving average of the weights."""
    average = AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(decay), use_buffers=True)
    for module in average.modules():
        if isinstance(module, nn.RNNBase):
            module.flatten_parameters()  # cuDNN wants them in one piece, which copying undoes
    return average


def _accelerator(config: LoopConfig) -> Accelerator:
    """The accelerator, which moves models to the device, casts, and synchronises gradients."""
    several = int(os.environ.get("WORLD_SIZE", "1")) > 1
    if several:
        if config.device not in ("auto", "cpu"):
            raise DataError(f"device is {config.device!r}; expected auto or cpu with several processes")
        here, devices = int(os.environ.get("LOCAL_WORLD_SIZE", "1")), torch.cuda.device_count()
        if config.device == "auto" and 0 < devices < here:
            raise DataError(f"{here} processes on this machine share {devices} CUDA devices; start one for each device")
    else:  # another training in this process may have another device
        AcceleratorState._reset_state(reset_partial_state=True)
    device = resolve_device(config.device)
    if not several and device.type == "cuda" and device.index is not None:
        torch.cuda.set_device(device)
    precision = resolve_precision(config.precision, device)
    if precision == torch.bfloat16 and device.type == "cpu" and not has_bfloat16():
        raise DataError("precision is 'bfloat16', which this processor lacks (no AVX-512); expected float32 or auto")
    unused = DistributedDataParallelKwargs(find_unused_parameters=True)
    mixed = "bf16" if precision == torch.bfloat16 else "no"
    # Left to itself, Accelerate takes other accelerators, and each of several processes without a GPU for the only one.
    return Accelerator(mixed_precision=mixed, cpu=device.type == "cpu", kwargs_handlers=[unused])


def train_part(
    part: str,
    task: Task,
    config: Any,
    model_config: Any,
    details: Mapping[str, Any] | None = None,
    inputs: Mapping[str, Any] | None = None,
    mean_with: str = "",
) -> str:
    """Train a part of the system and write its checkpoint.

    Args:
        part: one of `nsdr.io.checkpoint.PARTS`.
        task: what to train.
        config: the training, with `run_dir`, `output` ("" for `run_dir/checkpoint`) and `loop`.
        model_config: the dataclass that rebuilds the network.
        details: what else the part's JSON file holds.
        inputs: plain values that stand for the content of the data; a run is resumed only with the same.
        mean_with: folder of a checkpoint of the same network; the mean of its weights and the trained ones is evaluated and
            written in place of the trained ones. "" for none.

    Returns:
        The folder of the checkpoint.

    Raises:
        FloatingPointError, DataError: see `train`.
    """
    metrics: Mapping[str, float | None] = train(
        task, config.loop, config.run_dir, resolved(config) | {**(inputs or {})}
    )
    output: str = config.output or f"{config.run_dir}/checkpoint"
    if mean_with:
        trained = {name: value.clone() for name, value in task.model.state_dict().items()}
        start_from(task.model, mean_with, part)
        with torch.no_grad():
            for name, value in task.model.state_dict().items():
                if value.is_floating_point():  # others count batches
                    value.lerp_(trained[name], 0.5)
        metrics = {name: v if math.isfinite(v) else None for name, v in task.evaluate(task.model).items()}
    processes = PartialState()
    if processes.is_main_process:
        more = {**(details or {}), "metrics": metrics, "training": described(config)}
        save_checkpoint(output, part, task.model.state_dict(), model_config, more, half=True)
    processes.wait_for_everyone()
    return output


def held_out(indices: NDArray[np.integer[Any]], every: int, where: str) -> NDArray[np.bool_]:
    """Which of the scenes (N,) are held out for evaluation: those whose index is divisible by `every`.

    Raises:
        DataError: there are none of either; names `where` they are from.
    """
    found = np.asarray(indices) % every == 0
    if found.all() or not found.any():
        expected = f"scenes whose index is divisible by {every}, to evaluate on, and others to train on"
        raise DataError(f"{where}: expected {expected}; got {found.sum()} and {(~found).sum()}")
    return found

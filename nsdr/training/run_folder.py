"""The folder of a training run: configuration, metrics and checkpoints, from which a killed run goes on."""

import json
import logging
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from nsdr.errors import DataError
from nsdr.io.files import atomic_path, read_json, remove_partial_files, sync, write_json
from nsdr.io.fingerprint import code_revision

__all__ = ["RunFolder", "TrainingState"]

log = logging.getLogger(__name__)

KEPT_CHECKPOINTS = 2
"""Newest checkpoints that are kept: should the newest be damaged, the one before it is resumed from."""
LOSSES = ("step", "loss", "learning_rate")
"""Columns of `metrics.jsonl` that are no metrics, beside the loss terms `loss/...`."""


@dataclass(frozen=True)
class TrainingState:
    """Everything that a step changes.

    Attributes:
        model: what is trained.
        optimizer: its optimizer.
        average: the exponential moving average of the weights; None where there is none.
        scaler: the gradient scaler of fp16 training; None where there is none.
    """

    model: nn.Module
    optimizer: Any
    average: AveragedModel | None = None
    scaler: Any = None

    def save(self, folder: Path) -> dict[str, Any]:
        """Write the tensors as safetensors files; returns the scaler's state, plain values."""
        values = self.optimizer.state_dict()["state"]
        flat = {f"{i}.{name}": torch.as_tensor(value) for i, state in values.items() for name, value in state.items()}
        tensors = {"model": self.model.state_dict(), "optimizer": flat}
        if self.average is not None:
            tensors["average"] = self.average.state_dict()
        for name, part in tensors.items():
            # Copies: safetensors refuses tensors that share memory.
            save_file(
                {k: v.detach().cpu().clone().contiguous() for k, v in part.items()}, folder / f"{name}.safetensors"
            )
        return {} if self.scaler is None else dict(self.scaler.state_dict())

    def load(self, folder: Path, scaler: Mapping[str, Any]) -> None:
        """Take over what `save` wrote."""
        optimizer: dict[int, dict[str, Tensor]] = {}
        for key, value in load_file(folder / "optimizer.safetensors").items():
            index, name = key.split(".", 1)
            optimizer.setdefault(int(index), {})[name] = value
        self.model.load_state_dict(load_file(folder / "model.safetensors"))
        if self.average is not None:
            self.average.load_state_dict(load_file(folder / "average.safetensors"))
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": optimizer, "param_groups": groups})
        if self.scaler is not None:
            self.scaler.load_state_dict(dict(scaler))


class RunFolder:
    """`config.json` (configuration and the code's revision), `metrics.jsonl` and the newest checkpoints, `step_N`.

    A folder without a checkpoint holds nothing to go on from: a run with any configuration may start in it.

    Args:
        path: the folder; created if missing.
        resolved: the whole configuration as plain values.
        writes: whether this process writes; with several, one does.

    Raises:
        DataError: the folder's checkpoints come from another configuration.
    """

    def __init__(self, path: str | Path, resolved: Mapping[str, Any], writes: bool = True) -> None:
        self.path, self.writes = Path(path), writes
        if writes:
            remove_partial_files(self.path)
        resolved = json.loads(json.dumps(resolved))
        config = self.path / "config.json"
        if self._checkpoints() and config.exists():
            before = read_json(config)["config"]
            changed = sorted(k for k in {*before, *resolved} if before.get(k) != resolved.get(k))
            if changed:
                raise DataError(
                    f"{path}: was started with another configuration ({', '.join(changed)}); use a new run_dir"
                )
        elif writes:
            details = {"config": resolved, "revision": code_revision(), "torch": torch.__version__}
            write_json(config, details, indent=1)

    @property
    def _metrics(self) -> Path:
        return self.path / "metrics.jsonl"

    def _checkpoints(self) -> list[Path]:
        """Complete checkpoints, the newest first."""
        complete = [p for p in self.path.glob("step_*") if (p / "state.json").exists()]
        return sorted(complete, key=_step_of, reverse=True)

    def save(self, state: TrainingState, step: int, record: Mapping[str, float]) -> None:
        """Write the checkpoint `step_N`, and then delete all but the newest ones.

        Args:
            state: what to save.
            step: number of finished steps, N.
            record: the losses of this step, for its line in `metrics.jsonl`, which is written later.
        """
        if not self.writes:
            return
        folder, temporary = self.path / f"step_{step:07d}", self.path / f".step_{step:07d}"
        for leftover in (folder, *self.path.glob(".step_*")):
            shutil.rmtree(leftover, ignore_errors=True)
        temporary.mkdir()
        scaler = state.save(temporary)
        write_json(temporary / "state.json", {"step": step, "record": record, "scaler": scaler})
        sync(*temporary.iterdir(), temporary)
        os.replace(temporary, folder)
        sync(self.path)
        kept = [p for p in self._checkpoints() if _step_of(p) <= step][:KEPT_CHECKPOINTS]
        for old in self.path.glob("step_*"):
            if old not in kept:
                shutil.rmtree(old)

    def restore(self, state: TrainingState) -> tuple[int, dict[str, float]]:
        """Load the newest checkpoint that is whole, and drop the lines of later steps from `metrics.jsonl`.

        Returns:
            The number of finished steps (0 without a checkpoint), and the losses of the last one as given to `save`.

        Raises:
            DataError: there are checkpoints, and all are damaged.
        """
        folders, step, record = self._checkpoints(), 0, {}
        for folder in folders:
            try:
                content = read_json(folder / "state.json")
                state.load(folder, content["scaler"])
                step, record = int(content["step"]), dict(content["record"])
                break
            except (SafetensorError, OSError, KeyError, TypeError, RuntimeError, DataError) as e:
                log.warning("%s: damaged (%s); going back to the checkpoint before it", folder, str(e).splitlines()[0])
        else:
            if folders:
                raise DataError(f"{self.path}: no checkpoint can be read; delete the folder to start again")
        if step:
            log.info("%s: resumes at step %d", self.path, step)
        if self.writes and self._metrics.exists():
            with atomic_path(self._metrics) as temporary:
                temporary.write_text("".join(json.dumps(line) + "\n" for line in self._lines() if line["step"] <= step))
        return step, record

    def write_line(self, step: int, record: Mapping[str, float]) -> None:
        """Append a step's losses and metrics to `metrics.jsonl`."""
        if self.writes:
            with open(self._metrics, "a") as file:
                file.write(json.dumps({"step": step, **record}) + "\n")

    def metrics(self, step: int) -> dict[str, float] | None:
        """The metrics that `metrics.jsonl` has for a step; None where it has no line."""
        for line in self._lines():
            if line["step"] == step:
                return {k: v for k, v in line.items() if k not in LOSSES and not k.startswith("loss/")}
        return None

    def _lines(self) -> Iterator[dict[str, Any]]:
        """The lines of `metrics.jsonl`; one that a kill left unfinished is passed over."""
        for line in self._metrics.read_text().splitlines() if self._metrics.exists() else ():
            try:
                yield json.loads(line)
            except ValueError:
                continue


def _step_of(checkpoint: Path) -> int:
    return int(checkpoint.name.removeprefix("step_"))

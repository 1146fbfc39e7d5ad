"""The folder of a training run: configuration, metrics and checkpoints, from which a killed run goes on."""

import hashlib
import json
import logging
import os
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError, torch as safetensors
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from nsdr.errors import DataError
from nsdr.io.configuration import parse_config
from nsdr.io.files import atomic_path, check_output_folder, remove_partial_files, sync, write_json, writing
from nsdr.io.fingerprint import code_revision
from nsdr.io.reading import read_json

__all__ = ["RunFolder", "TrainingState", "parse_training", "training_time"]

T = TypeVar("T")
log = logging.getLogger(__name__)

KEPT_CHECKPOINTS = 2
"""Newest checkpoints that are kept: should the newest be damaged, the one before it is resumed from."""
LOSSES = ("step", "loss", "learning_rate")
"""Columns of `metrics.jsonl` that are no metrics, beside the loss terms `loss/...`."""


def parse_training(kind: type[T], argv: Sequence[str] | None, part: str) -> T:
    """The configuration of `nsdr train PART` from its arguments; its outputs are checked before any data are read.

    Raises:
        DataError: as of `parse_config`; or `run_dir` or `output` cannot be written.
    """
    config: Any = parse_config(kind, argv, f"nsdr train {part}")
    for folder in (config.run_dir, config.output or config.run_dir):
        check_output_folder(folder)
    return config


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
        """Write the tensors as safetensors files; returns the scaler's state, plain values.

        Raises:
            OSError: the folder cannot be written.
        """
        values = self.optimizer.state_dict()["state"]
        flat = {f"{i}.{name}": torch.as_tensor(value) for i, state in values.items() for name, value in state.items()}
        tensors = {"model": self.model.state_dict(), "optimizer": flat}
        if self.average is not None:
            tensors["average"] = self.average.state_dict()
        for name, part in tensors.items():
            # Copies: safetensors refuses tensors that share memory.
            copies = {k: v.detach().cpu().clone().contiguous() for k, v in part.items()}
            (folder / f"{name}.safetensors").write_bytes(safetensors.save(copies))
        return {} if self.scaler is None else dict(self.scaler.state_dict())

    def load(self, folder: Path, scaler: Mapping[str, Any]) -> None:
        """Take over what `save` wrote."""
        optimizer: dict[int, dict[str, Tensor]] = {}
        for key, value in safetensors.load_file(folder / "optimizer.safetensors").items():
            index, name = key.split(".", 1)
            optimizer.setdefault(int(index), {})[name] = value
        self.model.load_state_dict(safetensors.load_file(folder / "model.safetensors"))
        if self.average is not None:
            self.average.load_state_dict(safetensors.load_file(folder / "average.safetensors"))
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": optimizer, "param_groups": groups})
        for parameter, values in self.optimizer.state.items():
            for name, value in values.items():
                if value.shape == parameter.shape:  # in the parameter's memory format, as the optimizer made it
                    values[name] = torch.empty_like(parameter).copy_(value)
        if self.scaler is not None:
            self.scaler.load_state_dict(dict(scaler))


def _without_device(config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration without `loop.device`, which does not say what is trained."""
    loop = config.get("loop")
    return {**config, "loop": {**loop, "device": ""}} if isinstance(loop, dict) else dict(config)


class RunFolder:
    """`config.json` (configuration and the code's revision), `metrics.jsonl` and the newest checkpoints, `step_N`.

    A folder without a checkpoint holds nothing to go on from: a run with any configuration may start in it.

    Args:
        path: the folder; created if missing.
        resolved: the whole configuration as plain values.
        writes: whether this process writes; with several, one does.

    Raises:
        DataError: the folder's checkpoints come from another configuration; its device may be another.
    """

    def __init__(self, path: str | Path, resolved: Mapping[str, Any], writes: bool = True) -> None:
        self.path, self.writes = Path(path), writes
        self._clock = _Clock()
        if writes:
            remove_partial_files(self.path)
        resolved = json.loads(json.dumps(resolved))
        config = self.path / "config.json"
        if self._checkpoints() and config.exists():
            before = read_json(config)["config"]
            before, now = _without_device(before), _without_device(resolved)
            changed = sorted(k for k in {*before, *now} if before.get(k) != now.get(k))
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
        return _complete_checkpoints(self.path)

    def save(self, state: TrainingState, step: int, record: Mapping[str, float]) -> None:
        """Write the checkpoint `step_N`, and then delete all but the newest ones.

        Args:
            state: what to save.
            step: number of finished steps, N.
            record: the losses of this step, for its line in `metrics.jsonl`, which is written later.

        Raises:
            DataError: it cannot be written, such as on a full disk; the earlier checkpoints stay.
        """
        if not self.writes:
            return
        folder, temporary = self.path / f"step_{step:07d}", self.path / f".step_{step:07d}"
        for leftover in (folder, temporary):
            shutil.rmtree(leftover, ignore_errors=True)
        with writing(folder):
            try:
                temporary.mkdir()
                scaler = state.save(temporary)
                content = {"step": step, "record": record, "scaler": scaler, "sha256": _checksums(temporary)}
                content |= self._clock.read()
                write_json(temporary / "state.json", content)
                sync(*temporary.iterdir(), temporary, *self.path.glob(self._metrics.name))
                os.replace(temporary, folder)
                sync(self.path)
            finally:
                shutil.rmtree(temporary, ignore_errors=True)
        self._delete_all_but(self._checkpoints(), step)

    def _delete_all_but(self, checkpoints: Sequence[Path], step: int) -> None:
        """Delete the checkpoints but for the newest ones up to a step, and what kills left of others."""
        kept = [p for p in checkpoints if _step_of(p) <= step][:KEPT_CHECKPOINTS]
        for old in self.path.glob("step_*"):
            if old not in kept:  # hidden before it is taken apart
                shutil.rmtree(self.path / f".{old.name}", ignore_errors=True)
                with writing(self.path):
                    os.replace(old, self.path / f".{old.name}")
        for leftover in self.path.glob(".step_*"):
            shutil.rmtree(leftover, ignore_errors=True)

    def restore(self, state: TrainingState) -> tuple[int, dict[str, float]]:
        """Load the newest checkpoint that is whole, and drop the lines of later steps from `metrics.jsonl`.

        Returns:
            The number of finished steps (0 without a checkpoint), and the losses of the last one as given to `save`.

        Raises:
            DataError: there are checkpoints, and all are damaged; or the folder cannot be written.
        """
        folders, step, record = self._checkpoints(), 0, {}
        for folder in folders:
            try:
                content = read_json(folder / "state.json")
                if content.get("sha256", sums := _checksums(folder)) != sums:
                    raise DataError("its files do not have the checksums in state.json")
                state.load(folder, content["scaler"])
                step, record = int(content["step"]), dict(content["record"])
                self._clock = _Clock(float(content.get("seconds", 0)), float(content.get("cpu_seconds", 0)))
                break
            except (SafetensorError, OSError, KeyError, TypeError, RuntimeError, DataError) as e:
                log.warning("%s: damaged (%s); going back to the checkpoint before it", folder, str(e).splitlines()[0])
        else:
            if folders:
                raise DataError(f"{self.path}: no checkpoint can be read; delete the folder to start again")
        if step:
            log.info("%s: resumes at step %d", self.path, step)
        if self.writes:
            self._delete_all_but(folders, max((_step_of(p) for p in folders), default=0))
        if self.writes and self._metrics.exists():
            with atomic_path(self._metrics) as temporary:
                temporary.write_text("".join(json.dumps(line) + "\n" for line in self._lines() if line["step"] <= step))
        return step, record

    def write_line(self, step: int, record: Mapping[str, float]) -> None:
        """Append a step's losses and metrics to `metrics.jsonl`; raises `DataError` if it cannot be written."""
        if self.writes:
            with writing(self._metrics), open(self._metrics, "a") as file:
                file.write(json.dumps({"step": step, **record}) + "\n")

    def metrics(self, step: int) -> dict[str, float] | None:
        """The metrics that `metrics.jsonl` has for a step; None where it has no line."""
        for line in self._lines():
            if line["step"] == step:
                return {k: v for k, v in line.items() if k not in LOSSES and not k.startswith("loss/")}
        return None

    def _lines(self) -> Iterator[dict[str, Any]]:
        """The lines of `metrics.jsonl`; one that a kill left unfinished is passed over."""
        for line in self._metrics.read_text(errors="replace").splitlines() if self._metrics.exists() else ():
            try:
                yield json.loads(line)
            except ValueError:
                continue


class _Clock:
    """Time of a training: of the steps up to the checkpoint that it went on from, and since then.

    Args:
        seconds: time before (s).
        cpu_seconds: CPU time before, of all threads (s).
    """

    def __init__(self, seconds: float = 0.0, cpu_seconds: float = 0.0) -> None:
        self._start, self._cpu_start = time.monotonic() - seconds, time.process_time() - cpu_seconds

    def read(self) -> dict[str, float]:
        """Both times until now."""
        seconds, cpu_seconds = time.monotonic() - self._start, time.process_time() - self._cpu_start
        return {"seconds": round(seconds, 3), "cpu_seconds": round(cpu_seconds, 3)}


def training_time(path: str | Path) -> dict[str, float]:
    """Seconds and CPU seconds (of one process, all its threads) up to the newest checkpoint of a run.

    Steps that a kill undid do not count.
    """
    for folder in _complete_checkpoints(Path(path))[:1]:
        content = read_json(folder / "state.json")
        return {name: content[name] for name in ("seconds", "cpu_seconds") if name in content}
    return {}


def _complete_checkpoints(path: Path) -> list[Path]:
    """The newest first."""
    return sorted((p for p in path.glob("step_*") if (p / "state.json").exists()), key=_step_of, reverse=True)


def _checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of the tensors' files, by name."""
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.glob("*.safetensors"))}


def _step_of(checkpoint: Path) -> int:
    return int(checkpoint.name.removeprefix("step_"))

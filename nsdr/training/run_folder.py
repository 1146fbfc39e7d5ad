"""The folder of a training run: configuration, metrics and checkpoints, from which a killed run goes on."""

import hashlib
import json
import logging
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError, torch as safetensors
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from nsdr.errors import DataError, machine_error
from nsdr.io.configuration import parse_config
from nsdr.io.device import resolve_device
from nsdr.io.files import check_output_folder, json_text, remove_partial_files, sync, write_file, write_json, writing
from nsdr.io.fingerprint import code_revision
from nsdr.io.reading import read_json

T = TypeVar("T")
log = logging.getLogger(__name__)

KEPT_CHECKPOINTS = 2
"""Newest checkpoints that are kept: should the newest be damaged, the one before it is resumed from."""
LOSSES = ("step", "loss", "learning_rate")
"""Columns of `metrics.jsonl` that are no metrics, beside the loss terms `loss/...`."""
MAY_CHANGE = ("loop.steps", "loop.log_every", "loop.evaluate_every", "loop.save_every")
"""Settings with which a run may be resumed although they differ: the steps that were made would be the same with them."""
SHORT_OPTIONS = {
    "--steps": "--loop.steps",
    "--batch-size": "--loop.batch-size",
    "--lr": "--loop.learning-rate",
    "--seed": "--loop.seed",
    "--device": "--loop.device",
}
"""Short names of options of `nsdr train PART`."""
CONFIGS = {
    "frame-parser": "frame_parser",
    "dynamics": "dynamics",
    "collisions": "dynamics",
    "question-parser": "question_parser",
    "baseline": "baselines",
}
"""The folder of `configs` with the settings of each part."""


def parse_training(kind: type[T], argv: Sequence[str] | None, part: str) -> T:
    """The configuration of `nsdr train PART` from its arguments; its outputs are checked before any data are read.

    Raises:
        DataError: see `parse_config`; `run_dir` or `output` is no folder or read-only; or there is no such device.
        MachineError: `run_dir` or `output` cannot be written.
    """
    config: Any = parse_config(kind, argv, f"nsdr train {part}", short=SHORT_OPTIONS, group=CONFIGS[part])
    resolve_device(config.loop.device)  # reading the data may take minutes
    for folder in (config.run_dir, config.output or config.run_dir):
        check_output_folder(folder)
    return config


def resolved(config: Any) -> dict[str, Any]:
    """The settings of a training as plain values, without those that may change: where it writes, and what it runs on."""
    values = {name: value for name, value in asdict(config).items() if name not in ("run_dir", "output")}
    for name in ("device", "workers"):
        values["loop"].pop(name)
    return values


def described(config: Any) -> dict[str, Any]:
    """The configuration for readers of a checkpoint. Paths are cut to their last part, which says nothing of the machine."""
    return {k: Path(v).name if isinstance(v, str) and "/" in v else v for k, v in resolved(config).items()}


@dataclass(frozen=True)
class TrainingState:
    """Everything that a step changes; `average` is the exponential moving average of the weights, where there is one."""

    model: nn.Module
    optimizer: Any
    average: AveragedModel | None = None

    def tensors(self) -> dict[str, Tensor]:
        """Copies (of any shape, on the CPU) of all tensors: `model/…`, `optimizer/INDEX.…` and `average/…`."""
        of_parameters = self.optimizer.state_dict()["state"].items()
        parts = {
            "model": self.model.state_dict(),
            "optimizer": {
                f"{i}.{name}": torch.as_tensor(v) for i, values in of_parameters for name, v in values.items()
            },
            "average": {} if self.average is None else self.average.state_dict(),
        }
        return {
            f"{part}/{name}": value.detach().cpu().clone().contiguous()
            for part, values in parts.items()
            for name, value in values.items()
        }

    def load(self, tensors: Mapping[str, Tensor]) -> None:
        """Restore the state from what `tensors` returned."""

        def part(name: str) -> dict[str, Tensor]:
            return {k.removeprefix(f"{name}/"): v for k, v in tensors.items() if k.startswith(f"{name}/")}

        self.model.load_state_dict(part("model"))
        if self.average is not None:
            self.average.load_state_dict(part("average"))
        state: dict[int, dict[str, Tensor]] = {}
        for key, value in part("optimizer").items():
            index, name = key.split(".", 1)
            state.setdefault(int(index), {})[name] = value
        self.optimizer.load_state_dict(self.optimizer.state_dict() | {"state": state})
        for parameter, values in self.optimizer.state.items():
            for name, value in values.items():
                if value.shape == parameter.shape:  # in the parameter's memory format, as the optimizer made it
                    values[name] = torch.empty_like(parameter).copy_(value)


class RunFolder:
    """`config.json` (configuration and code revision), `metrics.jsonl`, TensorBoard's events and the newest checkpoints.

    A checkpoint is `step_N.safetensors` and, written after it, `step_N.json`. A folder without one holds nothing to go on from:
    a run with any configuration may start in it. A run may be resumed with other values of the settings in `MAY_CHANGE`;
    `config.json` then holds the new ones, and in `changes` the step from which each of them holds, with the old value.

    Args:
        path: the folder; created if missing.
        resolved: the whole configuration as plain values.
        writes: whether this process writes; with several, one does.

    Attributes:
        changed: the settings that differ from those of the run before, such as "loop.steps", with their old and new value.

    Raises:
        DataError: the folder's checkpoints come from another configuration; names each setting with both values.
    """

    def __init__(self, path: str | Path, resolved: Mapping[str, Any], writes: bool = True) -> None:
        self.path, self.writes = Path(path), writes
        self._metrics = self.path / "metrics.jsonl"
        self._events: Any = None
        self._cpu_before = -time.process_time()
        if writes:
            remove_partial_files(self.path)
        self._config = self.path / "config.json"
        self._details = {"config": json.loads(json.dumps(resolved)), "revision": code_revision()}
        self._details["torch"] = torch.__version__
        self.changed: dict[str, tuple[Any, Any]] = {}
        if _checkpoints(self.path) and self._config.exists():
            started = read_json(self._config)
            self.changed = _differences(started["config"], self._details["config"])
            refused = [name for name in self.changed if name not in MAY_CHANGE]
            if refused:
                values = ", ".join("{}: {} before, {} now".format(name, *self.changed[name]) for name in refused)
                raise DataError(f"{path}: was started with another configuration ({values}); use a new run_dir")
            self._details = started | {"config": self._details["config"]}
        elif writes:
            write_json(self._config, self._details, indent=1)

    def accept_changes(self, step: int) -> None:
        """Write to `config.json` which settings differ after so many steps; `changed` has their old and new values."""
        if self.changed:
            new = [{"step": step, "setting": name, "before": old} for name, (old, _) in self.changed.items()]
            self._details["changes"] = [*self.changes, *new]
            if self.writes:
                write_json(self._config, self._details, indent=1)

    @property
    def changes(self) -> list[dict[str, Any]]:
        """What was changed when the run was resumed: the `step` from which it holds, `setting`, and the value `before`."""
        found: list[dict[str, Any]] = self._details.get("changes", [])
        return found

    def save(self, state: TrainingState, step: int, record: Mapping[str, float]) -> None:
        """Write the checkpoint after so many steps, with the losses of the last one, and delete all but the newest ones.

        Raises:
            MachineError: it cannot be written, such as on a full disk; the earlier checkpoints stay.
        """
        if not self.writes:
            return
        with writing(self.path):
            sync(*self.path.glob(self._metrics.name))
        content = safetensors.save(state.tensors())
        details = {"step": step, "record": record, "sha256": hashlib.sha256(content).hexdigest()}
        path = self.path / f"step_{step:07d}.json"
        write_file(path.with_suffix(".safetensors"), content)
        write_json(path, details)
        self._delete_all_but([p for p in _checkpoints(self.path) if p <= path])

    def _delete_all_but(self, checkpoints: Sequence[Path]) -> None:
        """Delete all checkpoints but the first ones of these, and what killed processes left of others."""
        kept = {path.stem for path in checkpoints[:KEPT_CHECKPOINTS]}
        for old in sorted(self.path.glob("step_*.*")):  # the JSON file first
            if old.stem not in kept:
                old.unlink()

    def restore(self, state: TrainingState) -> tuple[int, dict[str, float]]:
        """Load the newest checkpoint that is whole, and drop the lines of later steps from `metrics.jsonl`.

        Returns:
            The number of finished steps (0 without a checkpoint), and the losses of the last one as given to `save`.

        Raises:
            DataError: there are checkpoints, and all are damaged.
            MachineError: the machine fails while a checkpoint is read, or the folder cannot be written.
        """
        checkpoints, step, record = _checkpoints(self.path), 0, {}
        for path in checkpoints:
            try:
                details, content = read_json(path), path.with_suffix(".safetensors").read_bytes()
                if hashlib.sha256(content).hexdigest() != details["sha256"]:
                    raise DataError("its weights do not have the checksum in the JSON file")
                state.load(safetensors.load(content))
                step, record = int(details["step"]), dict(details["record"])
                log.info("%s: resumes at step %d", self.path, step)
                break
            except (SafetensorError, OSError, KeyError, TypeError, RuntimeError, DataError) as e:
                if failure := machine_error(e, path):
                    raise failure from e
                reason = str(e).splitlines()[0]
                log.warning("%s: damaged (%s); going back to the one before it", path.with_suffix(""), reason)
        if checkpoints and not step:
            raise DataError(f"{self.path}: no checkpoint can be read; delete the folder to start again")
        if self.writes:
            self._delete_all_but(checkpoints)
            if self._metrics.exists():
                lines = [self._line(line) for line in self._lines() if line["step"] <= step]
                write_file(self._metrics, "".join(lines))
            self._cpu_before += self._cpu_seconds()
            self._start_events(step)
        return step, record

    def write(self, step: int, record: Mapping[str, float]) -> None:
        """Append losses and metrics, and `cpu_seconds`, the CPU time so far, to `metrics.jsonl` and to TensorBoard's events.

        Raises:
            MachineError: they cannot be written.
        """
        if self.writes:
            record = {**record, "cpu_seconds": round(self._cpu_before + time.process_time(), 1)}
            with writing(self._metrics), open(self._metrics, "a") as file:
                file.write(self._line({"step": step, **record}))
            if self._events is not None:
                with writing(self.path):
                    for name, value in record.items():
                        self._events.add_scalar(name, value, step)
                    self._events.flush()  # raises what failed in the writer's thread, too

    def _line(self, values: Mapping[str, float | None]) -> str:
        """A line of `metrics.jsonl`. JSON has no NaN: None stands for what is not finite."""
        known = {k: v if v is not None and math.isfinite(v) else None for k, v in values.items()}
        return json_text(known, self._metrics) + "\n"

    def _start_events(self, start: int) -> None:
        """Begin a file of events for TensorBoard; those of later steps in earlier files are hidden."""
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            log.warning("TensorBoard is not installed (pip install 'nsdr[train]'); metrics.jsonl has the same numbers")
            return
        with writing(self.path):
            self._events = SummaryWriter(self.path, purge_step=start + 1)

    def metrics(self, step: int) -> dict[str, float | None] | None:
        """The metrics of a step in `metrics.jsonl`, None for those that are not finite; None if the step has no line."""
        for line in self._lines():
            if line["step"] == step:
                return {k: v for k, v in line.items() if k not in LOSSES and not k.startswith("loss/")}
        return None

    def _cpu_seconds(self) -> float:
        """CPU time (s) that was spent on the steps in `metrics.jsonl`, over all processes one after another."""
        return max((float(line.get("cpu_seconds", 0)) for line in self._lines()), default=0.0)

    def _lines(self) -> Iterator[dict[str, Any]]:
        """The lines of `metrics.jsonl`; one that a killed process left unfinished is skipped."""
        for line in self._metrics.read_text(errors="replace").splitlines() if self._metrics.exists() else ():
            try:
                yield json.loads(line)
            except ValueError:
                continue


def _checkpoints(path: Path) -> list[Path]:
    """The JSON files of the checkpoints, the newest first."""
    return sorted(path.glob("step_*.json"), reverse=True)


def _differences(before: Mapping[str, Any], now: Mapping[str, Any], section: str = "") -> dict[str, tuple[Any, Any]]:
    """Of settings that differ, such as "loop.steps", the value before and now; "nothing" where there is none."""
    found: dict[str, tuple[Any, Any]] = {}
    for key in {**before, **now}:
        old, new = before.get(key, "nothing"), now.get(key, "nothing")
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            found |= _differences(old, new, f"{section}{key}.")
        elif old != new:
            found[f"{section}{key}"] = (old, new)
    return found

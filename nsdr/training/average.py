"""The mean of the weights of several runs: `nsdr train average FOLDER FOLDER --part dynamics --output runs/mean`."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jsonargparse
import torch
from torch import Tensor

from nsdr.errors import DataError
from nsdr.io.checkpoint import PARTS, load_checkpoint, save_checkpoint
from nsdr.io.files import check_output_folder

OWN = ("metrics", "training")
"""What each run has of its own in its JSON; everything else must be equal."""
DIGITS = 16
"""Hexadecimal digits that stand for the content of a file of weights."""


def average_checkpoints(folders: Sequence[str | Path], part: str, output: str | Path) -> str:
    """Write the mean of the weights of checkpoints of one part, as float16; their JSONs are kept under `averaged`.

    The mean has no `metrics` of its own: nothing was measured. Counts of batches are rounded.

    Args:
        folders: two or more checkpoints that hold the part.
        part: one of `nsdr.io.checkpoint.PARTS`.
        output: folder of the mean; other parts in it stay.

    Returns:
        `output`.

    Raises:
        CheckpointError: a file is missing or corrupt; names it.
        DataError: fewer than two folders, an unknown part, or checkpoints of different networks.
        MachineError: `output` cannot be written.
    """
    if part not in PARTS:
        raise DataError(f"--part: expected one of {', '.join(PARTS)}, got {part!r}")
    if len(folders) < 2:
        raise DataError(f"expected two or more folders of checkpoints to average, got {len(folders)}")
    check_output_folder(output)
    states, details = zip(*(load_checkpoint(folder, part) for folder in folders), strict=True)
    first, shapes = _settings(details[0]), {name: value.shape for name, value in states[0].items()}
    averaged = []
    for folder, state, description in zip(folders, states, details, strict=True):
        other = _settings(description)
        for name in (k for k in {**first, **other} if first.get(k) != other.get(k)):
            raise DataError(
                f"{folder}: {part}.json: {name}: expected {first.get(name)!r:.60}, got {other.get(name)!r:.60}; only "
                f"checkpoints of the same network as {folders[0]} can be averaged"
            )
        if {name: value.shape for name, value in state.items()} != shapes:
            raise DataError(f"{folder}: {part}.safetensors: has other tensors than {folders[0]}; restore the files")
        digest = hashlib.sha256((Path(folder) / f"{part}.safetensors").read_bytes()).hexdigest()[:DIGITS]
        averaged.append({"weights_sha256": digest} | {k: description[k] for k in OWN if k in description})
    common = {k: v for k, v in details[0].items() if k not in (*OWN, "part", "config")}
    mean = {name: _mean([state[name] for state in states]) for name in states[0]}
    save_checkpoint(output, part, mean, details[0]["config"], {**common, "averaged": averaged}, half=True)
    return str(output)


def _settings(details: dict[str, Any]) -> dict[str, Any]:
    """What must be equal, the network's settings one by one."""
    config = {f"config.{name}": value for name, value in details["config"].items()}
    return config | {k: v for k, v in details.items() if k not in (*OWN, "config")}


def _mean(values: Sequence[Tensor]) -> Tensor:
    mean = torch.stack([value.double() for value in values]).mean(0)
    return (mean if values[0].is_floating_point() else mean.round()).to(values[0].dtype)


def main(argv: Sequence[str] | None = None) -> str:
    """Average from command-line arguments; returns the folder of the mean.

    Raises:
        CheckpointError, DataError: see `average_checkpoints`.
    """
    about = "Write the mean of the weights of checkpoints of the same network."
    parser = jsonargparse.ArgumentParser(prog="nsdr train average", description=about, exit_on_error=False)
    parser.add_argument("folders", nargs="+", help="two or more folders of checkpoints")
    parser.add_argument("--part", required=True, help=f"which part of them: {', '.join(PARTS)}")
    parser.add_argument("--output", required=True, help="folder of the mean")
    options = parser.parse_args(None if argv is None else list(argv))
    return average_checkpoints(options.folders, options.part, options.output)

"""The mean of the weights of several runs: `nsdr train average FOLDER FOLDER --part dynamics --output runs/mean`."""

import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jsonargparse
import torch
from torch import Tensor

from nsdr.errors import DataError
from nsdr.io.checkpoint import PARTS, load_checkpoint, save_checkpoint
from nsdr.io.files import check_output_folder

__all__ = ["average_checkpoints", "main"]

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
        DataError: fewer than two folders, an unknown part, checkpoints of different networks, or `output` cannot be written.
    """
    if part not in PARTS:
        raise DataError(f"--part: expected one of {', '.join(PARTS)}, got {part!r}")
    if len(folders) < 2:
        raise DataError(f"expected two or more folders of checkpoints to average, got {len(folders)}")
    check_output_folder(output)
    states, descriptions = zip(*(load_checkpoint(folder, part) for folder in folders), strict=True)
    common = {k: v for k, v in descriptions[0].items() if k not in OWN}
    for folder, state, description in zip(folders[1:], states[1:], descriptions[1:], strict=True):
        other = {k: v for k, v in description.items() if k not in OWN}
        different = [k for k in {**common, **other} if common.get(k) != other.get(k)]
        if different:
            raise DataError(
                f"{folder}: {part}.json: {_difference(different[0], common, other)}; only checkpoints of the same network as "
                f"{folders[0]} can be averaged"
            )
        shapes = [{name: tuple(value.shape) for name, value in s.items()} for s in (states[0], state)]
        if shapes[0] != shapes[1]:
            raise DataError(f"{folder}: {part}.safetensors: has other tensors than {folders[0]}; restore the files")
    mean = {name: _mean([state[name] for state in states]) for name in states[0]}
    averaged = [
        {"weights_sha256": _digest(Path(folder) / f"{part}.safetensors")} | {k: d[k] for k in OWN if k in d}
        for folder, d in zip(folders, descriptions, strict=True)
    ]
    details = {k: v for k, v in common.items() if k not in ("part", "config")} | {"averaged": averaged}
    save_checkpoint(output, part, mean, common["config"], details, half=True)
    return str(output)


def _difference(key: str, first: dict[str, Any], other: dict[str, Any]) -> str:
    """What differs, as far down as one setting: "config.hidden: expected 512, got 16"."""
    a, b = first.get(key), other.get(key)
    if isinstance(a, dict) and isinstance(b, dict):
        inner = next(k for k in {**a, **b} if a.get(k) != b.get(k))
        return f"{key}.{inner}: expected {a.get(inner)!r:.60}, got {b.get(inner)!r:.60}"
    return f"{key}: expected {a!r:.60}, got {b!r:.60}"


def _mean(values: Sequence[Tensor]) -> Tensor:
    mean = torch.stack([value.double() for value in values]).mean(0)
    return (mean if values[0].is_floating_point() else mean.round()).to(values[0].dtype)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:DIGITS]


def main(argv: Sequence[str] | None = None) -> str:
    """Average from command-line arguments; returns the folder of the mean.

    Raises:
        CheckpointError, DataError: as of `average_checkpoints`.
    """
    parser = jsonargparse.ArgumentParser(
        prog="nsdr train average",
        description="Write the mean of the weights of checkpoints of the same network.",
        exit_on_error=False,
    )
    parser.add_argument("folders", nargs="+", help="two or more folders of checkpoints")
    parser.add_argument("--part", required=True, help=f"which part of them: {', '.join(PARTS)}")
    parser.add_argument("--output", required=True, help="folder of the mean")
    options = parser.parse_args(sys.argv[1:] if argv is None else list(argv))
    return average_checkpoints(options.folders, options.part, options.output)

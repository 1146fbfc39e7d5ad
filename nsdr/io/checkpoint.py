"""Checkpoints: a folder with one safetensors file and one JSON file for each part. Nothing is ever unpickled."""

import os
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from nsdr.errors import CheckpointError
from nsdr.io.files import atomic_path, read_json, write_json

__all__ = ["find_checkpoint", "load_checkpoint", "save_checkpoint"]

PARTS = ("frame_parser", "dynamics", "question_parser")


def find_checkpoint(path_or_id: str | Path = "default") -> Path:
    """The folder of a checkpoint.

    Looked for in this order: `path_or_id` as a path; below `$NSDR_CHECKPOINTS`; below the `checkpoints` folder of
    the checkout; below `share/nsdr/checkpoints` of the environment, where an installed wheel puts `default`; as a repository
    id of the Hugging Face hub (`user/name`).

    Raises:
        CheckpointError: found nowhere; says where it was looked for.
    """
    name = str(path_or_id)
    roots = [Path(os.environ["NSDR_CHECKPOINTS"])] if os.environ.get("NSDR_CHECKPOINTS") else []
    roots.append(Path(__file__).resolve().parents[2] / "checkpoints")
    roots.append(Path(sys.prefix) / "share" / "nsdr" / "checkpoints")
    for folder in [Path(name), *(root / name for root in roots)]:
        if folder.is_dir():
            return folder
    looked = ", ".join([name, *(str(root / name) for root in roots)])
    remedy = "set NSDR_CHECKPOINTS to a folder that holds it, or clone the repository: its checkpoints/ has `default`"
    if name.count("/") != 1 or name.startswith((".", "/")):
        raise CheckpointError(f"no checkpoint {name!r} (looked in {looked}); {remedy}")
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import HfHubHTTPError, HFValidationError, LocalEntryNotFoundError

    try:
        return Path(snapshot_download(name, allow_patterns=["*.safetensors", "*.json", "*.md"]))
    except (HfHubHTTPError, HFValidationError, LocalEntryNotFoundError, OSError) as e:
        first_line = str(e).splitlines()[0]
        raise CheckpointError(f"no checkpoint {name!r} in {looked} nor on the hub ({first_line}); {remedy}") from e


def save_checkpoint(
    folder: str | Path, part: str, state: Mapping[str, Any], config: Any, details: Mapping[str, Any], half: bool = False
) -> None:
    """Write `<part>.safetensors` and `<part>.json` (the config dataclass, and details such as metrics and data).

    Args:
        folder: created when missing; other parts in it stay.
        part: one of `PARTS`.
        state: tensors by name.
        config: the frozen dataclass that rebuilds the model.
        details: plain values for the reader (metrics with their data, training configuration).
        half: store floats as float16.
    """
    import torch
    from safetensors.torch import save_file

    def stored(value: torch.Tensor) -> torch.Tensor:
        value = value.detach().cpu().contiguous()
        return value.half() if half and value.is_floating_point() else value

    folder = Path(folder)
    with atomic_path(folder / f"{part}.safetensors") as temporary:
        save_file({name: stored(value) for name, value in state.items()}, temporary)
    write_json(folder / f"{part}.json", {"part": part, "config": asdict(config), **details}, indent=1)


def load_checkpoint(folder: str | Path, part: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """(tensors by name, the JSON's content) of one part; float16 tensors come back as float32.

    Raises:
        CheckpointError: a file is missing or corrupt; names it.
    """
    import torch
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    folder = Path(folder)
    details = read_json(folder / f"{part}.json", CheckpointError)
    weights = folder / f"{part}.safetensors"
    if not isinstance(details, dict) or details.get("part") != part or not isinstance(details.get("config"), dict):
        raise CheckpointError(f"{folder / part}.json: not the description of a {part}; restore it from the repository")
    if not weights.is_file():
        raise CheckpointError(f"{weights}: no such file; restore it, or train the part (`nsdr train`)")
    try:
        state = load_file(weights)
    except (SafetensorError, OSError) as e:
        raise CheckpointError(f"{weights}: corrupt ({e}); restore it, or train the part (`nsdr train`)") from e
    return {k: v.float() if v.dtype == torch.float16 else v for k, v in state.items()}, details

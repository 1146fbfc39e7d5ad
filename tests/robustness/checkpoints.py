"""Wrong checkpoints: tensors missing, added, renamed, of another size or type, not finite or zero; and changed settings."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file

from tests.robustness.case import WRONG, Case, Write, dumped
from tests.robustness.files import DAMAGES, Damage

SHIPPED = Path(__file__).resolve().parents[2] / "checkpoints" / "default"
PARTS = ("question_parser", "frame_parser", "dynamics", "collisions")
VIDEO = ("parse", "{good}/gray.mp4", "--set", "video.check=off", "--checkpoint", "weights", "-o", "scene.json")
COMMANDS = {
    "question_parser": ("program", "How many?", "--question-parser", "network", "--checkpoint", "weights"),
    "frame_parser": VIDEO,
    "dynamics": (*VIDEO, "--dynamics", "propnet"),
    "collisions": VIDEO,
}
"""A command that loads each part."""
State = dict[str, torch.Tensor]


def _matrix(state: State) -> str:
    """The first tensor of weights by name."""
    return min(name for name, value in state.items() if value.dim() > 1)


def _changed(change: Callable[[torch.Tensor], torch.Tensor]) -> Callable[[State], object]:
    return lambda state: state.update({_matrix(state): change(state[_matrix(state)]).contiguous()})


def _one_value(value: float) -> Callable[[torch.Tensor], torch.Tensor]:
    def change(weights: torch.Tensor) -> torch.Tensor:
        weights = weights.clone()
        weights.view(-1)[weights.numel() // 2] = value
        return weights

    return change


TENSORS: dict[str, Callable[[State], object]] = {
    "missing": lambda s: s.pop(_matrix(s)),
    "added": lambda s: s.update(zebra=torch.ones(3)),
    "renamed": lambda s: s.update({f"{_matrix(s)}_zebra": s.pop(_matrix(s))}),
    "all missing": lambda s: s.clear(),
    "one NaN": _changed(_one_value(float("nan"))),
    "one infinite": _changed(_one_value(float("inf"))),
    "all NaN": lambda s: s.update({k: v * float("nan") for k, v in s.items() if v.is_floating_point()}),
    "one tensor of zeros": _changed(torch.zeros_like),
    "all zero": lambda s: s.update({k: torch.zeros_like(v) for k, v in s.items()}),
    "int8": _changed(lambda w: torch.ones_like(w, dtype=torch.int8)),
    "boolean": _changed(lambda w: w > 0),
    "int64": _changed(lambda w: torch.ones_like(w, dtype=torch.int64)),
    "row missing": _changed(lambda w: w[:-1]),
    "transposed": _changed(lambda w: w.transpose(0, 1)[..., :-1]),
    "flattened": _changed(torch.Tensor.flatten),
    "empty": _changed(lambda w: w[:0]),
}
"""Changes to the weights of a part."""
WEIGHTS_DAMAGES: dict[str, Damage] = {
    "empty": lambda data: b"",
    "half": lambda data: data[: len(data) // 2],
    "last byte missing": lambda data: data[:-1],
    "trailing text": lambda data: data + b"zebra",
    "header of 10^18 bytes": lambda data: (10**18).to_bytes(8, "little") + data[8:],
    "header without end": lambda data: data[:8] + b"{" * (len(data) - 8),
    "no header": lambda data: b"\x00" * 100,
    "text": lambda data: b"zebra",
    "pickle": lambda data: b"\x80\x04\x95\x0b\x00\x00\x00\x00\x00\x00\x00\x8c\x05zebra\x94.",
    "zip": lambda data: b"PK\x03\x04" + data,
}
"""Ways to damage a file of weights."""
JSON_CHANGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "without part": lambda d: d.pop("part"),
    "another part": lambda d: d.update(part="zebra"),
    "part as number": lambda d: d.update(part=5),
    "without config": lambda d: d.pop("config"),
    "config as list": lambda d: d.update(config=[1]),
    "config empty": lambda d: d["config"].clear(),
    "unknown setting": lambda d: d["config"].update(zebra=5),
}
"""Changes to the description of a part."""
JSON_DAMAGES = ("empty", "two thirds", "UTF-16", "zero bytes", "100,000 brackets", "trailing text", "number", "null",
                "empty list", "empty object", "no JSON", "compressed without end")  # fmt: skip
NUMBERS = {int: "count", float: "number", list: "list", str: "word"}


def _checkpoint(
    part: str, file: str, change: Callable[[Path], object] | None = None, content: bytes | None = None
) -> Write:
    """Links to the shipped files, but for one, which is changed, replaced, or left out."""

    def write(folder: Path, good: Path) -> None:
        target = folder / "weights"
        target.mkdir()
        for source in SHIPPED.glob("*.*"):
            if source.name != file:
                (target / source.name).symlink_to(source)
        if change is not None:
            change(target / file)
        elif content is not None:
            (target / file).write_bytes(content)

    return write


def _saved(part: str, change: Callable[[State], object]) -> Callable[[Path], object]:
    def save(path: Path) -> None:
        state = load_file(SHIPPED / path.name)
        change(state)
        save_file(state, path)

    return save


def checkpoint_cases() -> Iterator[Case]:
    """All wrong checkpoints."""
    for part in PARTS:
        argv, weights, description = COMMANDS[part], f"{part}.safetensors", f"{part}.json"
        rule, shipped = f"checkpoint, {part}", json.loads((SHIPPED / description).read_text())
        for name, change in TENSORS.items():
            yield Case(f"{rule}, tensors", name, argv, _checkpoint(part, weights, _saved(part, change)), part)
        for name, damage in WEIGHTS_DAMAGES.items():
            damaged = lambda path, damage=damage: path.write_bytes(damage((SHIPPED / path.name).read_bytes()))  # noqa: E731
            yield Case(f"{rule}, weights file", name, argv, _checkpoint(part, weights, damaged), weights)
        yield Case(f"{rule}, weights file", "missing", argv, _checkpoint(part, weights), weights)
        yield Case(f"{rule}, weights file", "folder", argv, _checkpoint(part, weights, Path.mkdir), weights)
        other = "dynamics" if part != "dynamics" else "question_parser"
        swapped = lambda path, other=other: path.symlink_to(SHIPPED / f"{other}.safetensors")  # noqa: E731
        yield Case(f"{rule}, weights file", "another part's", argv, _checkpoint(part, weights, swapped), part)
        for name, edit in JSON_CHANGES.items():
            details = json.loads(json.dumps(shipped))
            edit(details)
            if details != shipped:
                yield Case(
                    f"{rule}, settings",
                    name,
                    argv,
                    _checkpoint(part, description, content=dumped(details).encode()),
                    description,
                )
        for key, value in shipped["config"].items():
            details = json.loads(json.dumps(shipped))
            del details["config"][key]
            without = dumped(details).encode()
            yield Case(
                f"{rule}, settings",
                f"without {key}",
                argv,
                _checkpoint(part, description, content=without),
                description,
            )
            for wrong in WRONG[NUMBERS[type(value)]]:
                details["config"][key] = wrong
                text = dumped(details).encode()
                yield Case(
                    f"{rule}, settings",
                    f"{key} = {str(wrong)[:30]}",
                    argv,
                    _checkpoint(part, description, content=text),
                    description,
                )
        for name in JSON_DAMAGES:
            content = DAMAGES[name]((SHIPPED / description).read_bytes())
            yield Case(
                f"{rule}, settings file", name, argv, _checkpoint(part, description, content=content), description
            )
        yield Case(f"{rule}, settings file", "missing", argv, _checkpoint(part, description), description)
        yield Case(f"{rule}, settings file", "folder", argv, _checkpoint(part, description, Path.mkdir), description)

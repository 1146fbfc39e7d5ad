"""Checkpoints: a folder with one safetensors file and one JSON file for each part. Nothing is ever unpickled."""

import os
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, Self, TypeVar, runtime_checkable

from nsdr.errors import CheckpointError, DataError, machine_error
from nsdr.io.description import described
from nsdr.io.device import resolve_device
from nsdr.io.files import write_file, write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.io.shipped import shipped_folders
from nsdr.io.worlds import stored_world, world_in
from nsdr.world.world import CLEVRER_WORLD, World

if TYPE_CHECKING:
    import torch
    from torch import nn

Config = TypeVar("Config")
Network = TypeVar("Network", bound="nn.Module")
Model = TypeVar("Model", bound="nn.Module")

PARTS = ("frame_parser", "dynamics", "collisions", "question_parser", "baseline")
"""Parts of a checkpoint, by the names of their files."""
PIPELINE = "pipeline.json"
"""File of a checkpoint that says how a pipeline is composed of its parts."""
HUB_ID = re.compile(r"[\w-][\w.-]*/[\w-][\w.-]*(@[\w.-]+)?")
"""A repository of the Hugging Face Hub, and after `@` a branch, tag or commit of it."""
HUB_FILES = ("*.safetensors", "*.json", "*.md")
"""Files of a repository that are downloaded. No pickles."""
RESTORE = "restore the file, or train the part (`nsdr train`)"
SCORES = {
    "frame_parser": "f1",
    "dynamics": "collision_f1",
    "collisions": "collision_f1",
    "question_parser": "choice_exact",
}
"""Of each part, which of the metrics in its JSON file (0-1) says best how good it is."""
LOW_SCORE = 0.5
"""Weights with a score below this are loaded with a warning."""


def find_checkpoint(path_or_id: str | Path = "default", group: str = "") -> Path:
    """The folder of a checkpoint.

    A name is looked for in this order: below `$NSDR_CHECKPOINTS`; below the `checkpoints` folder of the checkout; below
    `share/nsdr/checkpoints` of the environment, where an installed wheel puts those that ship; in the working folder; and if it
    is "user/repo" or "user/repo@revision", on the Hugging Face Hub, from which it is downloaded once. A name that begins with
    `.`, `~` or `/` is a path, so `./default` is your own folder even if a checkpoint of this name ships.

    Args:
        path_or_id: the name or path.
        group: subfolder of each of these places in which a name is looked for, such as "baselines"; "" for the place itself.

    Raises:
        CheckpointError: found nowhere; says where it was looked for. Or the download fails.
    """
    name = str(path_or_id)
    if not name.strip():
        raise CheckpointError("the checkpoint's name is empty; expected a folder, or a name such as default")
    roots = [Path(os.environ["NSDR_CHECKPOINTS"])] if os.environ.get("NSDR_CHECKPOINTS") else []
    roots += shipped_folders("checkpoints")
    own = Path(name).expanduser()
    named = [] if own.is_absolute() or name.startswith(".") else [root / group / name for root in roots]
    found = next((folder for folder in [*named, own] if folder.is_dir()), None)
    if found is not None:
        if found != own and any(own.glob("*.safetensors")):
            warnings.warn(f"{name}: taken from {found}; ./{name} is the folder of that name here", stacklevel=2)
        return found
    missing = f"no checkpoint {name!r} (looked in {', '.join(map(str, [*named, own]))})"
    if HUB_ID.fullmatch(name):
        return _downloaded(name, missing)
    remedy = (
        "set NSDR_CHECKPOINTS to a folder that holds it, or clone the repository: its checkpoints/ has all that ship"
    )
    raise CheckpointError(f"{missing}; {remedy}")


def _downloaded(name: str, missing: str) -> Path:
    """The local copy of a repository of the Hugging Face Hub; `missing` begins the message if there is none."""
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import HfHubHTTPError, HFValidationError, LocalEntryNotFoundError

    repository, _, revision = name.partition("@")
    try:
        return Path(snapshot_download(repository, revision=revision or None, allow_patterns=list(HUB_FILES)))
    except (HfHubHTTPError, HFValidationError, LocalEntryNotFoundError, OSError) as e:
        if failure := machine_error(e):
            raise failure from e
        reason = " ".join(str(e).split())[:200]
        raise CheckpointError(f"{missing}, and the Hugging Face Hub does not give it: {reason}") from e


def folder_of_part(folder: Path, part: str, shipped: str = "default") -> Path:
    """The folder that a pipeline takes a part from: the checkpoint's, or a shipped one's if the checkpoint lacks the part.

    Args:
        folder: of the checkpoint.
        part: one of `PARTS`.
        shipped: name of the shipped checkpoint with the part.

    Raises:
        CheckpointError: the checkpoint has no part of a pipeline at all.
    """
    if has_part(folder, part):
        return folder
    if not any(has_part(folder, other) for other in PARTS if other != "baseline"):
        known = ", ".join(f"{name}.json" for name in PARTS if name != "baseline")
        raise CheckpointError(f"{folder}: has none of {known}; expected the folder of a checkpoint")
    return find_checkpoint(shipped)


def is_default(folder: Path) -> bool:
    """Whether a folder is the checkpoint `default`; False if that is not installed."""
    try:
        return folder.resolve() == find_checkpoint().resolve()
    except CheckpointError:
        return False


def has_part(folder: Path, part: str) -> bool:
    """Whether a checkpoint has files of a part."""
    return any((folder / f"{part}{ending}").exists() for ending in (".json", ".safetensors"))


def save_checkpoint(
    folder: str | Path, part: str, state: Mapping[str, Any], config: Any, details: Mapping[str, Any], half: bool = False
) -> None:
    """Write `<part>.safetensors` and `<part>.json` (the config dataclass, and details such as metrics and data).

    Args:
        folder: created when missing; other parts in it stay.
        part: one of `PARTS`.
        state: tensors by name.
        config: the frozen dataclass that rebuilds the model, or its plain values.
        details: plain values for the reader (metrics with their data, training configuration).
        half: store floats as float16.
    """
    import torch
    from safetensors.torch import save

    def stored(value: torch.Tensor) -> torch.Tensor:
        value = value.detach().cpu().contiguous()
        return value.half() if half and value.is_floating_point() else value

    folder = Path(folder)
    write_file(folder / f"{part}.safetensors", save({name: stored(value) for name, value in state.items()}))
    settings = asdict(config) if is_dataclass(config) and not isinstance(config, type) else dict(config)
    write_json(folder / f"{part}.json", {"part": part, "config": settings, **details}, indent=1)


def load_checkpoint(folder: str | Path, part: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """(tensors by name, the JSON's content) of one part. Numbers of other formats, such as float16, come back as float32.

    Raises:
        CheckpointError: a file is missing or corrupt; names it.
        MachineError: the machine fails while a file is read; names it.
    """
    import torch
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    details = load_description(folder, part)
    weights = Path(folder) / f"{part}.safetensors"
    if not weights.is_file():
        raise CheckpointError(f"{weights}: no such file; {RESTORE}")
    check_limit(weights.stat().st_size, "weights_bytes", weights, CheckpointError)
    try:
        weights.open("rb").close()  # safetensors says "no such file" whatever the system's error is
        stored = load_file(weights)
    except (SafetensorError, OSError, MemoryError, KeyError, ValueError, RuntimeError) as e:
        if failure := machine_error(e, weights):
            raise failure from e
        raise CheckpointError(f"{weights}: corrupt ({e}); {RESTORE}") from e
    state = {name: value.float() if value.is_floating_point() else value for name, value in stored.items()}
    for name, value in state.items():
        fault = ""
        if value.dtype not in (torch.float32, torch.int64):  # the integers count batches
            fault = f"expected floating-point numbers or int64, got {value.dtype}"
        elif not bool(value.isfinite().all()):
            fault = "not all finite"
        elif value.dim() > 1 and not bool(value.any()):
            fault = "all zero"
        if fault:
            raise CheckpointError(f"{weights}: {name}: {fault}; {RESTORE}")
    return state, details


def load_description(folder: str | Path, part: str) -> dict[str, Any]:
    """The JSON's content of one part of a checkpoint: its `config`, and what else belongs to it.

    Raises:
        CheckpointError: the file is missing or not such a description; names it.
    """
    path = Path(folder) / f"{part}.json"
    try:
        details = read_json(path)
    except DataError as e:
        raise CheckpointError(str(e)) from e
    if not isinstance(details, dict) or details.get("part") != part or not isinstance(details.get("config"), dict):
        raise CheckpointError(f"{path}: not the description of a {part}; restore it from the repository")
    return details


def load_network(folder: str | Path, part: str, kind: type[Config], build: Callable[[Config], Network]) -> Network:
    """The network of one part, with its weights.

    Args:
        folder: of the checkpoint.
        part: name of its files.
        kind: dataclass of the network's settings.
        build: makes a network from them.

    Warns of weights that were hardly trained (`SCORES`).

    Raises:
        CheckpointError: a file is missing or corrupt, or holds another kind of network; names the file.
    """
    import torch

    state, details = load_checkpoint(folder, part)
    where, known = Path(folder) / f"{part}.json", [f.name for f in fields(kind)]  # type: ignore[arg-type]
    config: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in details["config"].items()}
    different = sorted(set(config) ^ set(known))
    if different:
        raise CheckpointError(
            f"{where}: expected a network of {kind.__name__} ({', '.join(known)}), found one of other settings "
            f"({', '.join(different)}); give a checkpoint of that kind"
        )
    try:
        settings = kind(**config)
        # No memory is taken before the sizes are known to be those of the weights.
        with torch.device("meta"), _without_initial_values():
            empty = build(settings)
        _check_formats(empty, state)
        empty.load_state_dict(state, assign=True)
        network = build(settings)
        network.load_state_dict(state)
    except (TypeError, ValueError, RuntimeError, ArithmeticError, LookupError) as e:
        if failure := machine_error(e, where):
            raise failure from e
        reason = " ".join(str(e).split())[:200]
        raise CheckpointError(f"{where}: not a network of {kind.__name__} ({reason}); restore the files") from e
    score = (details.get("metrics") or {}).get(SCORES.get(part))
    if score is not None and score < LOW_SCORE:
        warnings.warn(
            f"{where}: these weights were at {SCORES[part]} {score:.2g} when their training ended; what they find is mostly "
            "wrong",
            stacklevel=2,
        )
    return network


def trained_for(folder: str | Path, part: str) -> World:
    """The world that one part of a checkpoint was trained for; CLEVRER's if its JSON says none.

    Raises:
        CheckpointError: the file is missing or no such description; names it.
    """
    details = load_description(folder, part)
    try:
        return world_in(details, f"{Path(folder) / f'{part}.json'}: ")
    except DataError as e:
        raise CheckpointError(str(e)) from e


def world_of_checkpoint(folder: Path) -> World:
    """The world of the first part of a checkpoint that was trained for another one than CLEVRER's, or CLEVRER's."""
    worlds = (trained_for(folder, part) for part in PARTS if has_part(folder, part))
    return next((world for world in worlds if world != CLEVRER_WORLD), CLEVRER_WORLD)


def start_from(network: "nn.Module", folder: str | Path, part: str, anew: Sequence[str] = ()) -> None:
    """Give a network the weights of a checkpoint.

    Args:
        network: the network.
        folder: of the checkpoint.
        part: of the checkpoint.
        anew: beginnings of the names of tensors that keep the values that they have.

    Raises:
        CheckpointError: a file is missing or corrupt, or holds a network of other settings; names the folder.
    """
    state, _ = load_checkpoint(folder, part)
    own = network.state_dict()
    state = {
        name: own[name] if name in own and name.startswith(tuple(anew)) else value for name, value in state.items()
    }
    try:
        _check_formats(network, state)
        network.load_state_dict(state)
    except (TypeError, RuntimeError) as e:
        if failure := machine_error(e, folder):
            raise failure from e
        reason = " ".join(str(e).split())[:200]
        raise CheckpointError(f"{folder}: its {part} is of other settings ({reason}); give one of the same") from e


def _check_formats(network: "nn.Module", state: Mapping[str, Any]) -> None:
    for name, value in network.state_dict().items():
        if name in state and state[name].dtype != value.dtype:
            raise TypeError(f"{name}: expected {value.dtype}, got {state[name].dtype}")


def _without_initial_values() -> Any:
    """Within it, tensors are not filled with random numbers, for which torch's meta device loads its compiler.

    Without this, `Pipeline.from_pretrained` took 5.5 s of CPU time instead of 3.9 s (medians of five runs by turns, on a busy
    machine).
    """
    import torch
    from torch.overrides import TorchFunctionMode

    class Unfilled(TorchFunctionMode):
        def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
            given = kwargs or {}
            if function in (torch.Tensor.normal_, torch.Tensor.uniform_, torch.nn.init.normal_, torch.nn.init.uniform_):
                return args[0] if args else given["tensor"]
            return function(*args, **given)

    return Unfilled()


@runtime_checkable
class HasWeights(Protocol):
    """A part of the system with weights, which can be moved to a device and stored. Parts without these methods have none."""

    def to(self, device: str) -> Self:
        """Move the networks to a device; returns the part."""

    def save_pretrained(self, folder: str | Path) -> None:
        """Write the weights into a checkpoint's folder."""


class PretrainedPart(Generic[Model]):
    """A part of the system with a network. Inputs go to the device of its weights; results come back to the CPU.

    Attributes:
        part: name of its files in a checkpoint.
        name: which of several networks of this part it is; "" if there is one only.
        default_checkpoint: name of the shipped checkpoint that has its weights.
        built_from: the dataclass of the network's settings, and what builds the network from them.
        free: for networks of a world, beginnings of the names of the world's values that may be others than those which the
            network was trained for (see `World.differences`). They are built from settings and a world, and keep it as
            `model.world`. None for networks of no world.
        model: the network; `model.config` are its settings. Parts with several have other `from_checkpoint` and `network`.
    """

    part: ClassVar[str]
    name: ClassVar[str] = ""
    default_checkpoint: ClassVar[str] = "default"
    built_from: ClassVar[tuple[type, Callable[..., "nn.Module"]]]
    free: ClassVar[tuple[str, ...] | None] = None
    model: Model

    @classmethod
    def from_checkpoint(cls, folder: str | Path, **options: Any) -> Self:
        """The part of a checkpoint's folder, on the CPU; `options` are arguments of the constructor.

        Raises:
            CheckpointError: a file is missing or corrupt, or holds another kind of network.
        """
        make: Callable[..., Self] = cls
        kind, build = cls.built_from
        if cls.free is not None:
            build = partial(build, world=trained_for(folder, cls.part))
        return make(load_network(folder, cls.part, kind, build), **options)

    @classmethod
    def from_pretrained(cls, path_or_id: str | Path = "", device: str = "auto", **options: Any) -> Self:
        """The part with the weights of a checkpoint.

        Args:
            path_or_id: see `find_checkpoint`; "" for the shipped weights.
            device: see `to`.
            options: arguments of the constructor.

        Raises:
            CheckpointError: not found, incomplete or corrupt.
            DataError: the device is unknown or not available.
        """
        return cls.from_checkpoint(find_checkpoint(path_or_id or cls.default_checkpoint), **options).to(device)

    @property
    def network(self) -> "nn.Module":
        """The network, or all networks as one module."""
        return self.model

    @property
    def trained_for(self) -> World:
        """The world of the network's weights; CLEVRER's if the network knows none."""
        return getattr(self.network, "world", CLEVRER_WORLD)

    def check_world(self, world: World) -> None:
        """Raise `DataError` if the network was trained for a world that differs from this one in what it depends on."""
        if self.free is None or world is self.trained_for:
            return
        trained = self.trained_for
        differing = [name for name in trained.differences(world) if not name.startswith(self.free)]
        if differing:
            raise DataError(
                f"{type(self).__name__}: its weights are of the world {trained.name}; the world {world.name} has other "
                f"{', '.join(differing)}: give weights of this world, or train them (`nsdr train {self.part}`)"
            )

    __repr__ = described

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        """The dataclass that rebuilds the network, and what else belongs into the JSON."""
        of_world = {} if self.free is None else stored_world(self.trained_for)
        return self.model.config, {"network": self.name, **of_world} if self.name else of_world

    def save_pretrained(self, folder: str | Path, details: Mapping[str, Any] | None = None) -> None:
        """Write the part's weights and description for `from_pretrained(folder)`.

        Args:
            folder: created if missing; other parts of a checkpoint in it are kept.
            details: plain values to add to the JSON, such as metrics.
        """
        config, more = self._description()
        save_checkpoint(folder, self.part, self.network.state_dict(), config, {**(details or {}), **more})

    def to(self, device: str) -> Self:
        """Move the weights to a device of torch; returns the part itself. "auto" is CUDA where that is available, else the CPU.

        Raises:
            DataError: the device is unknown or not available.
        """
        self.network.to(resolve_device(device))
        return self

    @property
    def device(self) -> "torch.device":
        """Where the weights are."""
        import torch

        return next((p.device for p in self.network.parameters()), torch.device("cpu"))

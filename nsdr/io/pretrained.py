"""What parts with weights have in common: loading, saving and moving between devices."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar

from nsdr.io.checkpoint import find_checkpoint, load_network, save_checkpoint
from nsdr.io.device import resolve_device

if TYPE_CHECKING:
    import torch
    from torch import nn

__all__ = ["PretrainedModel", "PretrainedPart"]

Model = TypeVar("Model", bound="nn.Module")


class PretrainedPart(ABC):
    """A part of the system with a network. Inputs go to the device of its weights; results come back to the CPU.

    Attributes:
        part: name of its files in a checkpoint.
        default_checkpoint: name of the shipped checkpoint that has its weights.
    """

    part: ClassVar[str]
    default_checkpoint: ClassVar[str] = "default"

    @classmethod
    @abstractmethod
    def from_checkpoint(cls, folder: str | Path, **options: Any) -> Self:
        """The part of a checkpoint's folder, on the CPU; `options` are arguments of the constructor.

        Raises:
            CheckpointError: a file is missing or corrupt, or holds another kind of network.
        """

    @property
    @abstractmethod
    def network(self) -> "nn.Module":
        """The network, or all networks as one module."""

    @abstractmethod
    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        """The dataclass that rebuilds the network, and what else belongs into the JSON."""

    @classmethod
    def from_pretrained(cls, path_or_id: str | Path = "", device: str = "auto", **options: Any) -> Self:
        """The part with the weights of a checkpoint.

        Args:
            path_or_id: a folder, the name of a shipped checkpoint or an address on the Hugging Face hub (see
                `nsdr.io.checkpoint.find_checkpoint`); "" for the shipped weights.
            device: as of `to`.
            options: arguments of the constructor.

        Raises:
            CheckpointError: not found, incomplete or corrupt.
            DataError: the device is unknown or not available.
        """
        return cls.from_checkpoint(find_checkpoint(path_or_id or cls.default_checkpoint), **options).to(device)

    def save_pretrained(self, folder: str | Path, details: Mapping[str, Any] | None = None) -> None:
        """Write the part's weights and description for `from_pretrained(folder)`.

        Args:
            folder: created if missing; other parts of a checkpoint in it are kept.
            details: plain values to add to the JSON, such as metrics.
        """
        config, more = self._description()
        save_checkpoint(folder, self.part, self.network.state_dict(), config, {**(details or {}), **more})

    def to(self, device: str) -> Self:
        """Move the weights to a device; returns the part itself.

        Args:
            device: a device of torch, such as "cpu" or "cuda:1"; "auto" is CUDA where that is available, else the CPU.

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


class PretrainedModel(PretrainedPart, Generic[Model]):
    """A part with one network, which its settings rebuild.

    Attributes:
        built_from: the dataclass of the settings, and what builds the network from them.
        model: the network; `model.config` are its settings.
    """

    built_from: ClassVar[tuple[type, Callable[[Any], "nn.Module"]]]
    model: Model

    @classmethod
    def from_checkpoint(cls, folder: str | Path, **options: Any) -> Self:
        """The part of a checkpoint's folder, on the CPU; `options` are arguments of the constructor.

        Raises:
            CheckpointError: a file is missing or corrupt, or holds another kind of network.
        """
        make: Callable[..., Self] = cls
        return make(load_network(folder, cls.part, *cls.built_from), **options)

    @property
    def network(self) -> Model:
        """The network."""
        return self.model

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        return self.model.config, {}

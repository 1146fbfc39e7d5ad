"""Parts of the system in words: class, device, and the settings that differ from the defaults, as `__repr__ = described`."""

import inspect
from dataclasses import MISSING, fields, is_dataclass
from types import MappingProxyType
from typing import Any

from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import World


def described(part: object) -> str:
    """A part as a call with what is special about it, such as "FrameParser(device=cuda:0, stride=2)".

    Args:
        part: an object that keeps the arguments of its constructor as attributes. Texts, numbers, truth values and settings
            are told where they are not the defaults, and parts with weights are told likewise.
    """
    device = getattr(part, "device", None)
    told = [] if device is None else [f"device={device}"]
    try:
        parameters = inspect.signature(type(part)).parameters
    except ValueError:  # a class in C may not tell its arguments
        parameters = MappingProxyType({})
    for name, parameter in parameters.items():
        value = getattr(part, name, None)
        if isinstance(value, str | int | float):
            told += [f"{name}={value!r}"] if value != parameter.default else []
        elif is_dataclass(value) and not isinstance(value, type):
            told += differing(value)
        elif hasattr(value, "save_pretrained"):
            told.append(f"{name}={described(value)}")
    return f"{type(part).__name__}({', '.join(told)})"


def differing(settings: Any) -> list[str]:
    """The fields of a dataclass that differ from their defaults, as "name=value". A world and a vocabulary are told as one."""
    if isinstance(settings, World):
        return [] if settings == World() else [f"world={settings!r}"]
    if isinstance(settings, Vocabulary):
        return [] if settings == Vocabulary() else [f"words={' '.join(settings.attributes)!r}"]
    found = []
    for f in fields(settings):
        value, default = getattr(settings, f.name), f.default if f.default_factory is MISSING else f.default_factory()
        found += [f"{f.name}={value!r}"] if value != default else []
    return found

"""Worlds in files."""

from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec

from nsdr.io.configuration import check_sections
from nsdr.io.reading import read_yaml
from nsdr.io.shipped import find_config
from nsdr.validation import convert
from nsdr.world.world import CLEVRER_WORLD, World


def read_world(file_or_name: str | Path) -> World:
    """A world from a YAML file. What the file leaves out is as in CLEVRER.

    Args:
        file_or_name: a file, or the name of a world that ships: "clevrer", "pucks" or "blocks".

    Raises:
        DataError: an unreadable file, an unknown key, a value out of its range, or values that contradict each other; names the
            file and the value.
    """
    file = find_config(file_or_name, "worlds")
    content = read_yaml(file)
    check_sections(World, content, str(file))
    world: World = convert(content, World, f"{file}: ")
    return world


def stored_world(world: World) -> dict[str, Any]:
    """What a file says about its world: `world` with all values, or nothing for CLEVRER's."""
    return {} if world == CLEVRER_WORLD else {"world": asdict(world)}


def world_in(content: Mapping[str, Any], where: str = "") -> World:
    """The world of a file, from its content: inverse of `stored_world`.

    Args:
        content: of the file.
        where: the file or the place in it, with which error messages begin: "file.json: ".

    Raises:
        DataError: values that are no world.
    """
    stored = content.get("world")
    if stored is None:
        return CLEVRER_WORLD
    check_sections(World, stored, f"{where}world")
    return _world(msgspec.json.encode(stored), f"{where}world: ")


@lru_cache(maxsize=16)
def _world(stored: bytes, where: str) -> World:
    world: World = convert(msgspec.json.decode(stored), World, where)
    return world

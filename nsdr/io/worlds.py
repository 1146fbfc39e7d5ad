"""Worlds in files."""

from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec

from nsdr.errors import DataError
from nsdr.io.configuration import check_sections
from nsdr.io.files import write_json
from nsdr.io.reading import read_json, read_yaml
from nsdr.io.shipped import find_config
from nsdr.validation import convert
from nsdr.world.world import CLEVRER_WORLD, World

WORLD_FILE = "world.json"
"""File with the world of a folder's content."""


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


def world_of_folder(folder: str | Path) -> World:
    """The world of what is in a folder: that of its `world.json`, or CLEVRER's if it has none.

    Raises:
        DataError: see `read_world`.
    """
    path = Path(folder) / WORLD_FILE
    return read_world(path) if path.exists() else CLEVRER_WORLD


def store_world(folder: str | Path, world: World) -> None:
    """Write the world of what will be in a folder into its `world.json`; nothing for CLEVRER's.

    Raises:
        DataError: the folder is of another world; says in what they differ.
    """
    path = Path(folder) / WORLD_FILE
    if path.exists():
        if differences := ", ".join(read_world(path).differences(world)):
            raise DataError(f"{path}: is another world than {world.name}, in {differences}; choose another folder")
    elif world != CLEVRER_WORLD:
        write_json(path, asdict(world), indent=1)


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


def world_beside(file: str | Path) -> World:
    """The world of the generated data set that a file is of: its `manifest.json` is beside the file or one folder above.

    It is CLEVRER's without one.

    Raises:
        DataError: an unreadable manifest, or values that are no world.
    """
    return world_of_data_set(file, levels=2) or CLEVRER_WORLD


def world_of_data_set(file: str | Path, levels: int = 4) -> World | None:
    """The world of the generated data set that a file is in; None without a `manifest.json` in the folders above the file.

    Args:
        file: the file.
        levels: number of folders above it that may be the data set's; videos are four levels below.

    Raises:
        DataError: an unreadable manifest, or values that are no world.
    """
    for folder in list(Path(file).absolute().parents)[:levels]:
        manifest = folder / "manifest.json"
        if manifest.is_file() and isinstance(content := read_json(manifest), dict):
            return world_in(content, f"{manifest}: ")
    return None


@lru_cache(maxsize=16)
def _world(stored: bytes, where: str) -> World:
    world: World = convert(msgspec.json.decode(stored), World, where)
    return world

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
WorldSource = World | str | Path
"""A world, its file, or the name of one that ships; see `read_world`."""


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


def as_world(world: WorldSource) -> World:
    """The world itself. Files that were read are kept in memory.

    Raises:
        DataError: see `read_world`.
    """
    return world if isinstance(world, World) else _read_once(str(world))


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
    """The world of a file, see `known_world_beside`; CLEVRER's where nothing says which it is.

    Raises:
        DataError: an unreadable world or manifest, or values that are no world.
    """
    return known_world_beside(file) or CLEVRER_WORLD


def known_world_beside(file: str | Path, levels: int = 2) -> World | None:
    """The world of the `world.json` beside a file, or else that of the generated data set that the file is of.

    None if there is neither.

    Args:
        file: the file.
        levels: number of folders above the file of which one may have the data set's `manifest.json`: two above question files,
            four above videos.

    Raises:
        DataError: an unreadable world or manifest, or values that are no world.
    """
    folders = list(Path(file).absolute().parents)[:levels]
    if (folders[0] / WORLD_FILE).is_file():
        return read_world(folders[0] / WORLD_FILE)
    for manifest in (folder / "manifest.json" for folder in folders):
        if manifest.is_file() and isinstance(content := read_json(manifest), dict):
            return world_in(content, f"{manifest}: ")
    return None


def store_world_beside(file: str | Path, world: World) -> None:
    """Write the world of a file that will be written into the `world.json` beside it, unless `world_beside` finds it anyway.

    Raises:
        DataError: what is beside the file says that it is of a world with other words.
    """
    known = known_world_beside(file)
    if known is None:
        store_world(Path(file).parent, world)
    elif known.vocabulary != world.vocabulary:
        raise DataError(
            f"{file}: the folder is of the world {known.name}, which has other words than {world.name}; choose another folder"
        )


def check_world_of_data(where: str | Path, theirs: World, weights: str, ours: World) -> None:
    """Raise `DataError` if data were made in another world than the one that weights are for; says what differs.

    Args:
        where: the data.
        theirs: the world that they were made in.
        weights: what is for the other world, for the message.
        ours: that world.
    """
    if differing := ", ".join(theirs.differences(ours)):
        raise DataError(
            f"{where}: was made in the world {theirs.name}, and {weights} is for {ours.name}, which has other {differing}; "
            f"give weights for {theirs.name} (--checkpoint)"
        )


@lru_cache(maxsize=32)
def _read_once(file_or_name: str) -> World:
    return read_world(file_or_name)


@lru_cache(maxsize=16)
def _world(stored: bytes, where: str) -> World:
    world: World = convert(msgspec.json.decode(stored), World, where)
    return world

"""Worlds in files."""

from pathlib import Path

from nsdr.io.configuration import check_sections
from nsdr.io.reading import read_yaml
from nsdr.io.shipped import find_config
from nsdr.validation import convert
from nsdr.world.world import World


def read_world(file_or_name: str | Path) -> World:
    """A world from a YAML file. What the file leaves out is as in CLEVRER.

    Args:
        file_or_name: a file, or the name of a world that ships: "clevrer".

    Raises:
        DataError: an unreadable file, an unknown key, a value out of its range, or values that contradict each other; names the
            file and the value.
    """
    file = find_config(file_or_name, "worlds")
    content = read_yaml(file)
    check_sections(World, content, str(file))
    world: World = convert(content, World, f"{file}: ")
    return world

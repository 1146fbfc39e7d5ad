"""`nsdr generate dataset|scene`: from a YAML file and flags to files."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from nsdr.configuration import parse_config
from nsdr.errors import DataError
from nsdr.files import write_json
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.records import truth_document
from nsdr.generate.scene import SceneConfig, simulate_scene
from nsdr.generate.view import View

__all__ = ["COMMANDS", "SceneOptions", "main"]


@dataclass(frozen=True)
class SceneOptions:
    """One scene's truth file, by seed.

    Attributes:
        output: JSON file to write.
        seed: of the scene.
        scene: what scenes look like.
    """

    output: str
    seed: int = 0
    scene: SceneConfig = field(default_factory=SceneConfig)


def _dataset(argv: Sequence[str]) -> str:
    return str(generate_dataset(parse_config(DatasetConfig, argv, "nsdr generate dataset")))


def _scene(argv: Sequence[str]) -> str:
    options = parse_config(SceneOptions, argv, "nsdr generate scene")
    scene = simulate_scene(options.seed, options.scene)
    write_json(options.output, truth_document(scene, options.seed, View()))
    return options.output


COMMANDS = {"dataset": _dataset, "scene": _scene}


def main(argv: Sequence[str]) -> str:
    """Run one of `COMMANDS` with its arguments (`-o` is short for `--output`); returns what was written.

    Raises:
        DataError: an unknown command, or anything the command complains about.
    """
    if not argv or argv[0] not in COMMANDS:
        raise DataError(f"nsdr generate: expected one of {', '.join(COMMANDS)}, got {argv[0] if argv else 'nothing'!r}")
    return COMMANDS[argv[0]](["--output" if a == "-o" else a for a in argv[1:]])

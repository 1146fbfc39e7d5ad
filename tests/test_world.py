"""Worlds as values and as files."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from nsdr import World, read_world
from nsdr.errors import DataError
from nsdr.world.physics import Physics, Timeline
from nsdr.world.vocabulary import Color, Material, Shape, Vocabulary

PUCKS = Vocabulary(
    (Color("orange", (255, 140, 0)), Color("white", (240, 240, 240), ("pale",))),
    (Material("wood", ("wooden",)), Material("steel"), Material("glass", restitution=0.9)),
    (Shape("puck", "cylinder", (0.5, 0.5, 0.1), 0.02), Shape("die", "box", plural="dice", synonyms=("brick", "box"))),
)


def test_the_world_that_ships_is_the_default() -> None:
    assert read_world("clevrer") == World()


def changed(place: tuple[str | int, ...], value: Any, folder: Path) -> Path:
    """The file of CLEVRER's world with another value at a place."""
    content = part = yaml.safe_load(Path("configs/worlds/clevrer.yaml").read_text())
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("vocabulary", "colors", 1, "word"), "grey", "vocabulary: grey: there more than once; expected one meaning"),
        (("vocabulary", "colors", 1, "word"), "Light blue", r"matching regex .* - at `\$.vocabulary.colors\[1\].word`"),
        (
            ("vocabulary", "colors", 1, "srgb"),
            [1, 2, 300],
            r"Expected `int` <= 255 - at `\$.vocabulary.colors\[1\].srgb\[2\]`",
        ),
        (
            ("vocabulary", "colors", 1, "rgb"),
            [1, 2, 3],
            r"vocabulary: colors\[1\]: rgb: no such setting; known are word, srgb",
        ),
        (("vocabulary", "materials"), [], r"length >= 1 - at `\$.vocabulary.materials`"),
        (
            ("vocabulary", "shapes", 1, "size_world"),
            [1, 2, 3],
            r"shape sphere: .* expected a sphere's, \[1.0, 1.0, 1.0\]",
        ),
        (("vocabulary", "shapes", 1, "friction"), 0.1, "shape sphere: friction 0.1: expected 0, because spheres slide"),
        (("physics", "gravity"), 0, r"Expected `float` > 0.0 - at `\$.physics.gravity`"),
        (("physics", "mass_range"), [2, 1], "mass_range: expected the smaller number first, got 2 and 1"),
        (("physics", "gravty"), 1, "physics: gravty: no such setting; known are gravity, linear_damping"),
        (("camera", "eye_world"), [4, 0, -1], "camera: eye_world .* the place at least 0.5 high"),
        (("timeline",), None, "timeline: expected settings"),
        (("lamps",), 3, "lamps: no such setting; known are name, vocabulary, physics, timeline, camera"),
    ],
)
def test_a_world_that_contradicts_itself_is_refused_with_the_place(place, value, message, tmp_path) -> None:
    with pytest.raises(DataError, match=rf"mine\.yaml: .*{message}"):
        read_world(changed(place, value, tmp_path))


def test_what_a_file_leaves_out_is_as_in_clevrer(tmp_path) -> None:
    path = tmp_path / "slow.yaml"
    path.write_text("name: slow\nphysics: {start_speed_world_per_s: [0.5, 1.0]}\ntimeline: {fps: 10}\n")
    assert read_world(path) == World("slow", physics=Physics(start_speed_world_per_s=(0.5, 1.0)), timeline=Timeline(10))


def test_words_have_indices_plurals_and_meanings() -> None:
    assert [PUCKS.index(*PUCKS.triple(i)) for i in range(PUCKS.n_triples)] == list(range(12))
    assert PUCKS.triple(7) == ("white", "wood", "die")
    assert {noun: meaning for noun, meaning in PUCKS.nouns.items() if meaning[0]} == {
        "puck": ("puck", "N"),
        "pucks": ("puck", "NS"),
        "die": ("die", "N"),
        "dice": ("die", "NS"),
        "brick": ("die", "N"),
        "bricks": ("die", "NS"),
        "box": ("die", "N"),
        "boxes": ("die", "NS"),
    }
    assert PUCKS.adjectives["wooden"] == "wood"
    assert PUCKS.adjectives["pale"] == "white"

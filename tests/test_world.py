"""Worlds as values and as files."""

import ast
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import nsdr
from nsdr import (
    Camera,
    Executor,
    GrammarParser,
    Pipeline,
    Scene,
    World,
    load,
    read_world,
    save,
)
from nsdr.errors import DataError, ProgramError, QuestionError
from nsdr.world.physics import Physics, Timeline
from nsdr.world.vocabulary import Color, Material, Shape, Vocabulary
from tests.test_types_and_storage import proposals

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
        (("vocabulary", "colors", 1, "srgb"), [80, 90, 87], "colors gray and red: .* look the same"),
        (("vocabulary", "shapes", 2, "solid"), "box", r"shapes cube and cylinder: both are a box of the size \[0.4"),
        (
            ("vocabulary", "shapes", 0, "size_world"),
            [4, 4, 4],
            "layout: area_world .*: 6 objects of up to 4 world units",
        ),
        (
            ("vocabulary", "shapes", 0, "size_world"),
            [0.4, 0.4, 0.1],
            "shapes sphere and cube: a sphere with the radius",
        ),
        (("physics", "start_speed_world_per_s"), [50, 60], "would move by 0.24, and pass through shape cube"),
        (
            ("physics", "table_half_width_world"),
            5,
            "layout: far_world and area_world reach to 10.5: expected the table's",
        ),
        (("layout", "area_world"), [20, 25, 0, 5], "layout: far_world and area_world reach to 25"),
        (("layout", "area_world"), [6, 10, 0, 5], "the middle of layout.area_world .* is not in the image"),
        (("layout", "objects"), [[20, 1]], "20 objects of up to 0.4 world units do not fit"),
        (("layout", "start_distance_world"), [4, 3], r"start_distance_world \[4.0, 3.0\]: expected the smaller"),
        (
            ("layout", "participants"),
            7,
            r"layout: participants 7: expected .* the largest scenes \(layout.objects\), 6, or",
        ),
        (("timeline", "frames"), 1, r"Expected `int` >= 10 - at `\$.timeline.frames`"),
        (("timeline", "fps"), 5000, r"Expected `int` <= 1000 - at `\$.timeline.fps`"),
        (
            ("physics", "moving_speed_world_per_s"),
            3,
            "moving_speed_world_per_s 3: nothing would count as moving; .* 3 - at",
        ),
        (("physics", "start_speed_world_per_s"), [0.05, 0.07], "at most 0.351 in the 179 frames .* 0.389 away"),
        (
            ("camera", "lens_mm"),
            3,
            "camera: in images of 480x320 with lens_mm 3, a cube .* is 3.3 pixels wide; expected 4",
        ),
        (("camera", "width"), 481, "camera: expected an even width and height .* got 481x320"),
        (("look", "lamps", 0, "power"), -1, r">= 0.0 - at `\$.look.lamps\[0\].power`"),
        (("look", "lamps", 0, "watt"), 1, r"look: lamps\[0\]: watt: no such setting"),
    ],
)
def test_a_world_that_contradicts_itself_is_refused_with_the_place(place, value, message, tmp_path) -> None:
    with pytest.raises(DataError, match=rf"mine\.yaml: .*{message}"):
        read_world(changed(place, value, tmp_path))


def test_a_scene_needs_as_many_combinations_of_words_as_objects(tmp_path) -> None:
    path = tmp_path / "few.yaml"
    path.write_text("vocabulary: {shapes: [{word: disc, solid: cylinder}], colors: [{word: red, srgb: [200, 0, 0]}]}")
    with pytest.raises(DataError, match=r"few\.yaml: .*its words make 2 combinations for scenes of 6 objects"):
        read_world(path)


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


class Part:
    """Does nothing."""

    def parse(self, *_: Any) -> None: ...

    def explain(self, *_: Any) -> None: ...


MINE = World("mine", PUCKS, timeline=Timeline(15, 60), camera=Camera((3.0, 0.0, 4.0)))


def test_scenes_of_another_world_say_it_when_they_are_stored(tmp_path) -> None:
    scene = Scene.of(["white steel die", "orange wood puck"], [("collision", 30, "die", "puck")], world=MINE)
    assert scene.n_frames == 60
    save(tmp_path / "scene.json", scene)
    found = load(tmp_path / "scene.json", Scene)
    assert found.world == MINE
    assert str(found) == str(scene)
    clevrer = Scene.of(["red metal cube"])
    save(tmp_path / "clevrer.json", clevrer)
    assert "world" not in (tmp_path / "clevrer.json").read_text()
    assert load(tmp_path / "clevrer.json", Scene).world == World()


def test_questions_are_asked_in_the_words_of_the_scene() -> None:
    scene = Scene.of(["white steel die", "orange wood puck"], [("collision", 30, "die", "puck")], world=MINE)
    parser, executor = GrammarParser(vocabulary=PUCKS), Executor(scene)
    answers = {
        "What is the material of the object that collides with the puck?": "steel",
        "Is there a pale brick?": "yes",
        "How many dice are there?": 1,
    }
    assert {text: executor.answer(parser.parse(text)).answer for text in answers} == answers
    assert executor.answer("query_material(unique(filter_shape(objects, die)))").answer == "steel"
    with pytest.raises(ProgramError, match="cube"):
        executor.answer("query_material(unique(filter_shape(objects, cube)))")
    with pytest.raises(QuestionError, match="unknown word 'cube'"):
        parser.parse("What color is the cube?")


def test_words_of_another_world_are_refused() -> None:
    with pytest.raises(DataError, match=r"one shape \(puck, die\), such as 'white wood puck'"):
        Scene.of(["red metal cube"], world=MINE)
    with pytest.raises(DataError, match="Scene: object 0: color: expected one of orange, white, got 'red'"):
        replace(Scene.of(["red metal cube"]), world=MINE)
    with pytest.raises(DataError, match=r"VideoProposals.attribute: expected 0 to 11, got 19"):
        replace(proposals(), attribute=np.full(20, 19), world=MINE)


def test_a_pipeline_takes_proposals_of_its_own_world() -> None:
    found = replace(proposals(), world=MINE)
    assert found.words[0] == "white wood die"
    with pytest.raises(DataError, match="have the words of the world mine; the pipeline is for the world CLEVRER"):
        Pipeline(*[Part()] * 3).judge(proposals=found)  # type: ignore[list-item]
    moon = World("moon", physics=Physics(gravity=1.6), timeline=Timeline(10))
    with pytest.raises(
        DataError, match=r"of the world moon; .* has other physics\.gravity, timeline\.fps: give weights"
    ):
        Pipeline(*[Part()] * 3).judge(proposals=replace(proposals(), world=moon))  # type: ignore[list-item]


def test_pipelines_refuse_worlds_whose_physics_they_do_not_know() -> None:
    heavy = World("jupiter", physics=Physics(gravity=24.8))
    assert heavy.differences(World()) == ["physics.gravity"]
    assert World("clevrer 2", camera=Camera(lens_mm=28.0)).differences(World()) == ["camera.lens_mm"]
    with pytest.raises(DataError, match=r"of the world CLEVRER; the world jupiter has other physics\.gravity:"):
        Pipeline(Part(), nsdr.PhysicsPredictor.from_pretrained(), Part(), world=heavy)  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"the frame parser was trained on .*; .* world mine has? "):
        Pipeline(nsdr.FrameParser.from_pretrained(), Part(), Part(), world=MINE)  # type: ignore[arg-type]
    assert Pipeline(*[Part()] * 3, world=MINE).world == MINE  # type: ignore[list-item]


def test_no_word_of_clevrers_is_in_the_code_outside_of_its_world_and_its_files() -> None:
    known = {word for words in Vocabulary().words.values() for word in words} - {
        "sphere",
        "cylinder",
    }  # these are solids, too
    package = Path(nsdr.__file__).parent
    paths = sorted(package.rglob("*.py"))
    others = [path for path in paths if path.relative_to(package).parts[0] not in ("world", "clevrer")]
    assert 100 < len(others) < len(paths)
    for path in others:
        for node in ast.walk(ast.parse(path.read_text())):
            assert not (isinstance(node, ast.Constant) and node.value in known), f"{path}:{node.lineno}: {node.value}"

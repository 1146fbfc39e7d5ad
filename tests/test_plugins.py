"""The worked examples of docs/plugins.md run as they stand there, in Python and as an installed package."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from pycocotools import mask as rle

import nsdr
from nsdr.clevrer import proposals_from_masks, read_questions
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.cli.main import main
from nsdr.dynamics import BACKENDS
from nsdr.io.registry import Registry
from nsdr.io.video import read_video
from nsdr.world.world import CLEVRER_WORLD

from .test_layouts import INDEX, LAYOUTS, write_layout

PAGE = Path(__file__).parent.parent / "docs" / "plugins.md"


def example(name: str) -> str:
    code = re.search(rf"<!-- example: {name} -->\n```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    return code[1]


def defined(name: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(example(name), names)
    return names


@pytest.fixture
def package(tmp_path, monkeypatch):
    """An installed package with a dynamics backend and a scene source of its own."""
    source = """
def make_backend(folder, config):
    return ConstantVelocity()


def make_source(data, wanted):
    from nsdr import Scene, load

    return lambda questions: load(data / "scene_500002.json", Scene)
"""
    (tmp_path / "my_package.py").write_text(example("dynamics") + source)
    metadata = tmp_path / "my_package-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    entry_points = "[nsdr.dynamics]\nconstant = my_package:make_backend\n"
    entry_points += "[nsdr.scene_sources]\nmine = my_package:make_source\n"
    (metadata / "entry_points.txt").write_text(entry_points)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("my_package", None)


@pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128")
def test_an_installed_backend_is_used_by_name(package, capsys, tmp_path, short_video) -> None:
    ask = ["answer", str(short_video), "How many collisions happen?"]
    assert main([*ask, "--dynamics", "constant"]) == 0
    assert capsys.readouterr().out == "0\n"
    (tmp_path / "mine.yaml").write_text("dynamics: {backend: constant}\ntracker: {score: 1.0}\n")
    assert main([*ask, "--config", str(tmp_path / "mine.yaml")]) == 2
    assert "no objects found in more than 12 frames" in capsys.readouterr().err
    settings = ["--config", str(tmp_path / "mine.yaml"), "--set", "tracker.score=0.9"]
    assert main([*ask, *settings]) == 0
    assert capsys.readouterr().out == "0\n"


def test_an_installed_source_is_used_by_name(package, tmp_path) -> None:
    command = ["evaluate", "--questions", str(QUESTIONS), "--data", str(TRUTH.parent), "--source", "mine"]
    assert main([*command, "--programs", "gold", "-o", str(tmp_path / "out.json")]) == 0
    assert json.loads((tmp_path / "out.json").read_text())["descriptive"]["accuracy"] == 1.0


def test_the_documented_source_finds_videos_in_folders(tmp_path) -> None:
    (scene,) = read_questions(QUESTIONS)
    split = write_layout(tmp_path / "data", LAYOUTS["as SlotFormer wants it"])
    (tmp_path / "data" / "videos" / scene.video_filename).touch()
    make_source = defined("source")["make_source"]
    assert make_source(tmp_path / "data", {scene.scene_index})(scene)["video"].name == scene.video_filename
    of_split = make_source(CLEVRER(split).split("validation"), {INDEX})
    assert of_split(replace(scene, scene_index=INDEX))["video"].name == f"video_{INDEX}.mp4"


@pytest.mark.parametrize(
    ("name", "source", "message"),
    [
        ("raises", "lambda questions: {}['missing']", r"raises \(my_raises\) failed: KeyError: 'missing'"),
        ("counts", "lambda questions: 3", "source counts returned an int; expected an nsdr.Scene"),
    ],
)
def test_what_an_installed_part_does_wrong_is_no_bug_of_ours(
    name, source, message, tmp_path, monkeypatch, capsys
) -> None:
    (tmp_path / f"my_{name}.py").write_text(f"def make_source(data, wanted):\n    return {source}\n")
    metadata = tmp_path / f"my_{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: my-{name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[nsdr.scene_sources]\n{name} = my_{name}:make_source\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    command = ["evaluate", "--questions", str(QUESTIONS), "--data", str(TRUTH.parent), "--source", name]
    assert main([*command, "--programs", "gold", "-o", str(tmp_path / "out.json")]) in (1, 2)
    assert re.search(message, capsys.readouterr().err)


def test_parts_that_return_something_else_are_named(example_scene, short_video) -> None:
    class Texts:
        def parse(self, text: str, kind: str = "descriptive") -> str:
            return "events objects filter_collision count"

    class Lists:
        def parse(self, frames, progress: bool = False) -> list:
            return []

    pipeline = nsdr.Pipeline.from_pretrained()
    pipeline.frame_parser = Lists()
    with pytest.raises(nsdr.DataError, match=r"Lists\.parse returned a list; expected an nsdr\.VideoProposals"):
        pipeline.scene(short_video)
    pipeline.question_parser = Texts()
    with pytest.raises(nsdr.DataError, match=r"Texts\.parse returned a str; expected an nsdr\.Program"):
        pipeline.answer(example_scene, "How many collisions happen?")


def test_unknown_names_and_broken_packages_are_named(capsys) -> None:
    assert main(["answer", str(VIDEO), "How many collisions happen?", "--dynamics", "zebra"]) == 2
    assert (
        "dynamics backend (or YAML file) 'zebra': expected one of physics, propnet, propnet_patches"
        in capsys.readouterr().err
    )
    parts: Registry[object] = Registry("part", "nsdr.nothing", {"broken": "nsdr.nowhere:thing"})
    with pytest.raises(nsdr.DataError, match=r"part 'broken': cannot load nsdr\.nowhere:thing"):
        parts["broken"]
    assert BACKENDS.names()[:3] == ["physics", "propnet", "propnet_patches"]


@pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128")
def test_the_documented_dynamics_backend_answers_questions(short_video) -> None:
    pipeline = nsdr.Pipeline.from_pretrained()
    pipeline.dynamics = defined("dynamics")["ConstantVelocity"]()
    assert pipeline.answer(short_video, "How many collisions happen?").answer == 0
    answer = pipeline.answer(short_video, "What will happen next?", ["The brown cube collides with the purple cube"])
    assert len(answer.choices) == 1


@pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128")
def test_the_documented_detector_makes_proposals_of_another_detectors_masks(short_video) -> None:
    frames = read_video(short_video)[:3]
    expected = nsdr.FrameParser.from_pretrained().parse(frames)
    assert expected.masks is not None
    arrays: dict[int, list[Any]] = {0: [], 1: [], 2: []}
    rows = zip(expected.frame_index, expected.attribute, expected.score, expected.masks, strict=True)
    for frame, attribute, score, counts in rows:
        mask = rle.decode({"size": [320, 480], "counts": counts.encode()}).astype(bool)
        arrays[int(frame)].append((CLEVRER_WORLD.vocabulary.triple(int(attribute)), float(score), mask))
    of_frame = iter(arrays.values())
    detector = defined("detector")["MyDetector"](lambda frame: next(of_frame))
    proposals = detector.parse(frames)
    assert len(proposals) > 6
    for name in ("frame_index", "attribute", "score", "centroid_px", "box_xyxy_px"):
        np.testing.assert_array_equal(getattr(proposals, name), getattr(expected, name))
    assert proposals.masks == expected.masks


def test_masks_of_another_size_are_refused() -> None:
    red = ("red", "metal", "cube")
    with pytest.raises(nsdr.DataError, match=r"frame 1: mask: expected \(320, 480\), got \(480, 320\)"):
        proposals_from_masks(2, [(1, red, 1.0, np.ones((480, 320), bool))])
    with pytest.raises(nsdr.DataError, match="pink"):
        proposals_from_masks(2, [(1, ("pink", "metal", "cube"), 1.0, np.ones((320, 480), bool))])


@pytest.mark.parametrize("dtype", [bool, np.uint8, float, np.float16])
def test_a_soft_mask_counts_where_it_is_at_least_one_half(dtype) -> None:
    probable = np.zeros((320, 480))
    probable[100:110, 200:220] = 0.9
    probable[110:120, 200:220] = 0.4
    mask = probable if np.dtype(dtype).kind == "f" else probable > 0.5
    found = proposals_from_masks(1, [(0, ("red", "metal", "cube"), 1.0, mask.astype(dtype))])
    assert found.area_px.tolist() == [200]
    for wrong in (3.0, -1.0, np.nan):
        with pytest.raises(nsdr.DataError, match="frame 0: mask: expected true or false, or probabilities"):
            proposals_from_masks(1, [(0, ("red", "metal", "cube"), 1.0, np.full((320, 480), wrong))])


def test_the_documented_question_parser_answers_in_german(example_scene) -> None:
    pipeline = nsdr.Pipeline.from_pretrained()
    pipeline.question_parser = defined("parser")["German"]()
    assert pipeline.answer(example_scene, "Wie viele Würfel gibt es?").answer == 2
    with pytest.raises(nsdr.QuestionError, match="Wie viele Kollisionen"):
        pipeline.answer(example_scene, "Was passiert?")


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        (
            "question_parser",
            lambda text, kind: None,
            r"method parse\(text, kind\) -> Program, got a function without it",
        ),
        ("question_parser", nsdr.GrammarParser, "got the class GrammarParser; give an object of it"),
        (
            "dynamics",
            nsdr.GrammarParser(),
            r"dynamics: .* method explain\(states, collisions=None\) -> Explanation, got a Gra",
        ),
        ("frame_parser", object(), r"frame_parser: .* method parse\(frames, progress=False\) -> VideoProposals"),
    ],
)
def test_parts_without_their_method_are_refused_when_they_are_given(part, value, message) -> None:
    bare = nsdr.Pipeline(None, None, None)  # type: ignore[arg-type]
    with pytest.raises(nsdr.DataError, match=message):
        setattr(bare, part, value)
    with pytest.raises(nsdr.DataError, match=message):
        nsdr.Pipeline(**{"frame_parser": None, "dynamics": None, "question_parser": None, part: value})  # type: ignore[arg-type]

"""The worked examples of docs/plugins.md run as they stand there, in Python and as an installed package."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools import mask as rle

import nsdr
from nsdr.clevrer import proposals_from_masks
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.cli.main import main
from nsdr.dynamics import BACKENDS
from nsdr.io.registry import Registry
from nsdr.io.video import read_video
from nsdr.world.vocabulary import attributes_of

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

    return lambda questions: load(Scene, data / "scene_500002.json")
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
    ask = ["answer", str(short_video), "-q", "How many collisions happen?"]
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


def test_unknown_names_and_broken_packages_are_named(capsys) -> None:
    assert main(["answer", str(VIDEO), "-q", "How many collisions happen?", "--dynamics", "zebra"]) == 2
    assert "dynamics backend (or YAML file) 'zebra': expected one of physics, state, paper" in capsys.readouterr().err
    parts: Registry[object] = Registry("part", "nsdr.nothing", {"broken": "nsdr.nowhere:thing"})
    with pytest.raises(nsdr.DataError, match=r"part 'broken': cannot load nsdr\.nowhere:thing"):
        parts["broken"]
    assert BACKENDS.names()[:3] == ["physics", "state", "paper"]


@pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128")
def test_the_documented_dynamics_backend_answers_questions(short_video) -> None:
    pipeline = nsdr.Pipeline.from_pretrained()
    pipeline.dynamics = defined("dynamics")["ConstantVelocity"]()
    assert pipeline.answer(short_video, "How many collisions happen?").answer == "0"
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
        arrays[int(frame)].append((attributes_of(int(attribute)), float(score), mask))
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


def test_the_documented_question_parser_answers_in_german(example_scene) -> None:
    pipeline = nsdr.Pipeline.from_pretrained()
    pipeline.question_parser = defined("parser")["German"]()
    assert pipeline.answer(example_scene, "Wie viele Würfel gibt es?").answer == "2"
    with pytest.raises(nsdr.QuestionError, match="Wie viele Kollisionen"):
        pipeline.answer(example_scene, "Was passiert?")

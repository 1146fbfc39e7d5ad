"""The worked example of docs/plugins.md runs as it stands there, in Python and as an installed package."""

import json
import re
import sys
from pathlib import Path

import pytest

import nsdr
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.cli.main import main
from nsdr.dynamics import BACKENDS
from nsdr.io.registry import Registry

PAGE = Path(__file__).parent.parent / "docs" / "plugins.md"


def example() -> str:
    code = re.search(r"<!-- example -->\n```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert code is not None
    return code[1]


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
    (tmp_path / "my_package.py").write_text(example() + source)
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
    code = example()
    assert len([line for line in code.splitlines() if line.strip()]) <= 22
    names: dict[str, object] = {}
    exec(code, names)
    pipeline = nsdr.Pipeline.from_pretrained()
    pipeline.dynamics = names["ConstantVelocity"]()  # type: ignore[operator]
    assert pipeline.answer(short_video, "How many collisions happen?").answer == "0"
    answer = pipeline.answer(short_video, "What will happen next?", ["The brown cube collides with the purple cube"])
    assert len(answer.choices) == 1

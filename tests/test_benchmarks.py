"""The benchmarks: each can be started, and is in the list of what makes which number."""

import runpy
import sys
from pathlib import Path

import pytest

from benchmarks import digests

FOLDER = Path(__file__).parent.parent / "benchmarks"
SCRIPTS = sorted(path.stem for path in FOLDER.glob("*.py") if "__main__" in path.read_text())


@pytest.mark.parametrize("name", SCRIPTS)
def test_each_benchmark_shows_its_help(name: str, monkeypatch, capsys) -> None:
    monkeypatch.delitem(sys.modules, f"benchmarks.{name}", raising=False)
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit, match="0"):
        runpy.run_module(f"benchmarks.{name}", run_name="__main__")
    assert "usage: " in capsys.readouterr().out


def test_the_list_names_every_benchmark() -> None:
    lines = (FOLDER / "README.md").read_text().splitlines()
    assert [line.split("`")[1] for line in lines if line.startswith("| `")] == SCRIPTS


def digests_of(stages: dict[str, list[bytes]], arguments: list[str], monkeypatch, capsys) -> tuple[str, int]:
    """What `benchmarks.digests` prints last about a part with these stages, and its exit status."""
    monkeypatch.setattr(digests, "PARTS", {"one": lambda _: iter(stages.items()), "other": lambda _: iter([])})
    monkeypatch.setattr(sys, "argv", ["digests", "--proposals", "-", "--videos", "-", "--parts", "one", *arguments])
    try:
        digests.main()
        status = 0
    except SystemExit as e:
        status = int(e.code or 0)
    return capsys.readouterr().out.splitlines()[-1], status


def test_digests_name_the_stages_that_differ(tmp_path, monkeypatch, capsys) -> None:
    before, patch = str(tmp_path / "before.json"), (monkeypatch, capsys)
    digests_of({"tracks": [b"1", b"2"], "answers": [b"yes"]}, ["-o", before], *patch)
    same = digests_of({"answers": [b"yes"], "tracks": [b"1", b"2"]}, ["--compare", before], *patch)
    moved = digests_of({"tracks": [b"12"], "answers": [b"yes"]}, ["--compare", before], *patch)
    fewer = digests_of({"tracks": [b"1", b"2"]}, ["--compare", before], *patch)
    assert same == ("no stage differs", 0)
    assert moved == ("differs: one: tracks", 1)
    assert fewer == ("differs: one: answers", 1)


def test_a_stage_that_gives_nothing_has_no_digest() -> None:
    with pytest.raises(AssertionError, match="nothing"):
        digests.digest([])

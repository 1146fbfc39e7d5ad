"""Two kills of two commands by the benchmark that kills all of them ten times."""

import importlib.util
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parent.parent / "benchmarks" / "kills.py"


@pytest.mark.robustness
@pytest.mark.parametrize(
    ("command", "size"), [("generate dataset", ["--videos", "2"]), ("train question-parser", ["--steps", "14"])]
)
def test_killed_commands_end_with_the_same_files(command: str, size: list[str], capsys, monkeypatch) -> None:
    spec = importlib.util.spec_from_file_location("kills", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    kills = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "kills", kills)
    spec.loader.exec_module(kills)
    status = kills.main(["--kills", "2", "--only", command, *size])
    captured = capsys.readouterr()
    assert (status, captured.err) == (0, "")
    row = captured.out.splitlines()[-1].split(" | ")
    assert row[0] == f"| `nsdr {command}`"
    assert int(row[2]) >= 1  # a run may end before its kill

"""Programs as token lists, and the benchmark of the executor."""

from pathlib import Path

import pytest

from benchmarks import executor as benchmark
from nsdr import Executor, ProgramError, Scene


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        (["objects count"], "unknown module or word 'objects count'"),
        (["objects", "red filter_color", "count"], "unknown module or word 'red filter_color'"),
        (["objects", "uniquecount"], "unknown module or word 'uniquecount'"),
        (["objects", 3], "a token is 3; expected texts"),
        (["objects", "red"], "2 values are left"),
        (["red"], "ends in the word 'red'"),
        (["objects", "red", "unique"], "argument 1 is color"),
        (["objects", "red", "blue", "filter_color", "count"], "takes no|are left|argument"),
        (["objects", "count", "count"], "argument 1 is number"),
        ([""], "unknown module or word ''"),
        ([], "the program is empty"),
        (["objects", "unique", "objects"], "2 values are left"),
    ],
)
def test_malformed_token_lists_are_refused_as_programs_are(small_scene: Scene, program: list[str], reason: str) -> None:
    with pytest.raises(ProgramError, match=reason):
        Executor(small_scene).run(program)


def test_tokens_around_a_program_are_skipped(small_scene: Scene) -> None:
    executor = Executor(small_scene)
    assert executor.run(["<START>", "objects", "count", "<END>", "objects"]) == 4
    assert executor.run(["objects", "<END>", "unique", "count"]) == executor.run(["objects"])
    assert executor.run("objects  COUNT") == 4
    assert executor.run(["objects", "events", "filter_end", "query_frame", "filter_resting", "count"]) == executor.run(
        "objects end get_frame filter_stationary count"
    )


def test_the_limit_on_tokens_holds(small_scene: Scene, monkeypatch) -> None:
    monkeypatch.setenv("NSDR_LIMITS", "program_tokens=2")
    executor = Executor(small_scene)
    assert executor.run(["objects", "count"]) == 4
    for program in ("objects null filter_moving count", ["objects", "null", "filter_moving", "count"]):
        with pytest.raises(ProgramError, match="more than 2 tokens"):
            executor.run(program)


STUB = """
class Simulation:
    def __init__(self, path, use_event_ann=True):
        assert use_event_ann
        with open(path) as file:
            self.text = file.read()
"""


def test_the_benchmark_runs_the_released_code_of_a_clone(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "clone" / "executor"
    folder.mkdir(parents=True)
    (folder / "simulation.py").write_text(STUB)
    (folder / "executor.py").write_text(
        "class Executor:\n    def __init__(self, sim):\n        assert 'predictions' in sim.text\n"
        "    def run(self, program, debug=False):\n        assert 'get_frame' not in program\n"
    )
    benchmark.main(["--scenes", "2", "--repeats", "1", "--official", str(tmp_path / "clone")])
    output = capsys.readouterr().out
    assert "released code, programs" in output
    assert "not at hand" not in output


def test_the_benchmark_says_what_is_no_clone_and_that_none_is_given(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(["--scenes", "1", "--repeats", "1", "--official", str(tmp_path)])
    assert "expected a clone with executor/executor.py" in capsys.readouterr().err
    benchmark.main(["--scenes", "1", "--repeats", "1"])
    assert "the released code is not at hand" in capsys.readouterr().out


def test_released_names() -> None:
    assert benchmark.released_names(["objects", "end", "get_frame"]) == [
        "objects",
        "events",
        "filter_end",
        "query_frame",
    ]

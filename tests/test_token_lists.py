"""Programs as token lists."""

import pytest

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

"""Questions as prompts, their solutions, and tags in question files."""

import json

import pytest
from msgspec.structs import replace

from nsdr import DataError
from nsdr.clevrer import prompt, read_questions, solution, without_answers, write_questions
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions

CHOICES = (
    Choice(0, "The red cube is removed", None, "correct", "observational"),
    Choice(1, "The sphere exits", None, "wrong", "inferential"),
    Choice(2, "The cube enters", None, "correct"),
)
WHAT_IF = Question(3, "What happens?", "counterfactual", None, None, None, CHOICES)
OPEN = Question(4, "What color is it?", "descriptive", "query_color", None, "red")


def test_options_have_letters() -> None:
    lines = prompt(WHAT_IF).splitlines()
    assert lines[:4] == ["What happens?", "A. The red cube is removed", "B. The sphere exits", "C. The cube enters"]
    assert solution(WHAT_IF) == "<answer>A,C</answer>"
    assert solution(replace(WHAT_IF, choices=CHOICES[1:2])) == "<answer>none</answer>"
    assert solution(OPEN) == "<answer>red</answer>"


def test_questions_without_answers_have_no_solution() -> None:
    scene = without_answers(SceneQuestions(0, "video_00000.mp4", (WHAT_IF, OPEN)))
    for question in scene.questions:
        with pytest.raises(DataError, match="no answer"):
            solution(question)


def test_tags_are_kept_in_question_files(tmp_path) -> None:
    scene = SceneQuestions(0, "video_00000.mp4", (WHAT_IF, OPEN))
    write_questions(tmp_path / "tagged.json", [scene])
    assert read_questions(tmp_path / "tagged.json") == [scene]
    rows = json.loads((tmp_path / "tagged.json").read_text())
    assert "tag" not in rows[0]["questions"][0]["choices"][2]
    rows[0]["questions"][0]["choices"][1]["tag"] = "maybe"
    (tmp_path / "bad.json").write_text(json.dumps(rows))
    with pytest.raises(DataError, match=r"bad.json.*choices\[1\].tag`"):
        read_questions(tmp_path / "bad.json")
    assert all(c.tag is None for c in without_answers(scene).questions[0].choices)

"""`nsdr score` on questions in the layout of MVBench and TVBench."""

import json
from pathlib import Path

import pytest

from nsdr import DataError
from nsdr.cli.main import main
from nsdr.evaluation.candidates import read_candidate_questions

ROWS = [
    {"video": "video_10009.mp4", "question": "How many objects move?", "candidates": ["3", "5", "4"], "answer": "4"},
    {
        "video": "video_10009.mp4",
        "question": "Which of these?",
        "candidates": ["A cube", "A sphere"],
        "answer": "A cube",
    },
    {"video": "video_10010.mp4", "question": "Does it?", "candidates": ["yes", "no", "not sure"], "answer": "no"},
]


@pytest.fixture
def questions(tmp_path: Path) -> Path:
    path = tmp_path / "moving_count.json"
    path.write_text(json.dumps(ROWS))
    return path


def test_one_candidate_is_right(questions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answers = ["C", "<answer>(A) A cube</answer>", "A and B"]
    ids = ["10009-0", "10009-1", "10010-2"]
    given = tmp_path / "answers.jsonl"
    lines = [json.dumps({"id": i, "response": a}) for i, a in zip(ids, answers, strict=True)]
    given.write_text("\n".join(lines))
    report = tmp_path / "report.json"
    assert main(["score", str(given), "--questions", str(questions), "-o", str(report)]) == 0
    assert "accuracy 66.7%" in capsys.readouterr().out
    found = json.loads(report.read_text())
    assert (found["accuracy"], found["scored"], found["unread"]) == (pytest.approx(2 / 3), 3, [])
    assert found["chance"] == pytest.approx((1 / 3 + 1 / 2 + 1 / 3) / 3)
    given.write_text("\n".join([lines[0], json.dumps({"id": "10010-2", "response": "perhaps"})]))
    assert main(["score", str(given), "--questions", str(questions), "-o", str(report)]) == 0
    found = json.loads(report.read_text())
    assert (found["accuracy"], found["answered"], found["unread"]) == (pytest.approx(1 / 3), 2, ["10010-2"])
    assert main(["score", str(given), "--questions", str(questions), "--allow-missing", "-o", str(report)]) == 0
    assert json.loads(report.read_text())["accuracy"] == 1 / 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"answer": "7"},
            r"moving_count.json: \[0\]: expected the answer '7' to be one of the candidates, got 3, 5, 4",
        ),
        ({"video": "a.mp4"}, r"moving_count.json: \[0\]: .*video"),
        ({"candidates": ["4"]}, r"moving_count.json: \[0\]: .*candidates"),
    ],
)
def test_wrong_rows_are_named(questions: Path, change: dict, message: str) -> None:
    questions.write_text(json.dumps([ROWS[0] | change]))
    with pytest.raises(DataError, match=message):
        read_candidate_questions(questions)

"""`nsdr score`."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from nsdr import DataError
from nsdr.clevrer import (
    read_answers,
    read_given,
    read_questions,
    solution,
    without_answers,
    write_questions,
    write_responses,
    write_submission,
)
from nsdr.clevrer.example import QUESTIONS, TRUTH
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions
from nsdr.cli.main import main
from nsdr.evaluation.measures import compare_results, difference_interval, format_comparison
from nsdr.evaluation.responses import reference_rows, score_responses

OPEN = Question(0, "What color is it?", "descriptive", "query_color", None, "red")
WHAT_IF = Question(
    1,
    "What happens?",
    "counterfactual",
    None,
    None,
    None,
    (
        Choice(4, "The red cube exits", None, "correct", "observational"),
        Choice(7, "The sphere exits", None, "wrong", "inferential"),
    ),
)
SCENES = [SceneQuestions(i, f"video_{i:05d}.mp4", (OPEN, WHAT_IF)) for i in range(10000, 10010)]


def _responses(tmp_path: Path, name: str, wrong: int = 0, text: str = "<answer>blue</answer>") -> Path:
    """A file of right answers, except to the open questions of the first scenes."""
    rows = [((s.scene_index, q.id), solution(q)) for s in SCENES for q in s.questions]
    rows = [((s, q), text if q == 0 and s < 10000 + wrong else r) for (s, q), r in rows]
    write_responses(tmp_path / name, rows)
    return tmp_path / name


def test_every_form_of_file_is_read_alike(tmp_path: Path) -> None:
    lines = [
        {"id": "10000-0", "response": "red", "video": "never used"},
        {"id": "10000-1", "response": "A"},
        {"id": "10001-1", "response": None},
    ]
    (tmp_path / "a.jsonl").write_text("\n".join(map(json.dumps, lines)))
    found = read_answers(tmp_path / "a.jsonl")
    assert found == {(10000, 0): "red", (10000, 1): "A", (10001, 1): ""}
    results = [
        {"scene_index": 10000, "question_id": 0, "answer": "red"},
        {"scene_index": 10000, "question_id": 1, "choices": [{"choice_id": 7, "answer": "wrong"}]},
        {"scene_index": 10001, "question_id": 1, "choices": [{"choice_id": i, "answer": "correct"} for i in (4, 7)]},
    ]
    write_submission(tmp_path / "a.json", results)
    first, second, third = read_answers(tmp_path / "a.json").values()
    assert read_given(OPEN, first).answer == "red"
    assert "expected those of [4, 7]" in read_given(WHAT_IF, second).problem
    assert read_given(WHAT_IF, third).answer == {"A", "B"}
    assert "open question" in read_given(OPEN, third).problem


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        (
            '{"id": "10000-0", "response": "red"}\n{"id": "10000-0", "response": "blue"}',
            "10000-0 is answered twice",
        ),
        ('{"id": "x", "response": "red"}', "id`"),
        ('{"id": "10000-0"}', '`response`; expected a row such as {"id": "10003-7", "response": "A, C"}'),
        ('{"id": "10000-0", "response": ["A"]}', "response`"),
        ('{"id": "10000-0", "response": "red"}\n[1]', "line 2: "),
        ("id,response\n10000-0,red\n", "not JSON Lines; expected a row such as"),
        ('{"id": "10000-\u0661", "response": "red"}', "id`"),
        (
            '[{"scene_index": 1, "questions": [{"question_id": 0}]}]',
            "questions[0]: expected 'answer' or, for a question with options, 'choices', got neither",
        ),
        ("[]", "at least 1 answer"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "bad").write_text(content)
    with pytest.raises(DataError, match="bad") as error:
        read_answers(tmp_path / "bad")
    assert message in str(error.value)


def test_unread_missing_and_unknown_answers_are_counted(tmp_path: Path) -> None:
    lines = _responses(tmp_path, "a.jsonl", 2, "red or blue").read_text().splitlines()
    missing = json.loads(lines.pop())
    lines.append(json.dumps({**missing, "id": "77-1"}))
    (tmp_path / "a.jsonl").write_text("\n".join(lines))
    report = score_responses(SCENES, read_answers(tmp_path / "a.jsonl"))
    assert (report["descriptive"]["accuracy"], report["descriptive"]["n"]) == (0.8, 10)
    assert report["counterfactual"]["per_option"] == 0.9
    responses = report.responses
    assert (responses["questions"], responses["answered"], responses["scored"]) == (20, 19, 20)
    assert (responses["missing"], responses["unknown"]) == (["10009-1"], ["77-1"])
    assert responses["unread_by_type"]["descriptive"] == 2
    assert responses["unread"][0] == {
        "id": "10000-0",
        "question_type": "descriptive",
        "problem": "several answer words: blue, red",
        "response": "red or blue",
    }
    text = str(report)
    for line in (
        "1 have none (10009-1): they count as wrong",
        "1 answers are about other questions (77-1): ignored",
        "2 responses cannot be read and count as wrong: descriptive 2",
        "  10000-0: several answer words: blue, red: 'red or blue'",
    ):
        assert line in text.splitlines()

    allowed = score_responses(SCENES, read_answers(tmp_path / "a.jsonl"), allow_missing=True)
    assert allowed["counterfactual"]["per_option"] == 1.0
    assert "they are left out" in str(allowed)


def test_halves_come_from_the_question_file(tmp_path: Path) -> None:
    report = score_responses(SCENES, read_answers(_responses(tmp_path, "a.jsonl", 5)))
    assert report["counterfactual"]["tags"]["inferential"]["n_options"] == 10


def test_answers_to_other_or_unlabelled_questions_are_refused(tmp_path: Path) -> None:
    answers = read_answers(_responses(tmp_path, "a.jsonl"))
    with pytest.raises(DataError, match="none of the 20 answers is about one of the 2 questions"):
        score_responses([replace(SCENES[0], scene_index=3)], answers)
    with pytest.raises(DataError, match="have no answers in their file"):
        score_responses([without_answers(s) for s in SCENES], answers)


def test_references() -> None:
    rows = reference_rows(SCENES)
    assert rows["always-yes"]["counterfactual"]["per_option"] == 0.5
    assert rows["always-yes"]["counterfactual"]["tags"]["inferential"]["per_option"] == 0.0
    assert rows["frequent"]["descriptive"]["accuracy"] == 1.0
    assert "frequent" not in reference_rows([replace(SCENES[0], questions=(replace(OPEN, subtype=None),))])


def test_pairs_count_where_both_are_right() -> None:
    def second(index: int, kind: str, answer: str) -> SceneQuestions:
        question = replace(OPEN, answer=answer, pair="10000-0", pair_kind=kind)
        return SceneQuestions(index, f"video_{index:05d}.mp4", (question, WHAT_IF))

    scenes = [
        SCENES[0],
        second(10001, "changed", "blue"),
        second(10002, "mirrored", "red"),
        second(10003, "noisy", "red"),
    ]

    def pairs(*words: str, allow_missing: bool = False) -> dict[str, tuple[float, int]]:
        given = {(10000 + i, 0): word for i, word in enumerate(words)}
        report = score_responses(scenes, given, allow_missing)
        return {kind: (row["accuracy"], row["n"]) for kind, row in report.tables.get("pairs", {}).items()}

    assert pairs("red", "red", "red", "blue") == {"changed": (0, 1), "mirrored": (1, 1), "noisy": (0, 1)}
    assert pairs("red", "blue", "red", "red") == {"changed": (1, 1), "mirrored": (1, 1), "noisy": (1, 1)}
    assert pairs("blue", "blue", "red", "red") == {"changed": (0, 1), "mirrored": (0, 1), "noisy": (0, 1)}
    assert pairs("red", "blue", allow_missing=True) == {"changed": (1, 1)}
    assert "pairs" not in score_responses(SCENES, {(10000, 0): "red"}).tables
    text = str(score_responses(scenes, {(10000, 0): "red", (10002, 0): "red"}))
    assert re.search(r"^changed pairs, both +0.0 \[0.0, .*\] +1$", text, re.MULTILINE)
    assert re.search(r"noisy\n( +always-.*\n){2} +frequent .* 0.0 +100.0 +100.0$", text, re.MULTILINE)
    assert re.search(r"^mirrored pairs, both +100.0 \[.*, 100.0\] +1$", text, re.MULTILINE)


def test_two_systems_are_compared_on_the_same_questions(tmp_path: Path) -> None:
    reports = [score_responses(SCENES, read_answers(_responses(tmp_path, "a.jsonl", n))) for n in (4, 1)]
    first, second = (report.results for report in reports)
    found = compare_results(first, second)
    row = found["descriptive"]["per_question"]
    assert row["difference"] == pytest.approx(0.3)
    assert (row["only_first"], row["only_second"], row["n"]) == (0, 3, 10)
    assert row["interval"][0] <= 0.3 <= row["interval"][1]
    assert found["counterfactual"]["inferential"]["difference"] == 0
    assert "descriptive, per question" in format_comparison(found, "a", "b")
    assert compare_results(first, second[:2])["descriptive"]["per_question"]["n"] == 1
    with pytest.raises(DataError, match="no scored question in common"):
        compare_results(first, [])


def test_interval_of_a_difference() -> None:
    low, high = difference_interval([False] * 50 + [True] * 50, [True] * 100, list(range(100)))
    assert 0.3 < low < 0.5 < high < 0.7
    paired = difference_interval([True, False] * 50, [False, True] * 50, [i // 2 for i in range(100)])
    assert paired == pytest.approx((-0.193, 0.193), abs=1e-3)
    one_video = difference_interval([False] * 3 + [True] * 7, [True] * 10, [0] * 10)
    assert one_video == pytest.approx((-0.045, 0.545), abs=1e-3)
    assert difference_interval([True] * 3, [False] * 3, [0, 1, 2])[0] == -1.0
    low, high = difference_interval([True] * 10, [True] * 10, list(range(10)))
    assert low == -high
    assert 0.2 < high < 0.3


def test_the_recording_knows_more_than_constant_answers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene_500002.json").write_bytes(TRUTH.read_bytes())
    scenes = read_questions(QUESTIONS)
    rows = (((s.scene_index, q.id), "none" if q.choices else "yes") for s in scenes for q in s.questions)
    constant, keep, out = tmp_path / "no.jsonl", tmp_path / "keep.json", tmp_path / "report.json"
    write_responses(constant, rows)
    recording = ["evaluate", "--counterfactuals", "recording", "--programs", "gold", "--submission", str(keep)]
    assert main([*recording, "--questions", str(QUESTIONS), "--source", "scenes", "--data", str(tmp_path)]) == 0
    assert main(["score", str(constant), str(keep), "--questions", str(QUESTIONS), "-o", str(out)]) == 0
    document = json.loads(out.read_text())
    assert [r["responses"]["unread"] for r in document["reports"]] == [[], []]
    assert document["comparison"]["descriptive"]["per_question"]["difference"] > 0.5
    assert "minus" in capsys.readouterr().out
    assert len(read_answers(keep)) == sum(len(s.questions) for s in scenes)


def test_score_names_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_questions(tmp_path / "q.json", SCENES)
    answers = str(_responses(tmp_path, "a.jsonl"))
    assert main(["score", answers, "--questions", str(tmp_path / "q.json")]) == 0
    assert main(["score", answers, "--questions", str(QUESTIONS)]) == 2
    assert "a.jsonl with " in capsys.readouterr().err
    assert main(["score", answers, "--questions", str(tmp_path / "q.json"), "-o", str(tmp_path / "q.json")]) == 2
    assert "choose another name" in capsys.readouterr().err


def test_answers_in_the_forms_that_systems_write_are_read(tmp_path: Path) -> None:
    """Numbers and truth values for words, and "error", as an answer or a key, where the released executor failed."""
    (scene,) = read_questions(QUESTIONS)
    chosen = [q for q in scene.questions if len(q.choices) > 1][:2]
    counted = replace(chosen[0], id=100, type="descriptive", subtype="count", answer="3", choices=())
    existing, shaped = replace(counted, id=101, answer="yes"), replace(counted, id=102, answer="sphere")
    asked = replace(scene, questions=(*chosen, counted, existing, shaped))
    failed: list[dict[str, Any]] = [
        {"question_id": q.id, "choices": [{"choice_id": c.id, "answer": c.answer == "correct"} for c in q.choices]}
        for q in chosen
    ]
    failed[0]["choices"][0] = {"choice_id": chosen[0].choices[0].id, "error": "unique: no object"}
    failed[1]["choices"][1]["answer"] = "error"
    rows = [
        {"question_id": 100, "answer": 3},
        {"question_id": 101, "answer": True},
        {"question_id": 102, "answer": "ball"},
    ]
    path = tmp_path / "submission.json"
    path.write_text(json.dumps([{"scene_index": scene.scene_index, "questions": failed + rows}]))
    write_questions(tmp_path / "questions.json", [asked])
    assert (
        main(["score", str(path), "--questions", str(tmp_path / "questions.json"), "-o", str(tmp_path / "r.json")]) == 0
    )
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["descriptive"]["accuracy"] == 1.0
    choices = [c["correct"] for row in report["results"] for c in row.get("choices", ())]
    assert choices.count(False) == 2
    assert sum(report[q.type]["per_question"] or 0 for q in chosen) == 0
    assert len(report["responses"]["failed_options"]) == 2
    lines = [{"id": f"{scene.scene_index}-{row['question_id']}", "response": row["answer"]} for row in rows]
    (tmp_path / "lines.jsonl").write_text("\n".join(map(json.dumps, lines)))
    assert score_responses([asked], read_answers(tmp_path / "lines.jsonl"))["descriptive"]["accuracy"] == 1.0

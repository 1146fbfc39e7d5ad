"""What texts alone predict, and the command that tags question files."""

import json
import random
import sys

import pytest
from msgspec.structs import replace

from nsdr import DataError
from nsdr.baselines.blind import FOLDS, tag_blind
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions, read_questions, write_questions
from nsdr.cli.main import main

COLLIDE = (
    "all_events objects {} filter_color unique filter_collision objects {} filter_color unique filter_collision unique"
)
WITHOUT = "all_events objects {} filter_color unique get_counterfact belong_to"


def scene(index: int, shape: str, option: str, negated: bool = False, answer: str | None = None) -> SceneQuestions:
    """A count whose answer follows from the shape, and an option whose answer follows from its text and "not"."""
    right = (option == "blue") != negated
    choices = (Choice(0, f"The {option} cube and the green sphere collide", None, "correct" if right else "wrong"),)
    text = f"Which of the following will {'not ' * negated}happen without the red cylinder?"
    count = Question(
        0, f"How many {shape}s are there?", "descriptive", "count", None, answer or str(len(shape) % 5), ()
    )
    return SceneQuestions(
        index, f"video_{index:05d}.mp4", (count, Question(1, text, "counterfactual", None, None, None, choices))
    )


def scenes(n: int = 40, first: int = 0) -> list[SceneQuestions]:
    rng = random.Random(0)
    return [
        scene(first + i, rng.choice(["cube", "sphere"]), rng.choice(["blue", "gray"]), rng.random() < 0.5)
        for i in range(n)
    ]


def blind(tagged: list[SceneQuestions]) -> list[bool | None]:
    return [x.blind for s in tagged for q in s.questions for x in (q.choices or (q,))]


def test_answers_that_follow_from_texts_are_predicted() -> None:
    tagged = tag_blind(scenes())
    assert blind(tagged) == [True] * 80
    assert all(q.blind is None for s in tagged for q in s.questions if q.choices)


def test_no_scene_predicts_itself() -> None:
    """Each scene repeats a text with an answer of its own, which no other scene has."""
    own = [
        SceneQuestions(
            i,
            "v.mp4",
            tuple(Question(k, f"What about thing{i}?", "descriptive", "count", None, str(i), ()) for k in range(4)),
        )
        for i in range(15)
    ]
    assert not any(blind(tag_blind(own)))


def test_tags_are_determined_by_the_seed() -> None:
    rng = random.Random(1)
    noise = [scene(i, rng.choice(["cube", "sphere"]), "blue", answer=rng.choice("0123")) for i in range(60)]
    assert tag_blind(noise, seed=3) == tag_blind(noise, seed=3)
    assert tag_blind(noise, seed=3) != tag_blind(noise, seed=4)


def test_other_scenes_can_be_learned_from() -> None:
    training = [scene(100 + i, "cube", "blue", answer="3") for i in range(5)]
    tagged = tag_blind([scene(0, "cube", "gray")], training)
    assert blind(tagged) == [False, False]  # learned: always 3, and always correct
    with pytest.raises(DataError, match="1 scenes, such as 100, are among the training questions too"):
        tag_blind(training[:1], training)


def test_what_cannot_be_predicted_is_refused(monkeypatch) -> None:
    with pytest.raises(DataError, match=r"4 scenes with descriptive questions are too few .* expected at least 5"):
        tag_blind(scenes(FOLDS - 1))
    (question, _) = scene(9, "cube", "blue").questions
    bare = SceneQuestions(9, "v.mp4", (replace(question, answer=None),))
    with pytest.raises(DataError, match="scene 9, question 0: has no answer"):
        tag_blind([*scenes(8), bare])
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(DataError, match=r"blind tags need scikit-learn: pip install 'nsdr\[blind\]'"):
        tag_blind(scenes())


@pytest.fixture
def files(tmp_path):
    """A question file of eight scenes and compact truth: the blue cube hits the green sphere in each."""
    rows, blocks = [], []
    colors = ["red", "green", "blue"]
    for i in range(8):
        choices = (
            Choice(
                0,
                "The blue cube and the green sphere collide",
                tuple(COLLIDE.format("blue", "green").split()),
                "correct",
            ),
            Choice(1, "The red cylinder hits the blue cube", tuple(COLLIDE.format("blue", "green").split()), "wrong"),
        )
        question = Question(0, "What if?", "counterfactual", None, tuple(WITHOUT.format("red").split()), None, choices)
        rows.append(SceneQuestions(i, f"video_{i:05d}.mp4", (question,)))
        objects = [{"id": k, "color": c, "material": "rubber", "shape": "cube"} for k, c in enumerate(colors)]
        hit = {"type": "collision", "object": [1, 2], "frame": 50}
        blocks.append({"video": i, "n_frames": 128, "objects": objects, "in_outs": [], "collisions": [hit]})
    write_questions(tmp_path / "questions.json", rows)
    (tmp_path / "truth.json").write_text(json.dumps(blocks))
    return tmp_path


def test_command_tags_a_file_and_prints_the_shares(files, capsys) -> None:
    questions, truth, output = (str(files / name) for name in ("questions.json", "truth.json", "tagged.json"))
    assert main(["tag", questions, "--truth", truth, "-o", output]) == 0
    tagged = [c for s in read_questions(output) for q in s.questions for c in q.choices]
    assert [(c.tag, c.blind) for c in tagged] == [("observational", True), ("inferential", True)] * 8
    printed = capsys.readouterr().out
    assert "observational           50.0 %  100.0 %       8" in printed
    assert "counterfactual         100.0 %               16" in printed
    assert main(["tag", questions, "--truth", truth, "--no-blind", "-o", output]) == 0
    assert "text alone" not in capsys.readouterr().out
    assert all(c.blind is None for s in read_questions(output) for q in s.questions for c in q.choices)


def test_command_refuses_what_it_cannot_tag(files, capsys) -> None:
    questions, truth, output = (str(files / name) for name in ("questions.json", "truth.json", "tagged.json"))
    some = json.loads((files / "truth.json").read_text())[:5]
    (files / "some.json").write_text(json.dumps(some))
    for arguments, message in (
        (["--no-blind"], "--no-blind without --truth leaves nothing to tag"),
        (["--no-blind", "--truth", truth, "--train", truth], "--train is what texts are learned from"),
        (["--truth", str(files / "some.json")], "lacks 3 scenes with counterfactual questions, such as 5"),
        (["--truth", str(files / "none")], "none: no such file or folder"),
        (
            ["--train", questions],
            f"{questions} with --train {questions}: 8 scenes, such as 0, are among the training questions too",
        ),
    ):
        assert main(["tag", questions, *arguments, "-o", output]) == 2
        assert message in capsys.readouterr().err
    rows = json.loads((files / "questions.json").read_text())
    del rows[0]["questions"][-1]["choices"][0]["program"]
    (files / "bad.json").write_text(json.dumps(rows))
    write_questions(files / "none.json", [replace(s, questions=s.questions[:1]) for s in scenes(8)])
    for name, message in (
        ("bad.json", f"bad.json with {truth}: scene 0, question 0, choice 0: has no program"),
        ("none.json", "none.json: has no counterfactual question, and --truth tags only those"),
    ):
        assert main(["tag", str(files / name), "--truth", truth, "-o", output]) == 2
        assert message in capsys.readouterr().err
    assert not (files / "tagged.json").exists()
    assert main(["tag", questions, "--truth", truth, "-o", questions]) == 2

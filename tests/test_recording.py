"""The unchanged recording, tags of counterfactual options, and intervals over scenes."""

import json

import numpy as np
import pytest
from msgspec.structs import replace

from nsdr import DataError, Event, Scene, SceneObject
from nsdr.baselines import keep_recording, tag_options
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions, write_questions
from nsdr.cli.main import main
from nsdr.errors import ExecutionError
from nsdr.evaluation import accuracy_interval, wilson_interval
from nsdr.evaluation.runner import EvaluationConfig
from nsdr.evaluation.score import score_scenes
from nsdr.symbolic import Executor

OBJECTS = tuple(SceneObject(i, color, "rubber", "cube") for i, color in enumerate(["red", "green", "blue"]))
HITS = (Event("collision", 10, (0, 1)), Event("collision", 20, (1, 2)))
QUESTION = "all_events objects red filter_color unique get_counterfact belong_to"
HIT = "objects {} filter_color unique filter_collision"
CHOICE = f"all_events {HIT.format('green')} {HIT.format('blue')} unique"


def scene(counterfactual) -> Scene:
    everywhere = np.ones((3, 128), bool)
    return Scene(OBJECTS, 128, everywhere, everywhere, HITS, predicted=(), counterfactual=counterfactual)


def asked(answer: str) -> SceneQuestions:
    choice = Choice(0, "", tuple(CHOICE.split()), answer)
    return SceneQuestions(
        7, "v.mp4", (Question(0, "", "counterfactual", None, tuple(QUESTION.split()), None, (choice,)),)
    )


def test_the_recording_keeps_what_the_removed_object_has_no_part_in() -> None:
    kept = keep_recording(scene({0: ()}))
    assert kept.counterfactual == {0: (HITS[1],), 1: (), 2: (HITS[0],)}
    assert kept.events == HITS


@pytest.mark.parametrize(
    ("answer", "tag", "right"), [("correct", "observational", False), ("wrong", "inferential", True)]
)
def test_options_are_tagged_by_what_the_recording_answers(answer: str, tag: str, right: bool) -> None:
    tagged = tag_options(asked(answer), scene(None))
    executor = Executor(scene({0: (), 1: (), 2: ()}))  # without the red cube, the others do not meet
    report = score_scenes([(tagged, executor)])
    assert report.results[0]["choices"][0]["tag"] == tag
    tags = report["counterfactual"]["tags"]
    assert (tags[tag]["n_options"], tags[tag]["per_option"]) == (1, float(right))
    assert f"  {tag}" in str(report)


def with_choice(scene_questions: SceneQuestions, **values) -> SceneQuestions:
    (question,) = scene_questions.questions
    choices = tuple(replace(c, **values) for c in question.choices)
    return replace(scene_questions, questions=(replace(question, choices=choices),))


def test_files_are_tagged_by_the_true_scene() -> None:
    true = scene(None)  # an annotation: what happens without an object is not known
    (question,) = tag_options(asked("wrong"), true).questions
    assert [c.tag for c in question.choices] == ["inferential"]
    (question,) = tag_options(asked("correct"), true).questions
    assert [c.tag for c in question.choices] == ["observational"]


@pytest.mark.parametrize(
    ("questions", "message"),
    [
        (with_choice(asked("wrong"), answer=None), "scene 7, question 0: lacks programs or answers"),
        (with_choice(asked("wrong"), program=None), "scene 7, question 0: lacks programs or answers"),
        (
            with_choice(asked("wrong"), program=tuple(CHOICE.replace("blue", "gray").split())),
            "scene 7, question 0, choice 0 .*: .*gray",
        ),
    ],
)
def test_what_cannot_be_tagged_is_an_error(questions: SceneQuestions, message: str) -> None:
    with pytest.raises(DataError, match=message):
        tag_options(questions, scene(None))


def test_questions_that_fail_count_in_their_half() -> None:
    tagged = with_choice(asked("wrong"), tag="inferential")
    report = score_scenes([(tagged, ExecutionError("no video"))])
    assert report["counterfactual"]["tags"]["inferential"]["n_options"] == 1


def test_evaluation_tags_options_by_the_true_scenes(tmp_path, capsys) -> None:
    """CLEVRER's question files have no tags; the true scenes tell which options the recording answers rightly."""
    (question,) = asked("correct").questions
    right = replace(question.choices[0], text="They collide")
    question = replace(question, text="What if?", choices=(right, replace(right, id=1, answer="wrong")))
    write_questions(tmp_path / "questions.json", [SceneQuestions(7, "video_00007.mp4", (question,))])
    objects = [{"id": o.id, "color": o.color, "material": o.material, "shape": o.shape} for o in OBJECTS]
    hits = [{"type": "collision", "object": list(e.objects), "frame": e.frame} for e in HITS]
    block = {"video": 7, "n_frames": 128, "objects": objects, "in_outs": [], "collisions": hits}
    (tmp_path / "truth.json").write_text(json.dumps([block]))
    (tmp_path / "others.json").write_text(json.dumps([block | {"video": 8}]))
    row = {"name": "row", "tags_from": str(tmp_path / "truth.json"), "questions": str(tmp_path / "questions.json")}
    rows = [
        row | {"name": "recording", "source": "ground-truth", "data": row["tags_from"], "programs": "gold",
               "counterfactuals": "recording"},
        row | {"name": "guesses", "baseline": "random"},
    ]  # fmt: skip
    experiment, results = tmp_path / "table.yaml", tmp_path / "table.json"
    experiment.write_text(json.dumps({"title": "Table", "rows": rows}))
    assert main(["experiment", str(experiment), "-o", str(tmp_path)]) == 0
    first, second = (row["table"]["counterfactual"]["tags"] for row in json.loads(results.read_text())["rows"])
    assert [first[tag]["per_option"] for tag in ("observational", "inferential")] == [1.0, 0.0]
    assert [second[tag]["n_options"] for tag in ("observational", "inferential")] == [1, 1]
    experiment.write_text(json.dumps({"title": "Table", "rows": [row | {"tags_from": str(tmp_path / "others.json")}]}))
    experiment.write_text(experiment.read_text().replace('"name": "row"', '"name": "row", "baseline": "random"'))
    assert main(["experiment", str(experiment), "-o", str(tmp_path)]) == 2
    assert "others.json, which lacks 1 scenes with counterfactual questions, such as 7" in capsys.readouterr().err


def test_intervals_are_wider_where_answers_of_a_scene_go_together() -> None:
    rng = np.random.default_rng(0)
    right = rng.random(100) < 0.8
    together = [bool(r) for r in right for _ in range(10)]
    low, high = accuracy_interval(together, [i for i in range(100) for _ in range(10)])
    apart = accuracy_interval(together, list(range(1000)))
    assert high - low > 2 * (apart[1] - apart[0])
    assert accuracy_interval([True] * 20, [1] * 20) == wilson_interval(1.0, 20)
    assert accuracy_interval([], []) == (0.0, 1.0)


def test_the_recording_is_refused_with_the_official_semantics() -> None:
    with pytest.raises(DataError, match="counterfactuals: recording needs --semantics paper"):
        EvaluationConfig("q.json", "d", source="predictions", semantics="official", counterfactuals="recording")

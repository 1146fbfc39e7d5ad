"""The control without physics, tags of counterfactual options, and intervals over scenes."""

import numpy as np
import pytest
from msgspec.structs import replace

from nsdr import DataError, Event, Scene, SceneObject
from nsdr.baselines import keep_recording, tag_options
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions
from nsdr.errors import ExecutionError
from nsdr.evaluation import accuracy_interval, evaluate, format_table, wilson_interval
from nsdr.evaluation.experiments import markdown_table
from nsdr.evaluation.runner import EvaluationConfig
from nsdr.evaluation.score import score_answers
from nsdr.symbolic import Executor
from nsdr.types import Answer, ChoiceAnswer

OBJECTS = tuple(SceneObject(i, color, "rubber", "cube") for i, color in enumerate(["red", "green", "blue"]))
HITS = (Event("collision", 10, (0, 1)), Event("collision", 20, (1, 2)))
QUESTION = "all_events objects red filter_color unique get_counterfact belong_to"
HIT = "objects {} filter_color unique filter_collision"
CHOICE = f"all_events {HIT.format('green')} {HIT.format('blue')} unique"


def scene(counterfactual) -> Scene:
    everywhere = np.ones((3, 128), bool)
    return Scene(OBJECTS, 128, everywhere, everywhere, HITS, unseen=(), counterfactual=counterfactual)


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
    report = evaluate([(tagged, executor)])
    assert report["results"][0]["choices"][0]["tag"] == tag
    tags = report["counterfactual"]["tags"]
    assert (tags[tag]["n_options"], tags[tag]["per_option"]) == (1, float(right))
    assert f"  {tag}" in format_table(report)


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
        (with_choice(asked("wrong"), answer=None), "scene 7, question 0: has no program or no answers"),
        (with_choice(asked("wrong"), program=None), "scene 7, question 0, choice 0: has no program"),
        (
            with_choice(asked("wrong"), program=tuple(CHOICE.replace("blue", "gray").split())),
            "scene 7, question 0, choice 0: the scene cannot judge it",
        ),
    ],
)
def test_what_cannot_be_tagged_is_an_error(questions: SceneQuestions, message: str) -> None:
    with pytest.raises(DataError, match=message):
        tag_options(questions, scene(None))


def test_questions_that_fail_count_in_their_half() -> None:
    tagged = with_choice(asked("wrong"), tag="inferential", blind=True)
    report = evaluate([(tagged, ExecutionError("no video"))])
    assert report["counterfactual"]["tags"]["inferential"]["n_options"] == 1
    assert report["counterfactual"]["blind"]["text alone right"]["n_options"] == 1


def test_reports_have_the_halves_that_texts_alone_predict() -> None:
    options = with_choice(asked("wrong"), blind=False)
    open_questions = tuple(
        Question(i, "How many?", "descriptive", "count", None, answer, (), blind)
        for i, (answer, blind) in enumerate([("1", True), ("1", True), ("2", False)], start=1)
    )
    questions = replace(options, questions=(*options.questions, *open_questions))
    judged = Answer("", (), None, choices=(ChoiceAnswer("", "wrong", (), ()),))
    answers = {0: judged, **{i: Answer("", (), "1") for i in (1, 2, 3)}}
    report = score_answers([(questions, answers)])
    halves = report["descriptive"]["blind"]
    assert [(h["accuracy"], h["n"]) for h in halves.values()] == [(1.0, 2), (0.0, 1)]
    assert report["counterfactual"]["blind"]["text alone wrong"]["per_option"] == 1.0
    assert report["counterfactual"]["blind"]["text alone right"]["n_options"] == 0
    text = format_table(report)
    assert [line.split()[:3] for line in text.splitlines()].count(["text", "alone", "wrong"]) == 2
    row = {"settings": {"name": "guesses"}, "table": report}
    table = markdown_table("Title", "command", [row])
    assert "- guesses: descriptive 100.0 / 0.0 %, counterfactual - / 100.0 %" in table
    assert "text alone" not in format_table(score_answers([(asked("wrong"), {0: judged})]))


def test_intervals_are_wider_where_answers_of_a_scene_go_together() -> None:
    rng = np.random.default_rng(0)
    right = rng.random(100) < 0.8
    together = [bool(r) for r in right for _ in range(10)]
    low, high = accuracy_interval(together, [i for i in range(100) for _ in range(10)])
    apart = accuracy_interval(together, list(range(1000)))
    assert high - low > 2 * (apart[1] - apart[0])
    assert accuracy_interval([True] * 20, [1] * 20) == wilson_interval(1.0, 20)
    assert accuracy_interval([], []) == (0.0, 1.0)


def test_the_control_is_refused_with_the_official_semantics() -> None:
    with pytest.raises(DataError, match="counterfactuals: recording needs --semantics paper"):
        EvaluationConfig("q.json", "d", source="predictions", semantics="official", counterfactuals="recording")

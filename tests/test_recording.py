"""The control without physics, tags of counterfactual options, and intervals over scenes."""

import numpy as np
import pytest

from nsdr import DataError, Event, Scene, SceneObject
from nsdr.baselines import keep_recording
from nsdr.clevrer.questions import Choice, Question, SceneQuestions
from nsdr.evaluation import accuracy_interval, evaluate, format_table, wilson_interval
from nsdr.evaluation.runner import EvaluationConfig
from nsdr.symbolic import Executor

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
    executor = Executor(scene({0: (), 1: (), 2: ()}))  # without the red cube, the others do not meet
    report = evaluate([(asked(answer), executor)])
    assert report["results"][0]["choices"][0]["tag"] == tag
    tags = report["counterfactual"]["tags"]
    assert (tags[tag]["n_options"], tags[tag]["per_option"]) == (1, float(right))
    assert f"  {tag}" in format_table(report)


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

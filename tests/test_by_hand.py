"""What a researcher touches in Python: what is printed, scenes and programs by hand, pixels, frames, and parts of their own."""

from types import SimpleNamespace

import numpy as np
import pytest

import nsdr
from nsdr.clevrer.example import TRUTH
from nsdr.types.answers import ChoiceAnswer


@pytest.fixture(scope="module")
def scene() -> nsdr.Scene:
    return nsdr.load(TRUTH)


def test_a_printed_scene_is_its_objects_and_events(scene: nsdr.Scene) -> None:
    lines = str(scene).splitlines()
    assert lines[:2] == ["128 frames, 6 objects", "  object 0: brown metal cylinder"]
    assert lines[7:9] == [
        "  brown metal cylinder and cyan metal sphere collide (frame 17)",
        "  purple metal cube enters (frame 25)",
    ]
    assert len(lines) == 1 + len(scene.objects) + len(scene.events)
    assert scene.describe(scene.events[1]) == "purple metal cube enters (frame 25)"


def test_a_printed_answer_is_a_line_and_one_for_each_choice(scene: nsdr.Scene) -> None:
    executor = nsdr.Executor(scene)
    count = executor.answer("events objects filter_collision count")
    assert (count.answer, count.text, str(count)) == (4, "4", "4")
    assert isinstance(count.answer, int)
    assert executor.answer("objects exist").answer == "yes"
    assert executor.answer("events objects filter_in last filter_order get_frame").answer == "frame 112"
    collides = "all_events objects {} filter_shape filter_collision objects {} filter_shape filter_collision unique"
    choices = [
        ("yes", "events objects filter_in first filter_order"),
        ("no", "all_events objects cyan filter_color filter_in unique"),
        ("what", collides.format("cube", "sphere")),
    ]
    judged = executor.answer_choices("events belong_to", choices)
    lines = str(judged).splitlines()
    assert (judged.answer, lines[:3]) == ("yes", ["yes", "correct yes", "wrong   no"])
    assert lines[3].startswith("error   what: ")
    assert str(judged.choices[1]) == "wrong no"
    assert len(repr(judged)) < 1000


@pytest.mark.parametrize(
    ("judgements", "answer", "text"),
    [
        (("correct", "wrong"), "a", "a"),
        (("correct", "correct"), ("a", "b"), "a; b"),
        (("wrong", None), (), "none"),
    ],
)
def test_the_answer_of_a_multiple_choice_question_is_what_is_correct(judgements, answer, text) -> None:
    choices = [ChoiceAnswer(name, judged, (), ()) for name, judged in zip("ab", judgements, strict=True)]
    found = nsdr.Answer.of_choices("?", (), choices)
    assert (found.answer, found.text, found.is_multiple_choice) == (answer, text, True)


def test_a_printed_choice_says_how_probable_its_judgement_is() -> None:
    choices = [ChoiceAnswer("it exits", "correct", (), (), probability=0.98), ChoiceAnswer("it stays", "wrong", (), ())]
    assert str(nsdr.Answer.of_choices("?", (), choices)).splitlines() == [
        "it exits",
        "correct (98 %) it exits",
        "wrong          it stays",
    ]


def test_a_printed_track_names_its_object() -> None:
    frames = np.arange(3, 6)
    place = np.zeros((3, 2))
    track = nsdr.Track(
        nsdr.SceneObject(2, "red", "metal", "cube"), frames, place, place, np.zeros((3, 4), int), np.ones(3)
    )
    assert repr(track) == "Track(object 2, red metal cube: 3 detections from frame 3 to 5)"


def test_a_printed_pipeline_names_its_parts_and_what_is_special_about_them() -> None:
    class Mine:
        def __init__(self, gate: float = 0.5, backend: object = None) -> None:
            self.gate, self.backend = gate, backend

    video = nsdr.VideoConfig(check="warn")
    pipeline = nsdr.Pipeline(Mine(0.25), SimpleNamespace(), nsdr.GrammarParser(extensions=True), video=video)  # type: ignore[arg-type]
    assert repr(pipeline) == (
        "Pipeline(frame_parser=Mine(gate=0.25), dynamics=SimpleNamespace(), "
        "question_parser=GrammarParser(extensions=True), video=VideoConfig(check='warn'))"
    )

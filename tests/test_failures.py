"""Errors of programs that do not fit a scene, in a user's words."""

import pickle

import pytest

from nsdr import ExecutionError, Executor, QuestionError, Scene, narrate
from nsdr.symbolic.phrases import noun_phrase
from nsdr.symbolic.program import Program

RED = "objects red filter_color unique"
RED_CUBE = "objects red filter_color cube filter_shape unique"
BLUE = "objects blue filter_color unique"
TWO_REDS = "the red metal cube and the red rubber sphere"


@pytest.mark.parametrize(
    ("program", "phrase"),
    [
        ("objects cube filter_shape brown filter_color unique", "the brown cube"),
        ("objects metal filter_material", "metal object"),
        ("objects start get_frame filter_moving unique", "the moving object when the video begins"),
        (
            f"objects cube filter_shape events {BLUE} filter_in unique get_frame filter_stationary unique",
            "the stationary cube when the blue object enters",
        ),
        (f"events {RED_CUBE} filter_collision {BLUE} filter_collision unique",
         "the collision of the red cube and the blue object"),
        ("events objects cube filter_shape filter_in first filter_order", "the first entrance of a cube"),
        (f"events events {BLUE} filter_out unique filter_before objects filter_collision unique",
         "the collision before the exit of the blue object"),
        ("events end filter_before unique", "the event before the end of the video"),
        ("unseen_events objects filter_collision unique", "the collision after the video"),
        (f"events {BLUE} filter_collision unique {BLUE} get_col_partner",
         "the other object of the collision of the blue object"),
        (f"objects {BLUE} query_shape filter_shape red filter_color unique",
         "the red object with the shape of the blue object"),
    ],
)  # fmt: skip
def test_noun_phrases(program: str, phrase: str) -> None:
    steps = Program.parse(program).steps
    assert noun_phrase(steps, len(steps) - 1) == phrase


@pytest.mark.parametrize(
    ("text", "program", "message"),
    [
        ("What is the shape of the red thing?", f"{RED} query_shape", f"'the red object' fits two objects: {TWO_REDS}"),
        ("What shape is the one in red?", f"{RED} query_shape", f"'the red object' fits two objects: {TWO_REDS}"),
        ("What shape is the red one?", "objects yellow filter_color cube filter_shape unique query_shape",
         "no object in this video is a yellow cube; it has: the red metal cube, the blue rubber sphere, "
         "the green rubber cylinder and the red rubber sphere"),
        ("", "events objects filter_collision unique get_frame",
         "'the collision' fits two events: the red metal cube and the blue rubber sphere collide (frame 20); "
         "the blue rubber sphere and the green rubber cylinder collide (frame 40)"),
        ("", f"events {RED_CUBE} filter_out unique get_frame",
         "there is no exit of the red cube; the exits of this video: the blue rubber sphere exits (frame 60)"),
    ],
)  # fmt: skip
def test_messages_name_what_is_asked_and_say_what_the_scene_has(executor: Executor, text, program, message) -> None:
    with pytest.raises(ExecutionError) as caught:
        executor.answer(program, text)
    assert str(caught.value) == message


def test_errors_name_the_step(executor: Executor) -> None:
    with pytest.raises(ExecutionError) as caught:
        executor.run(f"{RED} query_shape")
    error = pickle.loads(pickle.dumps(caught.value))
    assert (error.step, error.module) == (4, "unique")


def test_one_bad_choice_does_not_lose_the_others(executor: Executor, small_scene: Scene) -> None:
    question = f"events events {BLUE} filter_collision last filter_order filter_ancestor belong_to"
    choices = [("the blue object", BLUE), ("the red one", RED), ("zebra", QuestionError("unknown word 'zebra'"))]
    first, second, third = executor.answer_choices(question, choices).choices
    assert (first.answer, first.error) == ("correct", "")
    assert (second.answer, second.trace) == (None, ())
    assert second.error == f"'the red object' in choice B fits two objects: {TWO_REDS}"
    assert (third.answer, third.program, third.error) == (None, (), "unknown word 'zebra'")
    assert narrate(second, small_scene) == "<answer>none</answer>"
    alone = executor.answer_choices(question, choices[1:2]).choices[0]
    assert alone.error.startswith("'the red object' in the choice fits two")


def test_an_error_of_the_question_is_not_blamed_on_its_choices(executor: Executor) -> None:
    question = f"all_events {RED} get_counterfact belong_to"
    with pytest.raises(ExecutionError, match=r"^'the red object' fits two objects"):
        executor.answer_choices(
            question, [("the blue object", BLUE), ("the red one", RED)], "Without the red object, what …?"
        )


def test_events_and_frames_are_answers(executor: Executor) -> None:
    assert executor.answer("unseen_events").answer == (
        "the green rubber cylinder and the red rubber sphere collide (about frame 150)"
    )
    assert executor.answer("events objects filter_collision").answer == (
        "the red metal cube and the blue rubber sphere collide (frame 20)\n"
        "the blue rubber sphere and the green rubber cylinder collide (frame 40)"
    )
    assert executor.answer(f"events {RED_CUBE} filter_out").answer == "none"
    assert executor.answer("events objects filter_out unique get_frame").answer == "frame 60"

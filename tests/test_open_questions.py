"""Questions without choices that are answered event by event, and entrances and exits that are simulated."""

from dataclasses import replace

import numpy as np
import pytest

from nsdr import Answer, Event, ExecutionError, Executor, GrammarParser, QuestionError, Rollout, Scene, narrate, verify
from nsdr.dynamics.physics.simulated_view import uncertain_borders
from nsdr.dynamics.scene import events_of, scene_from_prediction
from nsdr.language.texts import in_words
from nsdr.question_parser.base import read_programs
from nsdr.types import DynamicsPrediction, UncertainEvent
from nsdr.world.vocabulary import CLEVRER

PARSER = GrammarParser()
COLLIDE, EXITS, ENTERS = "The red cube hits the blue ball", "The green tube leaves", "The green tube enters"
OBJECTS = "4 objects: the red metal cube, the blue rubber sphere, the green rubber cylinder, the red rubber sphere"
VIDEO = (
    "the red rubber sphere enters (frame 10)",
    "the red metal cube and the blue rubber sphere collide (frame 20)",
    "the blue rubber sphere and the green rubber cylinder collide (frame 40)",
    "the blue rubber sphere exits (frame 60)",
)
LATER = "the green rubber cylinder and the red rubber sphere collide (about frame 150)"


@pytest.fixture
def scene(small_scene: Scene) -> Scene:
    """Without the red cube (0) the blue sphere (1) is not hit and stays, and the green cylinder (2) probably exits."""
    exits, possible = Event("out", 140, (2,)), Event("in", 90, (2,))
    return replace(
        small_scene,
        predicted=(*small_scene.predicted, Event("out", 160, (3,))),
        counterfactual={
            0: (Event("in", 12, (3,)), exits, Event("collision", 158, (2, 3))),
            1: (Event("in", 10, (3,)), Event("collision", 30, (0, 2)), Event("out", 160, (3,))),
        },
        uncertain=(UncertainEvent(exits, 0.75, 0), UncertainEvent(possible, 0.125, 0)),
        collisions_only=False,
    )


def answered(scene: Scene, question: str) -> str | None:
    return Executor(scene).answer(read_programs(PARSER, question)[0], question).answer


def all_hold(text: str, scene: Scene) -> bool:
    """Whether each line before the answer is a claim that holds."""
    found = verify(text, scene)
    return len(found.claims) == len(text.splitlines()) - 1 > 0 and all(c.holds for c in found.claims)


@pytest.mark.parametrize(
    ("question", "lines"),
    [
        ("What happens in this video?", VIDEO),
        ("What is going on?", VIDEO),
        ("Tell me what happens.", VIDEO),
        ("Describe what happens in the clip", VIDEO),
        ("Describe the scene.", (OBJECTS, *VIDEO)),
        ("Can you describe the video?", (OBJECTS, *VIDEO)),
        ("What do you see?", (OBJECTS, *VIDEO)),
        ("What will happen next?", (LATER, "the red rubber sphere exits (about frame 160)")),
        (
            "What would happen without the red cube?",
            (
                "still: the red rubber sphere enters (frame 12)",
                "no longer: the blue rubber sphere and the green rubber cylinder collide (frame 40)",
                "no longer: the blue rubber sphere exits (frame 60)",
                "new: the green rubber cylinder exits (about frame 140, 75 %)",
                f"other frame: {LATER.replace('150', '158 instead of 150')}",
                "no longer: the red rubber sphere exits (about frame 160)",
            ),
        ),
        (
            "What if the blue ball was not there?",
            (
                "still: the red rubber sphere enters (frame 10)",
                "new: the red metal cube and the green rubber cylinder collide (frame 30)",
                f"no longer: {LATER}",
                "still: the red rubber sphere exits (about frame 160)",
            ),
        ),
    ],
)
def test_what_happens_is_told_event_by_event(scene: Scene, question: str, lines: tuple[str, ...]) -> None:
    assert answered(scene, question) == "\n".join(lines)


def test_where_only_collisions_are_known_only_they_are_compared(small_scene: Scene) -> None:
    lines = (
        "no longer: the blue rubber sphere and the green rubber cylinder collide (frame 40)",
        f"still: {LATER}",
    )
    assert answered(small_scene, "What would happen without the red cube?") == "\n".join(lines)


def test_empty_scenes_are_described(small_scene: Scene) -> None:
    nothing = replace(small_scene, events=(), predicted=(), counterfactual={0: ()})
    assert answered(nothing, "Describe the scene") == OBJECTS
    for question in ("What happens?", "What will happen next?", "What will happen without the red cube?"):
        assert answered(nothing, question) == "none"
    none = Scene((), 5, np.zeros((0, 5), bool), None, ())
    assert answered(none, "Describe the scene") == "0 objects"
    with pytest.raises(ExecutionError, match="events without red metal cube are not known"):
        answered(replace(nothing, counterfactual=None), "What if there were no red cube?")


@pytest.mark.parametrize(
    "text",
    [
        *("What has happened?", "What happened?", "What was going on?", "What happens first?", "Describe the red cube"),
        *("What would you do if the red cube is removed?", "What would not happen without the red cube?"),
    ],
)
def test_what_no_program_says_is_refused(text: str) -> None:
    assert isinstance(PARSER.parse_batch([text], "descriptive")[0], QuestionError)


@pytest.mark.parametrize(
    "program", ["events", "objects events describe", "objects red filter_color unique counterfact_events"]
)
def test_their_programs_in_words_are_read_as_themselves(program: str) -> None:
    assert PARSER.parse(in_words(program, CLEVRER)).tokens == tuple(program.split())


def test_lists_take_no_candidates() -> None:
    with pytest.raises(QuestionError, match="not a multiple-choice question"):
        read_programs(PARSER, "What happens in the video?", [COLLIDE])


@pytest.mark.parametrize(
    ("question", "expected"),
    [
        ("What will happen without the red cube?", {EXITS: ("correct", 0.75), ENTERS: ("wrong", 0.125)}),
        ("What will not happen without the red cube?", {EXITS: ("wrong", 0.25), ENTERS: ("correct", 0.875)}),
        (
            "What will happen without the blue ball?",
            {EXITS: ("wrong", 0.005), "The red ball exits": ("correct", 0.995)},
        ),
        ("What will happen next?", {EXITS: ("wrong", 0.005), "The red ball exits": ("correct", 0.995)}),
        ("What will happen without the red cube?", {"The red cube exits": ("wrong", 0.005)}),
    ],
)
def test_options_about_entering_and_leaving_are_judged(
    scene: Scene, question: str, expected: dict[str, tuple[str, float]]
) -> None:
    program, choices = read_programs(PARSER, question, list(expected))
    judged = Executor(scene).answer_choices(program, list(zip(expected, choices or (), strict=True)))
    assert {c.choice: (c.answer, c.probability) for c in judged.choices} == expected
    for choice in judged.choices:
        assert all_hold(narrate(choice, scene, "long"), scene)


@pytest.mark.parametrize("question", ["What will happen next?", "What would happen without the red cube?"])
def test_what_is_told_of_a_prediction_is_true(scene: Scene, question: str) -> None:
    assert all_hold(narrate(Executor(scene).answer(PARSER.parse(question)), scene), scene)


def test_entrances_and_exits_that_few_runs_have_are_uncertain() -> None:
    visible = np.ones((4, 2, 9), bool)
    visible[:, 0, 7:] = False  # exits in all runs
    visible[0, 1, 5:] = False  # exits in the first run
    visible[1, 1, 3:6] = False  # exits earlier in another, and enters again
    visible[2, 1, 0] = False  # enters before the runs differ
    found = uncertain_borders(visible, 2, 0.005)
    assert found == [UncertainEvent(Event("in", 6, (1,)), 0.25), UncertainEvent(Event("out", 5, (1,)), 0.5)]
    assert uncertain_borders(visible[:1], 0, 0.005) == []


def test_scenes_have_the_probable_entrances_and_exits_of_rollouts(small_scene: Scene) -> None:
    visible = np.ones((4, 180), bool)
    visible[2, 140:], visible[3, 150:] = False, False
    unlikely, likely = UncertainEvent(Event("out", 150, (3,)), 0.25), UncertainEvent(Event("out", 170, (1,)), 0.75)
    rollout = Rollout(np.zeros((4, 180, 2)), visible, (), uncertain=(unlikely, likely))
    expected = (Event("out", 140, (2,)), likely.event)
    assert events_of(rollout) == expected
    made = scene_from_prediction(DynamicsPrediction(small_scene.objects, 128, rollout, {0: rollout}))
    assert (made.predicted, made.counterfactual, made.collisions_only) == (expected, {0: expected}, False)
    removed = [(u.removed, u.event, u.probability) for u in made.uncertain or ()]
    assert removed == [(k, u.event, u.probability) for k in (None, 0) for u in (unlikely, likely)]


def test_a_printed_list_of_events_has_the_probability_of_the_whole_on_a_line_of_its_own() -> None:
    several = Answer(
        "What happens?", ("events", "describe"), "it enters (frame 3)\nit exits (frame 9)", probability=0.97
    )
    assert str(several).splitlines() == ["it enters (frame 3)", "it exits (frame 9)", "all of this: 97 %"]

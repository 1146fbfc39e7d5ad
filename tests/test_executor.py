import pkgutil
import subprocess
import sys
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import nsdr.clevrer
import nsdr.symbolic
from nsdr import Event, ExecutionError, Executor, ProgramError, Scene, SceneObject
from nsdr.clevrer.example import QUESTIONS
from nsdr.clevrer.files.questions import read_questions
from nsdr.symbolic import format_trace, format_tree
from nsdr.symbolic.causal import ancestor_sets, causal_path, direct_causes
from nsdr.symbolic.probabilities import SIMULATED_DOUBT
from nsdr.world.vocabulary import CLEVRER

COLORS, MATERIALS, SHAPES = CLEVRER.words.values()
RED_CUBE = "objects red filter_color cube filter_shape unique"
BLUE = "objects blue filter_color unique"
GREEN = "objects green filter_color unique"

ROWS = [
    ("How many objects are there?", "objects count", "4"),
    ("How many collisions happen?", "events objects filter_collision count", "2"),
    ("Are there collisions?", "events objects filter_collision exist", "yes"),
    ("How many objects enter the scene?", "events objects filter_in count", "1"),
    ("Are there any cubes that exit the scene?", "events objects cube filter_shape filter_out exist", "no"),
    ("How many objects are moving when the video begins?", "objects start get_frame filter_moving count", "1"),
    ("How many objects are moving when the video ends?", "objects end get_frame filter_moving count", "1"),
    ("How many objects are moving?", "objects null filter_moving count", "3"),
    ("What color is the stationary object?", "objects null filter_stationary unique query_color", "green"),
    (
        "How many objects are stationary when the red sphere enters the scene?",
        "objects events objects red filter_color sphere filter_shape unique filter_in unique get_frame "
        "filter_stationary count",
        "2",
    ),
    (
        "What shape is the first object to collide with the blue object?",
        f"events {BLUE} filter_collision first filter_order {BLUE} get_col_partner query_shape",
        "cube",
    ),
    (
        "What material is the last object to collide with the blue object?",
        f"events {BLUE} filter_collision last filter_order {BLUE} get_col_partner query_material",
        "rubber",
    ),
    (
        "What color is the second object to collide with the blue object?",
        f"events {BLUE} filter_collision second filter_order {BLUE} get_col_partner query_color",
        "green",
    ),
    (
        "What shape is the object that exits the scene?",
        "events objects filter_out unique get_object query_shape",
        "sphere",
    ),
    (
        "How many collisions happen before the blue object exits the scene?",
        f"events events {BLUE} filter_out unique filter_before objects filter_collision count",
        "2",
    ),
    (
        "How many collisions happen after the red sphere enters the scene?",
        "events events objects red filter_color sphere filter_shape unique filter_in unique filter_after "
        "objects filter_collision count",
        "2",
    ),
    ("Is there no cube?", "objects cube filter_shape exist negate", "no"),
]


@pytest.mark.parametrize(("question", "program", "answer"), ROWS)
def test_descriptive(executor: Executor, question: str, program: str, answer: str) -> None:
    assert executor.answer(program, question).text == answer


def judged(executor: Executor, question: str, choice: str) -> str:
    return executor.answer_choices(question, [("", choice)]).choices[0].answer


COLLISION_WITH_GREEN = f"events {BLUE} filter_collision {GREEN} filter_collision unique"


@pytest.mark.parametrize(
    ("choice", "answer"),
    [
        (RED_CUBE, "correct"),
        (BLUE, "correct"),  # takes part in the target and in its cause
        (GREEN, "correct"),  # takes part in the target alone (paper)
        ("objects red filter_color sphere filter_shape unique", "wrong"),
        (f"events {RED_CUBE} filter_collision {BLUE} filter_collision unique", "correct"),
        (COLLISION_WITH_GREEN, "wrong"),  # nothing is responsible for itself
        ("events objects filter_in unique", "wrong"),
    ],
)
def test_responsible_for_the_second_collision(executor: Executor, choice: str, answer: str) -> None:
    question = f"events {COLLISION_WITH_GREEN} filter_ancestor belong_to"
    assert judged(executor, question, choice) == answer
    assert judged(executor, question + " negate", choice) == {"correct": "wrong", "wrong": "correct"}[answer]


def test_the_target_is_no_member_of_its_own_causes(executor: Executor) -> None:
    assert executor.run(f"events {COLLISION_WITH_GREEN} filter_ancestor count") == 1
    first = f"events {RED_CUBE} filter_collision {BLUE} filter_collision unique"
    assert executor.run(f"events {first} filter_ancestor exist") is False


def possible(a: str, b: str) -> str:
    return f"all_events {a} filter_collision {b} filter_collision unique"


def test_predictive(executor: Executor) -> None:
    question = "unseen_events belong_to"
    red_sphere = "objects red filter_color sphere filter_shape unique"
    assert judged(executor, question, possible(GREEN, red_sphere)) == "correct"
    assert judged(executor, question, possible(RED_CUBE, BLUE)) == "wrong"


def test_counterfactual(executor: Executor) -> None:
    without_blue = f"all_events {BLUE} get_counterfact belong_to"
    assert judged(executor, without_blue, possible(RED_CUBE, GREEN)) == "correct"
    assert judged(executor, without_blue, possible(RED_CUBE, BLUE)) == "wrong"
    assert judged(executor, without_blue + " negate", possible(RED_CUBE, BLUE)) == "correct"


def test_the_questions_of_the_example_are_answered_correctly(example_scene: Scene) -> None:
    executor = Executor(example_scene)
    types = set()
    for question in read_questions(QUESTIONS)[0].questions:
        types.add(question.type)
        assert question.program is not None
        if question.type == "descriptive":
            assert executor.answer(question.program).text == question.answer, question.text
            continue
        choices = [(c.text, c.program or ()) for c in question.choices]
        judgements = [c.answer for c in executor.answer_choices(question.program, choices).choices]
        assert judgements == [c.answer for c in question.choices], question.text
    assert len(types) == 4


def test_trace_holds_every_step_with_inputs_and_results(executor: Executor) -> None:
    answer = executor.answer("events objects filter_collision count")
    assert [s.module for s in answer.trace] == ["events", "objects", "filter_collision", "count"]
    assert answer.trace[2].inputs == (0, 1)
    assert answer.trace[2].value == (Event("collision", 20, (0, 1)), Event("collision", 40, (1, 2)))
    text = format_trace(answer.trace)
    assert "filter_collision(1, 2)" in text
    assert "red metal cube and blue rubber sphere collide (frame 20)" in text


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (
            "objects red filter_color unique query_shape",
            "'the red object' fits two objects: the red metal cube and the red rubber sphere",
        ),
        (
            "objects yellow filter_color unique query_shape",
            "no object in this video is yellow; it has: the red metal cube, ",
        ),
        (
            "events objects filter_in second filter_order get_object query_color",
            "no second entrance; there is one: the red rubber sphere enters",
        ),
        (f"events {possible(RED_CUBE, BLUE)} filter_before count", "is only a possible event and has no frame"),
        (
            f"events {RED_CUBE} filter_collision unique {GREEN} get_col_partner query_color",
            "is not a collision of green",
        ),
    ],
)
def test_execution_errors_say_what_was_asked_for_and_what_there_is(
    executor: Executor, program: str, message: str
) -> None:
    with pytest.raises(ExecutionError, match=message):
        executor.run(program)


def test_unknown_motion_future_and_counterfactuals_are_errors(small_scene: Scene) -> None:
    blind = Executor(Scene(small_scene.objects, 128, small_scene.visible, None, small_scene.events))
    with pytest.raises(ExecutionError, match="motion is not known in this scene"):
        blind.run("objects null filter_moving count")
    with pytest.raises(ExecutionError, match="events after the video are not known"):
        blind.run("unseen_events count")
    with pytest.raises(ExecutionError, match="events without blue rubber sphere are not known"):
        blind.run(f"all_events {BLUE} get_counterfact count")


def test_motion_after_the_video_is_an_error(executor: Executor) -> None:
    with pytest.raises(ExecutionError, match="motion at frame 150 is not known"):
        executor.run("objects unseen_events unique get_frame filter_moving count")


def test_programs_of_other_sorts_are_rejected(executor: Executor) -> None:
    with pytest.raises(ProgramError, match="judges a choice; pass it to `answer_choices`"):
        executor.answer("unseen_events belong_to")
    with pytest.raises(ProgramError, match="takes no choice"):
        executor.answer_choices("objects count", [("", RED_CUBE)])
    with pytest.raises(ProgramError, match="gives objects"):
        executor.answer("objects")


def test_empty_scene_counts_nothing() -> None:
    nothing = Scene((), 128, np.zeros((0, 128), bool), np.zeros((0, 128), bool), ())
    assert Executor(nothing).run("objects count") == 0
    assert Executor(nothing).run("events objects filter_collision exist") is False


TRIPLES = st.tuples(st.sampled_from(COLORS), st.sampled_from(MATERIALS), st.sampled_from(SHAPES))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    triples = draw(st.lists(TRIPLES, min_size=2, max_size=6, unique=True))
    objects = tuple(SceneObject(i, *t) for i, t in enumerate(triples))
    pairs = [(i, j) for i in range(len(objects)) for j in range(i + 1, len(objects))]
    happened = draw(st.lists(st.sampled_from(pairs), unique=True))
    events = tuple(Event("collision", draw(st.integers(0, 127)), pair) for pair in happened)
    flags = np.array(draw(st.lists(st.booleans(), min_size=len(objects), max_size=len(objects))))
    moving = np.repeat(flags[:, None], 128, 1)
    return Scene(objects, 128, np.ones_like(moving), moving, events)


FILTERS = [
    "red filter_color",
    "metal filter_material",
    "cube filter_shape",
    "null filter_moving",
    "null filter_stationary",
]


@given(scenes(), st.sampled_from(FILTERS), st.sampled_from(FILTERS))
@settings(deadline=None)
def test_filters_commute(scene: Scene, first: str, second: str) -> None:
    executor = Executor(scene)
    assert executor.run(f"objects {first} {second}") == executor.run(f"objects {second} {first}")


@given(scenes(), st.sampled_from(FILTERS))
@settings(deadline=None)
def test_count_is_the_number_of_members_and_exist_says_whether_any(scene: Scene, chosen: str) -> None:
    executor = Executor(scene)
    members = executor.run(f"objects {chosen}")
    assert executor.run(f"objects {chosen} count") == len(members)
    assert executor.run(f"objects {chosen} exist") is bool(members)
    assert executor.run(f"objects {chosen} exist negate negate") is bool(members)


@given(scenes())
@settings(deadline=None)
def test_ancestors_are_transitive_and_earlier(scene: Scene) -> None:
    ancestors = ancestor_sets(scene.events)
    for index, causes in enumerate(direct_causes(scene.events)):
        mine = ancestors[index]
        for cause in causes:
            assert scene.events[cause].frame <= scene.events[index].frame
            assert mine >= ancestors[cause]
        assert index not in mine


def test_symbolic_part_and_file_formats_load_no_torch() -> None:
    names = [
        info.name
        for package in (nsdr.symbolic, nsdr.clevrer)
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    ]
    assert len(names) > 15
    code = f"import sys, {', '.join(names)}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_trace_as_a_tree(executor: Executor) -> None:
    answer = executor.answer("objects cube filter_shape count")
    assert format_tree(answer.trace).splitlines() == [
        "count: 1",
        "└─ filter_shape: red metal cube",
        "   ├─ objects: red metal cube, blue rubber sphere, green rubber cylinder, red rubber sphere",
        "   └─ cube",
    ]


def test_steps_list_the_objects_and_events_they_depend_on(executor: Executor) -> None:
    trace = executor.answer("events objects filter_collision count").trace
    assert trace[-1].events == (Event("collision", 20, (0, 1)), Event("collision", 40, (1, 2)))
    assert trace[1].objects == (0, 1, 2, 3)


@given(scenes())
@settings(deadline=None)
def test_belonging_agrees_with_membership(scene: Scene) -> None:
    executor = Executor(scene)
    members = executor.run("events objects filter_collision")
    for i, j in combinations(range(len(scene.objects)), 2):
        a, b = (f"objects {o.color} filter_color {o.material} filter_material {o.shape} filter_shape unique" for o in
                (scene.objects[i], scene.objects[j]))  # fmt: skip
        answer = judged(executor, "events objects filter_collision belong_to", possible(a, b))
        assert (answer == "correct") == any(e.objects == (i, j) for e in members)


@given(scenes(), st.data())
@settings(deadline=None)
def test_removing_an_unrelated_object_changes_no_ancestor(scene: Scene, data: st.DataObject) -> None:
    """Removing an object that takes part in no ancestor of an event keeps the ancestors of that event."""
    ancestors = ancestor_sets(scene.events)
    for index, event in enumerate(scene.events):
        before = {scene.events[i] for i in ancestors[index]}
        involved = {o for e in [event, *before] for o in e.objects}
        unrelated = [o.id for o in scene.objects if o.id not in involved]
        if not unrelated:
            continue
        removed = data.draw(st.sampled_from(unrelated))
        kept = [e for e in scene.events if removed not in e.objects]
        assert {kept[i] for i in ancestor_sets(kept)[kept.index(event)]} == before


def test_the_likelier_of_two_predictions_is_correct(small_scene: Scene) -> None:
    red_sphere = "objects red filter_color sphere filter_shape unique"
    choices = [("a", possible(RED_CUBE, GREEN)), ("b", possible(RED_CUBE, red_sphere))]
    question = "unseen_events belong_to"
    assert [c.answer for c in Executor(small_scene).answer_choices(question, choices).choices] == ["wrong", "wrong"]
    scores = np.zeros((4, 4))
    scores[0, 3] = scores[3, 0] = 0.3
    scored = Executor(replace(small_scene, predicted_scores=scores), data_set_rules=True)
    assert [c.answer for c in scored.answer_choices(question, choices).choices] == ["wrong", "correct"]
    # Scores do not matter where the choices are judged differently, and for other questions.
    happens = [("c", possible(GREEN, red_sphere)), ("b", possible(RED_CUBE, red_sphere))]
    assert [c.answer for c in scored.answer_choices(question, happens).choices] == ["correct", "wrong"]
    assert [c.answer for c in scored.answer_choices(question + " negate", choices).choices] == ["correct", "correct"]


def test_the_rule_of_the_data_set_holds_only_where_it_is_asked_for(small_scene: Scene) -> None:
    red_sphere = "objects red filter_color sphere filter_shape unique"
    choices = [("a", possible(RED_CUBE, GREEN)), ("b", possible(RED_CUBE, red_sphere))]
    scene = replace(small_scene, predicted_scores=np.full((4, 4), 0.3), uncertain=())
    judged = Executor(scene).answer_choices("unseen_events belong_to", choices).choices
    assert [(c.answer, c.probability) for c in judged] == [("wrong", SIMULATED_DOUBT), ("wrong", SIMULATED_DOUBT)]
    ruled = Executor(scene, data_set_rules=True).answer_choices("unseen_events belong_to", choices).choices
    assert [c.answer for c in ruled] == ["correct", "wrong"]


def test_entrances_and_exits_after_the_video_or_without_an_object_are_refused(small_scene: Scene) -> None:
    """ "What will happen without the purple object?" - "The cyan sphere exits the scene"; only collisions are known."""
    scene = replace(small_scene, uncertain=())
    exits = f"all_events {GREEN} filter_out unique"
    for question in (
        *("unseen_events belong_to", "unseen_events belong_to negate"),
        *(
            f"all_events {RED_CUBE} get_counterfact belong_to",
            f"all_events {RED_CUBE} get_counterfact belong_to negate",
        ),
    ):
        choices = [
            ("it exits", exits),
            ("they collide", possible(GREEN, "objects red filter_color sphere filter_shape unique")),
        ]
        exiting, colliding = Executor(scene).answer_choices(question, choices).choices
        assert exiting.answer is None
        assert "exits" in exiting.error
        assert "only collisions are" in exiting.error
        assert colliding.answer in ("correct", "wrong")
        assert colliding.probability is not None
    with pytest.raises(ExecutionError, match="which objects exit"):
        Executor(scene).answer("unseen_events objects filter_out count")


def test_the_shortest_chain_of_causes_is_found_among_very_many() -> None:
    """Three objects that collide again and again: the number of chains grows exponentially."""
    pairs = ((0, 1), (1, 2), (0, 2))
    events = [Event("collision", f, pairs[f % 3]) for f in range(600)]
    path = causal_path(events, lambda e: e.frame == 0, events[-1])
    assert path is not None
    assert (path[0], path[-1]) == (events[0], events[-1])
    causes = direct_causes(events)
    assert all(events.index(a) in causes[events.index(b)] for a, b in pairwise(path))
    assert causal_path(events, lambda e: False, events[-1]) is None


@pytest.mark.parametrize(
    ("program", "answer", "correct", "wrong", "unreadable"),
    [
        (
            f"events {BLUE} filter_collision first filter_order get_frame",
            "frame 20",
            ["frame 20", "B. 20", "At frame 20."],
            ["frame 3", "(C) 30", "none of the above"],
            ["soon", "frame 20 or 30"],
        ),
        ("events objects cube filter_shape filter_out", "none", ["none", "A. None."], ["Not sure"], ["the cube exits"]),
        (
            f"{RED_CUBE} query_name",
            "red metal cube",
            ["The red metal cube", "It is the red metal cube."],
            ["the blue rubber sphere"],
            ["the red cube", "the red metal cube or the blue rubber sphere"],
        ),
        (
            "objects cube filter_shape count",
            "1",
            ["1 cube", "There is one cube."],
            ["2", "I can't tell"],
            ["none", "-1"],
        ),
        (
            f"{RED_CUBE} query_shape",
            "cube",
            ["The red cube", "a block"],
            ["B. The red ball"],
            ["red", "a cube or a ball"],
        ),
        ("objects red filter_color exist", "yes", ["Yes, 2 red ones."], ["No."], ["There is a red cube", "1", "red"]),
        (f"{RED_CUBE} query_color", "red", ["The cube is red."], ["A blue cube"], ["the cube", "red or blue", "3"]),
    ],
)
def test_candidates_are_read_by_what_is_asked_for(
    executor: Executor, program: str, answer: str, correct: list[str], wrong: list[str], unreadable: list[str]
) -> None:
    found = executor.answer(program, candidates=[*correct, *wrong, *unreadable])
    assert found.text == answer
    expected = ["correct"] * len(correct) + ["wrong"] * len(wrong) + [None] * len(unreadable)
    assert {c.choice: c.answer for c in found.choices} == {
        c.choice: word for c, word in zip(found.choices, expected, strict=True)
    }
    assert [bool(c.error) for c in found.choices] == [word is None for word in expected]
    assert bool(executor.answer(program, candidates=unreadable).notes)


def test_a_candidate_without_an_answer_says_what_is_expected(executor: Executor) -> None:
    errors = {
        "objects red filter_color count": "a number, such as 3",
        "objects red filter_color exist": "yes or no",
        f"{RED_CUBE} query_shape": "one shape: cube, sphere, cylinder",
    }
    for program, expected in errors.items():
        (choice,) = executor.answer(program, candidates=["The zebra"]).choices
        assert choice.error == f"says no answer that can be read; expected {expected}"


@pytest.mark.parametrize("side", ["before", "after"])
def test_of_what_is_simulated_only_collisions_are_known_before_or_after_an_event(small_scene: Scene, side: str) -> None:
    for events in ("unseen_events", f"events {RED_CUBE} get_counterfact"):
        part = f"{events} events {BLUE} filter_out unique filter_{side}"
        with pytest.raises(ExecutionError, match="only collisions are"):
            Executor(small_scene).run(f"{part} objects filter_out count")

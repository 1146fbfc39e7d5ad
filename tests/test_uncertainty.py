"""Uncertain collisions, and the probabilities of answers that follow from them."""

import doctest
import pickle
from dataclasses import replace

import numpy as np
import pytest

from nsdr import DataError, Event, ExecutionError, Executor, Scene, load, narrate, save
from nsdr.baselines.recording import keep_recording
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.evaluation import calibration
from nsdr.evaluation.experiments import markdown_table
from nsdr.evaluation.score import score_scenes
from nsdr.symbolic import probabilities
from nsdr.symbolic.probabilities import SIMULATED_DOUBT
from nsdr.symbolic.uncertainty import N_DRAWS, possible_scenes
from nsdr.tracking.tracker import existence
from nsdr.types import DynamicsPrediction, ObjectPhysics, Rollout, SceneObject, Track, UncertainEvent, VideoTracks
from nsdr.types.answers import ChoiceAnswer, format_probability
from nsdr.types.events import enter_exit_events

HIT = Event("collision", 20, (0, 1))
MAYBE = Event("collision", 80, (0, 2))
COUNT = "events objects filter_collision count"
RED_CUBE, BLUE, GREEN = (
    f"objects {word} filter_{kind} unique" for word, kind in (("cube", "shape"), ("blue", "color"), ("green", "color"))
)
RED_SPHERE = "objects red filter_color sphere filter_shape unique"
WITHOUT_BLUE = f"all_events {BLUE} get_counterfact belong_to"


def possible(one: str, other: str) -> str:
    return f"all_events {one} filter_collision {other} filter_collision unique"


@pytest.fixture
def unsure(small_scene: Scene) -> Scene:
    """The first collision happens with 75 %, another one with 25 %."""
    return replace(small_scene, uncertain=(UncertainEvent(HIT, 0.75), UncertainEvent(MAYBE, 0.25)))


def test_the_worked_example_is_right() -> None:
    assert doctest.testmod(probabilities) == (0, 13)


def test_uncertain_events_are_checked(small_scene: Scene) -> None:
    with pytest.raises(DataError, match=r"UncertainEvent: .*probability"):
        UncertainEvent(HIT, 1.5)
    with pytest.raises(DataError, match=r"UncertainEvent.event: expected an event at a frame"):
        UncertainEvent(Event("in", -1, (0,)), 0.5)
    with pytest.raises(DataError, match=r"Scene.uncertain: expected removed objects from 0 to 3, got 4"):
        replace(small_scene, uncertain=(UncertainEvent(HIT, 0.5, 4),))
    with pytest.raises(DataError, match="expected objects from 0 to 3 at a frame"):
        replace(small_scene, uncertain=(UncertainEvent(Event("collision", 3, (0, 7)), 0.5),))


def test_uncertain_collisions_survive_saving_and_old_files_have_none(unsure: Scene, tmp_path) -> None:
    scene = replace(unsure, uncertain=(*unsure.uncertain, UncertainEvent(HIT, 0.5, 3)))
    path = tmp_path / "scene.json"
    save(path, scene)
    assert load(path, Scene) == scene
    save(path, replace(scene, uncertain=None))
    path.write_text(path.read_text().replace(', "uncertain": null', ""))
    assert "uncertain" not in path.read_text()
    assert load(path, Scene).uncertain is None


def test_scenes_keep_the_uncertain_collisions_of_rollouts_that_are_in_view() -> None:
    objects = tuple(SceneObject(i, color, "metal", "cube") for i, color in enumerate(("red", "blue", "green")))
    visible = np.ones((3, 12), bool)
    visible[:2, 3:6] = False
    seen, later, hidden = Event("collision", 8, (0, 1)), Event("collision", 11, (0, 2)), Event("collision", 4, (0, 1))
    rollout = Rollout(
        np.zeros((3, 12, 2)),
        visible,
        (seen,),
        uncertain=(UncertainEvent(seen, 0.7), UncertainEvent(later, 0.2), UncertainEvent(hidden, 0.3)),
    )
    without = replace(rollout, collisions=(), uncertain=(UncertainEvent(seen, 0.4, 2),))
    prediction = DynamicsPrediction(objects, 10, rollout, {2: without})
    assert scene_from_prediction(prediction).uncertain == (
        UncertainEvent(seen, 0.7),
        UncertainEvent(later, 0.2),
        UncertainEvent(seen, 0.4, 2),
    )
    unknown = replace(prediction, counterfactual={2: replace(without, uncertain=None)})
    assert scene_from_prediction(unknown).uncertain is None
    assert keep_recording(scene_from_prediction(prediction)).uncertain is None


def test_possible_scenes_have_each_collision_as_often_as_its_probability_says(small_scene: Scene) -> None:
    later = Event("collision", 140, (0, 3))
    uncertain = (
        UncertainEvent(HIT, 0.75),
        UncertainEvent(MAYBE, 0.25),
        UncertainEvent(later, 0.5),
        UncertainEvent(HIT, 0.125, 2),
    )
    drawn = possible_scenes(replace(small_scene, uncertain=uncertain))
    assert sum(n for n, _ in drawn) == N_DRAWS

    def share(has) -> float:
        return sum(n for n, scene in drawn if has(scene)) / N_DRAWS

    assert share(lambda s: HIT in s.events) == 0.75
    assert share(lambda s: MAYBE in s.events) == 0.25
    assert share(lambda s: later in s.predicted) == 0.5
    assert share(lambda s: HIT in s.counterfactual[2]) == 0.125
    assert share(lambda s: HIT in s.counterfactual[3]) == 1.0  # that is certain
    assert all(s.uncertain is None for _, s in drawn)


def test_an_answer_is_as_probable_as_the_worlds_that_give_it(unsure: Scene, small_scene: Scene) -> None:
    executor = Executor(unsure)
    answer = executor.answer(COUNT)
    assert answer.answer == 2  # of the most probable world
    assert answer.probability == pytest.approx(0.75 * 0.75 + 0.25 * 0.25, abs=0.03)
    assert executor.answer("objects count").probability == 1.0
    assert Executor(small_scene).answer(COUNT).probability is None


def test_worlds_in_which_the_program_fails_are_left_out(unsure: Scene) -> None:
    partner = f"events {RED_CUBE} filter_collision unique {RED_CUBE} get_col_partner query_color"
    answer = Executor(unsure).answer(partner)
    assert answer.answer == "blue"
    assert answer.probability == pytest.approx(0.9, abs=0.01)  # with both or none, nothing is unique


def test_what_a_question_supposes_is_taken_to_have_happened(small_scene: Scene) -> None:
    """Red cube and green cylinder: the collision is not in the scene, but possible."""
    partner = f"events {GREEN} filter_collision {RED_CUBE} filter_collision unique {GREEN} get_col_partner query_color"
    why = f"events events {GREEN} filter_collision {RED_CUBE} filter_collision unique filter_ancestor belong_to"
    choices = [("the blue sphere", BLUE), ("the red cube", RED_CUBE)]
    likely = Executor(replace(small_scene, uncertain=(UncertainEvent(MAYBE, 0.3),)))
    answer = likely.answer(partner)
    assert (answer.answer, answer.probability) == ("red", 1.0)
    judged = likely.answer_choices(why, choices)
    assert [c.answer for c in judged.choices] == ["correct", "correct"]
    assert narrate(judged, likely.scene) == "<answer>A,B</answer>"  # of the scene's events none led to it
    for uncertain in (
        None,
        (),
        (UncertainEvent(MAYBE, 0.03),),
        (UncertainEvent(Event("collision", 80, (0, 3)), 0.3),),
    ):
        executor = Executor(replace(small_scene, uncertain=uncertain))
        with pytest.raises(ExecutionError, match="there is no collision"):
            executor.answer(partner)
        with pytest.raises(ExecutionError):
            executor.answer_choices(why, choices)


def test_what_a_choice_supposes_is_taken_to_have_happened(small_scene: Scene) -> None:
    """The blue sphere's collision with the red cube may have come from a collision that is not in the scene, but possible."""
    why = f"events events {RED_CUBE} filter_collision {BLUE} filter_collision unique filter_ancestor belong_to"
    choices = [
        ("the collision", f"events {RED_CUBE} filter_collision {RED_SPHERE} filter_collision unique"),
        ("green", GREEN),
    ]
    before = Event("collision", 10, (0, 3))

    def first(*uncertain: UncertainEvent) -> ChoiceAnswer:
        return Executor(replace(small_scene, uncertain=uncertain)).answer_choices(why, choices).choices[0]

    likely = first(UncertainEvent(before, 0.3))
    assert (likely.answer, likely.error, likely.probability) == ("correct", "", 1.0)
    assert before in {e for step in likely.trace for e in step.events}
    half = first(UncertainEvent(before, 0.3), UncertainEvent(Event("collision", 15, (0, 3)), 0.3))
    assert half.answer == "correct"  # in worlds with both, the choice fits two collisions
    for uncertain in ((), (UncertainEvent(before, 0.03),)):
        assert "there is no collision" in str(first(*uncertain).error)


def test_worlds_are_drawn_once(unsure: Scene, monkeypatch) -> None:
    calls = []
    real = possible_scenes
    monkeypatch.setattr("nsdr.symbolic.probabilities.possible_scenes", lambda s: calls.append(s) or real(s))
    executor = Executor(unsure)
    answer = executor.answer(COUNT)
    judged = executor.answer_choices(
        WITHOUT_BLUE, [("a", possible(RED_CUBE, GREEN)), ("b", possible(RED_CUBE, RED_SPHERE))]
    )
    assert pickle.loads(pickle.dumps(answer)) == answer
    assert (judged.choices[0].probability, executor.answer("objects count").probability) == (1 - SIMULATED_DOUBT, 1.0)
    assert len(calls) == 1


def test_a_choice_has_the_probability_that_it_is_correct(small_scene: Scene) -> None:
    uncertain = (
        UncertainEvent(Event("collision", 30, (0, 2)), 0.75, 1),
        UncertainEvent(Event("collision", 30, (0, 3)), 0.25, 1),
    )
    executor = Executor(replace(small_scene, uncertain=uncertain))
    single = executor.answer_choices(WITHOUT_BLUE, [("b", possible(RED_CUBE, RED_SPHERE))]).choices
    assert [(c.answer, c.probability) for c in single] == [("wrong", 0.25)]
    negated = executor.answer_choices(WITHOUT_BLUE + " negate", [("b", possible(RED_CUBE, RED_SPHERE))]).choices
    assert [(c.answer, c.probability) for c in negated] == [("correct", 0.75)]
    failing = executor.answer_choices(
        WITHOUT_BLUE, [("a", possible(RED_CUBE, GREEN)), ("b", "all_events unique")]
    ).choices
    assert [(c.answer, c.probability) for c in failing] == [("correct", 0.75), (None, None)]


def test_one_of_two_predictions_is_correct(small_scene: Scene) -> None:
    scores = np.zeros((4, 4))
    scores[0, 2] = scores[2, 0] = 0.1
    scores[0, 3] = scores[3, 0] = 0.3
    choices = [("a", possible(RED_CUBE, GREEN)), ("b", possible(RED_CUBE, RED_SPHERE))]
    scene = replace(small_scene, predicted_scores=scores, uncertain=())
    first, second = Executor(scene, data_set_rules=True).answer_choices("unseen_events belong_to", choices).choices
    assert (first.answer, second.answer) == ("wrong", "correct")
    assert second.probability == pytest.approx(0.3 * 0.9 / (0.3 * 0.9 + 0.1 * 0.7))
    assert first.probability == pytest.approx(1 - second.probability)
    equal = replace(scene, predicted_scores=np.zeros((4, 4)))
    nothing = Executor(equal, data_set_rules=True).answer_choices("unseen_events belong_to", choices).choices
    assert [c.probability for c in nothing] == [0.5, 0.5]
    one = np.zeros((4, 4))
    one[0, 3] = one[3, 0] = 1.0  # in all runs
    decided = replace(scene, predicted_scores=one)
    sure = Executor(decided, data_set_rules=True).answer_choices("unseen_events belong_to", choices).choices
    assert [c.probability for c in sure] == [SIMULATED_DOUBT, 1 - SIMULATED_DOUBT]


@pytest.mark.parametrize(
    ("answer", "probability", "text"),
    [
        ("correct", 0.98, " (98 %)"),
        ("wrong", 0.02, " (98 %)"),
        ("correct", 1.0, " (>99 %)"),
        ("correct", 0.001, " (<1 %)"),
        ("correct", None, ""),
        (None, 0.5, ""),
    ],
)
def test_probabilities_in_words(answer: str | None, probability: float | None, text: str) -> None:
    assert format_probability(ChoiceAnswer("a", answer, (), (), probability=probability)) == text


def test_calibration_of_statements() -> None:
    perfect = calibration([0.25] * 4 + [1.0] * 2, [True, False, False, False, True, True])
    assert perfect["ece"] == pytest.approx(0.0)
    assert perfect["brier"] == pytest.approx((0.75**2 + 3 * 0.25**2) / 6)
    assert (perfect["sure"], perfect["sure_wrong"]) == (2, 0)
    assert perfect["bins"] == [[0.25, 0.25, 4], [1.0, 1.0, 2]]
    sure = calibration([1.0, 1.0, 0.0, 0.0], [True, False, False, False])
    assert sure["ece"] == pytest.approx(0.5 * 0.5)
    assert (sure["sure"], sure["sure_wrong"]) == (4, 1)


def test_reports_have_the_calibration_of_answers_and_options(unsure: Scene) -> None:
    choices = (
        Choice(0, "a", tuple(possible(RED_CUBE, GREEN).split()), "correct"),
        Choice(1, "b", tuple(possible(RED_CUBE, RED_SPHERE).split()), "correct"),
    )
    questions = (
        Question(0, "How many?", "descriptive", "count", tuple(COUNT.split()), "2", ()),
        Question(1, "Without blue?", "counterfactual", None, tuple(WITHOUT_BLUE.split()), None, choices),
    )
    report = score_scenes([(SceneQuestions(7, "video_00007.mp4", questions), Executor(unsure))])
    descriptive, counterfactual = report.results
    p = descriptive["probability"]
    assert report["descriptive"]["calibration"]["bins"] == [[p, 1.0, 1]]
    assert [c["probability"] for c in counterfactual["choices"]] == [1 - SIMULATED_DOUBT, SIMULATED_DOUBT]
    # The second option was judged wrong, and is correct.
    brier = (SIMULATED_DOUBT**2 + (1 - SIMULATED_DOUBT) ** 2) / 2
    assert report["counterfactual"]["calibration"]["brier"] == pytest.approx(brier)
    assert "calibration" not in report["explanatory"]
    text = f"expected calibration error (Brier score): descriptive {100 * (1 - p):.1f} %"
    assert text in str(report)


def test_tables_of_experiments_say_how_calibrated_their_rows_are() -> None:
    table = {"descriptive": {"accuracy": 0.9, "n": 7, "calibration": {"ece": 0.0123, "brier": 0.05}}}
    for kind in ("explanatory", "predictive", "counterfactual"):
        table[kind] = {"per_option": None, "per_question": None, "n_questions": 0}
    row = {"settings": {"name": "ours"}, "table": table}
    plain = {"settings": {"name": "published"}, "table": table | {"descriptive": {"accuracy": 0.9, "n": 7}}}
    text = markdown_table("title", "command", [row, plain])
    assert text.endswith("(Brier score):\n\n- ours: descriptive 1.2 % (0.050)\n")
    assert "calibration" not in markdown_table("title", "command", [plain])


@pytest.fixture
def perceived(small_scene: Scene) -> Scene:
    """The scene as it was seen: all objects are certain."""
    return replace(small_scene, uncertain=(), existence=np.ones(4))


def drawn_share(scene: Scene, has) -> float:
    return sum(n for n, one in possible_scenes(scene) if has(one)) / N_DRAWS


def test_in_a_perceived_scene_frames_of_events_may_be_off(perceived: Scene) -> None:
    hits = [e.frame for e in perceived.events if e.objects == HIT.objects]
    assert hits == [HIT.frame]

    def frame(scene: Scene) -> int:
        return next(e.frame for e in scene.events if e.objects == HIT.objects)

    assert drawn_share(perceived, lambda s: frame(s) == HIT.frame) == pytest.approx(0.82, abs=0.002)
    assert drawn_share(perceived, lambda s: frame(s) == HIT.frame + 1) == pytest.approx(0.083, abs=0.002)
    entrance = next(e for e in perceived.events if e.kind == "in")
    (i,), f = entrance.objects, entrance.frame
    later = drawn_share(perceived, lambda s: Event("in", f + 1, (i,)) in s.events and not s.visible[i, f])
    assert later == pytest.approx(0.083, abs=0.002)
    earlier = drawn_share(perceived, lambda s: Event("in", f - 1, (i,)) in s.events and s.visible[i, f - 1])
    assert earlier == pytest.approx(0.083, abs=0.002)
    exact = possible_scenes(perceived, collisions_only=True)
    assert [n for n, _ in exact] == [N_DRAWS]
    assert exact[0][1].events == perceived.events


def test_an_entrance_before_the_second_frame_is_none() -> None:
    objects = (SceneObject(0, "red", "metal", "cube"),)
    visible = np.ones((1, 9), bool)
    visible[0, 0] = False
    scene = Scene(objects, 9, visible, None, (Event("in", 1, (0,)),), uncertain=(), existence=np.ones(1))
    there = drawn_share(scene, lambda s: not s.events and s.visible.all())
    assert there == pytest.approx(0.09, abs=0.002)
    answer = Executor(scene).answer("events objects filter_in count")
    assert (answer.answer, answer.probability) == (1, pytest.approx(0.91, abs=0.002))


def test_events_and_visibility_of_a_drawn_scene_agree(perceived: Scene) -> None:
    """An object is seen in two frames, and hits another one where it enters."""
    visible = perceived.visible.copy()
    visible[3] = False
    visible[3, 50:52] = True
    meets = Event("collision", 50, (2, 3))
    border = (Event("in", 50, (3,)), Event("out", 52, (3,)), Event("out", 60, (1,)))
    scene = replace(perceived, visible=visible, events=(*border, HIT, meets))
    for _, world in possible_scenes(scene):
        at_border = [e for e in world.events if e.kind != "collision"]
        assert sorted(map(str, at_border)) == sorted(map(str, enter_exit_events(world.visible)))
        for event in world.events:
            assert event.kind == "out" or world.visible[list(event.objects), event.frame].all()
    assert drawn_share(scene, lambda s: any(e.objects == meets.objects for e in s.events)) > 0.9


def test_an_object_may_not_be_there(perceived: Scene) -> None:
    """With it, its events go; the other objects are renumbered."""
    unsure = replace(perceived, existence=np.array([1, 0.75, 1, 1]))
    gone = [s for _, s in possible_scenes(unsure) if len(s.objects) == 3]
    assert gone
    for world in gone:
        assert [o.name for o in world.objects] == ["red metal cube", "green rubber cylinder", "red rubber sphere"]
        assert [(e.kind, e.objects) for e in world.events] == [("in", (2,))]
        assert [e.objects for e in world.predicted] == [(1, 2)]
        assert {k: [e.objects for e in of] for k, of in world.counterfactual.items()} == {0: [(1, 2)], 1: [], 2: []}
    assert drawn_share(unsure, lambda s: len(s.objects) == 3) == 0.25
    answer = Executor(unsure).answer("objects count")
    assert (answer.answer, answer.probability) == (4, 0.75)


def test_lists_of_events_are_right_whatever_ids_and_frames_are(perceived: Scene) -> None:
    unsure = replace(perceived, existence=np.array([0.75, 1, 1, 1]))
    answer = Executor(unsure).answer(f"events {GREEN} filter_collision")
    assert (answer.answer, answer.probability) == (
        "the blue rubber sphere and the green rubber cylinder collide (frame 40)",
        1.0,
    )
    answer = Executor(unsure).answer("events objects filter_collision")
    assert answer.probability == 0.75


def test_motion_near_the_limit_is_uncertain() -> None:
    objects = tuple(SceneObject(i, color, "metal", "cube") for i, color in enumerate(("red", "blue", "green")))
    speed = np.array([0.03, 0.5, 0.0])[:, None] * np.ones(6)
    physics = ObjectPhysics(np.stack([speed, np.zeros((3, 6))], -1), 0.02)
    scene = Scene(objects, 6, np.ones((3, 6), bool), speed > 0.02, (), uncertain=(), physics=physics)
    assert Executor(scene).answer("objects null filter_moving count").probability == 1.0
    seen = replace(scene, existence=np.ones(3))
    answer = Executor(seen).answer("objects null filter_moving count")
    assert (answer.answer, answer.probability) == (2, pytest.approx(0.6, abs=0.002))


def test_objects_that_enter_at_the_end_are_uncertain() -> None:
    def track(color: str, frames: list[int], shape: str = "cube") -> Track:
        n = len(frames)
        thing = SceneObject(["red", "blue", "green", "gray"].index(color), color, "metal", shape)
        box = np.tile([10, 10, 50, 50], (n, 1))
        return Track(thing, np.array(frames), np.zeros((n, 2)), np.full((n, 2), 30.0), box, np.ones(n))

    every_third = track("red", [0, 3, 6, 9, 11]), track("blue", [11]), track("green", [9, 11]), track("gray", [3])
    found = existence(VideoTracks(12, every_third))
    np.testing.assert_allclose(found, [1, 0.5, 0.75, 1])
    assert existence(VideoTracks(12, (*every_third[:3], track("gray", [11], "sphere"))))[3] == 1
    assert existence(VideoTracks(2, (track("red", [0, 1]),))) == [1]  # in every frame of a short video
    rollout = Rollout(np.zeros((4, 12, 2)), np.ones((4, 12), bool), (), uncertain=())
    prediction = DynamicsPrediction(tuple(t.object for t in every_third), 12, rollout)
    assert scene_from_prediction(prediction).existence is None
    assert (scene_from_prediction(prediction, found).existence == found).all()

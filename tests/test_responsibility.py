"""The two meanings of "responsible"."""

import json
from dataclasses import replace

import pytest

from nsdr import Event, ExecutionError, Executor, Scene, explain, save
from nsdr.cli.main import main
from nsdr.symbolic import but_for
from nsdr.types import UncertainCollision

SECOND, EXIT = Event("collision", 40, (1, 2)), Event("out", 60, (1,))
CUBE = "objects cube filter_shape unique"
RED_SPHERE = "objects red filter_color sphere filter_shape unique"
WHY = (
    "events events objects blue filter_color filter_collision objects green filter_color filter_collision unique "
    "filter_ancestor belong_to"
)


def in_vain(scene: Scene) -> Scene:
    """The scene in which the second collision happens without the red cube, too, and not without the red sphere."""
    counterfactual = dict(scene.counterfactual)
    counterfactual[0] = (Event("collision", 45, (1, 2)),)
    counterfactual[3] = (Event("collision", 20, (0, 1)),)
    return replace(scene, counterfactual=counterfactual)


@pytest.mark.parametrize(
    ("candidate", "needed"),
    [
        (0, True),  # without it there is no second collision
        (1, True),  # takes part
        (3, False),
        (Event("collision", -1, (0, 1)), True),
        (Event("collision", -1, (1, 2)), False),  # nothing is responsible for itself
        (Event("collision", -1, (0, 3)), False),  # did not happen
        (Event("in", -1, (3,)), False),
        (Event("out", -1, (1,)), False),  # later
    ],
)
def test_needed_for_a_collision(small_scene: Scene, candidate: Event | int, needed: bool) -> None:
    assert but_for(small_scene, SECOND, candidate) is needed


def test_what_is_not_known(small_scene: Scene) -> None:
    assert but_for(small_scene, EXIT, 3) is False  # the same collisions lead to it
    assert but_for(small_scene, EXIT, 0) is None  # other collisions, and no motion of that world
    assert but_for(small_scene, EXIT, 1) is True
    assert but_for(replace(small_scene, counterfactual=None), SECOND, 0) is None
    again = (*small_scene.events, Event("collision", 35, (0, 3)))
    busy = replace(small_scene, events=again)
    assert (
        but_for(busy, SECOND, Event("collision", -1, (0, 1))) is None
    )  # the cube's other collision may be the needed one
    assert but_for(in_vain(busy), SECOND, Event("collision", -1, (0, 1))) is False


def test_a_choice_carries_both_meanings(small_scene: Scene) -> None:
    scene = in_vain(small_scene)
    choices = [("the cube", CUBE), ("the red sphere", RED_SPHERE)]
    chain = Executor(scene).judge(WHY, choices).choices
    needed = Executor(scene, responsible="but_for").judge(WHY, choices).choices
    assert [c.answer for c in chain] == ["correct", "wrong"]
    assert [c.answer for c in needed] == ["wrong", "correct"]
    assert chain[0].meanings == needed[0].meanings == {"chain": True, "but_for": False}
    negated = Executor(scene, responsible="but_for").judge(WHY + " negate", choices).choices
    assert [c.answer for c in negated] == ["correct", "wrong"]
    assert explain(chain[0], scene).endswith("; by the causal chain (by what would have happened without it: wrong)")
    assert explain(needed[0], scene).endswith("; by what would have happened without it (by the causal chain: correct)")
    other = Executor(scene).judge("unseen_events belong_to", [("hit", "all_events unique")])
    assert other.choices[0].meanings == {}


def test_a_choice_fails_where_it_is_not_known(small_scene: Scene) -> None:
    why = "events events objects blue filter_color filter_out unique filter_ancestor belong_to"
    choice = Executor(small_scene, responsible="but_for").judge(why, [("the cube", CUBE)]).choices[0]
    assert choice.answer is None
    assert "not known in this scene" in choice.error
    assert Executor(small_scene).judge(why, [("the cube", CUBE)]).choices[0].answer == "correct"


def test_probabilities_are_of_the_meaning(small_scene: Scene) -> None:
    unsure = replace(small_scene, uncertain=(UncertainCollision(Event("collision", 45, (1, 2)), 0.25, 0),))
    choices = [("the cube", CUBE)]
    assert Executor(unsure).judge(WHY, choices).choices[0].probability == 1
    assert Executor(unsure, responsible="but_for").judge(WHY, choices).choices[0].probability == 0.75


def test_unknown_meanings_are_refused(small_scene: Scene) -> None:
    with pytest.raises(ExecutionError, match="'fault'; expected chain or but_for"):
        Executor(small_scene, responsible="fault")


def test_from_the_command_line(small_scene: Scene, tmp_path, capsys) -> None:
    save(in_vain(small_scene), tmp_path / "scene.json")
    ask = ["answer", str(tmp_path / "scene.json"), "-c", "the cube", "-q"]
    ask += ["What is responsible for the collision between the blue sphere and the green cylinder?"]
    assert main(ask) == 0
    assert "correct  the cube (by what would have happened without it: wrong)" in capsys.readouterr().out
    assert main([*ask, "--responsible", "but_for", "--json"]) == 0
    choice = json.loads(capsys.readouterr().out)["choices"][0]
    assert (choice["answer"], choice["meanings"]) == ("wrong", {"chain": True, "but_for": False})

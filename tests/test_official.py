"""The quirks of the released executor, one row each, on a small prediction file."""

from typing import Any

import pytest

from nsdr import DataError, ExecutionError, Executor, Scene
from nsdr.clevrer.predictions import check_predictions, predictions_document, read_predictions, scene_from_predictions
from nsdr.clevrer.velocity_rule import velocity_collisions
from nsdr.io.files import write_json
from nsdr.symbolic.official import official_world

from .test_dynamics import SMALL, _Script, tracks

A = {"color": "red", "material": "metal", "shape": "cube"}
B = {"color": "blue", "material": "rubber", "shape": "sphere"}
C = {"color": "green", "material": "rubber", "shape": "cylinder"}
GHOST = {"color": "yellow", "material": "metal", "shape": "cube"}


def sample(frame: int) -> dict[str, Any]:
    """A moves slowly and accelerates after the video; B enters at 10 and leaves at 60; C appears only after the video."""
    objects = [{"x": 10.0 + (0.05 * frame if frame <= 125 else 6.25 + 3.0 * (frame - 125)), "y": 20.0, **A}]
    if 10 <= frame < 60:
        objects.append({"x": 30.0, "y": 10.0 + 1.0 * frame, **B})
    if frame >= 140:
        objects.append({"x": 50.0, "y": 50.0, **C})
    return {"frame_index": frame, "objects": objects}


@pytest.fixture
def document() -> dict[str, Any]:
    trajectory = [sample(frame) for frame in range(0, 190, 5)]
    hits = [
        {"frame": 40, "objects": [A, B]},
        {"frame": 33, "objects": [A, B]},  # a second time, earlier: both stay
        {"frame": 50, "objects": [A, GHOST]},  # no such object
        {"frame": 150, "objects": [A, C]},
    ]
    without_c = [{"frame": 20, "objects": [B, A]}, {"frame": 170, "objects": [A, B]}]
    predictions = [
        {"what_if": -1, "trajectory": trajectory, "collisions": hits},
        {"what_if": 0, "trajectory": [], "collisions": []},
        {"what_if": 1, "trajectory": [], "collisions": [{"frame": 175, "objects": [A, C]}]},
        {"what_if": 2, "trajectory": [], "collisions": without_c},
    ]
    return {"objects": [{"id": i, **o} for i, o in enumerate((A, B, C))], "predictions": predictions}


RED, BLUE, GREEN = (f"objects {c} filter_color unique" for c in ("red", "blue", "green"))

ROWS = [
    ("collisions are not deduplicated", "events objects filter_collision count", "2"),
    ("collisions are in order of time", f"events {RED} filter_collision first filter_order get_frame", "frame 33"),
    ("enter at the first sample with the object", f"events {BLUE} filter_in unique get_frame", "frame 10"),
    ("leave at the first sample without it", f"events {BLUE} filter_out unique get_frame", "frame 60"),
    ("unseen entrances never match", "events objects filter_in count", "1"),
    ("unseen entrances do not match among unseen events", "unseen_events objects filter_in exist", "no"),
    ("unseen collisions match", f"unseen_events {GREEN} filter_collision exist", "yes"),
    ("the end is frame 125", "end get_frame", "frame 125"),
    ("at 125 the forward difference uses a predicted sample", "objects end get_frame filter_moving count", "1"),
    ("at 0 it moves at 0.05 per frame: at rest", "objects start get_frame filter_stationary count", "1"),
    ("null: movement after the video counts", "objects null filter_moving count", "2"),
    ("null: visible in the video only", "objects null filter_stationary count", "0"),
    (
        "motion at a frame between samples",
        f"objects events {RED} filter_collision first filter_order get_frame filter_moving count",
        "error",
    ),
    ("a count of a frame", f"events {RED} filter_collision last filter_order get_frame count", "error"),
    ("motion at a frame with a sample", f"objects events {BLUE} filter_in unique get_frame filter_moving count", "1"),
    ("start is skipped, the end token stops", "<START> objects count <END> objects nonsense", "3"),
    ("so does the null token", "objects count <NULL> exist", "3"),
    ("unknown tokens are values", "objects count nonsense", "nonsense"),
    ("unknown tokens fit no module", "objects nonsense filter_color count", "error"),
    ("what is left below the top is ignored", "objects objects count", "3"),
    ("missing arguments", "count", "error"),
    ("an empty program", "", "error"),
    ("unique of several", "objects unique query_color", "error"),
    ("an empty filter_end is no event", "objects filter_end get_frame", "error"),
    ("a number where filter_before wants an event", "events objects count filter_before count", "error"),
    ("direction", f"{BLUE} events {BLUE} filter_in unique get_frame query_direction", "up"),
    ("no direction where it is absent", f"{GREEN} start get_frame query_direction", "error"),
    ("counterfactual collisions count at any frame", f"all_events {BLUE} get_counterfact count", "1"),
    ("pairs, not times", f"all_events {GREEN} get_counterfact count", "1"),
    ("the released executor's names", "objects events filter_end query_frame filter_resting count", "0"),
    ("the released executor's shortcut", f"{GREEN} counterfact_events count", "1"),
]


@pytest.mark.parametrize(("quirk", "program", "answer"), ROWS)
def test_quirk(document: dict[str, Any], quirk: str, program: str, answer: str) -> None:
    assert Executor(document, "official").answer(program).answer == answer, quirk


def test_taking_part_is_not_being_responsible(document: dict[str, Any]) -> None:
    question = f"events events {RED} filter_collision first filter_order filter_ancestor belong_to"
    judge = Executor(document, "official").judge(question, [("blue", BLUE), ("red", RED), ("green", GREEN)])
    # Blue entered before: that is an ancestor. Red has no earlier event.
    assert [c.answer for c in judge.choices] == ["correct", "wrong", "wrong"]
    failed = Executor(document, "official").judge(question, [("yellow", "objects yellow filter_color unique")])
    assert failed.choices[0].answer == "error"


def test_semantics_and_scene_must_fit(document: dict[str, Any], small_scene: Scene) -> None:
    with pytest.raises(
        ExecutionError, match="the official semantics runs on the content of a prediction file, got a Scene"
    ):
        Executor(small_scene, "official")
    with pytest.raises(ExecutionError, match="the paper semantics runs on a Scene, got a dict"):
        Executor(document, "paper")
    with pytest.raises(DataError, match="not a prediction file"):
        official_world({"objects": []})
    with pytest.raises(DataError, match="expected predicted or velocity"):
        official_world(document, "guessed")


def test_collisions_from_velocities() -> None:
    # 0 moves to the right and reverses at frame 20 next to 1, which is at rest; 2 is far away.
    reversing = {t: (50.0, 10.0 + t if t <= 20 else 50.0 - t) for t in range(0, 50, 5)}
    resting = dict.fromkeys(range(0, 50, 5), (50.0, 40.0))
    far = dict.fromkeys(range(0, 50, 5), (90.0, 140.0))
    (event,) = velocity_collisions([reversing, resting, far])
    assert (event.objects, event.frame) == ((0, 1), 20)
    assert velocity_collisions([reversing, far]) == []


def test_ne_replaces_the_predicted_collisions(document: dict[str, Any]) -> None:
    ne = Executor(document, "official", collisions="velocity")
    assert ne.answer("events objects filter_collision count").answer == "0"


def test_paper_semantics_of_the_same_file(document: dict[str, Any]) -> None:
    scene = scene_from_predictions(document)
    executor = Executor(scene)
    assert executor.run("events objects filter_collision count") == 1
    assert executor.run("end get_frame") == 127
    assert executor.run("events objects filter_out count") == 1
    assert [e.frame for e in scene.unseen or ()] == [150]
    assert {k: len(v) for k, v in (scene.counterfactual or {}).items()} == {0: 0, 1: 1, 2: 1}


def test_our_predictions_are_written_as_a_prediction_file(tmp_path) -> None:
    from nsdr import StatePredictor

    prediction = StatePredictor(_Script(SMALL)).predict(tracks(128))
    written = predictions_document(prediction)
    check_predictions(written)
    write_json(tmp_path / "sim_00000.json", written)
    back = read_predictions(tmp_path / "sim_00000.json")
    assert [p["what_if"] for p in back["predictions"]] == [-1, 0, 1, 2]
    assert [s["frame_index"] for s in back["predictions"][0]["trajectory"]] == list(range(0, 180, 5))
    hits = [e.objects for e in prediction.observed.collisions if e.frame < 128]
    scene = scene_from_predictions(back)
    assert [e.objects for e in scene.events if e.kind == "collision"] == hits


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("objects"), "file: missing key 'objects'"),
        (lambda d: d["objects"][0].update(color="pink"), r"objects\[0\]\.color: 'pink'; expected one of gray"),
        (lambda d: d["predictions"][0].update(what_if=0), r"predictions\[0\]\.what_if: expected -1"),
        (lambda d: d["predictions"][1].update(what_if=7), r"predictions\[1\]\.what_if: expected 0 to 2, got 7"),
        (
            lambda d: d["predictions"][0]["trajectory"][2]["objects"][0].pop("x"),
            r"predictions\[0\]\.trajectory\[2\]\.objects\[0\]: missing key 'x'",
        ),
        (
            lambda d: d["predictions"][0]["collisions"][0]["objects"].pop(),
            r"predictions\[0\]\.collisions\[0\]\.objects: expected 2 objects, got 1",
        ),
    ],
)
def test_malformed_prediction_files_name_the_location(document, tmp_path, change, message) -> None:
    change(document)
    write_json(tmp_path / "sim.json", document)
    with pytest.raises(DataError, match=rf"sim\.json: {message}"):
        read_predictions(tmp_path / "sim.json")

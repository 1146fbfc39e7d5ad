"""The quirks of the released executor, one row each, on a small prediction file."""

import gzip
import json
from typing import Any

import numpy as np
import pytest

from nsdr import DataError, Event, ExecutionError, Executor, Rollout, SceneObject
from nsdr.clevrer.example import TRUTH
from nsdr.clevrer.files.predictions import (
    PredictionFile,
    predictions_document,
    read_predictions,
    scene_from_predictions,
)
from nsdr.clevrer.velocity_rule import sampled_velocity, velocity_collisions
from nsdr.cli.main import main
from nsdr.dynamics import states_from_tracks
from nsdr.io.files import write_json
from nsdr.symbolic import OfficialExecutor, format_trace
from nsdr.types import DynamicsPrediction
from nsdr.validation import convert

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


def executor_of(document: dict[str, Any], collisions: str = "predicted") -> OfficialExecutor:
    return OfficialExecutor(convert(document, PredictionFile), collisions)


RED, BLUE, GREEN = (f"objects {c} filter_color unique" for c in ("red", "blue", "green"))

ROWS = [
    ("collisions are not deduplicated, those of unknown objects count", "events objects filter_collision count", "3"),
    ("start, end, an entrance, an exit and three collisions", "events count", "7"),
    ("possible events are collisions", "all_events count", "3"),
    ("they have no frame", "all_events first filter_order get_frame", "error"),
    ("unseen entrances are listed", "unseen_events count", "2"),
    ("an exit can be compared with unseen events", f"events {BLUE} filter_out unique unseen_events belong_to", "no"),
    ("an entrance cannot if one entered", f"events {BLUE} filter_in unique unseen_events belong_to", "error"),
    ("the first event is the start", "events first filter_order get_frame", "0"),
    ("the start anywhere", "events objects filter_in filter_start get_frame", "error"),
    (
        "the start of events before another",
        f"events events {BLUE} filter_in unique filter_before filter_start get_frame",
        "0",
    ),
    ("start and end have no counterfactual", f"events {GREEN} get_counterfact count", "error"),
    ("an unknown partner", f"events {RED} filter_collision last filter_order {RED} get_col_partner", "-1"),
    ("has no color", f"events {RED} filter_collision last filter_order {RED} get_col_partner query_color", "error"),
    ("an object is its number", GREEN, "2"),
    ("objects and frames are numbers", f"objects {RED} filter_moving count", "0"),
    ("collisions are in order of time", f"events {RED} filter_collision first filter_order get_frame", "33"),
    ("enter at the first sample with the object", f"events {BLUE} filter_in unique get_frame", "10"),
    ("leave at the first sample without it", f"events {BLUE} filter_out unique get_frame", "60"),
    ("unseen entrances never match", "events objects filter_in count", "1"),
    ("unseen entrances do not match among unseen events", "unseen_events objects filter_in exist", "no"),
    ("unseen collisions match", f"unseen_events {GREEN} filter_collision exist", "yes"),
    ("the end is frame 125", "end get_frame", "125"),
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
    ("in small letters, too", "<start> objects count <end> objects", "3"),
    ("so does the null token", "objects count <NULL> exist", "3"),
    ("unknown tokens are values", "objects count nonsense", "nonsense"),
    ("so are those beyond CLEVRER", "objects null filter_fastest", "filter_fastest"),
    ("what is left below, and sets that are empty", "objects yellow filter_color objects count", "3"),
    ("a number of no object", "objects count null filter_moving count", "error"),
    ("unknown tokens fit no module", "objects nonsense filter_color count", "error"),
    ("what is left below the top is ignored", "objects objects count", "3"),
    ("missing arguments", "count", "error"),
    ("an empty program", "", "error"),
    ("unique of several", "objects unique query_color", "error"),
    ("an empty filter_end is no event", "objects filter_end get_frame", "error"),
    ("a number where filter_before wants an event", "events objects count filter_before count", "error"),
    ("direction", f"{BLUE} events {BLUE} filter_in unique get_frame query_direction", "right"),
    ("row numbers grow downwards", f"{RED} start get_frame query_direction", "down"),
    ("no direction where it is absent", f"{GREEN} start get_frame query_direction", "error"),
    ("counterfactual collisions count at any frame", f"all_events {BLUE} get_counterfact count", "1"),
    ("pairs, not times", f"all_events {GREEN} get_counterfact count", "1"),
    ("the released executor's names", "objects events filter_end query_frame filter_resting count", "0"),
    ("the released executor's shortcut, not deduplicated", f"{GREEN} counterfact_events count", "2"),
]


@pytest.mark.parametrize(("quirk", "program", "answer"), ROWS)
def test_quirk(document: dict[str, Any], quirk: str, program: str, answer: str) -> None:
    assert executor_of(document).answer(program).text == answer, quirk


def test_failures_are_the_answer_error(document: dict[str, Any]) -> None:
    executor = executor_of(document)
    assert executor.run("objects unique") == "error"
    assert executor.run("count") == "error"
    programs = ["objects count", "", "objects objects unique", "objects exist"]
    assert [executor.run(program) for program in programs] == [3, "error", "error", True]
    assert executor.answer("count").answer == "error"
    question = "<START> unseen_events belong_to <END>"
    choices = [("text", choice) for choice in ("count", "", "objects boggle", f"<START> {GREEN} <NULL>", RED)]
    judged = executor.answer_choices(question, choices)
    assert [c.answer for c in judged.choices] == ["error", "error", "error", "correct", "correct"]
    assert judged.choices[3].program == ("objects", "green", "filter_color", "unique", "unseen_events", "belong_to")
    assert [c.answer for c in executor.answer_choices("belong_to count", choices).choices] == ["error"] * 5


def test_objects_that_enter_at_one_sample_keep_the_order_of_the_file() -> None:
    rows = [{"x": 10.0, "y": 10.0, **o} for o in (C, A, B)]
    shown = [[], rows, rows[1:], []]
    trajectory = [{"frame_index": 5 * s, "objects": listed} for s, listed in enumerate(shown)]
    objects = [{"id": i, **o} for i, o in enumerate((A, B, C))]
    prediction = {"what_if": -1, "trajectory": trajectory, "collisions": []}
    executor = executor_of({"objects": objects, "predictions": [prediction]})
    entered = "events objects filter_in {} filter_order get_object query_color"
    assert [executor.run(entered.format(order)) for order in ("first", "second", "last")] == ["green", "red", "blue"]
    left = "events objects filter_out {} filter_order get_object query_color"
    assert [executor.run(left.format(order)) for order in ("first", "second", "last")] == ["green", "red", "blue"]


def test_the_trace_of_an_answer(document: dict[str, Any]) -> None:
    answer = executor_of(document).answer(f"events {BLUE} filter_in unique get_frame")
    lines = format_trace(answer.trace).splitlines()
    assert lines[0].split(maxsplit=2)[2].startswith("start (frame 0); blue rubber sphere in (frame 10); ")
    assert "red metal cube and unknown object collision (frame 50)" not in lines[0]
    assert "unknown object and red metal cube collision (frame 50)" in lines[0]
    assert lines[-2:] == [
        "  7  unique(6)                  blue rubber sphere in (frame 10)",
        "  8  get_frame(7)               10",
    ]


def test_taking_part_is_not_being_responsible(document: dict[str, Any]) -> None:
    question = f"events events {RED} filter_collision first filter_order filter_ancestor belong_to"
    judge = executor_of(document).answer_choices(question, [("blue", BLUE), ("red", RED), ("green", GREEN)])
    # Blue entered before: that is an ancestor. Red has no earlier event.
    assert [c.answer for c in judge.choices] == ["correct", "wrong", "wrong"]
    failed = executor_of(document).answer_choices(question, [("yellow", "objects yellow filter_color unique")])
    assert failed.choices[0].answer == "error"


def test_executors_and_what_they_run_on_must_fit(document: dict[str, Any]) -> None:
    with pytest.raises(ExecutionError, match="programs run on a Scene, got a PredictionFile"):
        Executor(convert(document, PredictionFile))  # type: ignore[arg-type]
    with pytest.raises(DataError, match="`predictions`"):
        executor_of({"objects": []})
    with pytest.raises(DataError, match="collisions: expected one of predicted, velocity, got"):
        executor_of(document, "guessed")


def test_collisions_from_velocities() -> None:
    # 0 moves to the right and stops at frame 20 next to 1, which is at rest; 2 is far away.
    stopping = {t: (50.0, 10.0 + min(t, 20)) for t in range(0, 50, 5)}
    resting = dict.fromkeys(range(0, 50, 5), (50.0, 40.0))
    far = dict.fromkeys(range(0, 50, 5), (90.0, 140.0))
    assert sampled_velocity(stopping, 0, 5) == (0.0, 1.0)
    assert sampled_velocity(stopping, 20, 5) == (0.0, 0.5)
    assert sampled_velocity({5: (1.0, 1.0)}, 5, 5) == (0.0, 0.0)
    # The velocity is 1, 0.5, 0 at 15, 20, 25: its changes at 20 and 25 are equal, so neither is a maximum.
    assert velocity_collisions([stopping, resting, far], 5) == []
    # It stops a little after 20: the change at 25 is the larger one.
    later = stopping | dict.fromkeys(range(25, 50, 5), (50.0, 31.0))
    (event,) = velocity_collisions([later, resting, far], 5)
    assert (event.objects, event.frame) == ((0, 1), 25)
    assert velocity_collisions([later, far], 5) == []


def test_the_last_samples_change_is_compared_too() -> None:
    # It reverses at the last but one sample. The change there is 1.4 after steps of 2 and 1.8, 1.3 after 1.8 and 2; that at
    # the last sample, whose velocity is that of the last step alone, is 1.3 and 1.4.
    larger = {0: (50.0, 10.0), 5: (50.0, 20.0), 10: (50.0, 29.0), 15: (50.0, 25.0)}
    smaller = larger | {5: (50.0, 19.0)}
    resting = dict.fromkeys(larger, (50.0, 35.0))
    assert velocity_collisions([larger, resting], 5) == [Event("collision", 10, (0, 1))]
    assert velocity_collisions([smaller, resting], 5) == []


def test_ne_replaces_the_predicted_collisions(document: dict[str, Any]) -> None:
    ne = executor_of(document, collisions="velocity")
    assert ne.answer("events objects filter_collision count").answer == 0


def test_paper_semantics_of_the_same_file(document: dict[str, Any]) -> None:
    scene = scene_from_predictions(convert(document, PredictionFile))
    executor = Executor(scene)
    assert executor.run("events objects filter_collision count") == 1
    assert executor.run("end get_frame") == 127
    assert executor.run("events objects filter_out count") == 1
    assert [e.frame for e in scene.predicted or ()] == [150]
    assert {k: len(v) for k, v in (scene.counterfactual or {}).items()} == {0: 0, 1: 1, 2: 1}


def test_our_predictions_are_written_as_a_prediction_file(tmp_path) -> None:
    from nsdr import PropNetPredictor

    prediction = PropNetPredictor(_Script(SMALL)).explain(states_from_tracks(tracks(128))).prediction
    written = predictions_document(prediction)
    convert(written, PredictionFile)
    write_json(tmp_path / "sim_00000.json", written)
    back = read_predictions(tmp_path / "sim_00000.json")
    assert [p.what_if for p in back.predictions] == [-1, 0, 1, 2]
    for p in back.predictions:
        assert [s.frame_index for s in p.trajectory] == list(range(0, 190, 5))
        assert all(c.frame % 5 == 0 for c in p.collisions)
    hits = [e.objects for e in prediction.observed.collisions if e.frame < 128]
    scene = scene_from_predictions(back)
    assert [e.objects for e in scene.events if e.kind == "collision"] == hits


def test_written_samples_continue_to_the_last_released_one() -> None:
    frames = np.arange(180)
    location = np.stack([np.stack([0 * frames, 0.01 * frames - 1], 1), np.stack([0.02 * frames, 0 * frames], 1)])
    visible = np.ones((2, 180), bool)
    visible[1, 100:] = False
    hits = tuple(Event("collision", frame, (0, 1)) for frame in (12, 13, 126, 127, 128, 178))
    objects = (SceneObject(0, "red", "metal", "cube"), SceneObject(1, "blue", "rubber", "sphere"))
    written = predictions_document(DynamicsPrediction(objects, 128, Rollout(location, visible, hits)))
    (prediction,) = written["predictions"]
    assert [c["frame"] for c in prediction["collisions"]] == [10, 15, 125, 125, 130, 180]
    assert len(prediction["trajectory"]) == 38
    shown = [{o["color"]: o["y"] for o in s["objects"]} for s in prediction["trajectory"]]
    assert [list(s) for s in shown[19:21]] == [["red", "blue"], ["red"]]
    columns = [s["red"] for s in shown]
    np.testing.assert_allclose(np.diff(columns), columns[1] - columns[0])  # to the right at one depth: constant speed
    # A collision stays on its side of the end of a video whose length is no multiple of 5 frames.
    other = DynamicsPrediction(objects, 130, Rollout(location, visible, (hits[0], *(
        Event("collision", frame, (0, 1)) for frame in (129, 130)))))  # fmt: skip
    assert [c["frame"] for c in predictions_document(other)["predictions"][0]["collisions"]] == [10, 125, 130]


def test_execute_with_the_official_semantics(document: dict[str, Any], tmp_path, capsys) -> None:
    write_json(tmp_path / "sim.json", document)
    (tmp_path / "sim.json.gz").write_bytes(gzip.compress((tmp_path / "sim.json").read_bytes()))
    for name in ("sim.json", "sim.json.gz"):
        command = ["program", "--semantics", "official", "--run", str(tmp_path / name)]
        assert main([*command, "<START> events objects filter_collision count <END>"]) == 0
        assert main([*command, "objects unique"]) == 0
        assert main([*command, "events objects filter_collision count", "--collisions", "velocity"]) == 0
        assert capsys.readouterr().out.split() == ["3", "error", "0"]
    assert main(["program", "objects count", "--run", str(TRUTH), "--collisions", "velocity"]) == 2
    assert "needs --semantics official" in capsys.readouterr().err


def test_the_released_parsers_programs_are_evaluated(document: dict[str, Any], tmp_path) -> None:
    write_json(tmp_path / "sim_00007.json", document)
    programs = (["<START>", "objects", "count", "<END>"], ["boggle", "count"])
    descriptive = {"question_type": "descriptive", "question_subtype": "count", "answer": "3"}
    questions: list[dict[str, Any]] = [
        {"question_id": i, "question": "How many are there?", "program": program, **descriptive}
        for i, program in enumerate(programs)
    ]
    choices = [
        {"choice_id": i, "choice": "text", "answer": "correct", "program": program.split()}
        for i, program in enumerate((GREEN, "objects objects unique"))
    ]
    row = {"question_id": 2, "question": "What will happen next?", "question_type": "predictive", "choices": choices}
    row["program"] = ["unseen_events", "belong_to", "<NULL>"]
    scene = {"scene_index": 7, "video_filename": "video_00007.mp4", "questions": [*questions, row]}
    write_json(tmp_path / "questions.json", [scene])
    command = ["evaluate", "--questions", str(tmp_path / "questions.json"), "--source", "predictions", "--data"]
    command += [str(tmp_path), "--semantics", "official", "-o", str(tmp_path / "out.json"), "--programs", "gold"]
    assert main(command) == 0
    results = json.loads((tmp_path / "out.json").read_text())["results"]
    assert [r.get("answer") for r in results] == ["3", "error", None]
    assert [r["correct"] for r in results] == [True, False, False]
    assert [c["answer"] for c in results[2]["choices"]] == ["correct", "error"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("objects"), "`objects`"),
        (lambda d: d["objects"][0].update(color="pink"), r"objects\[0\]\.color`"),
        (lambda d: d["predictions"][0].update(what_if=0), r"predictions\[0\]\.what_if: expected -1"),
        (lambda d: d["predictions"][1].update(what_if=7), r"predictions\[1\]\.what_if: expected 0 to 2, got 7"),
        (
            lambda d: d["predictions"][0]["trajectory"][2]["objects"][0].pop("x"),
            r"`x`.*predictions\[0\]\.trajectory\[2\]\.objects\[0\]`",
        ),
        (
            lambda d: d["predictions"][0]["collisions"][0]["objects"].pop(),
            r"predictions\[0\]\.collisions\[0\]\.objects`",
        ),
    ],
)
def test_malformed_prediction_files_name_the_location(document, tmp_path, change, message) -> None:
    change(document)
    write_json(tmp_path / "sim.json", document)
    with pytest.raises(DataError, match=rf"sim\.json: .*{message}"):
        read_predictions(tmp_path / "sim.json")

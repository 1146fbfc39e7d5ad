"""Whole folders of videos."""

import json
import re
import shutil
from dataclasses import fields

import numpy as np
import pytest

from nsdr import DataError, PipelineConfig, Scene, load, save
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.predictions import read_predictions, scene_from_predictions
from nsdr.cli.main import main
from nsdr.evaluation import EvaluationConfig, parse_videos, predict_dynamics
from nsdr.io.files import write_json
from nsdr.io.video import write_video
from nsdr.symbolic import OfficialExecutor


@pytest.fixture
def videos(tmp_path):
    from nsdr.io.video import read_video

    folder = tmp_path / "videos"
    frames = read_video(VIDEO)[40:60]
    for number in (1, 2):
        write_video(folder / f"video_0000{number}.mp4", frames)
    (folder / "video_00003.mp4").write_bytes(b"no video")
    return folder


def test_a_folder_is_parsed_skipping_what_is_done_and_what_fails(videos, tmp_path, capsys) -> None:
    output = tmp_path / "scenes"
    assert main(["parse", str(videos), "-o", str(output), "--workers", "1", "--set", "stride=2"]) == 1
    text = capsys.readouterr().out
    assert "2 done, 0 kept from before, 1 failed" in text
    assert "video_00003.mp4: VideoError" in text
    assert len(load(output / "scene_00001.json", Scene).objects) >= 2
    assert json.loads((output / "proposal_00001.json").read_text())["video_index"] == 1
    assert list(json.loads((output / "failures.json").read_text())) == ["video_00003.mp4"]
    before = (output / "scene_00002.json").read_bytes()
    (output / "scene_00001.json").unlink()
    (videos / "video_00003.mp4").unlink()
    summary = parse_videos(videos, output, settings=PipelineConfig(stride=2), workers=1)
    assert summary.done == ("video_00001.mp4",)
    assert summary.skipped == ("video_00002.mp4",)
    assert summary.failed == {}
    assert (output / "scene_00002.json").read_bytes() == before


def test_videos_of_other_scenes_are_counted_as_failed(tmp_path, capsys) -> None:
    write_video(tmp_path / "videos" / "video_00007.mp4", np.zeros((4, 320, 480, 3), np.uint8))
    assert main(["parse", str(tmp_path / "videos"), "-o", str(tmp_path / "out"), "--workers", "1"]) == 1
    found = capsys.readouterr()
    assert "0 done, 0 kept from before, 1 failed" in found.out
    assert "video_00007.mp4: VideoError" in found.out
    assert "the background is black" in found.err


def test_videos_of_one_number_are_named(videos, tmp_path) -> None:
    for folder in ("a", "b"):
        (videos / folder).mkdir()
        (videos / folder / "clip.mp4").touch()
    with pytest.raises(DataError, match=r"a/clip\.mp4 and .*b/clip\.mp4: both are number clip; rename one"):
        parse_videos(videos, tmp_path / "out")


def test_hidden_files_are_no_videos(tmp_path) -> None:
    for name in (".video_00001.partial.mp4", "._video_00001.mp4", ".work/video_00001.mp4"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with pytest.raises(DataError, match=r"holds no \*\.mp4"):
        parse_videos(tmp_path, tmp_path / "out")


def test_a_folder_without_videos_is_an_error(tmp_path) -> None:
    with pytest.raises(DataError, match=r"holds no \*\.mp4"):
        parse_videos(tmp_path, tmp_path / "out")


def test_proposals_become_prediction_files_that_both_executors_read(tiny_motion, tmp_path, capsys) -> None:
    compact, _ = tiny_motion
    output = tmp_path / "predictions"
    assert main(["parse", str(compact), "-o", str(output), "--form", "predictions", "--workers", "1"]) == 0
    assert "4 done, 0 kept from before, 0 failed" in capsys.readouterr().out
    document = read_predictions(output / "sim_00000.json")
    assert [p.what_if for p in document.predictions] == [-1, 0, 1]
    assert len(scene_from_predictions(document).objects) == 2
    assert OfficialExecutor(document).answer(["objects", "count"]).answer == 2
    first = (output / "sim_00002.json").read_bytes()
    (output / "sim_00002.json").unlink()
    assert predict_dynamics(compact, output, workers=1).done == ("00002",)
    assert (output / "sim_00002.json").read_bytes() == first
    scenes = predict_dynamics(compact, tmp_path / "scenes", "scenes", workers=1)
    assert len(scenes.done) == 4
    assert load(tmp_path / "scenes" / "scene_00001.json", Scene).n_frames == 128
    with pytest.raises(DataError, match="form is 'csv'; expected one of predictions, scenes"):
        predict_dynamics(compact, output, "csv")
    one = tmp_path / "proposal_00007.json"
    one.write_text("{}", encoding="utf-8")
    assert list(predict_dynamics(one, tmp_path / "one", workers=1).failed) == [one.name]
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(DataError, match=r"holds no proposal_N\.json"):
        predict_dynamics(empty, output)
    with pytest.raises(DataError, match="none: no such file or folder"):
        predict_dynamics(tmp_path / "none", output)


def test_a_split_is_evaluated_again_from_what_is_kept(videos, tmp_path, capsys, caplog) -> None:
    root = tmp_path / "root"
    (root / "videos").mkdir(parents=True)
    videos.rename(root / "videos" / "validation")
    for old, new in (("00001", "10000"), ("00002", "10001"), ("00003", "10002")):
        folder = root / "videos" / "validation"
        (folder / f"video_{old}.mp4").rename(folder / f"video_{new}.mp4")
    question = {
        "question_id": 0,
        "question": "How many collisions happen?",
        "question_type": "descriptive",
        "answer": "0",
    }
    rows = [
        {"scene_index": i, "video_filename": f"video_{i}.mp4", "questions": [question]}
        for i in (10000, 10001, 10002, 10003)
    ]
    (root / "questions").mkdir()
    (root / "questions" / "validation.json").write_text(json.dumps(rows))
    command = ["evaluate", "--source", "videos", "--root", str(root), "--set", "stride=2", "--workers", "1"]
    assert main([*command, "--cache", str(tmp_path / "cache")]) == 2
    error = capsys.readouterr().err
    assert "root: 3 of 4 videos are here; --available scores those: looked below " in error
    assert error.endswith("root has the folders questions, videos; video_10003.mp4 is missing\n")
    command += ["--available", "--cache", str(tmp_path / "cache"), "-o"]
    assert main([*command, str(tmp_path / "first.json")]) == 1
    assert "1 of 3 questions failed: scene 10002" in capsys.readouterr().err
    kept = sorted((tmp_path / "cache").rglob("scene_*.json"))
    assert len(kept) == 2
    kept[1].unlink()  # as if killed before
    before = kept[0].stat().st_mtime_ns
    assert main([*command, str(tmp_path / "second.json"), "--keep-going"]) == 0
    assert (tmp_path / "first.json").read_bytes() == (tmp_path / "second.json").read_bytes()
    assert kept[0].stat().st_mtime_ns == before
    whole = kept[0].read_bytes()
    kept[0].write_bytes(whole[:-9])  # damaged
    assert main([*command, str(tmp_path / "third.json"), "--keep-going"]) == 0
    assert (tmp_path / "first.json").read_bytes() == (tmp_path / "third.json").read_bytes()
    assert kept[0].read_bytes() == whole
    report = json.loads((tmp_path / "first.json").read_text())
    assert list(report["notes"]) == ["10000", "10001"]  # also of a scene that was kept
    assert all(any("20 frames" in note for note in notes) for notes in report["notes"].values())
    errors = {r["scene_index"]: r.get("error", "") for r in report["results"]}
    assert "VideoError" in errors[10002]
    assert 10003 not in errors
    assert errors[10000] == errors[10001] == ""
    failures = json.loads(next((tmp_path / "cache").rglob("failures.json")).read_text())
    assert sorted(failures) == ["10002"]
    assert main([*command, str(tmp_path / "other.json"), "--limit", "1", "--dynamics", "propnet"]) == 0
    assert len(list((tmp_path / "cache").rglob("scene_*.json"))) == 3  # another configuration, another folder


def test_what_a_split_cannot_be_evaluated_from_is_said(tmp_path, capsys) -> None:
    assert main(["evaluate", "--source", "truth"]) == 2
    assert "give --questions and --data, or --root" in capsys.readouterr().err
    (tmp_path / "questions").mkdir()
    shutil.copy(QUESTIONS, tmp_path / "questions" / "validation.json")
    assert main(["evaluate", "--source", "truth", "--root", str(tmp_path)]) == 2
    assert "source truth cannot be read from a split of --root" in capsys.readouterr().err
    official = ["--source", "predictions", "--root", str(tmp_path), "--semantics", "official"]
    assert main(["evaluate", *official]) == 2
    assert "source predictions cannot be read from a split of --root" in capsys.readouterr().err


def test_scenes_are_left_out_and_skipped_with_either_way_to_give_them(tmp_path, small_scene, capsys) -> None:
    """The same questions as a split of `--root` and as `--questions` with `--data`."""
    question = {
        "question_id": 0,
        "question": "How many collisions happen?",
        "question_type": "descriptive",
        "answer": "2",
    }
    questions = tmp_path / "questions" / "validation.json"
    rows = [
        {"scene_index": i, "video_filename": f"video_{i}.mp4", "questions": [question]} for i in range(10000, 10006)
    ]
    write_json(questions, rows)
    for i in range(10000, 10006):
        save(tmp_path / f"scene_{i}.json", small_scene)
        (tmp_path / f"video_{i}.mp4").touch()
    for given in (
        ["--source", "videos", "--root", str(tmp_path)],
        ["--source", "scenes", "--questions", str(questions), "--data", str(tmp_path)],
    ):
        options = ["--every", "2", "--limit", "2", "-o", str(tmp_path / "out.json")]
        assert main(["evaluate", *given, *options, "--keep-going"]) == 0
        report = json.loads((tmp_path / "out.json").read_text())
        assert [r["scene_index"] for r in report["results"]] == [10000, 10002]
    assert main(["evaluate", *given, "--truth-source", "scenes", "--truth", str(tmp_path)]) == 2
    assert "source scenes needs no pipeline: --truth-source would do nothing" in capsys.readouterr().err


def test_every_setting_of_an_evaluation_is_an_option(capsys) -> None:
    assert main(["evaluate", "--help"]) == 0
    words = set(re.findall(r"--[\w-]+", capsys.readouterr().out))
    missing = {f.name for f in fields(EvaluationConfig)} - {word[2:].replace("-", "_") for word in words}
    assert not missing


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--source", "zebra"], "source: expected one of videos, proposals,"),
        (["--source", "truth", "--collisions", "velocity"], "needs --semantics official"),
        (["--source", "truth", "--semantics", "official"], "runs on predictions, not on truth"),
        (["--source", "truth", "--truth", "x"], "truth_source and truth go together"),
        (["--source", "truth", "--videos", "x"], "videos goes with --source proposals"),
        (["--source", "proposals", "--videos", "x"], "videos would do nothing: dynamics 'physics' reads no images"),
        (["--source", "truth", "--every", "0"], "every"),
        (["--source", "truth", "--set", "tracker.score"], "expected key=value"),
        (["--source", "truth", "--split", "train"], "split train is of --root and does nothing without it"),
        (
            ["--source", "predictions", "--semantics", "official", "--dynamics", "propnet"],
            "--dynamics would do nothing",
        ),
        (
            ["--source", "predictions", "--semantics", "official", "--truth-source", "truth", "--truth", "x"],
            "--truth-source would do nothing",
        ),
    ],
)
def test_options_that_would_do_nothing_are_refused(options, message, capsys, tmp_path) -> None:
    shutil.copy(QUESTIONS, tmp_path / "q.json")
    assert main(["evaluate", "--questions", str(tmp_path / "q.json"), "--data", str(tmp_path), *options]) in (0, 2)
    assert message in capsys.readouterr().err


def test_a_video_is_parsed_without_a_file_and_a_folder_is_not(tmp_path, capsys) -> None:
    assert main(["parse", str(VIDEO)]) == 0
    assert "  object 4: purple metal cube\n" in capsys.readouterr().out
    assert main(["parse", str(tmp_path)]) == 2
    assert "is no single video; give -o FOLDER" in capsys.readouterr().err

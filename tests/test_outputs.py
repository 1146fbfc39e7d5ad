"""Outputs are checked before the work; what is no regular file is written to; failures are counted and give a status."""

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from nsdr import DataError
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.cli import perceive
from nsdr.cli.main import main
from nsdr.io.files import check_output, check_output_folder
from nsdr.io.jobs import Job, Summary
from nsdr.visualize.annotate import write_image

IMAGE = np.zeros((4, 6, 3), np.uint8)


@pytest.fixture
def places(tmp_path: Path) -> Path:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file.json").write_text("{}")
    (tmp_path / "fixed.json").write_text("{}")
    (tmp_path / "fixed.json").chmod(0o444)
    (tmp_path / "fixed").mkdir(mode=0o555)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("folder", "is a folder"),
        ("x.zebra", "expected a name ending in .json or .npz"),
        ("fixed.json", "read-only"),
        ("fixed/x.json", "read-only folder"),
        ("fixed/a/b/x.json", "read-only folder"),
        ("file.json/x.json", "is no folder"),
        ("a" * 300 + ".json", "cannot be written"),
        ("input.json", "already another input or output"),
        ("a\0.json", "is no name"),
    ],
)
def test_bad_outputs_are_refused(places: Path, name: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        check_output(places / name, (".json", ".npz"), [places / "folder" / ".." / "input.json"])


def test_devices_and_empty_names_are_refused() -> None:
    with pytest.raises(DataError, match="/dev/full: is a device or a pipe; expected a file"):
        check_output("/dev/full")
    with pytest.raises(DataError, match="is no name of an output"):
        check_output("")


def test_good_outputs_leave_no_trace(places: Path) -> None:
    assert check_output(places / "new" / "x.NPZ", (".json", ".npz")) == ".npz"
    check_output_folder(places / "new" / "folder")
    assert not (places / "new").exists()
    with pytest.raises(DataError, match="is no folder"):
        check_output_folder(places / "file.json")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["parse", VIDEO, "-o", "OUT/fixed/scene.json"], "read-only"),
        (["parse", VIDEO, "-o", "OUT/s.json", "--proposals-out", "OUT/x.zebra"], "x.zebra"),
        (["parse", VIDEO, "-o", "OUT/s.json", "--proposals-out", "OUT/s.json"], "already another"),
        (["parse", "OUT", "-o", "OUT/file.json"], "is no folder"),
        (["parse", "OUT", "-o", "OUT/fixed/y"], "read-only"),
        (["visualize", VIDEO, "-o", "OUT/x.zebra"], "expected a name ending in"),
        (["visualize", VIDEO, "-o", "OUT/fixed/x.png"], "read-only"),
        (["demo", "-o", "OUT/folder"], "is a folder"),
        (["evaluate", "--questions", QUESTIONS, "--data", "d", "--source", "scenes", "-o", "/dev/full"], "/dev/full"),
        (["evaluate", "--questions", QUESTIONS, "--data", "d", "--source", "scenes", "-o", QUESTIONS], "already"),
        (
            ["evaluate", "--questions", QUESTIONS, "--data", "d", "--source", "scenes", "--submission", "OUT/folder"],
            "is a",
        ),
        (["experiment", "none.yaml", "-o", "OUT/file.json"], "is no folder"),
        (["generate", "dataset", "-o", "OUT/file.json"], "is no folder"),
        (["generate", "scene", "-o", "OUT/folder"], "is a folder"),
        (["generate", "questions", "--scenes", "OUT", "-o", "OUT/fixed/q.json"], "read-only"),
        (["data", "frames", "OUT", "--proposals", "OUT", "-o", "OUT/file.json"], "is no folder"),
        (["data", "motion", "OUT", "-o", "OUT/fixed/x"], "read-only"),
        (["train", "frame-parser", "--frames", "none", "--run-dir", "OUT/fixed/x"], "read-only"),
        (["train", "question-parser", "--run-dir", "OUT/new", "--output", "OUT/file.json"], "is no folder"),
    ],
)
def test_commands_check_their_outputs_before_the_work(capsys, places, monkeypatch, arguments, message) -> None:
    monkeypatch.setattr(perceive, "make_pipeline", lambda _: pytest.fail("the work has begun"))
    before = sorted(places.rglob("*"))
    assert main([str(a).replace("OUT", str(places)) for a in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert sorted(places.rglob("*")) == before


def test_images_that_cannot_be_written_are_errors(places) -> None:
    with pytest.raises(DataError, match="expected a name ending in"):
        write_image(places / "x.zebra", IMAGE)
    with pytest.raises(DataError, match=r"file\.json"):
        write_image(places / "file.json" / "x.png", IMAGE)
    write_image(places / "new" / "x.jpg", IMAGE)
    assert (places / "new" / "x.jpg").read_bytes().startswith(b"\xff\xd8")


@pytest.fixture
def broken_questions(tmp_path: Path) -> Path:
    """The example's questions; the first one has a program that fails on the scene."""
    content = json.loads(
        gzip.decompress(QUESTIONS.read_bytes()) if QUESTIONS.suffix == ".gz" else QUESTIONS.read_text()
    )
    content[0]["questions"][0]["program"] = ["objects", "yellow", "filter_color", "unique", "query_shape"]
    (tmp_path / "questions.json").write_text(json.dumps(content))
    (tmp_path / "scenes").mkdir()
    shutil.copy(TRUTH, tmp_path / "scenes" / "scene_500002.json")
    return tmp_path / "questions.json"


def test_a_failed_question_gives_a_status_and_no_submission(capsys, tmp_path, broken_questions) -> None:
    submission = tmp_path / "submission.json"
    arguments = ["evaluate", "--questions", broken_questions, "--source", "scenes", "--data", tmp_path / "scenes"]
    arguments += ["--programs", "gold", "--cache", tmp_path / "cache", "--submission", submission]
    assert main([str(a) for a in arguments]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("error: 1 of 10 questions failed: scene 500002, question ")
    assert "no object in this video is yellow" in last
    assert not submission.exists()
    assert main([str(a) for a in [*arguments, "--keep-going"]]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("1 of 10 questions failed")
    assert submission.exists()


def test_an_experiment_with_failures_gives_a_status(capsys, tmp_path, broken_questions) -> None:
    values = {
        "questions": str(broken_questions),
        "data": str(tmp_path / "scenes"),
        "source": "scenes",
        "programs": "gold",
    }
    (tmp_path / "e.yaml").write_text(
        json.dumps({"title": "T", "common": values, "rows": [{"name": "a"}, {"name": "b"}]})
    )
    arguments = ["experiment", str(tmp_path / "e.yaml"), "-o", str(tmp_path / "results")]
    assert main(arguments) == 1
    assert "2 of 20 questions failed, such as row 'a', scene 500002" in capsys.readouterr().err
    assert main([*arguments, "--keep-going"]) == 0
    (tmp_path / "results" / "e.json").write_text("[1]")
    assert main(arguments) == 2
    assert "not the results of an experiment" in capsys.readouterr().err


def test_jobs_that_failed_stop_what_follows_or_are_left_out(tmp_path) -> None:
    jobs = [Job(name, name, tmp_path / name, "") for name in "abc"]
    summary = Summary(("a",), ("b",), {"c": "DataError: broken"})
    assert [job.name for job in summary.succeeded(jobs, tmp_path, keep_going=True)] == ["a", "b"]
    with pytest.raises(DataError, match="1 of 3 failed: c: DataError: broken"):
        summary.succeeded(jobs, tmp_path, keep_going=False)
    with pytest.raises(DataError, match="nothing is left"):
        Summary((), (), dict.fromkeys("abc", "broken")).succeeded(jobs, tmp_path, keep_going=True)


def test_frames_of_the_good_videos_with_keep_going(capsys, tmp_path) -> None:
    videos, proposals = tmp_path / "videos", tmp_path / "proposals"
    videos.mkdir()
    proposals.mkdir()
    for index in (1, 2):
        shutil.copy(VIDEO, videos / f"video_{index:05d}.mp4")
        document = {"video_index": index, "video_name": f"video_{index:05d}.mp4", "frames": []}
        document["frames"] = [{"frame_index": f, "objects": []} for f in range(128)]
        (proposals / f"proposal_{index:05d}.json").write_text(json.dumps(document))
    (videos / "video_00002.mp4").write_bytes(b"no video")
    arguments = ["data", "frames", videos, "--proposals", proposals, "-o", tmp_path / "out", "--every", "64"]
    assert main([str(a) for a in arguments]) == 2
    assert "1 of 2 failed: video_00002.mp4" in capsys.readouterr().err
    assert main([str(a) for a in [*arguments, "--keep-going"]]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("1 failed and are left out")

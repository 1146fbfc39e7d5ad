"""Writing files: atomically, on full disks, and by one process at a time."""

import errno
import fcntl
import os
import re
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.errors import DataError, MachineError
from nsdr.evaluation.runner import EvaluationConfig, _job
from nsdr.io.files import atomic_path, find_files, locked, remove_partial_files, write_json
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.video import read_video, write_video


def test_devices_and_pipes_are_never_replaced_and_links_are_followed(tmp_path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for target in (Path("/dev/null"), tmp_path / "pipe"):
        before = os.stat(target)
        with pytest.raises(DataError, match="is a device or a pipe; expected a file"):
            write_json(target, {"a": 1})
        assert os.stat(target).st_ino == before.st_ino
    (tmp_path / "target.json").write_text("old")
    (tmp_path / "link.json").symlink_to(tmp_path / "target.json")
    write_json(tmp_path / "link.json", 3)
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "target.json").read_text() == "3\n"


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS])
def test_a_full_disk_is_one_line_and_keeps_what_was_there(code, tmp_path, monkeypatch) -> None:
    path = tmp_path / "a.json"
    write_json(path, "before")

    def full(*_, **__):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(MachineError, match=rf"a\.json: cannot be written \({os.strerror(code)}\)"):
        write_json(path, "after")
    assert path.read_bytes() == b'"before"\n'
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_folder_is_no_target(tmp_path) -> None:
    with pytest.raises(DataError, match="is a folder; expected a file"):
        write_json(tmp_path, 1)
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        write_json(tmp_path / "file" / "below.json", 1)


def start(code: str) -> "subprocess.Popen[str]":
    """A Python program, once it has written its first line."""
    process = subprocess.Popen([sys.executable, "-c", code], stdin=-1, stdout=-1, text=True)
    assert process.stdout is not None
    assert process.stdout.readline()
    return process


WRITES = """
from nsdr.io.files import atomic_path
with atomic_path({path!r}) as temporary:
    temporary.write_text("half")
    print(temporary, flush=True)
    input()
"""


def test_what_a_kill_leaves_is_hidden(tmp_path) -> None:
    path = tmp_path / "video_00001.mp4"
    with start(WRITES.format(path=str(path))) as other:
        with atomic_path(path) as temporary:  # two may write one file: both whole, the last one stays
            temporary.write_text("ours")
        assert path.read_text() == "ours"
        other.kill()
        assert other.wait() == -signal.SIGKILL
    (left,) = [p.name for p in tmp_path.iterdir() if p != path]
    assert re.fullmatch(r"\.video_00001-[0-9a-f]{8}\.partial\.mp4", left)
    assert find_files(tmp_path, "*.mp4") == [path]
    remove_partial_files(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["video_00001.mp4"]
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise RuntimeError
    assert [p.name for p in tmp_path.iterdir()] == ["video_00001.mp4"]


def test_what_is_still_written_and_unfinished_folders_are_not_removed(tmp_path) -> None:
    """Another command writes a video below the folder in which this one works, and a download was interrupted there."""
    path = tmp_path / "videos" / "a.mp4"
    (tmp_path / ".video_train.partial").mkdir()
    with start(WRITES.format(path=str(path))) as other:
        run_jobs(print, [], tmp_path)
        assert other.communicate("\n")
        assert other.wait() == 0
    assert path.read_text() == "half"
    assert (tmp_path / ".video_train.partial").is_dir()


@pytest.mark.parametrize("value", [float("nan"), [1.0, {"a": float("inf")}]])
def test_no_file_holds_numbers_that_no_reader_takes(value, tmp_path) -> None:
    write_json(tmp_path / "a.json", "before")
    with pytest.raises(DataError, match=r"a\.json: .*not a finite number"):
        write_json(tmp_path / "a.json", value)
    assert (tmp_path / "a.json").read_text() == '"before"\n'


def test_writers_of_one_file_never_mix(tmp_path) -> None:
    """Four threads, each of which writes a file of one letter: every state of it is whole."""
    path = tmp_path / "a.txt"

    def write(letter: str) -> None:
        for _ in range(20):
            with atomic_path(path) as temporary:
                temporary.write_text(letter * 100_000)

    with ThreadPoolExecutor(4) as pool:
        running = [pool.submit(write, letter) for letter in "abcd"]
        while not all(task.done() for task in running):
            if path.exists():
                text = path.read_text()
                assert text == text[0] * 100_000
        for task in running:
            task.result()
    assert list(tmp_path.iterdir()) == [path]


def holds(folder: Path, name: str = "") -> "subprocess.Popen[str]":
    lock = f"locked({str(folder)!r}, {name!r})"
    code = f"from nsdr.io.files import locked\nwith {lock}: print('has it', flush=True); input()"
    return start(code)


def test_two_processes_do_not_write_to_one_folder(tmp_path) -> None:
    with holds(tmp_path) as other:
        with pytest.raises(DataError, match=rf"process {other.pid} on .* \(since .*\) writes to it; wait for it"):
            run_jobs(print, [Job("a", 1, tmp_path / "a", "f")], tmp_path)
        other.kill()
    with locked(tmp_path):  # the system released it
        pass
    assert not list(tmp_path.iterdir())  # nor does its file stay


def test_a_lock_is_taken_again_by_what_runs_within_it_and_by_no_other_thread(tmp_path) -> None:
    def take() -> None:
        with locked(tmp_path):
            pass

    with locked(tmp_path), locked(tmp_path), ThreadPoolExecutor(1) as pool:
        take()
        with pytest.raises(DataError, match="writes to it"):
            pool.submit(take).result()
        with locked(tmp_path, "other"):  # of an output, not of the folder
            pass
    take()


def test_a_lock_can_be_waited_for(tmp_path, caplog) -> None:
    with holds(tmp_path) as other:
        threading.Timer(0.5, other.kill).start()
        with locked(tmp_path, wait=True):
            assert other.wait() == -signal.SIGKILL
    assert f"process {other.pid} on" in caplog.text
    assert "waiting for its end" in caplog.text


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_a_folder_that_cannot_be_locked_is_one_line(code, tmp_path, monkeypatch) -> None:
    def refused(*_, **__):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "open", refused)
    with pytest.raises(MachineError, match=rf"cannot be written \({os.strerror(code)}\)"), locked(tmp_path):
        pass


def test_file_systems_without_locks_are_written_to(tmp_path, monkeypatch) -> None:
    def unsupported(*_):
        raise OSError(errno.EOPNOTSUPP, "not supported")

    monkeypatch.setattr(fcntl, "flock", unsupported)
    with locked(tmp_path):
        write_json(tmp_path / "a.json", 1)
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_hidden_files_are_no_inputs(tmp_path) -> None:
    for name in (
        "b/video_2.mp4",
        "video_1.mp4",
        "._video_1.mp4",
        ".video_3.partial.mp4",
        ".work/video_4.mp4",
        "b/x.txt",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [p.name for p in find_files(tmp_path, "*.mp4")] == ["video_2.mp4", "video_1.mp4"]


def test_links_to_folders_are_followed_and_each_folder_is_read_once(tmp_path) -> None:
    (tmp_path / "elsewhere" / "deep").mkdir(parents=True)
    (tmp_path / "elsewhere" / "deep" / "video_1.mp4").touch()
    videos = tmp_path / "videos"
    (videos / "real").mkdir(parents=True)
    (videos / "real" / "video_2.mp4").touch()
    (videos / "again").symlink_to("real")
    (videos / "linked").symlink_to(tmp_path / "elsewhere")
    (videos / "real" / "round").symlink_to("..")
    (videos / "nowhere").symlink_to("missing")
    (tmp_path / "elsewhere" / "up").symlink_to(tmp_path)
    (tmp_path / "whole").symlink_to(videos)
    for folder in (videos, tmp_path / "whole"):
        found = [str(path.relative_to(folder)) for path in find_files(folder, "*.mp4")]
        assert found == ["linked/deep/video_1.mp4", "real/video_2.mp4"]


def test_names_that_are_not_utf8_are_left_out_with_a_warning(tmp_path) -> None:
    for name in (b"a.mp4", b"s\xff.mp4", b"t\xfe.mp4", b"other\xfd.txt"):
        (tmp_path / os.fsdecode(name)).touch()
    with pytest.warns(UserWarning, match=r"s\\xff\.mp4 and 1 more files: .*not UTF-8; rename"):
        assert find_files(tmp_path, "*.mp4") == [tmp_path / "a.mp4"]


def test_commands_refuse_an_output_that_another_process_writes(tmp_path, capsys) -> None:
    (tmp_path / "e.yaml").write_text("title: T\nrows: [{name: r, published: [1, 2, 3, 4, 5, 6, 7]}]")
    out = str(tmp_path / "out")
    training = ["train", "question-parser", "--run-dir", out, "--evaluation-texts", "5", "--loop.device", "cpu"]
    commands = {
        "": [["generate", "dataset", "-o", out, "--videos", "1"], training],
        "e.json": [["experiment", str(tmp_path / "e.yaml"), "-o", out]],
    }
    for name, listed in commands.items():
        with holds(tmp_path / "out", name) as other:
            before = sorted((tmp_path / "out").iterdir())
            for arguments in listed:
                assert main(arguments) == 2
                assert f"{Path(out, name)}: process {other.pid} on" in capsys.readouterr().err
                assert sorted((tmp_path / "out").iterdir()) == before
            other.kill()
    assert main(commands["e.json"][0]) == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [".lock", "e.json", "e.md"]


def test_the_same_frames_give_the_same_video(tmp_path) -> None:
    """x264 with its defaults gives one of several files, from run to run."""
    frames = read_video(VIDEO)[40:60]
    found = set()
    for _ in range(5):
        write_video(tmp_path / "a.mp4", frames)
        found.add((tmp_path / "a.mp4").read_bytes())
    assert len(found) == 1


def test_kept_scenes_of_other_inputs_are_other_files(tmp_path) -> None:
    """Two evaluations may run at once on data sets whose videos have the same numbers."""
    config = EvaluationConfig(questions="q.json", data="d")
    jobs = []
    for content in ("first", "second"):
        (tmp_path / content).write_text(content)
        jobs.append(_job(config, "settings", 7, {"video": str(tmp_path / content)}, None))
    assert jobs[0].output.parent == jobs[1].output.parent
    assert jobs[0].output != jobs[1].output

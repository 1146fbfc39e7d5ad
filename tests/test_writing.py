"""Writing files: atomically, into special targets, on full disks, and by one process at a time."""

import errno
import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from nsdr.errors import DataError
from nsdr.io.files import atomic_path, remove_partial_files, write_json
from nsdr.io.lock import locked
from nsdr.io.runner import Job, run_jobs


def test_devices_pipes_and_links_are_written_to_and_not_replaced(tmp_path) -> None:
    write_json("/dev/null", {"a": 1})
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    os.mkfifo(tmp_path / "pipe")
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_text()))
    reader.start()
    write_json(tmp_path / "pipe", [1, 2])
    reader.join(10)
    assert read == ["[1, 2]\n"]
    assert stat.S_ISFIFO(os.stat(tmp_path / "pipe").st_mode)
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

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(DataError, match=rf"a\.json: cannot be written \({os.strerror(code)}\)"):
        write_json(path, "after")
    assert path.read_bytes() == b'"before"\n'
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_folder_is_no_target(tmp_path) -> None:
    with pytest.raises(DataError, match="is a folder; expected a file"):
        write_json(tmp_path, 1)
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        write_json(tmp_path / "file" / "below.json", 1)


def test_what_a_kill_leaves_is_hidden_and_removed(tmp_path) -> None:
    with pytest.raises(RuntimeError), atomic_path(tmp_path / "video_00001.mp4") as temporary:  # noqa: PT012
        assert temporary.name.startswith(".")
        (tmp_path / temporary.name.replace("-", "-x")).write_text("left by a kill")
        raise RuntimeError
    assert len(list(tmp_path.iterdir())) == 1
    remove_partial_files(tmp_path)
    assert not list(tmp_path.iterdir())


def test_two_processes_do_not_write_to_one_folder(tmp_path) -> None:
    code = f"from nsdr.io.lock import locked\nwith locked({str(tmp_path)!r}): print('has it', flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=-1, stdout=-1, text=True) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with pytest.raises(DataError, match=rf"process {other.pid} on .* \(since .*\) writes to it; wait for it"):
            run_jobs(print, [Job("a", 1, tmp_path / "a", "f")], tmp_path)
        other.kill()
    with locked(tmp_path):  # the system released it
        pass

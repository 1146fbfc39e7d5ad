"""Ctrl-C, SIGTERM and closed pipes: one line or none, a status, and no process that stays."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nsdr.clevrer.example import TRUTH
from nsdr.cli import ask, main as cli

RUN = [sys.executable, "-c", "import sys; from nsdr.cli import run; sys.exit(run())"]
SLOW = """
import sys, time
from pathlib import Path
from nsdr.cli import ask, main as cli
from nsdr.io.tasks import run_tasks

def nap(folder):
    (Path(folder) / f"worker_{__import__('os').getpid()}").touch()
    time.sleep(600)

def work(options):
    list(run_tasks(nap, [sys.argv[1]] * 4, workers=2))

if __name__ == "__main__":
    ask.FUNCTIONS["demo"] = ask.FUNCTIONS["demo"]._replace(run=work)
    sys.exit(cli.main(["demo"]))
"""
"""A command that keeps two workers busy."""
STARTUP_SECONDS, GONE_SECONDS = 120, 30
"""Waiting times on busy machines."""


def _workers(folder: Path) -> list[int]:
    return [int(path.name.removeprefix("worker_")) for path in folder.glob("worker_*")]


def _heed_ctrl_c() -> None:
    """Programs that a shell starts in the background ignore Ctrl-C, and so would these tests."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize(
    ("number", "whole_group", "status", "line"),
    [
        (signal.SIGINT, True, 130, "interrupted"),  # as the terminal does
        (signal.SIGTERM, False, 143, "terminated"),
    ],
)
def test_a_signal_ends_the_program_and_its_workers(tmp_path, number, whole_group, status, line) -> None:
    script = tmp_path / "slow.py"
    script.write_text(SLOW)
    process = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=_heed_ctrl_c,
    )
    end = time.monotonic() + STARTUP_SECONDS
    while len(_workers(tmp_path)) < 2 and time.monotonic() < end:
        time.sleep(0.05)
    workers = _workers(tmp_path)
    assert len(workers) == 2
    (os.killpg if whole_group else os.kill)(process.pid, number)
    _, err = process.communicate(timeout=GONE_SECONDS)
    assert process.returncode == status
    assert err == f"{line}\n"
    end = time.monotonic() + GONE_SECONDS
    while any(Path(f"/proc/{worker}").exists() for worker in workers) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)


def test_ctrl_c_within_this_process_is_one_line(capsys, monkeypatch) -> None:
    def interrupted(_: object) -> int:
        signal.raise_signal(signal.SIGINT)
        return 0

    before = signal.getsignal(signal.SIGINT)
    _heed_ctrl_c()
    monkeypatch.setitem(ask.FUNCTIONS, "demo", ask.FUNCTIONS["demo"]._replace(run=interrupted))
    assert cli.main(["demo"]) == 130
    assert capsys.readouterr().err == "interrupted\n"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


def test_a_closed_pipe_is_no_error() -> None:
    arguments = ["program", "objects count", "--run", str(TRUTH), "--trace"]
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run([*RUN, *arguments], stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert ended.returncode == 128 + signal.SIGPIPE
    assert ended.stderr == ""

"""Everything imports, and commands work, where what only POSIX systems have is missing, as on Windows."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import nsdr
from nsdr.clevrer.example import QUESTIONS, TRUTH

TAKEN_AWAY = """
import os, signal, sys

for name in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules[name] = None
for module, names in (
    (os, "fork forkpty getuid geteuid getpgid killpg setsid sched_getaffinity O_NOFOLLOW O_NONBLOCK O_NOCTTY"),
    (signal, "pthread_sigmask pthread_kill sigwait SIGKILL SIGPIPE SIGHUP SIGALRM alarm"),
):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
"""
"""Of Python's own libraries, in every process: the `sitecustomize` that Python imports when it starts."""
ALL_MODULES = """
import importlib, pkgutil, nsdr
for info in pkgutil.walk_packages(nsdr.__path__, "nsdr."):
    importlib.import_module(info.name)
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    (tmp_path / "sitecustomize.py").write_text(TAKEN_AWAY)
    return os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{Path(nsdr.__file__).parents[1]}"}


def run(environment: dict[str, str], *arguments: object) -> str:
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.robustness
def test_every_module_imports(environment) -> None:
    run(environment, "-c", ALL_MODULES)


@pytest.mark.robustness
def test_commands_work(environment, tmp_path) -> None:
    nsdr_command = ("-m", "nsdr.cli.main")
    assert "parse" in run(environment, *nsdr_command, "--help")
    assert "count" in run(environment, *nsdr_command, "program", "How many collisions happen?")
    shutil.copy(TRUTH, tmp_path / "scene_500002.json")
    evaluate = ("evaluate", "--questions", QUESTIONS, "--source", "scenes", "--data", tmp_path, "--programs", "gold")
    report = ("--cache", tmp_path / "cache", "-o", tmp_path / "report.json", "--workers", "2")
    assert "100.0" in run(environment, *nsdr_command, *evaluate, *report)
    assert run(environment, "-c", "import os; print(hasattr(os, 'fork'))") == "False\n"


@pytest.mark.robustness
def test_jobs_run_on_two_processes(environment, tmp_path) -> None:
    code = (
        "from pathlib import Path; from nsdr.io.files import write_json; from nsdr.io.jobs import Job, run_jobs\n"
        f"folder = Path({str(tmp_path / 'out')!r})\n"
        "jobs = [Job(n, n, folder / n, 'f') for n in 'abc']\n"
        "print(run_jobs(lambda item, output: write_json(output, item), jobs, folder, workers=2).done)\n"
    )
    assert run(environment, "-c", code) == "('a', 'b', 'c')\n"

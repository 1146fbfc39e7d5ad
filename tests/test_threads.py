"""Threads of the libraries: small parts run on one, idle ones sleep, and the process's own settings come back."""

import os
import subprocess
import sys
from collections.abc import Iterator
from threading import Barrier, Thread
from typing import Any

import numpy as np
import pytest
import torch
from threadpoolctl import ThreadpoolController
from torch.nn.modules.module import register_module_forward_pre_hook

from nsdr import PatchPropNetPredictor, PropNetPredictor, QuestionParser
from nsdr.dynamics import states_from_tracks
from nsdr.dynamics.physics import trajectory_fit
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.frame_parser.parser import FrameParser
from nsdr.io import device
from nsdr.io.device import available_cores, limit_threads

from .test_dynamics import tracks
from .test_frame_parser import TINY, build_frame_parser

Used = set[tuple[int, ...]]


BLAS = ThreadpoolController().select(user_api="blas")


def current() -> tuple[int, ...]:
    """Threads of torch, then the different numbers of the BLAS libraries."""
    return torch.get_num_threads(), *sorted({library["num_threads"] for library in BLAS.info()})


@pytest.fixture
def used() -> Iterator[Used]:
    """What networks use in a process whose torch and BLAS have three threads, which they have again afterwards."""
    before = torch.get_num_threads()
    seen: Used = set()
    hook = register_module_forward_pre_hook(lambda *_: seen.add(current()))
    torch.set_num_threads(3)
    with BLAS.limit(limits=3):
        yield seen
        after = current()
    hook.remove()
    torch.set_num_threads(before)
    assert after == (3, 3)


@pytest.mark.parametrize("part", [PropNetPredictor, PatchPropNetPredictor])
def test_dynamics_networks_run_on_one_thread(used: Used, part: type[Any]) -> None:
    assert part.from_pretrained(device="cpu").explain(states_from_tracks(tracks(20))).prediction
    assert used == {(1, 1)}


def test_the_fit_runs_on_one_thread(used: Used, monkeypatch: pytest.MonkeyPatch) -> None:
    solve = trajectory_fit.minimise

    def noted(*arguments: Any) -> Any:
        used.add(current())
        return solve(*arguments)

    monkeypatch.setattr(trajectory_fit, "minimise", noted)
    PhysicsPredictor(PropNetPredictor.from_pretrained(device="cpu")).explain(states_from_tracks(tracks(20)))
    assert used == {(1, 1)}


def test_the_question_parser_runs_on_one_thread(used: Used) -> None:
    QuestionParser.from_pretrained(device="cpu").parse("How many collisions happen?")
    assert used == {(1, 1)}


@pytest.mark.parametrize(("cores", "expected"), [(2, 2), (8, 3)])
def test_the_detector_uses_the_available_cores(used: Used, monkeypatch: pytest.MonkeyPatch, cores, expected) -> None:
    monkeypatch.setattr(device, "available_cores", lambda: cores)
    FrameParser(build_frame_parser(TINY)).parse(np.zeros((1, 320, 480, 3), np.uint8))
    assert used == {(expected, 1)}  # never more than the user's three


def test_limits_within_each_other(used: Used) -> None:
    with limit_threads(2):
        assert current() == (2, 1)
        with limit_threads(1):
            assert current() == (1, 1)
        assert current() == (2, 1)


def test_limits_of_several_threads(used: Used) -> None:
    both_inside, first_left = Barrier(2, timeout=30), Barrier(2, timeout=30)
    seen = {}

    def second() -> None:  # new to torch, it begins with what the first one has set
        with limit_threads(2):
            both_inside.wait()
            seen["inside"] = torch.get_num_threads()
            first_left.wait()
        seen["afterwards"] = current()

    thread = Thread(target=second)
    with limit_threads(1):
        thread.start()
        both_inside.wait()
    first_left.wait()
    thread.join()
    assert seen == {"inside": 2, "afterwards": (3, 3)}


def test_limits_end_with_an_error(used: Used) -> None:
    @limit_threads(1)
    def fail() -> None:
        raise ValueError("failed")

    for _ in range(2):
        with pytest.raises(ValueError, match="failed"):
            fail()
    assert current() == (3, 3)


@pytest.mark.robustness
@pytest.mark.parametrize(
    ("own", "policy"), [({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE"), ({"GOMP_SPINCOUNT": "1000"}, "")]
)
@pytest.mark.parametrize("use", ["nsdr.FrameParser", "run()"])
def test_idle_threads_sleep_unless_the_user_says_otherwise(own: dict[str, str], policy: str, use: str) -> None:
    """What OpenMP says of itself when torch loads it; and the caller's own environment stays as it is."""
    program = (
        "import os, sys, nsdr; from nsdr.cli import run; sys.argv = ['nsdr', '--version']; before = dict(os.environ); "
        f"print('torch' in sys.modules); {use}; import torch; print(dict(os.environ) == before)"
    )
    environment = {k: v for k, v in os.environ.items() if k not in device.WAITING} | {"OMP_DISPLAY_ENV": "true"}
    done = subprocess.run([sys.executable, "-c", program], env=environment | own, capture_output=True, text=True)
    assert done.stdout.split()[0] == "False", done.stderr
    assert done.stdout.split()[-1] == str(use != "run()" or bool(own))
    assert not policy or f"OMP_WAIT_POLICY = '{policy}'" in done.stderr


def test_available_cores_are_those_of_the_affinity() -> None:
    assert available_cores() <= len(os.sched_getaffinity(0))


@pytest.mark.robustness
def test_a_pipeline_runs_without_torchs_compiler() -> None:
    code = (
        "import sys, numpy as np, nsdr; pipeline = nsdr.Pipeline.from_pretrained(device='cpu'); "
        "pipeline.frame_parser.parse(np.full((1, 320, 480, 3), 128, np.uint8)); "
        "sys.exit(any(m in sys.modules for m in ('torch._dynamo', 'torch._inductor', 'sympy')))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0

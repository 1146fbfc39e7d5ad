"""A process that runs commands of `nsdr` one after the other, with a limit on its memory, and a client that survives it."""

import contextlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SPARE_BYTES = 6 << 30
"""Address space that a command may take on top of the loaded libraries (bytes)."""
HANG_SECONDS = 90
"""After this time a command is killed (s)."""


@dataclass(frozen=True)
class Result:
    """What a command did.

    Attributes:
        status: its exit status; None if it raised, died or hung.
        ended: "" or how it ended without a status.
        out: standard output.
        err: standard error.
        seconds: CPU time (s).
        memory: by how much the resident memory grew at most (bytes).
    """

    status: int | None
    ended: str
    out: str
    err: str
    seconds: float
    memory: int


class Worker:
    """Runs commands in a process of its own, which is replaced when it dies or hangs."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[str] | None = None

    def run(self, argv: Sequence[str], folder: Path) -> Result:
        """Run `nsdr` with these arguments in a folder."""
        process = self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        with tempfile.TemporaryFile("w+b") as out, tempfile.TemporaryFile("w+b") as err:
            paths = [f"/proc/{os.getpid()}/fd/{file.fileno()}" for file in (out, err)]
            process.stdin.write(json.dumps([list(argv), str(folder), *paths]) + "\n")
            process.stdin.flush()
            ready = select.select([process.stdout], [], [], HANG_SECONDS)[0]
            line = process.stdout.readline() if ready else ""
            texts = []
            for file in (out, err):
                file.seek(0)
                texts.append(file.read().decode(errors="replace"))
        if not line:
            self.close()
            code = process.returncode
            self.process = None
            ended = (
                f"killed after {HANG_SECONDS} s"
                if not ready
                else f"died ({signal.Signals(-code).name if code < 0 else code})"
            )
            return Result(None, ended, *texts, float(HANG_SECONDS if not ready else 0), 0)
        status, ended, seconds, memory = json.loads(line)
        return Result(status, ended, *texts, seconds, memory)

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()  # closes its pipes, too

    def _started(self) -> subprocess.Popen[str]:
        if self.process is None or self.process.poll() is not None:
            environment = os.environ | {"OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "PASSIVE", "PYTHONPATH": str(ROOT)}
            environment |= {"TQDM_DISABLE": "1"}
            command = [sys.executable, "-m", "tests.robustness.worker"]
            pipe = subprocess.PIPE
            self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment, cwd=ROOT)
            assert self.process.stdout is not None
            if self.process.stdout.readline() != "ready\n":
                raise RuntimeError("the worker process did not start")
        return self.process


def _memory(key: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024
    return 0


def _serve() -> None:
    """The program of the worker process: requests on standard input, results on standard output."""
    answers = os.fdopen(os.dup(1), "w")
    requests = os.fdopen(os.dup(0))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    import torch  # noqa: F401

    import nsdr.cli.generate
    import nsdr.evaluation
    import nsdr.training.dynamics
    import nsdr.training.frame_parser
    import nsdr.training.question_parser  # noqa: F401
    from nsdr.cli.main import main
    from tests.robustness.library import CALL, call
    from tests.robustness.machines import FULL, on_full_disk

    runners = {CALL: call, FULL: on_full_disk}

    limit = _memory("VmSize") + SPARE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    print("ready", file=answers, flush=True)
    for request in requests:
        argv, folder, out, err = json.loads(request)
        for number, path in ((1, out), (2, err)):
            target = os.open(path, os.O_WRONLY)
            os.dup2(target, number)
            os.close(target)
        with contextlib.suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")  # resets the peak of the resident memory
        before, start = _memory("VmRSS"), time.process_time()
        status, ended = None, ""
        os.chdir(folder)
        try:
            status = runners.get(argv[0], main)(argv[argv[0] in runners :])
        except BaseException as e:
            ended = f"raised {type(e).__name__}"
            traceback.print_exc()
        os.chdir(ROOT)
        sys.stdout.flush()
        sys.stderr.flush()
        result = [status, ended, time.process_time() - start, max(_memory("VmHWM") - before, 0)]
        print(json.dumps(result), file=answers, flush=True)


if __name__ == "__main__":
    _serve()

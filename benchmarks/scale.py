"""Videos an hour of `nsdr evaluate` from official proposals, with questions: one process, several, and workers of Ray.

`python benchmarks/scale.py --questions FILE --data FILE.npz [--limit 200] [--workers 2]`

Each row is a run from the start with an empty cache. Seconds of CPU time are those of all processes; memory is the peak of the
largest one, for all scenes and for a quarter of them.
"""

import argparse
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

MEASURE = (
    "import resource, subprocess, sys\n"
    "code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode\n"
    "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
    "print(code, used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20)\n"
)
"""Runs a command in a process of its own, so that the peak of its memory is not that of an earlier one."""


@dataclass(frozen=True)
class Run:
    """Wall and CPU time of a run (s), and its largest process (GiB)."""

    wall_s: float
    cpu_s: float
    peak_gib: float


def evaluate(options: argparse.Namespace, limit: int, arguments: list[str]) -> Run:
    """One run of `nsdr evaluate` over the first `limit` scenes.

    Raises:
        SystemExit: it failed.
    """
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, "-m", "nsdr.cli.main", "evaluate", "--keep-going", "--cache", cache]
        command += ["--source", "proposals", "--questions", str(options.questions), "--data", str(options.data)]
        start = time.perf_counter()
        command += ["--limit", str(limit), *arguments]
        done = subprocess.run([sys.executable, "-c", MEASURE, *command], stdout=subprocess.PIPE, text=True)
        code, cpu, peak = (float(v) for v in done.stdout.split())
    if code:
        raise SystemExit(f"{' '.join(command)} failed")
    return Run(time.perf_counter() - start, cpu, peak)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--questions", type=Path, required=True)
    parser.add_argument("--data", type=Path, required=True, help="proposals of the questions' scenes")
    parser.add_argument("--limit", type=int, default=200, help="number of scenes; 0 for all")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    rows = {"1 process": ["--workers", "1"], f"{options.workers} processes": ["--workers", str(options.workers)]}
    if importlib.util.find_spec("ray"):
        rows[f"{options.workers} Ray workers"] = ["--workers", str(options.workers), "--engine", "ray"]
    print(f"{options.limit} scenes, load {os.getloadavg()[0]:.1f} before the first run")
    print("| run | wall, s | CPU, s | videos an hour | memory, GiB | of a quarter, GiB |\n|---|---|---|---|---|---|")
    for name, arguments in rows.items():
        quarter = evaluate(options, options.limit // 4, arguments)
        whole = evaluate(options, options.limit, arguments)
        rate = 3600 * (options.limit - options.limit // 4) / (whole.wall_s - quarter.wall_s)
        figures = (
            f"{whole.wall_s:.0f} | {whole.cpu_s:.0f} | {rate:,.0f} | {whole.peak_gib:.2f} | {quarter.peak_gib:.2f}"
        )
        print(f"| {name} | {figures} |", flush=True)


if __name__ == "__main__":
    main()

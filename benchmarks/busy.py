"""Time of the commands on an idle machine, and beside busy processes, as ratios to the idle time.

`python benchmarks/busy.py [--busy 0 1 2] [--repeats 1] [--only PART-OF-A-NAME …]`

Every command runs in a fresh process on the clip that ships with the package; a first, untimed run fills Numba's cache. The
busy processes compute without a pause. Run it on a machine that does nothing else. Takes some minutes.
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.io.device import available_cores

BURNER = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(10**6))\n"
BACKENDS = ("physics", "state", "paper")
QUESTION = ["-q", "How many collisions happen?"]


def commands(folder: Path) -> dict[str, list[str]]:
    """Arguments of `nsdr` by the name of a row; they write below `folder/out`."""
    out, proposals, scenes = (str(folder / name) for name in ("out", "proposals", "scenes"))
    predict = ["predict-dynamics", proposals, "-o", out, "--dynamics"]
    evaluate = ["evaluate", "--questions", str(QUESTIONS), "--cache", out, "--source"]
    return {
        **{f"answer --dynamics {d}": ["answer", str(VIDEO), *QUESTION, "--dynamics", d] for d in BACKENDS},
        "parse-video --dynamics state": ["parse-video", str(VIDEO), "-o", f"{out}/s.json", "--dynamics", "state"],
        **{
            f"predict-dynamics --dynamics {d} (2 videos, 2 workers)": [*predict, d, "--workers", "2"]
            for d in BACKENDS[:2]
        },
        "evaluate --source scenes (1 video)": [*evaluate, "scenes", "--data", scenes],
        "evaluate --source proposals (1 video)": [*evaluate, "proposals", "--data", proposals, "--dynamics", "state"],
        "parse-question": ["parse-question", QUESTION[1]],
    }


def prepare(folder: Path) -> None:
    """Inputs of the commands: two proposal files and a scene of the clip."""
    (folder / "proposals").mkdir()
    (folder / "scenes").mkdir()
    number = VIDEO.stem.split("_")[-1]
    first = folder / "proposals" / f"proposal_{number}.json"
    seconds_of(["parse-video", str(VIDEO), "-o", str(folder / "scene.json"), "--proposals-out", str(first)])
    shutil.copy(first, first.with_name("proposal_00000.json"))
    shutil.copy(TRUTH, folder / "scenes" / f"scene_{number}.json")


def seconds_of(arguments: list[str]) -> float:
    """Wall time of a command of `nsdr` from its cold start.

    Raises:
        SystemExit: it failed.
    """
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "nsdr.cli.main", *arguments], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"nsdr {' '.join(arguments)} failed:\n{done.stdout}{done.stderr}")
    return time.perf_counter() - start


@contextmanager
def busy(n: int) -> Iterator[None]:
    """`n` processes that compute all the time; they end with this one, too."""
    burners = [subprocess.Popen([sys.executable, "-c", BURNER]) for _ in range(n)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--busy", type=int, nargs="+", default=[0, 1, 2], help="numbers of busy processes; 0 comes first"
    )
    parser.add_argument("--repeats", type=int, default=1, help="runs, of which the fastest counts")
    parser.add_argument("--only", nargs="+", default=[""], help="parts of the names of the commands to time")
    options = parser.parse_args()
    loads = sorted({0, *options.busy})
    print(f"{available_cores()} cores; load average before the start {os.getloadavg()[0]:.1f} (should be near 0)\n")
    print("| `nsdr` | idle, s | " + " | ".join(f"beside {n}, s (ratio)" for n in loads[1:]) + " |")
    print("|---" * (1 + len(loads)) + "|", flush=True)
    ratios = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for command, arguments in commands(folder).items():
            if not any(part in command for part in options.only):
                continue
            seconds = []
            for n in loads:
                runs = []
                for _ in range(options.repeats):
                    shutil.rmtree(folder / "out", ignore_errors=True)
                    with busy(n):
                        runs.append(seconds_of(arguments))
                seconds.append(min(runs))
            ratios += [s / seconds[0] for s in seconds[1:]]
            cells = [f"{seconds[0]:.1f}", *(f"{s:.1f} ({s / seconds[0]:.1f})" for s in seconds[1:])]
            print(f"| {command} | {' | '.join(cells)} |", flush=True)
    if ratios:
        print(f"\nhighest ratio: {max(ratios):.1f}")


if __name__ == "__main__":
    main()

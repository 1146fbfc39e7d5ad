"""All measurements of speed, one after the other.

`python -m benchmarks.speed [--data DIR] [--only TITLE ...] [-o results/speed.md]`

Each section of the output says how busy the machine was before it. DIR has clips and official proposals, truth and questions,
as `Makefile` says; without it, the sections that need them are left out and named.
"""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.shared import fastest, load_default, parser_of, table
from nsdr import Executor, track
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.questions import read_questions
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.io.device import available_cores
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import code_revision
from nsdr.question_parser.grammar import GrammarParser

BURNER = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(10**6))\n"
"""Computes without a pause until the process that started it ends."""
BUSY = 2
"""Number of such processes beside which commands are timed."""
SCENES = 200
"""Scenes of the section on whole splits."""
SCENES_WITH_PROGRAMS = 60
"""Scenes of the section on the executor."""
ROUNDS = 3


def executor(data: Path) -> str:
    """Programs a second of CPU time, on scenes from official proposals; executors are made anew."""
    proposals = dict(read_compact_proposals(data / "real/proposals_dev.npz"))
    backend, pairs = load_default(), []
    for asked in read_questions(data / "real/questions/mixed_dev.json")[:SCENES_WITH_PROGRAMS]:
        explanation = backend.explain(states_from_tracks(track(proposals[asked.scene_index])))
        pairs.append((scene_from_prediction(explanation.prediction), asked.questions))

    def each(run: Callable[[Executor, Any], Any]) -> None:
        for scene, questions in pairs:
            one = Executor(scene)
            for program in (q.program for q in questions if not q.choices):
                run(one, program)

    programs = [q.program for _, questions in pairs for q in questions if not q.choices]
    kinds = {"values": Executor.run, "answers with traces": Executor.answer}
    seconds = fastest({name: partial(each, run) for name, run in kinds.items()}, ROUNDS)
    tokens = sum(map(len, programs)) / len(programs)
    head = f"{len(programs)} programs of {tokens:.1f} tokens on average about {len(pairs)} scenes; CPU time"
    return "\n".join([head, *(f"{name}: {len(programs) / cpu:,.0f} programs/s" for name, (cpu, _) in seconds.items())])


def parsing(data: Path) -> str:
    """Distinct texts a second of CPU time, of the default question parser."""
    texts: dict[str, list[str]] = {"descriptive": [], "multiple_choice": [], "choice": []}
    for q in (q for scene in read_questions(data / "real/questions/mixed_dev.json") for q in scene.questions):
        texts["multiple_choice" if q.choices else "descriptive"].append(q.text)
        texts["choice"] += [choice.text for choice in q.choices]
    distinct = {kind: list(dict.fromkeys(listed)) for kind, listed in texts.items()}
    parser = GrammarParser()
    parser.parse_batch(distinct["choice"][:1], "choice")  # warms up
    start = time.process_time()
    for kind, listed in distinct.items():
        parser.parse_batch(listed, kind)
    seconds = time.process_time() - start
    n, n_distinct = (sum(map(len, t.values())) for t in (texts, distinct))
    return f"{n} texts, {n_distinct} distinct: {seconds:.1f} s, {n / seconds:.0f} texts/s"


def run_nsdr(*arguments: Any) -> tuple[float, float, float]:
    """Wall time, CPU time (s) and the peak memory of the largest process (GiB) of a command of `nsdr`, from its cold start.

    Raises:
        SystemExit: it failed.
    """
    command = [sys.executable, "-c", _MEASURE, sys.executable, "-m", "nsdr.cli.main", *map(str, arguments)]
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True)
    wall = time.perf_counter() - start
    if done.returncode:
        raise SystemExit(f"nsdr {' '.join(map(str, arguments))} failed:\n{done.stderr}")
    cpu, peak = map(float, done.stdout.split()[-2:])
    return wall, cpu, peak


_MEASURE = (
    "import resource, subprocess, sys\n"
    "code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode\n"
    "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
    "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20)\n"
    "sys.exit(code)\n"
)
"""Runs a command in a process of its own, so that the peak of its memory is not that of an earlier one."""


@contextmanager
def busy(n: int) -> Iterator[None]:
    """Within the block, `n` processes compute all the time."""
    burners = [subprocess.Popen([sys.executable, "-c", BURNER]) for _ in range(n)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def commands() -> str:
    """Wall time of commands on the clip that ships, idle and beside busy processes."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder, number = Path(name), VIDEO.stem.split("_")[-1]
        out, proposals, scenes = (folder / part for part in ("out", "proposals", "scenes"))
        proposals.mkdir()
        scenes.mkdir()
        first = proposals / f"proposal_{number}.json"
        run_nsdr("parse", VIDEO, "-o", folder / "scene.json", "--proposals-out", first)
        shutil.copy(first, proposals / "proposal_00000.json")
        shutil.copy(TRUTH, scenes / f"scene_{number}.json")
        answer = ("answer", VIDEO, "How many collisions happen?")
        evaluate = ("evaluate", "--questions", QUESTIONS, "--cache", out, "--source")
        timed: dict[str, tuple[Any, ...]] = {
            "answer": answer,
            "answer --dynamics propnet": (*answer, "--dynamics", "propnet"),
            "answer --dynamics propnet_patches": (*answer, "--dynamics", "propnet_patches"),
            "parse (proposals of 2 videos, 2 workers)": ("parse", proposals, "-o", out, "--workers", "2"),
            "evaluate --source scenes (1 video)": (*evaluate, "scenes", "--data", scenes),
            "evaluate --source proposals (1 video)": (*evaluate, "proposals", "--data", proposals),
            "program": ("program", answer[-1]),
        }
        for command, arguments in timed.items():
            seconds = []
            for n in (0, BUSY):
                shutil.rmtree(out, ignore_errors=True)
                with busy(n):
                    seconds.append(run_nsdr(*arguments)[0])
            rows.append((command, f"{seconds[0]:.1f}", f"{seconds[1]:.1f} ({seconds[1] / seconds[0]:.1f})"))
    return table(("`nsdr`", "idle, s", f"beside {BUSY} busy processes, s (ratio)"), rows)


def splits(data: Path) -> str:
    """Videos an hour of `nsdr evaluate` from proposals, without the start: of all scenes but the first quarter."""
    base = ["evaluate", "--keep-going", "--source", "proposals", "--data", data / "real/proposals_dev.npz"]
    base += ["--questions", data / "real/questions/mixed_dev.json"]
    kinds = {"1 process": ["--workers", 1], "2 processes": ["--workers", 2]}
    if importlib.util.find_spec("ray"):
        kinds["2 Ray workers"] = ["--workers", 2, "--engine", "ray"]
    rows = []
    for name, arguments in kinds.items():
        runs = []
        for limit in (SCENES // 4, SCENES):
            with tempfile.TemporaryDirectory() as cache:
                runs.append(run_nsdr(*base, "--cache", cache, "--limit", limit, *arguments))
        (start, _, small), (wall, cpu, peak) = runs
        rate = 3600 * (SCENES - SCENES // 4) / (wall - start)
        rows.append((name, f"{wall:.0f}", f"{cpu:.0f}", f"{rate:,.0f}", f"{peak:.2f}", f"{small:.2f}"))
    columns = ("run", "wall, s", "CPU, s", "videos an hour", "memory, GiB", "memory for a quarter, GiB")
    return f"{SCENES} scenes\n\n{table(columns, rows)}"


def printed(*arguments: str) -> str:
    """What another benchmark prints."""
    done = subprocess.run([sys.executable, "-m", *arguments], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)} failed")
    return done.stdout.strip()


def sections(data: Path | None) -> dict[str, Callable[[], str] | None]:
    """What is measured, by title; None where data are missing."""
    titles = ("Commands", "Executor", "Question parser", "Dynamics", "Detector", "Whole splits")
    if data is None:
        return {title: commands if title == "Commands" else None for title in titles}
    dev = ["--proposals", f"{data}/real/proposals_dev.npz", "--truth", f"{data}/real/truth_dev.json.gz"]
    clips = ["--videos", f"{data}/clips", "--proposals", f"{data}/clips", "--every", "0"]
    measured: tuple[Callable[[], str], ...] = (
        commands,
        partial(executor, data),
        partial(parsing, data),
        partial(printed, "benchmarks.dynamics", *dev, "--scenes", "50", "--rollouts", "1"),
        partial(printed, "benchmarks.frame_parser", *clips),
        partial(splits, data),
    )
    return dict(zip(titles, measured, strict=True))


def processor() -> str:
    """Name of the processor."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text().splitlines() if file.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--only", nargs="+", help="titles of sections")
    options = parser.parse_args()
    text = (
        "# Speed\n\n"
        f"`make bench` at revision {code_revision()}, {time.strftime('%Y-%m-%d')}: {available_cores()} cores of {processor()}, "
        f"no accelerator, Python {platform.python_version()}. Load is the mean number of busy processes in the minute before.\n"
    )
    for title, measure in sections(options.data).items():
        if options.only and title not in options.only:
            continue
        load = os.getloadavg()[0]
        found = "Not measured: needs `--data`." if measure is None else f"Load {load:.1f}.\n\n{_paragraphs(measure())}"
        print(f"## {title}\n\n{found}\n", flush=True)
        text += f"\n## {title}\n\n{found}\n"
        if options.output:
            with atomic_path(options.output) as temporary:  # what is done is kept if a later one fails
                temporary.write_text(text)


def _paragraphs(output: str) -> str:
    """Lines outside of tables as paragraphs of their own."""
    lines = (line if line.startswith("|") or not line else f"\n{line.strip()}\n" for line in output.splitlines())
    return "\n".join(lines).replace("\n\n\n", "\n\n").strip()


if __name__ == "__main__":
    main()

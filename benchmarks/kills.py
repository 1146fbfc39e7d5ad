"""Kill -9 of every long command, and what is lost: `python benchmarks/kills.py [--kills 10] [--only NAME ...] [--work FOLDER]`.

Every command runs once to its end. Then it is started again in an empty folder, killed with all its workers when it has come so
far, started again, and so on: the kills are spread evenly over the run by the units (steps, videos, scenes) that are done, each
at a random moment of its unit. At last it runs to its end. Both folders must hold the same files, hidden ones included, with
the same bytes. Prints a Markdown table; exits with 1 if a folder differs or a finished unit was done again without need.
"""

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from nsdr.io.ledger import LEDGER, read_ledger
from nsdr.world.world import CLEVRER_WORLD

SHORT_FRAMES = 40
"""Frames of each video of the data set whose generation is killed; those that other commands read have CLEVRER's 128."""
WORKERS = 2
"""Processes of each command that has `--workers`."""
POLL_S = 0.01
"""Time between two looks at the progress (s)."""
UNCOMPARED = re.compile(r"events\.out\.tfevents.*|\.fingerprints\.jsonl")
"""Names of files that are logs: one TensorBoard file per start, and a line for every task begun or done."""
TIMES = re.compile(rb'"(?:cpu_)?seconds": [\d.]+|"date": "[\d-]+"|\bin \d+ s \([\d-]+')
"""What experiments and trainings write of the time that they took."""


@dataclass(frozen=True)
class Command:
    """A command whose output goes to `out` in its working directory.

    Attributes:
        arguments: of `nsdr`.
        unit: what its progress is counted in.
        done: units that are finished, by the folder.
        kept: units of these that the next start does not do again.
    """

    arguments: Sequence[str]
    unit: str
    done: Callable[[Path], int]
    kept: Callable[[Path], int]


def finished_tasks(folder: Path) -> dict[str, tuple[int, int]]:
    """Inode and time of the outputs that the ledgers below a folder vouch for, by path."""
    found = {}
    for ledger in folder.rglob(LEDGER):
        for entry in read_ledger(ledger.parent).values():
            if entry.fingerprint:
                output = ledger.parent / entry.output
                status = output.stat()
                found[str(output)] = (status.st_ino, status.st_mtime_ns)
    return found


def tasks_and_files(folder: Path) -> int:
    """Finished tasks, and the files at the end: questions, statistics, tables."""
    names = ("questions/*", "questions_test.json", "statistics.*", "out.json", "example.*")
    return len(finished_tasks(folder)) + sum(1 for name in names for _ in folder.rglob(name))


def steps(folder: Path) -> int:
    """Training steps, each of which has a line; and the checkpoint at the end."""
    metrics = folder / "out" / "metrics.jsonl"
    lines = metrics.read_bytes().count(b"\n") if metrics.exists() else 0
    return lines + len(list(folder.glob("out/checkpoint/*.json")))


def saved_steps(folder: Path) -> int:
    """Steps up to the newest checkpoint."""
    return max((int(path.stem.split("_")[1]) for path in folder.glob("out/step_*.json")), default=0)


def commands(data: Path, videos: int, count: int) -> dict[str, Command]:
    """All commands, on a generated data set of so many videos and what was made from it; trainings of `count` steps."""
    root, both = data / "set", f"--workers {WORKERS}".split()
    network = (
        "{widths: [16, 16, 16, 32], blocks: 1, fpn_channels: 16, box_features: 32, mask_channels: 16, mask_layers: 1}"
    )

    def work(unit: str, *arguments: str) -> Command:
        return Command((*arguments, *both), unit, tasks_and_files, tasks_and_files)

    def training(part: str, *arguments: str) -> Command:
        loop = (
            f"--loop.steps {count} --loop.batch-size 2 --loop.log-every 1 --loop.save-every 6 --loop.evaluate-every 20"
        )
        options = f"--run-dir out {loop} --loop.device cpu".split()
        return Command(("train", part, *arguments, *options), "step", steps, saved_steps)

    motion = ("--proposals", f"{data}/motion/proposals.npz", "--truth", f"{data}/motion/truth.json.gz")
    return {
        "generate dataset": work("video", *generation("out", videos, SHORT_FRAMES)),
        "train question-parser": training(
            *("question-parser", "--model.embedding", "8", "--model.hidden", "16", "--evaluation-texts", "5")
        ),
        "train dynamics": training("dynamics", *motion, "--model.hidden", "16"),
        "train frame-parser": training(
            *("frame-parser", "--frames", f"{data}/frames", "--model", network, "--evaluation-frames", "2")
        ),
        "parse (proposals)": work(
            *("video", "parse", f"{root}/derender_proposals", "-o", "out", "--form", "predictions"),
        ),
        "parse (videos)": work("video", "parse", f"{root}/videos", "-o", "out", "--set", "stride=16"),
        "evaluate --root": work(
            *("scene", "evaluate", "--root", str(root), "--source", "proposals", "--programs", "gold"),
            *("--cache", "out/scenes", "-o", "out/out.json", "--keep-going"),
        ),
        "experiment": Command(
            ("experiment", f"{data}/example.yaml", "-o", "out", "--keep-going"),
            "scene",
            tasks_and_files,
            tasks_and_files,
        ),
    }


def generation(output: str, videos: int, frames: int) -> list[str]:
    shares = ["--splits.train", "0.3", "--splits.validation", "0.7", "--splits.test", "0"]
    scene = ["--first-scene", "500300", "--scene.n-frames", str(frames), "--scene.objects", "{3: 1.0}"]
    image = ["--render.width", "120", "--render.height", "80"]
    return ["generate", "dataset", "-o", output, "--videos", str(videos), *shares, *scene, *image]


def prepare(data: Path, videos: int) -> None:
    """The data set, and what the trainings and the experiment read."""
    run([*generation("set", videos, CLEVRER_WORLD.timeline.frames), "--workers", str(WORKERS)], data)
    frames = ("-o", "frames", "--every", "16")
    run(["data", "frames", "set/videos", "--proposals", "set/derender_proposals", *frames], data)
    run(["data", "motion", "set", "--split", "train", "-o", "motion"], data)
    (data / "example.yaml").write_text(
        "title: Example\n"
        f"common: {{questions: {data}/set/questions/validation.json, data: {data}/set/derender_proposals, programs: gold,\n"
        f"  source: proposals, cache: out/scenes, workers: {WORKERS}}}\n"
        "rows:\n  - {name: state, dynamics: propnet}\n  - {name: guess, baseline: random}\n  - {name: physics}\n"
    )


def start(arguments: Sequence[str], folder: Path) -> subprocess.Popen[bytes]:
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "PASSIVE"}
    with (folder / "log.txt").open("ab") as log:
        command = [sys.executable, "-m", "nsdr.cli.main", *arguments]
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True)


def run(arguments: Sequence[str], folder: Path) -> None:
    if start(arguments, folder).wait():
        lines = (folder / "log.txt").read_text().splitlines()[-5:]
        raise SystemExit("\n".join([f"nsdr {' '.join(arguments)} failed:", *lines]))


def contents(folder: Path) -> dict[str, bytes]:
    """What is compared, by path: all files, and the bytes of those that are no logs."""
    files = sorted(p for p in (folder / "out").rglob("*") if p.is_file() and not UNCOMPARED.fullmatch(p.name))
    return {str(p.relative_to(folder)): TIMES.sub(b"", p.read_bytes()) for p in files}


def whole_run(command: Command, folder: Path) -> tuple[float, float, int]:
    """Seconds until the first unit and per further unit of an uninterrupted run, and the number of its units."""
    begin = time.monotonic()
    process, first = start(command.arguments, folder), 0.0
    while process.poll() is None:
        time.sleep(POLL_S)
        if not first and command.done(folder):
            first = time.monotonic() - begin
    if process.returncode:
        raise SystemExit(f"nsdr {' '.join(command.arguments)} failed; see {folder}/log.txt")
    total = command.done(folder)
    return first, (time.monotonic() - begin - first) / max(total - 1, 1), total


def killed_run(command: Command, folder: Path, target: int, delay: float) -> bool:
    """Start, and kill some time after so many units are done; whether it still ran."""
    process = start(command.arguments, folder)
    while process.poll() is None and command.done(folder) < target:
        time.sleep(POLL_S)
    time.sleep(delay)
    alive = process.poll() is None
    os.killpg(process.pid, signal.SIGKILL) if alive else None
    process.wait()
    return alive


def measure(name: str, command: Command, work: Path, kills: int, rng: random.Random) -> tuple[str, bool]:
    """A row of the table, and whether all is well."""
    slug = re.sub(r"\W+", "_", name)
    whole, killed = work / f"{slug}_whole", work / f"{slug}_killed"
    first, per_unit, total = whole_run(command, whole)
    count = repeated = lost = 0
    before: dict[str, tuple[int, int]] = {}
    for k in range(kills):
        target = round(k * (total - 1) / max(kills - 1, 1))
        count += killed_run(command, killed, target, rng.uniform(0, per_unit if target else first))
        done = command.done(killed)
        if command.unit == "step":
            repeated += max(done - command.kept(killed), 0)
        else:
            repeated += min(WORKERS, total - done)  # tasks that may have been begun
        now = finished_tasks(killed)
        lost += sum(now.get(output) != status for output, status in before.items())
        before = now
    run(command.arguments, killed)
    now = finished_tasks(killed)
    lost += sum(now.get(output) != status for output, status in before.items())
    expected, found = contents(whole), contents(killed)
    differing = sorted(p for p in {*expected, *found} if expected.get(p) != found.get(p))
    for path in differing:
        print(f"{name}: {path} differs", file=sys.stderr)
    share = repeated / max(count, 1) / total
    row = f"| `nsdr {name}` | {total} {command.unit}s | {count} | {len(expected)} | {len(differing)} | {lost} | {share:.1%} |"
    return row, not differing and not lost


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    names = list(commands(Path(), 0, 0))
    parser.add_argument("--kills", type=int, default=10, help="of each command")
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="commands")
    parser.add_argument("--videos", type=int, default=24, help="of the generated data set")
    parser.add_argument("--steps", type=int, default=60, help="of each training")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--work", default="", help="folder to work in, which is kept; a temporary one by default")
    options = parser.parse_args(argv)
    rng, well = random.Random(options.seed), True
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(options.work or temporary).resolve()
        every = commands(work / "data", options.videos, options.steps)
        chosen = {name: command for name, command in every.items() if name in options.only}
        is_prepared = (work / "data" / "example.yaml").exists()
        if set(chosen) - {"generate dataset", "train question-parser"} and not is_prepared:
            prepare(work / "data", options.videos)
        print(
            "| command | units | kills | files | differing | finished tasks done again | begun again, per kill (at most) |"
        )
        print("|---|---|---|---|---|---|---|", flush=True)
        for name, command in chosen.items():
            row, is_well = measure(name, command, work, options.kills, rng)
            well &= is_well
            print(row, flush=True)
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())

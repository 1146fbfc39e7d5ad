"""All measurements of speed, one after the other: `python benchmarks/speed.py -o results/speed.md [--data DIR]`.

Each section is the command, the load before it, and what it printed. `--data` names a folder with clips and with official
proposals, truth and questions, as `Makefile` says; without it, the sections that need it are left out and named.
"""

import argparse
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

from nsdr.io.device import available_cores
from nsdr.io.files import atomic_path

HERE = Path(__file__).parent


def sections(data: Path | None) -> list[tuple[str, list[str] | None]]:
    """(title, arguments of Python) of each; None where data are missing."""
    real, clips = (data / "real", data / "clips") if data else (None, None)
    dev = ["--proposals", f"{real}/proposals_dev.npz", "--truth", f"{real}/truth_dev.json.gz", "--scenes", "50"]
    questions = ["--questions", f"{real}/questions/mixed_dev.json", "--data", f"{real}/proposals_dev.npz"]
    listed: list[tuple[str, list[str], bool]] = [
        ("Executor and prediction files", ["executor.py"], False),
        ("Commands from a cold start, idle and beside busy processes", ["busy.py", "--busy", "0", "2"], False),
        ("Dynamics", ["dynamics.py", *dev, "--rollouts", "1"], True),
        ("Detector", ["frame_parser.py", "--videos", f"{clips}", "--proposals", f"{clips}", "--every", "0"], True),
        (
            "Question parser: a file's texts at once, and one by one",
            ["parsing.py", f"{real}/questions/mixed_dev.json"],
            True,
        ),
        ("Whole splits", ["scale.py", *questions, "--limit", "200"], True),
    ]
    return [(title, None if needs_data and not data else arguments) for title, arguments, needs_data in listed]


def output_of(arguments: list[str]) -> str:
    """What a benchmark printed.

    Raises:
        SystemExit: it failed.
    """
    done = subprocess.run([sys.executable, str(HERE / arguments[0]), *arguments[1:]], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)} failed")
    return done.stdout.strip()


def revision() -> str:
    """Of the working tree, with a mark if it differs."""
    git = ["git", "-C", str(HERE), "describe", "--always", "--dirty", "--abbrev=12"]
    done = subprocess.run(git, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return done.stdout.strip() or "unknown"


def processor() -> str:
    """Name of the processor."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text().splitlines() if file.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--data", type=Path)
    options = parser.parse_args()
    text = (
        "# Speed\n\n"
        f"`make bench` at revision {revision()}, {time.strftime('%Y-%m-%d')}: {available_cores()} cores of {processor()}, "
        f"no accelerator, Python {platform.python_version()}. Load is the mean number of busy processes in the minute before.\n"
    )
    for title, arguments in sections(options.data):
        print(title, file=sys.stderr, flush=True)
        if arguments is None:
            text += f"\n## {title}\n\nNot measured: needs `--data`.\n"
            continue
        load = os.getloadavg()[0]
        shown = " ".join(arguments).replace(str(options.data), "DATA")
        text += f"\n## {title}\n\n`python benchmarks/{shown}`, load {load:.1f}\n\n{_block(output_of(arguments))}\n"
        with atomic_path(options.output) as temporary:  # what is done is kept if a later one fails
            temporary.write_text(text)


def _block(output: str) -> str:
    """Tables as they are, other lines as a block of text."""
    parts: list[tuple[bool, list[str]]] = []
    for line in output.splitlines():
        is_table = line.startswith("|")
        if not parts or parts[-1][0] != is_table:
            parts.append((is_table, []))
        parts[-1][1].append(line)
    return "\n\n".join("\n".join(lines if is_table else ["```", *lines, "```"]) for is_table, lines in parts)


if __name__ == "__main__":
    main()

"""A machine that fails or is odd: full disks, file names that are not UTF-8, links to folders that lead to themselves."""

import os
import resource
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from tests.robustness.case import Case
from tests.robustness.good import COMMANDS, PREDICT, SCORE

FULL = "full disk"
"""First argument of cases that run a command on a full disk; the second one is the size to which files can grow (bytes)."""
PROBED, WRITTEN = 1000, 5000
"""Sizes that a probe before the work notices, and that only the output itself exceeds (bytes)."""
OUTPUTS: dict[str, tuple[tuple[str, ...], str, tuple[int, ...]]] = {
    "parse (proposals)": ((*PREDICT[:2], "-o", "{good}/full", "--workers", "1"), "full", (PROBED,)),
    "generate scene": (("generate", "scene", "-o", "scene.json"), "scene.json", (PROBED, WRITTEN)),
    "evaluate": ((*COMMANDS["compact"], "--keep-going"), "out.json", (PROBED,)),
    "score": (SCORE, "report.json", (PROBED,)),
}
"""Commands, the output that their error names, and sizes that are too small for it."""
ODD = os.fsdecode(b"s\xff")
"""A name that is not UTF-8, without its ending; and how an error shows it."""
SHOWN = r"s\xff"
NAMED: dict[str, tuple[str, ...]] = {
    "answer": ("answer", f"{ODD}.mp4", "How many collisions happen?"),
    "answer, scene": ("answer", f"{ODD}.json", "How many collisions happen?"),
    "judge": ("judge", f"{ODD}.mp4"),
    "parse": ("parse", f"{ODD}.mp4", "-o", "scene.json"),
    "parse, output": ("parse", "{good}/video.mp4", "-o", f"{ODD}.json"),
    "visualize": ("visualize", f"{ODD}.mp4", "-o", "image.png"),
    "background": ("answer", "{good}/video.mp4", "How many collisions happen?", "--background", f"{ODD}.png"),
    "score": ("score", f"{ODD}.json", *SCORE[2:]),
    "configuration": ("generate", "scene", "--config", f"{ODD}.yaml", "-o", "scene.json"),
}  # fmt: skip
"""Commands that are given a file of such a name."""


def on_full_disk(arguments: Sequence[str]) -> int:
    """Run a command while no file can grow beyond a size; returns its exit status."""
    size, *argv = arguments
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(size), before[1]))
    try:
        return main(argv)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def _odd_files(folder: Path, _: Path) -> None:
    for suffix in (".mp4", ".json", ".png", ".yaml"):
        shutil.copy(VIDEO, folder / f"{ODD}{suffix}")


def _linked_in_a_circle(folder: Path, _: Path) -> None:
    (folder / "videos" / "a").mkdir(parents=True)
    (folder / "videos" / "a" / "up").symlink_to("..")
    (folder / "videos" / "again").symlink_to("a")


def machine_cases() -> Iterator[Case]:
    """All cases of failing machines."""
    for name, (argv, output, sizes) in OUTPUTS.items():
        for size in sizes:
            yield Case("machine, full disk", f"{name}, {size}", (FULL, str(size), *argv), named=output)
    for name, argv in NAMED.items():
        yield Case("machine, name", name, argv, _odd_files, SHOWN)
    folder = ("parse", "videos", "-o", "out", "--workers", "1")
    yield Case("machine, links", "in a circle", folder, _linked_in_a_circle, "videos")

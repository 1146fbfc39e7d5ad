"""Videos for controls: blind, reversed and exchanged ones, in CLEVRER's layout and under the names of the true ones."""

import random
import shutil
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from nsdr.clevrer.dataset import CLEVRER, Split, sub_folder
from nsdr.clevrer.files.questions import write_questions
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, check_installed, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, Summary, run_jobs
from nsdr.io.reading import read_json
from nsdr.io.video import even_frames, write_video

VERSION = 1
"""Of the videos that are written: raised when they change."""
CONTROLS = ("blind", "reversed", "shuffled")
"""Kinds of controls: grey frames; the frames in reverse order; each scene with the video of another one."""
EXCHANGED = "exchanged.json"
"""File in the folder of "shuffled" that gives, by scene index, the scene whose video it has."""
MIN_EXCHANGED = 2
GREY = 128
"""Value of every pixel of a blind video (0-255)."""
PRESET = "veryfast"
"""x264's preset of the videos that are encoded again."""


def write_controls(
    root: str | Path,
    output: str | Path,
    split: str = "validation",
    kinds: Sequence[str] = CONTROLS,
    limit: int = 0,
    workers: int = 0,
    engine: str = "processes",
) -> dict[str, Summary]:
    """Write a data set of videos and questions for each kind of control, resumably.

    `output/KIND/videos/SPLIT/video_10000-11000/video_10000.mp4` has as many frames as the true video of that name, in its
    size up to 480x320; blind and reversed videos are encoded again, in even sizes, exchanged ones are copies.

    Args:
        root: a data set in the official layout (see `nsdr.clevrer.CLEVRER`).
        output: the folder to write.
        split: which videos.
        kinds: some of `CONTROLS`.
        limit: the first n videos and their questions only; 0 for all.
        workers, engine: see `nsdr.io.tasks.run_tasks`.

    Raises:
        DataError: an unknown kind, no videos, fewer than 2 to exchange, `output` is `root` or below its videos, or PyAV is
            missing.
    """
    if unknown := sorted(set(kinds) - set(CONTROLS)):
        raise DataError(f"kinds: {unknown[0]!r} is no control; expected some of {', '.join(CONTROLS)}")
    taken = Path(root).resolve()
    if Path(output).resolve() == taken or (taken / "videos") in (Path(output) / "x").resolve().parents:
        raise DataError(f"{output}: is the data set itself, or among its videos; choose another output")
    check_installed("av", "writing videos needs PyAV", "visualize")
    videos = CLEVRER(root).split(split)
    indices = sorted(videos.entries("videos"))[: limit or None]
    if not indices:
        raise DataError(f"{root}: has no videos of {split}")
    if "shuffled" in kinds:
        exchange(indices)  # too few are found before anything is written
    return {kind: _write(kind, videos, indices, Path(output) / kind, workers, engine) for kind in kinds}


def exchange(indices: Sequence[int]) -> dict[int, int]:
    """For each scene another one, each once: a random cycle through all of them, so that none keeps its own.

    Raises:
        DataError: fewer than 2 scenes.
    """
    if len(indices) < MIN_EXCHANGED:
        raise DataError(f"kind shuffled: {len(indices)} videos: at least {MIN_EXCHANGED} are needed to exchange them")
    order = list(indices)
    random.Random(0).shuffle(order)
    return dict(sorted(zip(order, [*order[1:], order[0]], strict=True)))


def _write(kind: str, split: Split, indices: Sequence[int], folder: Path, workers: int, engine: str) -> Summary:
    taken = exchange(indices) if kind == "shuffled" else {i: i for i in indices}
    jobs = []
    for index, source in taken.items():
        place = folder / "videos" / split.name / sub_folder("video", index) / f"video_{index:05d}.mp4"
        video = split.video(source)
        jobs.append(Job(str(index), video, place, fingerprint(inputs=[video], config=[VERSION, kind])))
    summary = run_jobs(partial(_write_video, kind), jobs, folder, engine, workers)
    if kind == "shuffled":
        write_json(folder / EXCHANGED, {str(i): source for i, source in taken.items()}, indent=1)
    if split.question_file is not None:
        target = folder / "questions" / f"{split.name}.json"
        if taken.keys() < split.entries("videos").keys():
            write_questions(target, [scene for scene in split.questions() if scene.scene_index in taken])
        else:
            with atomic_path(target) as temporary:
                shutil.copyfile(split.question_file, temporary)
    if (manifest := split.root / "manifest.json").is_file():
        content = {**read_json(manifest), "kinds": ["videos", "questions"]}
        content.pop("config", None)  # no seed simulates what these videos show
        write_json(folder / "manifest.json", content, indent=1)
    return summary


def _write_video(kind: str, video: Path, output: Path) -> None:
    if kind == "shuffled":
        with atomic_path(output) as temporary:
            shutil.copyfile(video, temporary)
        return
    frames = even_frames(video)
    write_video(output, np.full_like(frames, GREY) if kind == "blind" else frames[::-1], preset=PRESET)

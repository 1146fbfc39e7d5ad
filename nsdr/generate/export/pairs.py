"""Pairs of videos about which the same question is asked, as a data set in CLEVRER's layout.

The first video of a pair is one of the data set's. The second is the same without an object, where the answer differs: a
system that does not look answers both alike, so it never has both right. Or the second shows the same events, mirrored or in
other light and with noise, and the answer is the same.
"""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import count, takewhile
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from tqdm import tqdm

from nsdr.clevrer.answers.prompts import solution
from nsdr.clevrer.dataset import CLEVRER, SPLITS, Split
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import Question, SceneQuestions, write_questions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.errors import DataError, NsdrError
from nsdr.generate.dataset import Files
from nsdr.io.files import atomic_path, write_json
from nsdr.io.video import even_frames, write_video
from nsdr.io.worlds import stored_world
from nsdr.symbolic import Executor
from nsdr.world.vocabulary import DIRECTIONS

GAIN = (0.85, 1.15)
"""Min and max factor of each colour channel of a noisy video."""
NOISE = 5.0
"""Standard deviation of the noise in each pixel, channel and frame of a noisy video (of 255)."""
PRESET = "veryfast"
"""x264's preset of the videos that are encoded again."""
Frames = Iterator[NDArray[np.uint8]]


def _mirrored(frames: NDArray[np.uint8], _: int) -> Frames:
    return (frame[:, ::-1] for frame in frames)


def _noisy(frames: NDArray[np.uint8], seed: int) -> Frames:
    rng = np.random.default_rng(seed)
    gain = rng.uniform(*GAIN, 3)
    return (np.clip(f * gain + rng.normal(0, NOISE, f.shape), 0, 255).round().astype(np.uint8) for f in frames)


SAME: dict[str, Callable[[NDArray[np.uint8], int], Frames]] = {"mirrored": _mirrored, "noisy": _noisy}
"""What makes the second videos in which the same happens, from the first one's frames and a seed."""


def write_pairs(
    data: CLEVRER, questions: Mapping[str, Sequence[SceneQuestions]], folder: Path
) -> dict[str, list[SceneQuestions]]:
    """Write a data set of pairs, whose `Question.pair` names the question that is to be compared.

    Args:
        data: the data set.
        questions: its questions by split, of videos that are all there.
        folder: the folder to write; videos that are there are kept.

    Returns:
        The questions of the pairs by split.

    Raises:
        DataError: the release's split has fewer indices than there are videos.
    """
    written = {split: _write_split(data.split(split), scenes, folder) for split, scenes in questions.items()}
    if data.manifest is not None:
        counts = {split: len(written.get(split, ())) for split in SPLITS}
        splits = {split: (indices.start, indices.start + counts[split]) for split, indices in SPLITS.items()}
        manifest = {"splits": splits, "kinds": ["videos", "questions"], "n_frames": data.manifest["n_frames"]}
        manifest |= stored_world(data.world)
        write_json(folder / "manifest.json", manifest, indent=1)
    return written


def _write_split(source: Split, scenes: Sequence[SceneQuestions], folder: Path) -> list[SceneQuestions]:
    """Write a split's videos and the questions about them; the videos get the first indices of the release's split."""
    indices = SPLITS[source.name]
    n = sum(1 + len(_counterfactual(source, scene)) + len(SAME) for scene in scenes)
    if n > len(indices):
        raise DataError(
            f"pairs of {source.name} need up to {n} videos; there are indices for {len(indices)}: use --limit"
        )
    written: list[SceneQuestions] = []
    for scene in tqdm(scenes, unit="video", desc=source.name):
        first = indices[len(written)]
        for kind, video, questions in _videos(source, scene):
            index = indices[len(written)]
            target = Files(folder, source.name, index).video
            if kind not in SAME:
                copy_once(video, target)
            elif not target.exists():
                frames = even_frames(video, source.world)
                write_video(target, SAME[kind](frames, index), source.world.timeline.fps, preset=PRESET)
            if kind:
                questions = [replace(q, pair=f"{first}-{q.id}", pair_kind=kind) for q in questions]
            written.append(SceneQuestions(index, target.name, tuple(questions)))
    write_questions(folder / "questions" / f"{source.name}.json", written)
    return written


def copy_once(source: Path, target: Path) -> None:
    """Copy a file, atomically, unless the target is there."""
    if not target.exists():
        with atomic_path(target) as temporary:
            shutil.copyfile(source, temporary)


def _videos(source: Split, scene: SceneQuestions) -> Iterator[tuple[str, Path, Sequence[Question]]]:
    """Yield a scene's video and those that are compared with it: kind of pair ("" of the first), file, and questions."""
    video = source.video(scene.scene_index)
    yield "", video, scene.questions
    for files in _counterfactual(source, scene):
        executor = Executor(scene_from_truth(read_truth_file(files.truth)))
        if changed := [other for q in scene.questions if (other := _changed(q, executor)) is not None]:
            yield "changed", files.video, changed
    yield "mirrored", video, [q for q in scene.questions if q.answer not in DIRECTIONS]
    yield "noisy", video, scene.questions


def _counterfactual(source: Split, scene: SceneQuestions) -> list[Files]:
    """The files of a scene's counterfactual videos."""
    found = (Files(source.root, source.name, scene.scene_index, number) for number in count(1))
    return list(takewhile(lambda files: files.truth.exists(), found))


def _changed(question: Question, executor: Executor) -> Question | None:
    """The question with its answers in a counterfactual video; None if they do not differ, or if it has none there.

    A counterfactual question has none: it would be about a second removal. A predictive question has some only if exactly one
    option is right there, as in CLEVRER.
    """
    if question.type == "counterfactual" or question.program is None:
        return None
    with suppress(NsdrError):
        if question.type == "descriptive":
            other = replace(question, answer=executor.answer(question.program).text)
        else:
            values = [executor.run([*(c.program or ()), *question.program]) for c in question.choices]
            answers = ["correct" if value else "wrong" for value in values]
            if question.type == "predictive" and answers.count("correct") != 1:
                return None
            judged = zip(question.choices, answers, strict=True)
            other = replace(question, choices=tuple(replace(c, answer=a) for c, a in judged))
        return other if solution(other) != solution(question) else None
    return None

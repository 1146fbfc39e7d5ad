"""Pairs of videos about which the same question is asked, as a data set in CLEVRER's layout.

The first video of a pair is one of the data set's. The second is the same without an object, where the answer differs: a
system that does not look answers both alike, so it never has both right. Or the second shows the same events, mirrored or in
other light and with noise, and the answer is the same.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import count, takewhile
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from tqdm import tqdm

from nsdr.clevrer.answers.prompts import solution
from nsdr.clevrer.dataset import SPLITS, Split
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import Question, SceneQuestions, write_questions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.errors import DataError, NsdrError
from nsdr.generate.dataset import Files
from nsdr.generate.export.base import Export, Exporter, SplitSummary, copy_once, is_unanswered
from nsdr.io.files import write_json
from nsdr.io.video import even_frames, write_video
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


def _write(export: Export) -> None:
    splits = {name: (indices.start, indices.start) for name, indices in SPLITS.items()}
    for split in export.splits:
        start, rows = SPLITS[split].start, _rows(export, split)
        write_questions(export.folder / "questions" / f"{split}.json", rows)
        splits[split] = start, start + len(rows)
        asked = [q for row in rows for q in row.questions]
        export.splits[split] = SplitSummary(len(rows), len(asked), sum(map(is_unanswered, asked)))
    if export.data.manifest is not None:
        n_frames = export.data.manifest["n_frames"]
        manifest = {"splits": splits, "kinds": ["videos", "questions"], "n_frames": n_frames}
        write_json(export.folder / "manifest.json", manifest, indent=1)


def _rows(export: Export, split: str) -> list[SceneQuestions]:
    """Write a split's videos, and return the questions about them; the indices are the first ones of the release's."""
    source, indices = export.data.split(split), SPLITS[split]
    n = sum(1 + len(_worlds(source, scene)) + len(SAME) for scene in export.questions(split))
    if n > len(indices):
        raise DataError(f"pairs of {split} need up to {n} videos; there are indices for {len(indices)}: use --limit")
    rows: list[SceneQuestions] = []
    for scene in tqdm(export.questions(split), total=export.splits[split].videos, unit="video", desc=split):
        first = indices[len(rows)]
        for kind, video, questions in _videos(source, scene):
            index = indices[len(rows)]
            target = Files(export.folder, split, index).video
            if kind not in SAME:
                copy_once(video, target)
            elif not target.exists():
                write_video(target, SAME[kind](even_frames(video), index), preset=PRESET)
            if kind:
                questions = [replace(q, pair=f"{first}-{q.id}", pair_kind=kind) for q in questions]
            rows.append(SceneQuestions(index, target.name, tuple(questions)))
    return rows


def _videos(source: Split, scene: SceneQuestions) -> Iterator[tuple[str, Path, Sequence[Question]]]:
    """A scene's video, and those that are compared with it: (kind of pair, or "" of the first; what is shown; questions)."""
    video = source.video(scene.scene_index)
    yield "", video, scene.questions
    for world in _worlds(source, scene):
        executor = Executor(scene_from_truth(read_truth_file(world.truth)))
        if changed := [other for q in scene.questions if (other := _changed(q, executor)) is not None]:
            yield "changed", world.video, changed
    yield "mirrored", video, [q for q in scene.questions if q.answer not in DIRECTIONS]
    yield "noisy", video, scene.questions


def _worlds(source: Split, scene: SceneQuestions) -> list[Files]:
    """The files of a scene's worlds without an object."""
    found = (Files(source.root, source.name, scene.scene_index, world) for world in count(1))
    return list(takewhile(lambda files: files.truth.exists(), found))


def _changed(question: Question, executor: Executor) -> Question | None:
    """The question with the answers in another world, if it has some there that differ.

    None of a counterfactual question, which is about a second removal, and of a predictive one of whose options not exactly
    one is right there, as in CLEVRER.
    """
    if question.type == "counterfactual" or question.program is None:
        return None
    with suppress(NsdrError):
        if question.type == "descriptive":
            other = replace(question, answer=executor.answer(question.program).answer)
        else:
            values = [executor.run([*(c.program or ()), *question.program]) for c in question.choices]
            answers = ["correct" if value else "wrong" for value in values]
            if question.type == "predictive" and answers.count("correct") != 1:
                return None
            judged = zip(question.choices, answers, strict=True)
            other = replace(question, choices=tuple(replace(c, answer=a) for c, a in judged))
        return other if solution(other) != solution(question) else None
    return None


PAIRS = Exporter(_write, refuses=("--scenes", "--videos none", "--reasoning"))
"""A data set in CLEVRER's layout of videos and questions, whose `Question.pair` names the question that is to be compared."""

"""Access to a folder with CLEVRER's files by split and video index, and a list of what is missing."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypedDict

from nsdr.clevrer.files.annotations import check_annotation
from nsdr.clevrer.files.proposals import read_proposals
from nsdr.clevrer.files.questions import SceneQuestions, read_questions
from nsdr.clevrer.layout import DataSetFiles
from nsdr.errors import DataError
from nsdr.io.description import differing
from nsdr.io.limits import check_limit
from nsdr.io.reading import read_json
from nsdr.io.worlds import world_in
from nsdr.types import VideoProposals
from nsdr.validation import PositiveCount, convert, expect
from nsdr.world.world import CLEVRER_WORLD, World

__all__ = ["CLEVRER", "KINDS", "SPLITS", "Inventory", "Split", "file_name", "sub_folder"]

SPLITS = {"train": range(0, 10000), "validation": range(10000, 15000), "test": range(15000, 20000)}
"""Video indices of each split."""
KINDS = ("videos", "annotations", "questions", "proposals")
"""Kinds of files."""
_FILES = {
    "videos": ["video_{index:05d}.mp4"],
    "annotations": ["annotation_{index:05d}.json"],
    "proposals": ["proposal_{index:05d}.json", "sim_{index:05d}.json", "sim_{index:05d}.json.gz"],
}
"""File names of each kind, in order of preference."""
QUESTION_FILES = {
    "train": ("train",),
    "validation": ("validation", "val", "valid"),
    "test": ("test",),
}
"""Names of each split's question file, without the ending, in order of preference; in `questions/` or the root."""
FOLDER_SIZE = 1000
"""Files in each sub-folder of the release."""


def file_name(kind: str, index: int) -> str:
    """Name of a video's file of a kind, such as "annotation_10000.json"."""
    return _FILES[kind][0].format(index=index)


def sub_folder(stem: str, index: int) -> str:
    """Name of the sub-folder of the release that has a video's file, such as "video_10000-11000"."""
    low = index // FOLDER_SIZE * FOLDER_SIZE
    return f"{stem}_{low:05d}-{low + FOLDER_SIZE:05d}"


class _Splits(TypedDict):
    train: tuple[int, int]
    validation: tuple[int, int]
    test: tuple[int, int]


class _Manifest(TypedDict):
    splits: _Splits
    kinds: list[Literal["videos", "annotations", "questions", "proposals"]]
    n_frames: PositiveCount


@dataclass(frozen=True)
class Inventory:
    """How complete one kind of files is in one split.

    Attributes:
        split: name of the split.
        kind: one of `KINDS`.
        found: number of files found.
        expected: number of files of the complete split.
        missing: video indices of the missing files.
    """

    split: str
    kind: str
    found: int
    expected: int
    missing: tuple[int, ...]


class CLEVRER:
    """A folder with CLEVRER's files, all or some of them.

    Below `root`, videos are anywhere in `videos/` or a folder such as `video_train` or `video_00000-01000`, annotations in
    `annotations/` or a folder `annotation_…`; a file's number says its split. A video may be a folder of frames, such as
    `video_00003`. Questions are in `questions/{split}.json` or `{split}.json`, or JSON Lines (`.jsonl`), and proposals in
    `proposals/`, `processed_proposals/` or `derender_proposals/`. The `manifest.json` of a generated data set lists its videos.

    Args:
        root: the folder.

    Attributes:
        world: what its manifest says of the world of its videos; CLEVRER's without one.

    Raises:
        DataError: there is no such folder, or its manifest is malformed.
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        if not self.root.is_dir():
            raise DataError(f"{root}: no such folder; `nsdr data download` creates one")
        path = self.root / "manifest.json"
        self.manifest = read_manifest(path) if os.path.lexists(path) else None
        self.world = CLEVRER_WORLD if self.manifest is None else world_in(self.manifest, f"{path}: ")
        self.files = DataSetFiles(self.root)

    def __repr__(self) -> str:
        sizes = [f"{name}={len(self.split(name).indices)}" for name in SPLITS]
        return f"CLEVRER({', '.join([repr(str(self.root)), *sizes, *differing(self.world)])})"

    def split(self, name: str) -> "Split":
        """One split.

        Args:
            name: "train", "validation" or "test".

        Raises:
            DataError: another name.
        """
        if name not in SPLITS:
            raise DataError(f"split is {name!r}; expected one of {', '.join(SPLITS)}")
        if self.manifest is None:
            return Split(self.files, name, SPLITS[name])
        kinds, n_frames = tuple(self.manifest["kinds"]), self.manifest["n_frames"]
        start, stop = self.manifest["splits"][name]
        return Split(self.files, name, range(start, stop), kinds, n_frames, self.world)

    def inventory(self) -> list[Inventory]:
        """How complete each kind of files is, for every split."""
        return [row for name in SPLITS for row in self.split(name).inventory()]


def read_manifest(path: Path) -> dict[str, Any]:
    """Read and check the `manifest.json` of a generated data set.

    Returns:
        `splits` (first and last video index + 1 by split), `kinds` of files, and `n_frames` per video.

    Raises:
        DataError: the file is missing or malformed; names the file and the location in the file.
    """
    manifest: dict[str, Any] = read_json(path)
    content: _Manifest = convert(manifest, _Manifest, f"{path}: ")
    splits: dict[str, Any] = {**content["splits"]}
    for name, official in SPLITS.items():
        start, stop = splits[name]
        expected = f"first and last video index + 1, from {official.start} to {official.stop}"
        fits = official.start <= start <= stop <= official.stop
        expect(fits, f"{path}: splits.{name}", expected, [start, stop])
    kinds = content["kinds"]
    expect(len(set(kinds)) == len(kinds), f"{path}: kinds", "different ones", kinds)
    check_limit(content["n_frames"], "frames", f"{path}: n_frames")
    return manifest


class Split:
    """The files of one split by video index; made by `CLEVRER.split`.

    Args:
        files: of the data set.
        name: "train", "validation" or "test".
        indices: video indices of the split.
        kinds: kinds of files that the data set has.
        n_frames: number of frames of each video.
        world: the world of the videos.
    """

    def __init__(
        self,
        files: DataSetFiles,
        name: str,
        indices: range,
        kinds: tuple[str, ...] = KINDS,
        n_frames: int = CLEVRER_WORLD.timeline.frames,
        world: World = CLEVRER_WORLD,
    ) -> None:
        self.files, self.root, self.name, self.indices = files, files.root, name, indices
        self.kinds, self.n_frames, self.world = kinds, n_frames, world

    def __repr__(self) -> str:
        told = [repr(str(self.root)), self.name, f"{len(self.indices)} videos", *differing(self.world)]
        return f"Split({', '.join(told)})"

    @property
    def question_file(self) -> Path | None:
        """Path of the split's question file; None if it is missing."""
        names = [f"{name}{end}" for end in (".json", ".jsonl") for name in QUESTION_FILES[self.name]]
        paths = (folder / name for name in names for folder in (self.root / "questions", self.root))
        return next((path for path in paths if path.is_file()), None)

    def questions(self) -> list[SceneQuestions]:
        """The questions of every scene.

        Raises:
            DataError: the file is missing or malformed.
        """
        path = self.question_file
        if path is None:
            raise DataError(f"{self.root}: has no questions/{self.name}.json")
        return read_questions(path, self.world)

    def path(self, kind: str, index: int) -> Path:
        """Path of a file of a kind ("videos", "annotations" or "proposals").

        Raises:
            DataError: it is missing.
        """
        path = self.find(kind, index)
        if path is None:
            file, where = _FILES[kind][0].format(index=index), self.files.expected(kind)
            raise DataError(f"{self.root}: has no {file} ({kind} of {self.name}): {where}; are all zip files unpacked?")
        return path

    def video(self, index: int) -> Path:
        """Path of a video.

        Raises:
            DataError: the video is missing.
        """
        return self.path("videos", index)

    def annotation(self, index: int) -> dict[str, Any]:
        """Read and check an annotation file.

        Raises:
            DataError: the file is missing or malformed.
        """
        path = self.path("annotations", index)
        annotation: dict[str, Any] = read_json(path)
        check_annotation(annotation, f"{path}: ")
        expect(annotation["scene_index"] == index, f"{path}: scene_index", str(index), annotation["scene_index"])
        return annotation

    def proposals(self, index: int) -> VideoProposals:
        """Read the mask proposals of a video.

        Raises:
            DataError: the file is missing or malformed.
        """
        return read_proposals(self.path("proposals", index))

    def entries(self, kind: str) -> dict[int, Path]:
        """The files of a kind ("videos", "annotations" or "proposals") that are there, by video index."""
        found = {i: self.find(kind, i) for i in self.indices}
        return {i: path for i, path in found.items() if path is not None}

    def inventory(self) -> list[Inventory]:
        """How complete each kind of files is."""
        rows = []
        for kind in self.kinds if self.indices else ():
            if kind == "questions":
                found = self.question_file is not None
                rows.append(Inventory(self.name, kind, int(found), 1, ()))
            elif not (kind == "annotations" and self.name == "test"):
                missing = [i for i in self.indices if self.find(kind, i) is None]
                n = len(self.indices)
                rows.append(Inventory(self.name, kind, n - len(missing), n, tuple(missing)))
        return rows

    def find(self, kind: str, index: int) -> Path | None:
        """Path of a file of a kind ("videos", "annotations" or "proposals"); None if it is missing."""
        return self.files.find(kind, [pattern.format(index=index) for pattern in _FILES[kind]])

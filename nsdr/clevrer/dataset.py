"""The official folder layout: what is there, what is missing, and access by split."""

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from nsdr.clevrer.annotations import check_annotation
from nsdr.clevrer.proposals import parse_proposals
from nsdr.clevrer.questions import SceneQuestions, iterate_questions
from nsdr.clevrer.schema import get
from nsdr.errors import DataError
from nsdr.io.files import parse_json, read_json
from nsdr.types import VideoProposals
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["CLEVRER", "KINDS", "SPLITS", "Inventory", "Split"]

SPLITS = {"train": range(0, 10000), "validation": range(10000, 15000), "test": range(15000, 20000)}
"""Video indices of each split."""

KINDS = ("videos", "annotations", "questions", "proposals")
_FOLDERS = {
    "videos": ["videos/{split}", "video_{split}"],
    "annotations": ["annotations/{split}", "annotation_{split}"],
    "proposals": ["derender_proposals", "processed_proposals", "proposals"],
}
_FILES = {
    "videos": ["video_{index:05d}.mp4"],
    "annotations": ["annotation_{index:05d}.json"],
    "proposals": ["proposal_{index:05d}.json", "sim_{index:05d}.json", "sim_{index:05d}.json.gz"],
}


@dataclass(frozen=True)
class Inventory:
    """What a data set holds of one kind in one split: `found` of `expected` files, and the first that are missing."""

    split: str
    kind: str
    found: int
    expected: int
    missing: tuple[int, ...]


class CLEVRER:
    """A folder with CLEVRER's files.

    Looked for below `root`: `videos/{split}/`, `annotations/{split}/` (with or without the official sub-folders of 1,000, or
    as the official zips, unopened), `questions/{split}.json` or `{split}.json`, and proposals in `derender_proposals/` or
    `processed_proposals/`. Parts may be missing. Generated data sets say in `manifest.json` which videos they have.

    Args:
        root: the folder.

    Raises:
        DataError: there is no such folder.
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        if not self.root.is_dir():
            raise DataError(f"{root}: no such folder; `nsdr data download` makes one")
        path = self.root / "manifest.json"
        self.manifest = read_manifest(path) if path.is_file() else None

    def split(self, name: str) -> "Split":
        """One of the splits "train", "validation" and "test".

        Raises:
            DataError: another name.
        """
        if name not in SPLITS:
            raise DataError(f"split is {name!r}; expected one of {', '.join(SPLITS)}")
        if self.manifest is None:
            return Split(self.root, name, SPLITS[name])
        start, stop = self.manifest["splits"][name]
        return Split(self.root, name, range(start, stop), tuple(self.manifest["kinds"]), self.manifest["n_frames"])

    def inventory(self) -> list[Inventory]:
        """What is there and what is missing, for every split and kind."""
        return [row for name in SPLITS for row in self.split(name).inventory()]


def read_manifest(path: Path) -> dict[str, Any]:
    """What a generated data set says of itself: `splits` (first and last index + 1), `kinds` of files and `n_frames`.

    Raises:
        DataError: not such a file.
    """
    manifest = read_json(path)
    splits = get(manifest, "splits", dict, str(path))
    for name in SPLITS:
        ends = get(splits, name, list, f"{path}: splits")
        if len(ends) != 2 or not all(isinstance(end, int) for end in ends):
            raise DataError(f"{path}: splits.{name}: expected two numbers, got {ends}")
    get(manifest, "kinds", list, str(path))
    get(manifest, "n_frames", int, str(path))
    return dict(manifest)


class Split:
    """One split: access by video index. Made by `CLEVRER.split`."""

    def __init__(
        self, root: Path, name: str, indices: range, kinds: tuple[str, ...] = KINDS, n_frames: int = VIDEO_FRAMES
    ) -> None:
        self.root, self.name, self.indices = root, name, indices
        self.kinds, self.n_frames = kinds, n_frames

    @cached_property
    def _files(self) -> dict[str, dict[str, "Entry"]]:
        """For each kind, where a file name is found."""
        return {kind: dict(_listing(self.root, kind, self.name)) for kind in _FILES}

    @property
    def question_file(self) -> Path | None:
        """The split's question file, None when it is missing."""
        for path in (self.root / "questions" / f"{self.name}.json", self.root / f"{self.name}.json"):
            if path.is_file():
                return path
        return None

    def questions(self) -> Iterator[SceneQuestions]:
        """Questions scene by scene.

        Raises:
            DataError: the file is missing or broken.
        """
        path = self.question_file
        if path is None:
            raise DataError(f"{self.root}: has no questions/{self.name}.json")
        return iterate_questions(path)

    def video(self, index: int) -> Path:
        """Path of a video. A video inside a zip is unpacked beside the zip first.

        Raises:
            DataError: it is missing.
        """
        entry = self._entry("videos", index)
        if entry.member is None:
            return entry.path
        target = entry.path.parent / entry.path.stem / entry.member
        if not target.exists():
            from nsdr.io.files import atomic_path

            with atomic_path(target) as temporary:
                temporary.write_bytes(entry.read())
        return target

    def annotation(self, index: int) -> dict[str, Any]:
        """Content of an annotation file, checked.

        Raises:
            DataError: missing or broken.
        """
        entry = self._entry("annotations", index)
        annotation = parse_json(entry.read(), str(entry))
        try:
            check_annotation(annotation, self.n_frames)
        except DataError as e:
            raise DataError(f"{entry}: {e}") from e
        return dict(annotation)

    def raw_proposals(self, index: int) -> bytes:
        """Bytes of a proposal file; raises `DataError` when it is missing."""
        return self._entry("proposals", index).read()

    def proposals(self, index: int) -> VideoProposals:
        """Mask proposals of a video.

        Raises:
            DataError: missing or broken.
        """
        entry = self._entry("proposals", index)
        return parse_proposals(entry.read(), str(entry))

    def inventory(self) -> list[Inventory]:
        """What is there and what is missing of every kind."""
        rows = []
        for kind in self.kinds if self.indices else ():
            if kind == "questions":
                there = self.question_file is not None
                rows.append(Inventory(self.name, kind, int(there), 1, ()))
            elif not (kind == "annotations" and self.name == "test"):
                missing = [i for i in self.indices if self._name(kind, i) is None]
                n = len(self.indices)
                rows.append(Inventory(self.name, kind, n - len(missing), n, tuple(missing)))
        return rows

    def _name(self, kind: str, index: int) -> str | None:
        names = [pattern.format(index=index) for pattern in _FILES[kind]]
        return next((name for name in names if name in self._files[kind]), None)

    def _entry(self, kind: str, index: int) -> "Entry":
        name = self._name(kind, index)
        if name is None:
            raise DataError(f"{self.root}: has no {_FILES[kind][0].format(index=index)} ({kind} of {self.name})")
        return self._files[kind][name]


@dataclass(frozen=True)
class Entry:
    """A file in a folder, or a member of a zip."""

    path: Path
    member: str | None = None

    def read(self) -> bytes:
        """Its bytes; raises `DataError` when it cannot be read."""
        try:
            if self.member is None:
                return self.path.read_bytes()
            with zipfile.ZipFile(self.path) as archive:
                return archive.read(self.member)
        except (OSError, zipfile.BadZipFile, KeyError) as e:
            raise DataError(f"{self}: cannot be read ({e})") from e

    def __str__(self) -> str:
        return str(self.path) if self.member is None else f"{self.path}:{self.member}"


def _listing(root: Path, kind: str, split: str) -> Iterator[tuple[str, Entry]]:
    """(file name, entry) of all files of a kind, zips first so that unpacked files win."""
    for pattern in _FOLDERS[kind]:
        folder = root / pattern.format(split=split)
        singular = kind.removesuffix("s")
        for archive in (folder / f"{singular}_{split}.zip", folder.with_suffix(".zip")):
            if archive.is_file():
                try:
                    with zipfile.ZipFile(archive) as opened:
                        for member in opened.namelist():
                            yield PurePosixPath(member).name, Entry(archive, member)
                except zipfile.BadZipFile as e:
                    raise DataError(f"{archive}: not a readable zip ({e}); download it again") from e
        if folder.is_dir():
            for path in folder.rglob("*.*"):
                if path.suffix != ".zip":
                    yield path.name, Entry(path)

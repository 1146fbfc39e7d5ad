"""Where the files of videos are: found by the numbers in their names, however people call the folders around them."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

from nsdr.errors import DataError
from nsdr.io.decoding import find_frame_folders
from nsdr.io.files import find_files
from nsdr.io.images import has_images

__all__ = ["FOLDERS", "DataSetFiles", "FolderFiles"]

FOLDERS: Mapping[str, tuple[str, ...]] = {
    "videos": ("video_*", "video", "videos"),
    "annotations": ("annotation_*", "annotation", "annotations"),
    "proposals": ("proposals", "processed_proposals", "derender_proposals"),
}
"""Folders of a data set, or patterns of their names, that may hold each kind of file; earlier ones are preferred. The release's
zips hold folders such as `video_00000-01000`, and people call folders of splits `train`, `val` or `video_validation`: a file's
number says its split, so only these first folders count."""


class FolderFiles:
    """The files below a folder, by name; hidden ones are left out.

    Args:
        folder: searched with its subfolders, when a file is not in the folder itself.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, names: Sequence[str]) -> Path | None:
        """The file with the first of these names that is there; None if none is.

        Of several files with one name, that with the fewest folders around it is taken.

        Raises:
            DataError: two files with the same name are equally deep; names both.
        """
        for name in names:
            if (path := self.folder / name).exists():
                return path
        return _first(names, self._files)

    def find_video(self, name: str) -> Path | None:
        """The video with this name, such as `video_00003.mp4`, or the folder of its frames, `video_00003`; None without either.

        Raises:
            DataError: as `find`.
        """
        stem = Path(name).stem
        if video := self.find([name]):
            return video
        return self.folder / stem if has_images(self.folder / stem) else _first([stem], self._frame_folders)

    @cached_property
    def _files(self) -> dict[str, list[Path]]:
        return _by_name(find_files(self.folder, "*.*"))

    @cached_property
    def _frame_folders(self) -> dict[str, list[Path]]:
        return _by_name(find_frame_folders(self.folder))


class DataSetFiles:
    """The videos, annotations and proposals of a data set, by kind and name.

    Args:
        root: folder of the data set; videos and annotations may also lie in the folder itself.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def find(self, kind: str, names: Sequence[str]) -> Path | None:
        """The file of a kind with the first of these names that is there; None if none is.

        Raises:
            DataError: two such files are equally deep below one folder; names both.
        """
        for name in names:
            for files in self._folders[kind]:
                if path := files.find_video(name) if kind == "videos" else files.find([name]):
                    return path
            if (path := self.root / name).is_file():
                return path
            if kind == "videos" and has_images(path.with_suffix("")):
                return path.with_suffix("")
        return None

    def expected(self, kind: str) -> str:
        """Where files of a kind are looked for, and which folders there are, for error messages."""
        places = ", ".join(f"{name}/" for name in FOLDERS[kind])
        found = sorted(p.name for p in self.root.iterdir() if p.is_dir() and not p.name.startswith("."))
        return f"looked below {places}; {self.root} has the folders {', '.join(found) or '(none)'}"

    @cached_property
    def _folders(self) -> dict[str, list[FolderFiles]]:
        """The folders that may hold each kind, in order of preference."""
        return {
            kind: [FolderFiles(p) for name in names for p in sorted(self.root.glob(name)) if p.is_dir()]
            for kind, names in FOLDERS.items()
        }


def _by_name(paths: Sequence[Path]) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in paths:
        found.setdefault(path.name, []).append(path)
    return found


def _first(names: Sequence[str], files: Mapping[str, Sequence[Path]]) -> Path | None:
    for name in names:
        if paths := sorted(files.get(name, ()), key=lambda path: len(path.parts)):
            first, *others = [path for path in paths if len(path.parts) == len(paths[0].parts)]
            for other in others:
                if other.resolve() != first.resolve():
                    raise DataError(f"{first} and {other} have one name; keep one of them, or give the folder of one")
            return first
    return None

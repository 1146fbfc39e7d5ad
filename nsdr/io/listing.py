"""Input files of a folder."""

from pathlib import Path

__all__ = ["find_files", "is_hidden"]


def find_files(folder: str | Path, pattern: str) -> list[Path]:
    """Files below a folder whose names match, sorted; without hidden ones, such as the unfinished files of a killed process.

    Args:
        folder: searched with its subfolders.
        pattern: of names, such as `video_*.mp4`.
    """
    folder = Path(folder)
    return sorted(p for p in folder.rglob(pattern) if p.is_file() and not is_hidden(p.relative_to(folder)))


def is_hidden(path: Path) -> bool:
    """Whether the file or a folder of the (relative) path has a name that begins with a dot."""
    return any(part.startswith(".") for part in path.parts)

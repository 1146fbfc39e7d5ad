"""Downloading CLEVRER's official files.

`nsdr.clevrer` imports this module eagerly, because function and module have the same name. So what the download needs is
imported when it starts.
"""

from collections.abc import Iterable
from pathlib import Path

from nsdr.errors import DataError, MachineError, NsdrError, machine_error

__all__ = ["OFFICIAL_ROOT", "download"]

OFFICIAL_ROOT = "https://data.csail.mit.edu/clevrer"
"""Where the authors publish the data set."""
WHAT = {
    "videos": "videos/{split}/video_{split}.zip",
    "annotations": "annotations/{split}/annotation_{split}.zip",
    "questions": "questions/{split}.json",
}
"""Path below `OFFICIAL_ROOT` of each kind of files."""
NOT_ITS_BEGINNING = 416
"""HTTP status where an incomplete file is longer than the server's."""


def download(
    root: str | Path, split: str, what: Iterable[str] = tuple(WHAT), base_url: str = OFFICIAL_ROOT
) -> list[Path]:
    """Download the files of a split into the official layout. Complete files are skipped, incomplete ones continued.

    Zip files are unpacked into a folder of their name and deleted.

    Args:
        root: target folder.
        split: "train", "validation" or "test" (which has no annotations).
        what: any of "videos", "annotations", "questions".
        base_url: where the official layout is served.

    Returns:
        Paths of the question file, and of the folders of videos and annotations.

    Raises:
        DataError: an unknown split or kind, a file that the server does not have, a zip that is damaged, or a connection that
            keeps breaking; or another process downloads to `root`.
    """
    from nsdr.clevrer.dataset import SPLITS
    from nsdr.io.files import locked

    if split not in SPLITS:
        raise DataError(f"split is {split!r}; expected one of {', '.join(SPLITS)}")
    paths = []
    with locked(root, "download"):
        for kind in what:
            if kind not in WHAT:
                raise DataError(f"cannot download {kind!r}; expected one of {', '.join(WHAT)}")
            if kind == "annotations" and split == "test":
                continue
            name = WHAT[kind].format(split=split)
            target = Path(root) / name
            is_zip = target.suffix == ".zip"
            complete = target.with_suffix("") if is_zip else target
            if not (complete.exists() or target.exists()):
                _fetch(f"{base_url.rstrip('/')}/{name}", target)
            if is_zip and target.exists():
                _unpack(target, complete)
            paths.append(complete)
    return paths


def _unpack(archive: Path, folder: Path) -> None:
    """Unpack a zip into a folder, which is complete when the zip is gone."""
    import os
    import shutil
    import zipfile

    from nsdr.io.files import writing

    partial = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        with writing(folder), zipfile.ZipFile(archive) as opened:
            opened.extractall(partial)
    except (NsdrError, MachineError):  # a full disk, or a name that no file can have
        raise
    except Exception as e:  # damaged ones raise many kinds
        if failure := machine_error(e, archive):
            raise failure from e
        raise DataError(f"{archive}: not a readable zip ({e}); delete it, and run the command again") from e
    shutil.copytree(partial, folder, copy_function=os.replace, dirs_exist_ok=True)
    shutil.rmtree(partial)
    archive.unlink()


def _fetch(url: str, target: Path) -> None:
    """Fetch a file; `target.part` holds an incomplete one, which a later call continues."""
    from huggingface_hub.file_download import http_get

    from nsdr.io.files import sync

    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(f"{target.name}.part")
    try:
        with part.open("ab") as file:
            http_get(url, file, resume_size=file.tell(), displayed_filename=target.name)
    except Exception as e:  # of the system, the HTTP client and the hub's
        if getattr(getattr(e, "response", None), "status_code", 0) == NOT_ITS_BEGINNING:
            part.unlink()
        if failure := machine_error(e, target):
            raise failure from e
        reason = (str(e).splitlines() or [type(e).__name__])[0]
        raise DataError(f"{url}: cannot be fetched ({reason}); run the command again to continue") from e
    sync(part)
    part.replace(target)

"""True scenes from files of any kind that holds them."""

from collections.abc import Iterator
from pathlib import Path

from nsdr.clevrer.files.annotations import check_annotation, check_truth, check_truth_blocks
from nsdr.clevrer.files.scenes import scene_from_annotation, scene_from_ground_truth, scene_from_truth
from nsdr.clevrer.files.schema import Id
from nsdr.errors import DataError
from nsdr.io.files import find_files
from nsdr.io.reading import read_json
from nsdr.types import Scene
from nsdr.validation import convert

__all__ = ["iterate_scenes"]


def iterate_scenes(path: str | Path) -> Iterator[tuple[int, str, Scene]]:
    """Yield index, video file name and scene of everything below a path.

    Args:
        path: a truth file (`truth_N.json`), an annotation file, or compact ground truth (`.json` or `.json.gz` with a list of
            blocks); a folder stands for the truth files, or else the annotation files, below it.

    Raises:
        DataError: there is nothing of this kind, or a file cannot be read; names it.
    """
    path = Path(path)
    if path.is_dir():
        below = find_files(path, "truth_*.json") or find_files(path, "annotation_*.json")
        if not below:
            raise DataError(f"{path}: holds no truth_*.json and no annotation_*.json")
        for file in below:
            yield from iterate_scenes(file)
        return
    if not path.is_file():
        raise DataError(f"{path}: no such file or folder")
    content = read_json(path)
    if isinstance(content, list):
        for index, block in check_truth_blocks(content, str(path)).items():
            yield index, f"video_{index:05d}.mp4", scene_from_ground_truth(block, block["n_frames"])
    elif isinstance(content, dict) and "motion_trajectory" in content:
        check_annotation(content, where=f"{path}: ")
        yield content["scene_index"], content["video_filename"], scene_from_annotation(content)
    else:
        check_truth(content, where=f"{path}: ")
        video: int = convert(content.get("scene_index"), Id, f"{path}: scene_index: ")
        yield video, f"video_{video:05d}.mp4", scene_from_truth(content)

"""Where scenes come from: a registry of sources, open to other packages."""

from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from nsdr.clevrer.dataset import Split
from nsdr.clevrer.files.annotations import read_annotation, read_truth, read_truth_file
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.predictions import PredictionFile, read_predictions, scene_from_predictions
from nsdr.clevrer.files.proposals import read_ground_truth, read_proposals
from nsdr.clevrer.files.questions import SceneQuestions
from nsdr.clevrer.files.scenes import scene_from_annotation, scene_from_ground_truth, scene_from_truth
from nsdr.clevrer.layout import FolderFiles
from nsdr.errors import DataError
from nsdr.io import storage
from nsdr.io.registry import Registry
from nsdr.tracking.tracker import tracks_from_annotation
from nsdr.types import Scene
from nsdr.validation import expect

PerceptionInput = Mapping[str, Any]
"""Arguments of `Pipeline.perceive`: `video`, `proposals` or `tracks`."""
SceneSource = Callable[[SceneQuestions], Scene | PerceptionInput]
"""The scene that questions are about, or what a pipeline makes it from."""
Data = Path | Split
"""A folder or file, or one split of a data set in the official layout."""
SourceFactory = Callable[[Data, Set[int]], SceneSource]
"""(data, indices of the wanted scenes) -> source."""

ANNOTATION = "annotation_{:05d}.json"
SIMULATION = ("sim_{:05d}.json", "sim_{:05d}.json.gz")


def _file(files: FolderFiles, names: Sequence[str], scene_index: int) -> Path:
    """The file of a scene.

    Args:
        files: where to look.
        names: patterns such as "annotation_{:05d}.json".
        scene_index: the scene.

    Raises:
        DataError: there is none, which names the expected files; or two files have its name.
    """
    expected = [name.format(scene_index) for name in names]
    path = files.find(expected)
    if path is None:
        raise DataError(f"{files.folder}: has no {' or '.join(expected)}, also not in its subfolders")
    return path


def _folder(data: Data, source: str) -> Path:
    if not isinstance(data, Path):
        raise DataError(f"source {source} cannot be read from a split of --root; give --questions and --data")
    if not data.exists():
        raise DataError(f"{data}: no such file or folder")
    return data


def _of(table: Mapping[int, Any], scene_index: int, data: Path) -> Any:
    if scene_index not in table:
        raise DataError(f"{data}: has no scene {scene_index}")
    return table[scene_index]


def _videos(data: Data, _: Set[int]) -> SceneSource:
    if isinstance(data, Split):
        return lambda s: {"video": data.video(s.scene_index)}
    files = FolderFiles(_folder(data, "videos"))

    def video(s: SceneQuestions) -> PerceptionInput:
        path = files.find_video(s.video_filename)
        if path is None:
            raise DataError(
                f"{files.folder}: has no {s.video_filename} and no folder of its frames, also not further below"
            )
        return {"video": path}

    return video


def _proposals(data: Data, wanted: Set[int]) -> SceneSource:
    if isinstance(data, Split):
        return lambda s: {"proposals": data.proposals(s.scene_index)}
    path = _folder(data, "proposals")
    if path.is_dir():
        names = tuple(f"{stem}_{{:05d}}.json{end}" for end in ("", ".gz") for stem in ("proposal", "sim"))
        files = FolderFiles(path)
        return lambda s: {"proposals": read_proposals(_file(files, names, s.scene_index))}
    found = {video: proposals for video, proposals in read_compact_proposals(path) if video in wanted}
    return lambda s: {"proposals": _of(found, s.scene_index, path)}


def _documents(
    data: Data, source: str, name: str, read: Callable[[Path], dict[str, Any]]
) -> Callable[[SceneQuestions], Any]:
    """What the file of a scene holds, which must be of the scene."""
    if isinstance(data, Split) and name == ANNOTATION:
        return lambda s: data.annotation(s.scene_index)
    files = FolderFiles(_folder(data, source))

    def document(s: SceneQuestions) -> dict[str, Any]:
        path = _file(files, (name,), s.scene_index)
        content = read(path)
        index = content["scene_index"]
        expect(index == s.scene_index, f"{path}: scene_index", str(s.scene_index), index)
        return content

    return document


def _tracks(data: Data, _: Set[int]) -> SceneSource:
    annotation = _documents(data, "tracks", ANNOTATION, read_annotation)
    return lambda s: {"tracks": tracks_from_annotation(annotation(s))}


def _annotations(data: Data, _: Set[int]) -> SceneSource:
    annotation = _documents(data, "annotations", ANNOTATION, read_annotation)
    return lambda s: scene_from_annotation(annotation(s))


def _truth(data: Data, _: Set[int]) -> SceneSource:
    truth = _documents(data, "truth", "truth_{:05d}.json", read_truth_file)
    return lambda s: scene_from_truth(truth(s))


def prediction_file(files: FolderFiles, scene_index: int) -> PredictionFile:
    """The prediction file of a scene, plain or gzipped; raises `DataError` if it is missing, and as `read_predictions`."""
    return read_predictions(_file(files, SIMULATION, scene_index))


def _predictions(data: Data, _: Set[int]) -> SceneSource:
    files = FolderFiles(_folder(data, "predictions"))
    return lambda s: scene_from_predictions(prediction_file(files, s.scene_index))


def _ground_truth(data: Data, _: Set[int]) -> SceneSource:
    path = _folder(data, "ground-truth")
    if path.is_file():
        blocks = read_truth(path)
        return lambda s: scene_from_ground_truth(_of(blocks, s.scene_index, path), blocks[s.scene_index]["n_frames"])
    files = FolderFiles(path)
    return lambda s: scene_from_ground_truth(*read_ground_truth(_file(files, SIMULATION, s.scene_index)))


def _scenes(data: Data, _: Set[int]) -> SceneSource:
    files = FolderFiles(_folder(data, "scenes"))
    return lambda s: storage.load(_file(files, ("scene_{:05d}.json",), s.scene_index), Scene)


_NAMES = ("videos", "proposals", "tracks", "predictions", "annotations", "ground-truth", "truth", "scenes")
SOURCES: Registry[SourceFactory] = Registry(
    "source",
    "nsdr.scene_sources",
    {name: f"nsdr.evaluation.sources:_{name.replace('-', '_')}" for name in _NAMES},
)
"""Scene sources by name; other packages add theirs by entry points of the group `nsdr.scene_sources`.

- videos: `video_N.mp4` or a folder of frames `video_N`, perceived by the pipeline
- proposals: `proposal_N.json` or `sim_N.json` (also gzipped), or a compact NPZ; tracked and perceived
- tracks: the motion of `annotation_N.json` as if it had been tracked
- predictions: `sim_N.json` of a dynamics predictor (also gzipped)
- annotations: `annotation_N.json`, true observed events
- ground-truth: the truth block of `processed_proposals/sim_N.json`, or a gzipped list of blocks
- truth: `truth_N.json` of generated scenes, everything true
- scenes: `scene_N.json` saved by `nsdr parse`
"""

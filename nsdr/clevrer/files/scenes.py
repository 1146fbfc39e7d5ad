"""Scenes from ground truth: CLEVRER's annotations and ground-truth blocks, and truth files of generated videos."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.files.annotations import check_annotation, check_truth, check_truth_blocks
from nsdr.errors import DataError
from nsdr.io.files import find_files
from nsdr.io.reading import read_json
from nsdr.io.worlds import world_in
from nsdr.types import Event, ObjectPhysics, Scene, SceneObject
from nsdr.types.events import collisions_in_view, enter_exit_events

__all__ = [
    "iterate_scenes",
    "scene_from_annotation",
    "scene_from_ground_truth",
    "scene_from_truth",
]


def scene_from_annotation(annotation: Mapping[str, Any]) -> Scene:
    """The scene of an annotation, with observed events and motion.

    Args:
        annotation: content of an annotation file.

    Raises:
        DataError: a missing key or unknown attribute word.
    """
    try:
        objects = _objects(annotation["object_property"], "object_id")
        frames = annotation["motion_trajectory"]
        world = world_in(annotation)
        visible, moving, velocity = _motion(frames, len(objects), world.physics.moving_speed_world_per_s)
        collisions = _collisions(annotation["collision"])
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not an annotation: {e!r}") from e
    events = enter_exit_events(visible) + collisions_in_view(collisions, visible)
    physics = ObjectPhysics(velocity, 0.0)
    return Scene(objects, len(frames), visible, moving, tuple(events), physics=physics, world=world)


def scene_from_truth(truth: Mapping[str, Any], n_frames: int | None = None) -> Scene:
    """The scene of a generated video's `truth_S.json`, with observed, predicted and counterfactual events and motion.

    Args:
        truth: `objects`, `frames` (in CLEVRER 7/5 of the video's), `collisions` and `counterfactual`.
        n_frames: number of frames that the video shows; None takes the file's `n_frames`, or those of its
            world's videos if it has none.

    Raises:
        DataError: a missing key or unknown attribute word.
    """
    try:
        objects = _objects(truth["objects"], "object_id")
        world = world_in(truth)
        n_frames = n_frames or truth.get("n_frames", world.timeline.frames)
        shown = truth["frames"][:n_frames]
        visible, moving, velocity = _motion(shown, len(objects), world.physics.moving_speed_world_per_s)
        collisions = _collisions(truth["collisions"])
        counterfactual = {int(removed): tuple(_collisions(rows)) for removed, rows in truth["counterfactual"].items()}
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not a truth file: {e!r}") from e
    events = enter_exit_events(visible) + collisions_in_view(collisions, visible)
    predicted = tuple(e for e in collisions if e.frame >= n_frames)
    log_mass = _log_mass(truth["objects"])
    covariance = None if log_mass is None else np.zeros((len(objects), len(objects)))
    physics = ObjectPhysics(velocity, 0.0, log_mass, covariance)
    return Scene(
        objects, n_frames, visible, moving, tuple(events), predicted, counterfactual, physics=physics, world=world
    )


def scene_from_ground_truth(block: Mapping[str, Any], n_frames: int | None = None) -> Scene:
    """The scene of a `ground_truth` block, with observed events; motion is not known.

    Args:
        block: `objects`, `in_outs` and `collisions`, from `read_ground_truth` or `read_truth`.
        n_frames: number of frames of the video; None for those of its world's videos. The scene has more where events come
            later, as in CLEVRER's irregular videos (`nsdr.clevrer.IRREGULAR_VIDEOS`).

    Raises:
        DataError: a missing key or unknown attribute word.
    """
    try:
        objects, world = _objects(block["objects"], "id"), world_in(block)
        events = [Event(e["type"], e["frame"], (e["object"],)) for e in block["in_outs"]]
        events += [Event("collision", e["frame"], tuple(sorted(e["object"]))) for e in block["collisions"]]
    except (KeyError, TypeError, IndexError) as e:
        raise DataError(f"not a ground-truth block: {e!r}") from e
    n_frames = max([n_frames or world.timeline.frames, *(e.frame + 1 for e in events)])
    visible = np.ones((len(objects), n_frames), bool)
    for i in range(len(objects)):
        changes = sorted((e for e in events if e.kind != "collision" and e.objects == (i,)), key=lambda e: e.frame)
        if changes:
            visible[i, : changes[0].frame] = changes[0].kind == "out"
        for event in changes:
            visible[i, event.frame :] = event.kind == "in"
    return Scene(objects, n_frames, visible, None, tuple(events), world=world)


def _objects(rows: Sequence[Mapping[str, Any]], key: str) -> tuple[SceneObject, ...]:
    return tuple(SceneObject(o[key], o["color"], o["material"], o["shape"]) for o in rows)


def _collisions(rows: Iterable[Mapping[str, Any]]) -> list[Event]:
    return [Event("collision", c["frame_id"], tuple(sorted(c["object_ids"]))) for c in rows]


def _log_mass(rows: Sequence[Mapping[str, Any]]) -> NDArray[np.floating[Any]] | None:
    """(n,) by id; None where a row has no mass."""
    if not all("mass" in o for o in rows):
        return None
    mass = [o["mass"] for o in sorted(rows, key=lambda o: int(o["object_id"]))]
    wrong = [m for m in mass if type(m) not in (int, float) or not 0 < m < np.inf]
    if wrong:
        raise DataError(f"not a truth file: objects: mass: expected a positive number, got {wrong[0]!r:.60}")
    return np.log(mass)


def _motion(
    frames: Sequence[Mapping[str, Any]], n: int, moving_speed: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.floating[Any]]]:
    """Which objects are visible (n, F) and move (n, F), and velocities on the ground (n, F, 2), NaN for objects not listed."""
    visible, moving = np.zeros((n, len(frames)), bool), np.zeros((n, len(frames)), bool)
    velocity = np.full((n, len(frames), 2), np.nan, np.float32)
    for f, frame in enumerate(frames):
        for o in frame["objects"]:
            i = o["object_id"]
            vx, vy, _ = o["velocity"]
            visible[i, f] = o["inside_camera_view"]
            moving[i, f] = vx * vx + vy * vy > moving_speed**2
            velocity[i, f] = vx, vy
    return visible, moving, velocity


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
        found: set[int] = set()
        for file in below:
            for scene in iterate_scenes(file):
                if scene[0] in found:
                    raise DataError(f"{file}: scene {scene[0]} is there twice below {path}; give a folder below it")
                found.add(scene[0])
                yield scene
        return
    if not path.is_file():
        raise DataError(f"{path}: no such file or folder")
    content = read_json(path)
    if isinstance(content, list):
        for index, block in check_truth_blocks(content, str(path)).items():
            yield index, f"video_{index:05d}.mp4", scene_from_ground_truth(block, block["n_frames"])
    elif isinstance(content, dict) and "motion_trajectory" in content:
        check_annotation(content, f"{path}: ")
        yield content["scene_index"], content["video_filename"], scene_from_annotation(content)
    else:
        check_truth(content, f"{path}: ")
        index = content["scene_index"]
        yield index, f"video_{index:05d}.mp4", scene_from_truth(content)

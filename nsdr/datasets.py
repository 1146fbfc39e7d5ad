"""Videos with the truth about them as a PyTorch data set, for models that learn how the world moves."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.utils.data import Dataset

from nsdr.clevrer.dataset import CLEVRER, SPLITS
from nsdr.clevrer.files.annotations import IRREGULAR_VIDEOS, read_truth_file
from nsdr.errors import DataError
from nsdr.generate.manifest import made_with
from nsdr.generate.render.geometry import Solid, instance_ids, optical_flow
from nsdr.generate.render.view import view_of
from nsdr.io.description import differing
from nsdr.io.limits import check_limit
from nsdr.io.video import window_frames
from nsdr.validation import Count, PositiveCount, Settings
from nsdr.world.camera import Camera
from nsdr.world.shapes import rendered_rotation
from nsdr.world.vocabulary import Vocabulary

__all__ = ["STATE", "VideoDataset"]

STATE = {"location": slice(0, 3), "rotation": slice(3, 7), "velocity": slice(7, 10), "angular_velocity": slice(10, 13)}
"""Columns of `states`: centre (world units), quaternion (x, y, z, w) of the shape with its axis along z, velocity (world
units/s), angular velocity (rad/s). Seconds are of simulated time, of which a frame is 0.028 in CLEVRER."""
VECTORS = ("location", "orientation", "velocity", "angular_velocity")
NEAREST = cv2.INTER_NEAREST_EXACT
"""Takes the value at a pixel's centre."""


@dataclass(frozen=True)
class _Truth:
    """The truth about a video with n objects and F frames, of which some may be after its end.

    Attributes:
        attributes: (n, 3).
        mass: (n,), NaN where it is not known.
        states: (F, n, 13).
        visible: (F, n).
        collisions: (frame, objects).
        camera: the camera that took the video.
        vocabulary: the words of the objects.
    """

    attributes: NDArray[np.int64]
    mass: NDArray[np.float32]
    states: NDArray[np.float64]
    visible: NDArray[np.bool_]
    collisions: tuple[tuple[int, tuple[int, int]], ...]
    camera: Camera
    vocabulary: Vocabulary

    def solids(self, frame: int) -> list[Solid]:
        """The geometry of the objects in a frame."""
        shapes = [self.vocabulary.shapes[i] for i in self.attributes[:, 2]]
        places = self.states[frame, :, STATE["location"]]
        turns = Rotation.from_quat(self.states[frame, :, STATE["rotation"]]).as_matrix()
        return [Solid(shape, place, turn) for shape, place, turn in zip(shapes, places, turns, strict=True)]


@dataclass(frozen=True)
class _Options(Settings):
    length: Count
    step: PositiveCount
    hop: Count
    image_size: tuple[PositiveCount, PositiveCount] | None
    max_objects: PositiveCount


class VideoDataset(Dataset[dict[str, Tensor]]):
    """Clips of CLEVRER's videos, or of a generated data set, with the truth about every frame.

    Items are dictionaries of tensors of the same shapes, which the default `collate_fn` stacks (T frames, N = `max_objects`):

    - `video` (T, 3, H, W) uint8 RGB
    - `masks` (T, H, W) uint8, what is seen at each pixel's centre by ray casting: 0 the ground, i + 1 the object of row i
    - `states` (T, N, 13) float32, columns as in `STATE`; `visible` (T, N) bool, whether the object is in the image
    - `contacts` (T, N, N) bool, symmetric: pairs that begin to collide after the clip's previous frame, up to this one
    - `attributes` (N, 3) int64, color, material and shape (`Vocabulary.words` of the world), -1 in rows without an object;
      `mass` (N,) float32, relative, NaN where it is not known (the release withholds it); `present` (N,) bool
    - `flow` (T, 2, H, W) float32, displacement of what is seen until the video's next frame (pixels to the right, down); 0 in
      the last frame of a released video, after which nothing is known
    - `frames` (T,) int64, numbers of the frames; `scene_index` int64

    In generated data sets, and in those in their `counterfactual/`, all of this comes from truth files. In the release's
    `train` and `validation`, it comes from annotations, and three videos of other lengths are left out
    (`nsdr.clevrer.IRREGULAR_VIDEOS`).

        >>> data = VideoDataset("data", "train", length=16, step=2, image_size=(64, 96))
        >>> batch = next(iter(torch.utils.data.DataLoader(data, batch_size=8, shuffle=True, num_workers=4)))

    Args:
        root: folder of the data set (`nsdr.clevrer.CLEVRER`).
        split: "train", "validation" or "test".
        length: frames of a clip; 0 for all that the video has.
        step: distance between successive frames of a clip (frames).
        hop: distance between the starts of successive clips of a video (frames); 0 for clips that do not overlap.
        image_size: height and width (pixels); None for the video's own, at most its world's.
        images, masks, flow: whether items have them. Without `images`, the videos may be missing, and masks and flow need an
            `image_size`.
        max_objects: rows of the objects.

    Raises:
        DataError: a file is missing or malformed, an option does not fit, or (when it is read) a scene has more objects.
    """

    def __init__(
        self,
        root: str | Path,
        split: str = "train",
        length: int = 0,
        step: int = 1,
        hop: int = 0,
        image_size: tuple[int, int] | None = None,
        images: bool = True,
        masks: bool = True,
        flow: bool = False,
        max_objects: int = 8,
    ) -> None:
        _Options(length, step, hop, image_size, max_objects)
        if image_size is not None:
            # Masks are cast at the aspect ratio of the world's images.
            camera = CLEVRER(root).world.camera
            height = max(image_size[0], image_size[1] * camera.height // camera.width)
            check_limit(
                height * height * camera.width // camera.height, "image_pixels", f"image_size {tuple(image_size)}"
            )
        if not images and (masks or flow) and image_size is None:
            raise DataError("image_size: masks and flow without images need a size")
        self._root, self._split = Path(root), CLEVRER(root).split(split)
        manifest = CLEVRER(root).manifest
        if manifest is None and (self._root / "truth").is_dir():
            raise DataError(
                f"{root}: has no manifest.json, which says by what camera its videos were taken; copy it from the data set "
                "that they belong to"
            )
        self._render = None if manifest is None else made_with(manifest, self._root)[1]
        self.image_size, self.images, self.masks, self.flow = image_size, images, masks, flow
        self.max_objects, self.step = max_objects, step
        n_frames = self._split.n_frames
        self.length = length or -(-n_frames // step)
        span = (self.length - 1) * step + 1
        if span > n_frames:
            raise DataError(f"length: {length} frames with step {step} span {span}; the videos have {n_frames}")
        starts = range(0, n_frames - span + 1, hop or span)
        self.clips = [(video, start) for video in self._videos() for start in starts]

    def __repr__(self) -> str:
        told = [repr(str(self._root)), self._split.name, f"{len(self)} clips of {self.length} frames"]
        return f"VideoDataset({', '.join([*told, *differing(self._split.world)])})"

    def __len__(self) -> int:
        return len(self.clips)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        video, start = self.clips[index]
        truth = self._truth(video)
        frames = np.arange(self.length) * self.step + start
        item: dict[str, Any] = {"frames": frames, "scene_index": np.int64(video), **self._objects(truth, frames)}
        size = self.image_size
        if self.images:
            images = self._images(video, frames)
            size = size or images[0].shape[:2]
            resized = [_resized(image, size, cv2.INTER_AREA) for image in images]
            item["video"] = np.stack(resized).transpose(0, 3, 1, 2)
        if size is not None and (self.masks or self.flow):
            item |= self._pixels(truth, frames, size)
        return {name: torch.from_numpy(np.array(value)) for name, value in item.items()}

    def _videos(self) -> list[int]:
        """Indices of the videos whose truth is known and, if images are wanted, whose video file is there."""
        split = self._split
        if self._render is None:
            known = sorted(set(split.entries("annotations")) - set(IRREGULAR_VIDEOS))
        else:
            known = [i for i in split.indices if self._truth_file(i).exists()]
        found = sorted(set(known) & set(split.entries("videos"))) if self.images else known
        if not found:
            wanted = "truth" if self._render is not None else "annotations"
            others = [name for name in SPLITS if CLEVRER(self._root).split(name).entries("videos")]
            remedy = f"it has videos of: {', '.join(others)}" if others else "`nsdr generate dataset` makes both"
            raise DataError(f"{self._root}: has no {split.name} videos with {wanted}; {remedy}")
        return found

    def _truth_file(self, video: int) -> Path:
        return self._root / "truth" / self._split.name / f"truth_{video:05d}.json"

    def _truth(self, video: int) -> _Truth:
        if self._render is None:
            annotation = self._split.annotation(video)
            rows, frames, collisions = (annotation[k] for k in ("object_property", "motion_trajectory", "collision"))
            camera = self._split.world.camera
        else:
            file = read_truth_file(self._truth_file(video))
            if file["scene_index"] != video:
                raise DataError(f"{self._truth_file(video)}: scene_index: expected {video}, got {file['scene_index']}")
            rows, frames, collisions = file["objects"], file["frames"], file["collisions"]
            camera = view_of(self._render, file["seed"], self._split.world).camera
        if len(rows) > self.max_objects:
            raise DataError(f"video {video} has {len(rows)} objects; max_objects is {self.max_objects}")
        return _truth_of(rows, frames, collisions, camera, self._split.world.vocabulary)

    def _objects(self, truth: _Truth, frames: NDArray[np.int64]) -> dict[str, Any]:
        n, most = len(truth.mass), self.max_objects
        contacts = np.zeros((len(frames), most, most), bool)
        for frame, (i, j) in truth.collisions:
            at = int(np.searchsorted(frames, frame))
            if frames[0] - self.step < frame <= frames[-1]:
                contacts[at, i, j] = contacts[at, j, i] = True
        return {
            "states": _padded(truth.states[frames].astype(np.float32), most, 1, 0.0),
            "visible": _padded(truth.visible[frames], most, 1, False),
            "contacts": contacts,
            "attributes": _padded(truth.attributes, most, 0, -1),
            "mass": _padded(truth.mass, most, 0, np.nan),
            "present": np.arange(most) < n,
        }

    def _images(self, video: int, frames: NDArray[np.int64]) -> list[NDArray[np.uint8]]:
        path = self._split.video(video)
        start, stop = int(frames[0]), int(frames[-1]) + 1
        decoded = window_frames(path, start, stop, self._split.world)
        if len(decoded) < stop - start:
            raise DataError(f"{path}: has {start + len(decoded)} frames; expected {self._split.n_frames}")
        return [decoded[frame - start] for frame in frames]

    def _pixels(self, truth: _Truth, frames: NDArray[np.int64], size: tuple[int, int]) -> dict[str, Any]:
        """Masks and flow, cast at the aspect ratio of the world's images and scaled to the size wanted."""
        shown = self._split.world.camera
        height = max(size[0], -(-size[1] * shown.height // shown.width))
        camera = replace(truth.camera, width=round(height * shown.width / shown.height), height=height)
        scale = np.array([size[1] / camera.width, size[0] / camera.height], np.float32)
        masks, flows = [], []
        for frame in frames:
            now = truth.solids(frame)
            if self.masks:
                ids = (instance_ids(now, camera) + 1).astype(np.uint8)
                masks.append(_resized(ids, size, NEAREST))
            if self.flow:
                following = truth.solids(min(frame + 1, len(truth.states) - 1))
                flow = _resized(optical_flow(now, following, camera), size, NEAREST)
                flows.append((flow * scale).transpose(2, 0, 1))
        return {name: np.stack(rows) for name, rows in (("masks", masks), ("flow", flows)) if rows}


def _truth_of(
    rows: list[dict[str, Any]],
    frames: list[dict[str, Any]],
    collisions: list[dict[str, Any]],
    camera: Camera,
    vocabulary: Vocabulary,
) -> _Truth:
    """The truth in a truth or annotation file, as arrays."""
    rows = sorted(rows, key=lambda row: row["object_id"])
    ordered = [sorted(frame["objects"], key=lambda row: row["object_id"]) for frame in frames]
    vectors = np.array([[[row[name] for name in VECTORS] for row in frame] for frame in ordered])
    location, orientation, velocity, spin = vectors.transpose(2, 0, 1, 3)
    shapes = [vocabulary.shape(row["shape"]) for row in rows]
    turns = [rendered_rotation(shape, orientation[:, i]).as_quat() for i, shape in enumerate(shapes)]
    return _Truth(
        np.array([[words.index(row[name]) for name, words in vocabulary.words.items()] for row in rows]),
        np.array([row.get("mass", np.nan) for row in rows], np.float32),
        np.concatenate([location, np.stack(turns, 1), velocity, spin], -1),
        np.array([[row["inside_camera_view"] for row in frame] for frame in ordered]),
        tuple((c["frame_id"], (c["object_ids"][0], c["object_ids"][1])) for c in collisions),
        camera,
        vocabulary,
    )


def _resized(image: NDArray[Any], size: tuple[int, int], how: int) -> NDArray[Any]:
    return image if image.shape[:2] == size else np.asarray(cv2.resize(image, size[::-1], interpolation=how))


def _padded(values: NDArray[Any], length: int, axis: int, fill: float) -> NDArray[Any]:
    widths = [(0, length - n if i == axis else 0) for i, n in enumerate(values.shape)]
    return np.pad(values, widths, constant_values=fill)

"""What is seen in a video: objects, detections and tracks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nsdr.types.checks import ArrayHolder, FloatArray, IntArray, check, check_values, check_whole, store_array
from nsdr.world.camera import CLEVRER_CAMERA, Camera
from nsdr.world.vocabulary import ATTRIBUTES, N_ATTRIBUTE_TRIPLES

__all__ = ["Camera", "SceneObject", "Track", "VideoProposals", "VideoTracks"]


@dataclass(frozen=True)
class SceneObject:
    """The identity of an object.

    Attributes:
        id: index in the scene.
        color: one of `nsdr.world.vocabulary.COLORS`.
        material: one of `nsdr.world.vocabulary.MATERIALS`.
        shape: one of `nsdr.world.vocabulary.SHAPES`.
    """

    id: int
    color: str
    material: str
    shape: str

    def __post_init__(self) -> None:
        check_whole("SceneObject", "id", self.id, 0)
        for name, words in ATTRIBUTES.items():
            value = getattr(self, name)
            check(value in words, f"object {self.id}: unknown {name} {value!r}; expected one of {', '.join(words)}")

    @property
    def name(self) -> str:
        """For example "red rubber cube"."""
        return f"{self.color} {self.material} {self.shape}"


def check_objects(owner: str, objects: Sequence[SceneObject]) -> None:
    """Raise `DataError` unless the objects have the ids 0, 1, ... in order."""
    ids = [o.id for o in objects]
    check(ids == list(range(len(ids))), f"{owner}: object ids must be 0..{len(ids) - 1} in order, got {ids}")


@dataclass(frozen=True, eq=False, repr=False)
class VideoProposals(ArrayHolder):
    """The frame parser's output for one video: one row per detected object, sorted by frame.

    Attributes:
        n_frames: number of frames of the video.
        frame_index: (N,) int, frame of each detection, ascending.
        attribute: (N,) int in 0-47, `nsdr.world.vocabulary.attribute_index` of the detected words.
        score: (N,) float in 0-1, confidence of the detector.
        centroid_px: (N, 2) float, mean (column, row) of the mask's pixel centres.
        area_px: (N,) int, number of mask pixels.
        box_xyxy_px: (N, 4) int, bounding box (left, top, right, bottom) of the mask, end exclusive.
        masks: N COCO run-length strings of the (320, 480) masks; None where only the numbers are known.
        processed: (P,) int, ascending frames that the detector processed; None for all.
    """

    n_frames: int
    frame_index: IntArray
    attribute: IntArray
    score: FloatArray
    centroid_px: FloatArray
    area_px: IntArray
    box_xyxy_px: IntArray
    masks: tuple[str, ...] | None = None
    processed: IntArray | None = None

    def __post_init__(self) -> None:
        n = len(self.frame_index)
        store_array(self, "frame_index", (n,), "i")
        store_array(self, "attribute", (n,), "i")
        store_array(self, "score", (n,), "f")
        store_array(self, "centroid_px", (n, 2), "f")
        store_array(self, "area_px", (n,), "i")
        store_array(self, "box_xyxy_px", (n, 4), "i")
        check(self.masks is None or len(self.masks) == n, f"VideoProposals.masks: expected {n} masks")
        check_whole("VideoProposals", "n_frames", self.n_frames, 1)
        check_values("VideoProposals", "score", self.score, 0, 1)
        check_values("VideoProposals", "centroid_px", self.centroid_px, -np.inf, np.inf)
        if n:
            check(bool((np.diff(self.frame_index) >= 0).all()), "VideoProposals: rows must be sorted by frame")
            low, high, end = int(self.frame_index[0]), int(self.frame_index[-1]), self.n_frames - 1
            check(0 <= low <= high <= end, f"VideoProposals: frames {low}-{high} outside 0-{end}")
            known = (self.attribute >= 0) & (self.attribute < N_ATTRIBUTE_TRIPLES)
            check(bool(known.all()), f"VideoProposals.attribute: expected 0-{N_ATTRIBUTE_TRIPLES - 1}")
        if self.processed is not None:
            store_array(self, "processed", (None,), "i")
            check(bool((np.diff(self.processed) > 0).all()), "VideoProposals.processed: frames must ascend")
            check_values("VideoProposals", "processed", self.processed, 0, self.n_frames - 1)

    def __len__(self) -> int:
        return len(self.frame_index)


@dataclass(frozen=True, eq=False, repr=False)
class Track(ArrayHolder):
    """One object followed through the video: its identity and its detections.

    Attributes:
        object: identity.
        frame_index: (T,) int, ascending frames in which it was detected.
        location_world: (T, 2) float, ground-plane position (x, y) of its centre (world units).
        centroid_px: (T, 2) float, as in `VideoProposals`.
        box_xyxy_px: (T, 4) int, as in `VideoProposals`.
        score: (T,) float, as in `VideoProposals`.
    """

    object: SceneObject
    frame_index: IntArray
    location_world: FloatArray
    centroid_px: FloatArray
    box_xyxy_px: IntArray
    score: FloatArray

    def __post_init__(self) -> None:
        n = len(self.frame_index)
        store_array(self, "frame_index", (n,), "i")
        store_array(self, "location_world", (n, 2), "f")
        store_array(self, "centroid_px", (n, 2), "f")
        store_array(self, "box_xyxy_px", (n, 4), "i")
        store_array(self, "score", (n,), "f")
        check(bool((np.diff(self.frame_index) > 0).all()), f"Track {self.object.id}: frames must ascend")
        owner = f"Track {self.object.id}"
        check_values(owner, "frame_index", self.frame_index[:1], 0, np.inf)
        check_values(owner, "location_world", self.location_world, -np.inf, np.inf)
        check_values(owner, "centroid_px", self.centroid_px, -np.inf, np.inf)
        check_values(owner, "score", self.score, 0, 1)


@dataclass(frozen=True)
class VideoTracks:
    """The tracks of one video.

    Attributes:
        n_frames: number of frames of the video.
        tracks: one per object, in the order of object ids.
        camera: that took the video; the positions follow from it.
    """

    n_frames: int
    tracks: tuple[Track, ...]
    camera: Camera = CLEVRER_CAMERA

    def __post_init__(self) -> None:
        check_whole("VideoTracks", "n_frames", self.n_frames, 1)
        check_objects("VideoTracks", [t.object for t in self.tracks])
        for t in self.tracks:
            last = int(t.frame_index[-1]) if len(t.frame_index) else -1
            check(last < self.n_frames, f"Track {t.object.id}: frame {last} outside 0-{self.n_frames - 1}")

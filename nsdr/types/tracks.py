"""What is seen in a video: objects, detections and tracks."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from nsdr.errors import DataError
from nsdr.types.arrays import ArrayHolder
from nsdr.validation import Array, BoolArray, Checked, Count, FloatArray, IntArray, PositiveCount, expect
from nsdr.world.camera import Camera
from nsdr.world.vocabulary import Vocabulary, Word
from nsdr.world.world import CLEVRER_WORLD, World


@dataclass(frozen=True)
class SceneObject(Checked):
    """The identity of an object.

    Attributes:
        id: index in the scene.
        color, material, shape: words of a world's vocabulary.
    """

    id: Count
    color: Word
    material: Word
    shape: Word

    @property
    def name(self) -> str:
        """For example "red rubber cube"."""
        return f"{self.color} {self.material} {self.shape}"


def check_objects(owner: str, objects: Sequence[SceneObject]) -> None:
    """Raise `DataError` unless the objects have the ids 0, 1, ... in order."""
    ids = [o.id for o in objects]
    expect(ids == list(range(len(ids))), f"{owner}: object ids", f"0 to {len(ids) - 1} in order", ids)


def check_words(owner: str, objects: Iterable[SceneObject], vocabulary: Vocabulary) -> None:
    """Raise `DataError` unless the words of the objects are those of a vocabulary; names the first that are not."""
    for o in objects:
        for (name, known), word in zip(vocabulary.words.items(), (o.color, o.material, o.shape), strict=True):
            expect(word in known, f"{owner}: object {o.id}: {name}", f"one of {', '.join(known)}", repr(word))


def object_of(number: int, words: str, vocabulary: Vocabulary) -> SceneObject:
    """The object with an id and words in any order, such as "red metal cube".

    Raises:
        DataError: the words are not one color, one material and one shape.
    """
    given = words.lower().removeprefix("the ").split() if isinstance(words, str) else []
    found = [[word for word in given if word in known] for known in vocabulary.words.values()]
    fits = len(given) == len(found) and all(len(of_one) == 1 for of_one in found)
    known = " and ".join(f"one {name} ({', '.join(values)})" for name, values in vocabulary.words.items())
    expect(fits, f"object {number}", f"{known}, such as {vocabulary.example!r}", repr(words))
    return SceneObject(number, *(word for (word,) in found))


def find_object(objects: Sequence[SceneObject], wanted: str | int) -> int:
    """The id of the object that is given by words or by its id.

    Raises:
        DataError: no object fits, or several do; the message lists the objects.
    """
    known = ", ".join(f"{o.id} {o.name}" for o in objects)
    if not isinstance(wanted, str):
        if wanted in range(len(objects)) and not isinstance(wanted, bool):
            return int(wanted)
        raise DataError(f"object {wanted}: expected an id of the scene's objects: {known}")
    words = set(wanted.lower().removeprefix("the ").split())
    fitting = [o.id for o in objects if words and words <= set(o.name.split())]
    if len(fitting) == 1:
        return fitting[0]
    found = "no object fits" if not fitting else f"{len(fitting)} objects fit; add words or give the id"
    raise DataError(f"{wanted!r}: {found}; the objects by id: {known}")


@dataclass(frozen=True, eq=False, repr=False)
class VideoProposals(ArrayHolder):
    """The frame parser's output for one video: one row per detected object, sorted by frame.

    Attributes:
        n_frames: number of frames of the video.
        frame_index: (N,) int, frame of each detection, ascending.
        attribute: (N,) int, `Vocabulary.index` of the detected words: 0-47 in CLEVRER.
        score: (N,) float in 0-1, confidence of the detector.
        centroid_px: (N, 2) float, mean (column, row) of the mask's pixel centres.
        area_px: (N,) int, number of mask pixels.
        box_xyxy_px: (N, 4) int, bounding box (left, top, right, bottom) of the mask, end exclusive.
        masks: N COCO run-length strings of the masks, of the image's size; None where only the numbers are known.
        processed: (P,) int, ascending frames that the detector processed; None for all.
        notes: what a user should know about the video as it was read, one sentence each.
        world: the world that the video is of.
    """

    n_frames: PositiveCount
    frame_index: Annotated[IntArray, Array("n")]
    attribute: Annotated[IntArray, Array("n", low=0)]
    score: Annotated[FloatArray, Array("n", low=0, high=1)]
    centroid_px: Annotated[FloatArray, Array("n", 2)]
    area_px: Annotated[IntArray, Array("n")]
    box_xyxy_px: Annotated[IntArray, Array("n", 4)]
    masks: tuple[str, ...] | None = None
    processed: Annotated[IntArray, Array("processed frames")] | None = None
    notes: tuple[str, ...] = ()
    world: World = CLEVRER_WORLD

    def __post_init__(self) -> None:
        super().__post_init__()
        most = self.world.vocabulary.n_triples - 1
        highest = int(self.attribute.max(initial=0))
        expect(highest <= most, "VideoProposals.attribute", f"0 to {most}", highest)
        if self.masks is not None:
            expect(len(self.masks) == len(self), "VideoProposals.masks", f"{len(self)} masks", len(self.masks))
        _check_frames("VideoProposals.frame_index", self.frame_index, self.n_frames)
        if self.processed is not None:
            _check_frames("VideoProposals.processed", self.processed, self.n_frames, repeated=False)

    def __len__(self) -> int:
        return len(self.frame_index)

    @property
    def words(self) -> tuple[str, ...]:
        """Of each of the N detections what was recognised, such as "red rubber cube"."""
        return tuple(" ".join(self.world.vocabulary.triple(i)) for i in self.attribute.tolist())

    def mask(self, i: int) -> BoolArray:
        """The mask of detection `i`: (height, width) bool, true where the object is seen.

        Raises:
            DataError: the proposals have no masks.
        """
        if self.masks is None:
            raise DataError("the proposals have no masks, only their numbers")
        from pycocotools import mask as rle

        return np.asarray(
            rle.decode({"size": [self.world.camera.height, self.world.camera.width], "counts": self.masks[i]}), np.bool_
        )


@dataclass(frozen=True, eq=False, repr=False)
class Track(ArrayHolder):
    """One object followed through the video: its identity and its detections.

    Attributes:
        object: identity.
        frame_index: (T,) int, ascending frames in which it was detected.
        location_world: (T, 2) float, ground-plane position (x, y) of its centre (world units).
        centroid_px: (T, 2) float, mean (column, row) of the pixels that are seen of it (pixels).
        box_xyxy_px: (T, 4) int, its bounding box (left, top, right, bottom), end exclusive (pixels).
        score: (T,) float in 0-1, confidence of the detector.
    """

    object: SceneObject
    frame_index: Annotated[IntArray, Array("n", low=0)]
    location_world: Annotated[FloatArray, Array("n", 2)]
    centroid_px: Annotated[FloatArray, Array("n", 2)]
    box_xyxy_px: Annotated[IntArray, Array("n", 4)]
    score: Annotated[FloatArray, Array("n", low=0, high=1)]

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_frames(f"Track {self.object.id}.frame_index", self.frame_index, repeated=False)

    def __repr__(self) -> str:
        frames = f" from frame {self.frame_index[0]} to {self.frame_index[-1]}" if len(self.frame_index) else ""
        return f"Track(object {self.object.id}, {self.object.name}: {len(self.frame_index)} detections{frames})"


@dataclass(frozen=True)
class VideoTracks(Checked):
    """The tracks of one video.

    Attributes:
        n_frames: number of frames of the video.
        tracks: one per object, in the order of object ids.
        world: the world that the video is of; the positions follow from its camera.
        notes: what a user should know about the video and how it was tracked, one sentence each.
    """

    n_frames: PositiveCount
    tracks: tuple[Track, ...]
    world: World = CLEVRER_WORLD
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        objects = [t.object for t in self.tracks]
        check_objects("VideoTracks", objects)
        check_words("VideoTracks", objects, self.world.vocabulary)
        for t in self.tracks:
            _check_frames(f"Track {t.object.id}.frame_index", t.frame_index, self.n_frames)

    @property
    def camera(self) -> Camera:
        """The camera that took the video."""
        return self.world.camera

    @property
    def centroid_px(self) -> FloatArray:
        """Where the objects are seen: (n_objects, n_frames, 2) float, (column, row) (pixels); NaN without a detection."""
        return self._by_frame("centroid_px", 2)

    @property
    def box_xyxy_px(self) -> FloatArray:
        """Boxes of the objects: (n_objects, n_frames, 4) float, left, top, right, bottom (pixels); NaN without a detection."""
        return self._by_frame("box_xyxy_px", 4)

    def _by_frame(self, name: str, width: int) -> FloatArray:
        found = np.full((len(self.tracks), self.n_frames, width), np.nan)
        for row, t in zip(found, self.tracks, strict=True):
            row[t.frame_index] = getattr(t, name)
        return found


def _check_frames(place: str, frames: IntArray, n_frames: int | None = None, repeated: bool = True) -> None:
    """Frames ascend, and are those of a video of `n_frames`."""
    if len(frames):
        ascending = bool((np.diff(frames) >= (0 if repeated else 1)).all())
        expect(ascending, place, "ascending frames", frames.tolist())
        low, high = int(frames[0]), int(frames[-1])
        if n_frames is not None:
            expect(low >= 0 and high < n_frames, place, f"frames from 0 to {n_frames - 1}", f"{low} to {high}")

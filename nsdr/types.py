"""The arrows of the data flow: what one stage hands to the next. All are frozen and validated on construction.

video -> `VideoProposals` -> `VideoTracks` -> `DynamicsPrediction` -> `Scene` -> `Answer`

Frames count from 0; the video shows frames below `n_frames`, later ones are unseen. Pixels are those of the 480x320
image, (column, row); world units are CLEVRER's ground plane (x towards the camera, y to the right of the image).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = [
    "Answer",
    "ChoiceAnswer",
    "DynamicsPrediction",
    "Event",
    "Rollout",
    "Scene",
    "SceneObject",
    "TraceStep",
    "Track",
    "VideoProposals",
    "VideoTracks",
]

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]


def _check_array(owner: object, name: str, shape: Sequence[int | None], kind: str) -> None:
    """Demand an array of a shape (None = any) and dtype kind ("f" float, "i" integer, "b" boolean)."""
    value = getattr(owner, name)
    where = f"{type(owner).__name__}.{name}"
    if not isinstance(value, np.ndarray):
        raise DataError(f"{where}: expected a numpy array, got {type(value).__name__}")
    if len(value.shape) != len(shape) or any(e not in (None, a) for e, a in zip(shape, value.shape, strict=True)):
        raise DataError(f"{where}: expected shape {tuple('?' if e is None else e for e in shape)}, got {value.shape}")
    if not (value.dtype.kind == kind or (kind == "i" and value.dtype.kind == "u")):
        raise DataError(f"{where}: expected dtype kind {kind!r}, got {value.dtype}")


def _check(condition: bool, message: str) -> None:
    if not condition:
        raise DataError(message)


class _Picklable:
    """Frozen mappings travel to other processes as dictionaries."""

    def __reduce__(self) -> tuple[Any, ...]:
        values = (getattr(self, f.name) for f in fields(self))  # type: ignore[arg-type]
        return type(self), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)


@dataclass(frozen=True)
class SceneObject:
    """An object with its identity: index in the scene and three attribute words."""

    id: int
    color: str
    material: str
    shape: str

    def __post_init__(self) -> None:
        for name, words in ATTRIBUTES.items():
            value = getattr(self, name)
            _check(value in words, f"object {self.id}: unknown {name} {value!r}; expected one of {', '.join(words)}")

    @property
    def name(self) -> str:
        """For example "red rubber cube"."""
        return f"{self.color} {self.material} {self.shape}"


def _check_objects(owner: str, objects: Sequence[SceneObject]) -> None:
    ids = [o.id for o in objects]
    _check(ids == list(range(len(ids))), f"{owner}: object ids must be 0..{len(ids) - 1} in order, got {ids}")


@dataclass(frozen=True)
class VideoProposals:
    """The frame parser's output for one video: one row a detected object, sorted by frame.

    Attributes:
        n_frames: frames of the video.
        frame_index: (N,) int.
        attribute: (N,) int, `nsdr.world.vocabulary.attribute_index` of the detected words.
        score: (N,) float, 0-1.
        centroid_px: (N, 2) float, mean (column, row) of the mask's pixel centres.
        area_px: (N,) int, number of mask pixels.
        box_xyxy_px: (N, 4) int, mask bounds, end exclusive.
        masks: COCO run-length strings of the (320, 480) masks, or None where only the numbers are known.
    """

    n_frames: int
    frame_index: IntArray
    attribute: IntArray
    score: FloatArray
    centroid_px: FloatArray
    area_px: IntArray
    box_xyxy_px: IntArray
    masks: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        n = len(self.frame_index)
        _check_array(self, "frame_index", (n,), "i")
        _check_array(self, "attribute", (n,), "i")
        _check_array(self, "score", (n,), "f")
        _check_array(self, "centroid_px", (n, 2), "f")
        _check_array(self, "area_px", (n,), "i")
        _check_array(self, "box_xyxy_px", (n, 4), "i")
        _check(self.masks is None or len(self.masks) == n, f"VideoProposals.masks: expected {n} masks")
        _check(self.n_frames > 0, f"VideoProposals.n_frames: expected at least 1, got {self.n_frames}")
        if n:
            _check(bool((np.diff(self.frame_index) >= 0).all()), "VideoProposals: rows must be sorted by frame")
            low, high = int(self.frame_index[0]), int(self.frame_index[-1])
            _check(
                low >= 0 and high < self.n_frames, f"VideoProposals: frames {low}-{high} outside 0-{self.n_frames - 1}"
            )
            _check(
                bool(((self.attribute >= 0) & (self.attribute < 48)).all()), "VideoProposals.attribute: expected 0-47"
            )

    def __len__(self) -> int:
        return len(self.frame_index)


@dataclass(frozen=True)
class Track:
    """One object followed through the video: its identity and what was seen of it.

    Attributes:
        object: identity.
        frame_index: (T,) int, ascending frames in which it was detected.
        location_world: (T, 2) float, ground-plane position (x, y) of its centre.
        centroid_px: (T, 2) float, as in `VideoProposals`.
        box_xyxy_px: (T, 4) int, as in `VideoProposals`.
        score: (T,) float.
    """

    object: SceneObject
    frame_index: IntArray
    location_world: FloatArray
    centroid_px: FloatArray
    box_xyxy_px: IntArray
    score: FloatArray

    def __post_init__(self) -> None:
        n = len(self.frame_index)
        _check_array(self, "frame_index", (n,), "i")
        _check_array(self, "location_world", (n, 2), "f")
        _check_array(self, "centroid_px", (n, 2), "f")
        _check_array(self, "box_xyxy_px", (n, 4), "i")
        _check_array(self, "score", (n,), "f")
        _check(bool((np.diff(self.frame_index) > 0).all()), f"Track {self.object.id}: frames must ascend")


@dataclass(frozen=True)
class VideoTracks:
    """All objects of one video. `n_frames` is the video's length."""

    n_frames: int
    tracks: tuple[Track, ...]

    def __post_init__(self) -> None:
        _check_objects("VideoTracks", [t.object for t in self.tracks])
        for t in self.tracks:
            last = int(t.frame_index[-1]) if len(t.frame_index) else -1
            _check(last < self.n_frames, f"Track {t.object.id}: frame {last} outside 0-{self.n_frames - 1}")


@dataclass(frozen=True)
class Event:
    """Something that happens at one frame.

    Attributes:
        kind: "in" (enters the image), "out" (leaves it) or "collision".
        frame: frame index; unseen when it is at or beyond the video's length.
        objects: ids, one for "in" and "out", two ascending for "collision".
    """

    kind: str
    frame: int
    objects: tuple[int, ...]

    def __post_init__(self) -> None:
        expected = {"in": 1, "out": 1, "collision": 2}.get(self.kind)
        _check(expected is not None, f"event kind {self.kind!r}: expected in, out or collision")
        ordered = len(self.objects) == expected and list(self.objects) == sorted(set(self.objects))
        _check(ordered, f"event {self.kind}: expected {expected} ascending object ids, got {self.objects}")


@dataclass(frozen=True)
class Rollout:
    """Motion and collisions of all objects in one course of the world.

    Attributes:
        location_world: (n_objects, F, 2) float, NaN where an object is absent or unknown.
        visible: (n_objects, F) bool, in the image.
        collisions: in order of time; pairs of object ids.
        unseen_scores: (n_objects, n_objects) float in 0-1, symmetric: how probable a collision of each pair after the
            video seems; None where that is not known.
        speed_world_per_s: (n_objects, F) float, NaN where it is not known; None where no speed is.
    """

    location_world: FloatArray
    visible: BoolArray
    collisions: tuple[Event, ...]
    unseen_scores: FloatArray | None = None
    speed_world_per_s: FloatArray | None = None

    def __post_init__(self) -> None:
        _check_array(self, "location_world", (None, None, 2), "f")
        _check_array(self, "visible", self.location_world.shape[:2], "b")
        if self.speed_world_per_s is not None:
            _check_array(self, "speed_world_per_s", self.location_world.shape[:2], "f")
        n = len(self.visible)
        if self.unseen_scores is not None:
            _check_array(self, "unseen_scores", (n, n), "f")
        for event in self.collisions:
            _check(
                event.kind == "collision" and event.objects[1] < n, f"Rollout: {event} is no collision of {n} objects"
            )


@dataclass(frozen=True)
class DynamicsPrediction(_Picklable):
    """The dynamics predictor's output for one video.

    Attributes:
        objects: identities.
        n_frames: frames of the video; rollouts go on beyond.
        observed: what happened and goes on to happen.
        counterfactual: for each removed object's id, the course of the world without it.
    """

    objects: tuple[SceneObject, ...]
    n_frames: int
    observed: Rollout
    counterfactual: Mapping[int, Rollout] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_objects("DynamicsPrediction", self.objects)
        for rollout in (self.observed, *self.counterfactual.values()):
            _check(
                len(rollout.visible) == len(self.objects), "DynamicsPrediction: a rollout has another number of objects"
            )
        object.__setattr__(self, "counterfactual", MappingProxyType(dict(self.counterfactual)))


@dataclass(frozen=True)
class Scene(_Picklable):
    """The symbolic scene a program runs on.

    Attributes:
        objects: identities, no attribute triple twice.
        n_frames: frames of the video.
        visible: (n_objects, n_frames) bool, in the image.
        moving: (n_objects, n_frames) bool, faster than the motion threshold; None where motion is not known.
        events: observed events (enter, exit, collision), by frame.
        unseen: collisions after the video; None where they are not known.
        counterfactual: collisions by the id of the removed object; None where they are not known.
        unseen_scores: (n_objects, n_objects) float as in `Rollout`; None for true scenes.
    """

    objects: tuple[SceneObject, ...]
    n_frames: int
    visible: BoolArray
    moving: BoolArray | None
    events: tuple[Event, ...]
    unseen: tuple[Event, ...] | None = None
    counterfactual: Mapping[int, tuple[Event, ...]] | None = None
    unseen_scores: FloatArray | None = None

    def __post_init__(self) -> None:
        _check_objects("Scene", self.objects)
        triples = [o.name for o in self.objects]
        twice = sorted({name for name in triples if triples.count(name) > 1})
        _check(not twice, f"Scene: more than one {', '.join(twice)}; attribute triples must be unique")
        n = len(self.objects)
        _check_array(self, "visible", (n, self.n_frames), "b")
        if self.moving is not None:
            _check_array(self, "moving", (n, self.n_frames), "b")
        if self.unseen_scores is not None:
            _check_array(self, "unseen_scores", (n, n), "f")
        counterfactual = self.counterfactual or {}
        for event in [*self.events, *(self.unseen or ()), *(e for events in counterfactual.values() for e in events)]:
            _check(
                max(event.objects) < n and min(event.objects) >= 0, f"Scene: {event} names an object beyond 0-{n - 1}"
            )
        object.__setattr__(self, "events", _in_order(self.events))
        if self.unseen is not None:
            object.__setattr__(self, "unseen", _in_order(self.unseen))
        if self.counterfactual is not None:
            object.__setattr__(self, "counterfactual", MappingProxyType(dict(self.counterfactual)))


def _in_order(events: Sequence[Event]) -> tuple[Event, ...]:
    """By frame; at one frame, entering and leaving come before collisions."""
    return tuple(sorted(events, key=lambda e: (e.frame, e.kind == "collision")))


@dataclass(frozen=True)
class TraceStep:
    """One executed module.

    Attributes:
        module: its token.
        inputs: indices of the steps whose results it took.
        kind: type of the result (`nsdr.symbolic.Kind`).
        value: the result in plain form: words, numbers, object ids, or `Event`s.
        text: the result in words.
        objects: ids of the objects the result rests on: its own, or for a word or number those of its inputs.
        events: the same for events.
    """

    module: str
    inputs: tuple[int, ...]
    kind: str
    value: Any
    text: str
    objects: tuple[int, ...] = ()
    events: tuple[Event, ...] = ()


@dataclass(frozen=True)
class ChoiceAnswer:
    """One option of a multiple-choice question: "correct" or "wrong", with how that came out."""

    choice: str
    answer: str
    program: tuple[str, ...]
    trace: tuple[TraceStep, ...]


@dataclass(frozen=True)
class Answer:
    """The answer to a question.

    Attributes:
        question: its text ("" when a program was given).
        program: the question's program, postfix tokens.
        answer: the answer word; None for a multiple-choice question.
        trace: executed steps; for a multiple-choice question see `choices`.
        choices: the options' answers; empty for a descriptive question.
    """

    question: str
    program: tuple[str, ...]
    answer: str | None
    trace: tuple[TraceStep, ...] = ()
    choices: tuple[ChoiceAnswer, ...] = ()

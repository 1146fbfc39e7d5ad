"""The data types that stages exchange. All are frozen dataclasses, validated on construction.

video -> `VideoProposals` -> `VideoTracks` -> `DynamicsPrediction` -> `Scene` -> `Answer`

Frames count from 0; the video shows frames below `n_frames`, later ones are unseen. Pixels are those of the 480x320
image, (column, row); world units are CLEVRER's ground plane (x towards the camera, y to the right of the image).

Arrays are stored as read-only views of the arrays passed in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.world.vocabulary import ATTRIBUTES, N_ATTRIBUTE_TRIPLES

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


def _store_array(owner: object, name: str, shape: Sequence[int | None], kind: str) -> None:
    """Check an array's shape (None = any length) and dtype kind ("f" float, "i" integer, "b" boolean); make it read-only."""
    value = getattr(owner, name)
    where = f"{type(owner).__name__}.{name}"
    if not isinstance(value, np.ndarray):
        raise DataError(f"{where}: expected a numpy array, got {type(value).__name__}")
    if len(value.shape) != len(shape) or any(e not in (None, a) for e, a in zip(shape, value.shape, strict=True)):
        raise DataError(f"{where}: expected shape {tuple('?' if e is None else e for e in shape)}, got {value.shape}")
    if not (value.dtype.kind == kind or (kind == "i" and value.dtype.kind == "u")):
        raise DataError(f"{where}: expected dtype kind {kind!r}, got {value.dtype}")
    view = value.view()  # the caller's own array stays writable
    view.flags.writeable = False
    object.__setattr__(owner, name, view)


def _check(condition: bool, message: str) -> None:
    if not condition:
        raise DataError(message)


class _ArrayHolder:
    """Base of the dataclasses that hold arrays or mappings.

    Instances are compared by value and are not hashable. Pickling and copying go through the constructor: read-only
    mappings cannot be pickled themselves, and unpickled arrays would be writable.
    """

    def _values(self) -> list[Any]:
        return [getattr(self, f.name) for f in fields(self)]  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _ArrayHolder) or type(other) is not type(self):
            return NotImplemented
        return all(_equal(a, b) for a, b in zip(self._values(), other._values(), strict=True))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in self._values())


def _equal(a: Any, b: Any) -> bool:
    """Equality of two field values; NaN equals NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return not isinstance(a, np.ndarray) and not isinstance(b, np.ndarray) and bool(a == b)


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


@dataclass(frozen=True, eq=False)
class VideoProposals(_ArrayHolder):
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
        _store_array(self, "frame_index", (n,), "i")
        _store_array(self, "attribute", (n,), "i")
        _store_array(self, "score", (n,), "f")
        _store_array(self, "centroid_px", (n, 2), "f")
        _store_array(self, "area_px", (n,), "i")
        _store_array(self, "box_xyxy_px", (n, 4), "i")
        _check(self.masks is None or len(self.masks) == n, f"VideoProposals.masks: expected {n} masks")
        _check(self.n_frames > 0, f"VideoProposals.n_frames: expected at least 1, got {self.n_frames}")
        if n:
            _check(bool((np.diff(self.frame_index) >= 0).all()), "VideoProposals: rows must be sorted by frame")
            low, high, end = int(self.frame_index[0]), int(self.frame_index[-1]), self.n_frames - 1
            _check(0 <= low <= high <= end, f"VideoProposals: frames {low}-{high} outside 0-{end}")
            known = (self.attribute >= 0) & (self.attribute < N_ATTRIBUTE_TRIPLES)
            _check(bool(known.all()), f"VideoProposals.attribute: expected 0-{N_ATTRIBUTE_TRIPLES - 1}")
        if self.processed is not None:
            _store_array(self, "processed", (None,), "i")

    def __len__(self) -> int:
        return len(self.frame_index)


@dataclass(frozen=True, eq=False)
class Track(_ArrayHolder):
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
        _store_array(self, "frame_index", (n,), "i")
        _store_array(self, "location_world", (n, 2), "f")
        _store_array(self, "centroid_px", (n, 2), "f")
        _store_array(self, "box_xyxy_px", (n, 4), "i")
        _store_array(self, "score", (n,), "f")
        _check(bool((np.diff(self.frame_index) > 0).all()), f"Track {self.object.id}: frames must ascend")


@dataclass(frozen=True)
class VideoTracks:
    """The tracks of one video.

    Attributes:
        n_frames: number of frames of the video.
        tracks: one per object, in the order of object ids.
    """

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
        frame: frame index; at or beyond the video's length for unseen events.
        objects: object ids: one for "in" and "out", two in ascending order for "collision".
    """

    kind: str
    frame: int
    objects: tuple[int, ...]

    def __post_init__(self) -> None:
        expected = {"in": 1, "out": 1, "collision": 2}.get(self.kind)
        _check(expected is not None, f"event kind {self.kind!r}: expected in, out or collision")
        ordered = len(self.objects) == expected and list(self.objects) == sorted(set(self.objects))
        _check(ordered, f"event {self.kind}: expected {expected} ascending object ids, got {self.objects}")


@dataclass(frozen=True, eq=False)
class Rollout(_ArrayHolder):
    """Trajectories and collisions of all objects, either as observed and predicted or with one object removed.

    Attributes:
        location_world: (n_objects, F, 2) float, ground-plane positions (x, y) (world units); NaN where absent or unknown.
        visible: (n_objects, F) bool, whether the object is in the image.
        collisions: collision events in order of time.
        unseen_scores: (n_objects, n_objects) float in 0-1, symmetric: probability of a collision after the video, or None.
        speed_world_per_s: (n_objects, F) float, speed on the ground (world units/s), NaN or None where it is not known.
    """

    location_world: FloatArray
    visible: BoolArray
    collisions: tuple[Event, ...]
    unseen_scores: FloatArray | None = None
    speed_world_per_s: FloatArray | None = None

    def __post_init__(self) -> None:
        _store_array(self, "location_world", (None, None, 2), "f")
        _store_array(self, "visible", self.location_world.shape[:2], "b")
        if self.speed_world_per_s is not None:
            _store_array(self, "speed_world_per_s", self.location_world.shape[:2], "f")
        n = len(self.visible)
        if self.unseen_scores is not None:
            _store_array(self, "unseen_scores", (n, n), "f")
        for event in self.collisions:
            fits = event.kind == "collision" and event.objects[1] < n
            _check(fits, f"Rollout: {event} is not a collision of two of the {n} objects")


@dataclass(frozen=True, eq=False)
class DynamicsPrediction(_ArrayHolder):
    """The dynamics predictor's output for one video.

    Attributes:
        objects: identities.
        n_frames: number of frames of the video; rollouts continue beyond it.
        observed: the rollout with all objects: the video and its continuation.
        counterfactual: rollouts with one object removed, by that object's id.
    """

    objects: tuple[SceneObject, ...]
    n_frames: int
    observed: Rollout
    counterfactual: Mapping[int, Rollout] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_objects("DynamicsPrediction", self.objects)
        for rollout in (self.observed, *self.counterfactual.values()):
            expected, got = len(self.objects), len(rollout.visible)
            _check(got == expected, f"DynamicsPrediction: expected rollouts of {expected} objects, got {got}")
        object.__setattr__(self, "counterfactual", MappingProxyType(dict(self.counterfactual)))


@dataclass(frozen=True, eq=False)
class Scene(_ArrayHolder):
    """The symbolic scene that programs run on.

    Attributes:
        objects: identities; attribute triples are unique.
        n_frames: number of frames of the video.
        visible: (n_objects, n_frames) bool, whether the object is in the image.
        moving: (n_objects, n_frames) bool, whether the object moves; None where motion is not known.
        events: observed events (enter, exit, collision) in order of time.
        unseen: collisions after the video; None where they are not known.
        counterfactual: collisions with one object removed, by that object's id; None where they are not known.
        unseen_scores: (n_objects, n_objects) float, as in `Rollout`; None for ground-truth scenes.
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
        repeated = sorted({name for name in triples if triples.count(name) > 1})
        _check(not repeated, f"Scene: more than one {', '.join(repeated)}; attribute triples must be unique")
        n = len(self.objects)
        _store_array(self, "visible", (n, self.n_frames), "b")
        if self.moving is not None:
            _store_array(self, "moving", (n, self.n_frames), "b")
        if self.unseen_scores is not None:
            _store_array(self, "unseen_scores", (n, n), "f")
        counterfactual = self.counterfactual or {}
        for event in [*self.events, *(self.unseen or ()), *(e for events in counterfactual.values() for e in events)]:
            known = max(event.objects) < n and min(event.objects) >= 0
            _check(known, f"Scene: {event} names an object outside 0-{n - 1}")
        object.__setattr__(self, "events", _in_order(self.events))
        if self.unseen is not None:
            object.__setattr__(self, "unseen", _in_order(self.unseen))
        if self.counterfactual is not None:
            object.__setattr__(self, "counterfactual", MappingProxyType(dict(self.counterfactual)))


def _in_order(events: Sequence[Event]) -> tuple[Event, ...]:
    """Events sorted by frame; at the same frame, entrances and exits come before collisions."""
    return tuple(sorted(events, key=lambda e: (e.frame, e.kind == "collision")))


@dataclass(frozen=True)
class TraceStep:
    """One executed module.

    Attributes:
        module: the module's token.
        inputs: indices of the steps that gave its arguments.
        kind: type of the result (`nsdr.symbolic.Kind`).
        value: the result: a word, number or truth value, object ids, or `Event`s.
        text: the result in words.
        objects: ids of the objects in the result, or for a word or number those of its inputs.
        events: the events in the result, or for a word or number those of its inputs.
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
    """The judgement of one choice of a multiple-choice question.

    Attributes:
        choice: text of the choice.
        answer: "correct" or "wrong"; with the official semantics also "error".
        program: postfix tokens of the choice's program followed by the question's.
        trace: executed steps.
    """

    choice: str
    answer: str
    program: tuple[str, ...]
    trace: tuple[TraceStep, ...]


@dataclass(frozen=True)
class Answer:
    """The answer to a question.

    Attributes:
        question: text of the question; "" when only a program was given.
        program: postfix tokens of the question's program.
        answer: the answer word; None for a multiple-choice question.
        trace: executed steps; empty for a multiple-choice question, whose choices have traces of their own.
        choices: the judged choices; empty for a descriptive question.
    """

    question: str
    program: tuple[str, ...]
    answer: str | None
    trace: tuple[TraceStep, ...] = ()
    choices: tuple[ChoiceAnswer, ...] = ()

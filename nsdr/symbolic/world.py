"""A scene prepared for execution: sets of objects and events are integers used as bit sets.

Event bits, from low to high: every possible event (for choices), observed events in order of time, unseen events in order of
time, the start and end of the video, and one mark per observed event for its participants (see `World.ancestors`).
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import ExecutionError
from nsdr.symbolic.causal import ancestor_sets
from nsdr.symbolic.quantities import Quantities, Simulate
from nsdr.types import Event, Scene, SceneObject

__all__ = ["MotionTable", "World", "world_of"]


@dataclass(frozen=True)
class MotionTable:
    """Visibility and motion of all objects, as bit sets.

    Attributes:
        visible_at: visible objects, by frame.
        moving_at: visible objects that move, by frame.
        visible_ever: objects visible at any frame of the video.
        moving_ever: objects that are visible and move at any frame.
    """

    visible_at: Sequence[int] | Mapping[int, int]
    moving_at: Sequence[int] | Mapping[int, int]
    visible_ever: int
    moving_ever: int

    def moving(self, objects: int, frame: int | None) -> int:
        """Those of the objects that are visible and move at a frame; with None, at any frame."""
        return objects & (self.moving_ever if frame is None else _at(self.moving_at, frame))

    def stationary(self, objects: int, frame: int | None) -> int:
        """Those of the objects that are visible and at rest at a frame; with None, that never move while visible."""
        if frame is None:
            return objects & self.visible_ever & ~self.moving_ever
        return objects & _at(self.visible_at, frame) & ~_at(self.moving_at, frame)


def _at(table: Sequence[int] | Mapping[int, int], frame: int) -> int:
    try:
        return table[frame]
    except (IndexError, KeyError):
        raise ExecutionError(f"motion at frame {frame} is not known") from None


class _Index:
    """Bit sets of events by kind, by object, and by kind and objects. Each added event takes the next bit."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.of_kind = {"in": 0, "out": 0, "collision": 0}
        self.of_object: dict[int, int] = {}
        self.same: dict[tuple[str, tuple[int, ...]], int] = {}

    def copy(self) -> "_Index":
        other = _Index.__new__(_Index)
        other.events, other.of_kind = self.events.copy(), self.of_kind.copy()
        other.of_object, other.same = self.of_object.copy(), self.same.copy()
        return other

    def add(self, event: Event) -> None:
        bit = 1 << len(self.events)
        self.events.append(event)
        kind, objects = event.kind, event.objects
        self.of_kind[kind] |= bit
        for i in objects:
            self.of_object[i] = self.of_object.get(i, 0) | bit
        self.same[kind, objects] = self.same.get((kind, objects), 0) | bit


@lru_cache(maxsize=16)
def _possible_events(n: int) -> _Index:
    """Every event that could happen to n objects; their frame is -1."""
    index = _Index()
    for pair in combinations(range(n), 2):
        index.add(Event("collision", -1, pair))
    for kind in ("in", "out"):
        for i in range(n):
            index.add(Event(kind, -1, (i,)))
    return index


class World:
    """Objects, events and motion as bit sets, which program modules run on. `world_of` makes one from a scene.

    Args:
        objects: identities.
        observed: events of the video in order of time.
        unseen: events after the video in order of time; None where they are not known.
        counterfactual: collisions without an object, by that object's id; None where they are not known.
        end_frame: frame of the event `end`.
        motion: makes the motion table; called when it is first needed.
        quantities: speeds, masses and changes, for questions beyond CLEVRER.
    """

    def __init__(
        self,
        objects: Sequence[SceneObject],
        observed: Sequence[Event],
        unseen: Sequence[Event] | None,
        counterfactual: Mapping[int, Sequence[Event]] | None,
        end_frame: int,
        motion: Callable[[], MotionTable],
        quantities: Quantities,
    ) -> None:
        self.objects = objects
        self.quantities = quantities
        self._observed_events = observed
        self._unseen_events = unseen
        self._counterfactual = counterfactual
        self._make_motion = motion
        self.all_objects = (1 << len(objects)) - 1
        self.with_word = _Words()
        for o in objects:
            bit = 1 << o.id
            self.with_word[o.color] |= bit
            self.with_word[o.material] |= bit
            self.with_word[o.shape] |= bit
        self._index_events(end_frame)
        self._involving: dict[int, int] = {1 << i: events for i, events in self._of_object.items()}

    def _index_events(self, end_frame: int) -> None:
        observed, unseen = self._observed_events, self._unseen_events or ()
        index = _possible_events(len(self.objects)).copy()
        self._first = len(index.events)
        self.possible = (1 << self._first) - 1
        for event in observed:
            index.add(event)
        for event in unseen:
            index.add(event)
        n_events = len(index.events)
        self.frames = [e.frame for e in index.events[self._first :]]
        self.observed = ((1 << len(observed)) - 1) << self._first
        self._unseen = ((1 << len(unseen)) - 1) << (self._first + len(observed))
        self.start, self.end = 1 << n_events, 2 << n_events
        # Only the frames of start and end are read; they match no filter.
        index.events += [Event("in", 0, (0,)), Event("in", end_frame, (0,))]
        self.events = index.events
        self._mark = len(self.events)
        self.members = (1 << self._mark) - 1
        # Of sets of events of which only the collisions are known.
        self.collisions_only = 1 << 2 * self._mark
        self.entering, self.exiting, self.colliding = index.of_kind.values()
        self._of_object, self._same = index.of_object, index.same

    def event(self, bit: int) -> Event:
        """The event that a one-bit set stands for."""
        return self.events[bit.bit_length() - 1]

    def object(self, bit: int) -> SceneObject:
        """The object that a one-bit set stands for."""
        return self.objects[bit.bit_length() - 1]

    def objects_of(self, event: int) -> int:
        """Objects that take part in an event, as a bit set."""
        if event == self.start or event == self.end:
            return 0
        bits = 0
        for i in self.events[event.bit_length() - 1].objects:
            bits |= 1 << i
        return bits

    def frame_of(self, event: int) -> int:
        """Frame of an event of the video."""
        frame = self.events[event.bit_length() - 1].frame
        if frame < 0:
            raise ExecutionError(f"{self.event_text(event)} is only a possible event and has no frame")
        return frame

    def before(self, frame: int) -> int:
        """Observed and unseen events before a frame."""
        earlier = (1 << bisect_left(self.frames, frame)) - 1
        return earlier << self._first

    def after(self, frame: int) -> int:
        """Observed and unseen events after a frame."""
        return (self.observed | self._unseen) & -(1 << (self._first + bisect_right(self.frames, frame)))

    def involving(self, objects: int) -> int:
        """Events in which any of the objects takes part."""
        found = self._involving.get(objects)
        if found is None:
            found = 0
            for i, events in self._of_object.items():
                if objects >> i & 1:
                    found |= events
            self._involving[objects] = found
        return found

    def participation(self, one: int) -> int:
        """Events in which an object takes part, and its marks as a participant of observed events (see `ancestors`)."""
        events = self.involving(one)
        return events | (events & self.observed) << self._mark

    def same_kind_and_objects(self, event: int) -> int:
        """All events of the same kind with the same objects, at any frame."""
        if event == self.start or event == self.end:
            return event
        e = self.events[event.bit_length() - 1]
        return self._same[e.kind, e.objects]

    def ancestors(self, events: int, event: int) -> int:
        """Those of the events that are responsible for an event, and the mark of that event.

        In the paper, taking part in an event makes an object responsible for it, but no event is responsible for itself.
        So the result contains the event's mark instead of the event; only `participation` of objects has marks.
        """
        if not event & self.observed:
            raise ExecutionError(f"{self.event_text(event)} was not observed, so its causes are not known")
        return (events & self._ancestors[event]) | event << self._mark

    @cached_property
    def _ancestors(self) -> dict[int, int]:
        return {bit << self._first: bits << self._first for bit, bits in ancestor_sets(self._observed_events).items()}

    def need_unseen(self) -> int:
        """Events after the video."""
        if self._unseen_events is None:
            raise ExecutionError("events after the video are not known in this scene")
        return self._unseen

    def need_counterfactual(self, removed: int) -> int:
        """Every event of the same kind and objects as one that happens without an object (a one-bit set)."""
        known = self._counterfactual
        object_id = removed.bit_length() - 1
        if known is None or object_id not in known:
            raise ExecutionError(f"events without {self.object_text(removed)} are not known in this scene")
        return self.like_any(known[object_id])

    def like_any(self, events: Sequence[Event]) -> int:
        """Every event of the same kind and objects as one of these."""
        result = 0
        for event in events:
            result |= self._same[event.kind, event.objects]
        return result

    @cached_property
    def motion(self) -> MotionTable:
        """Visibility and motion of all objects.

        Raises:
            ExecutionError: motion is not known.
        """
        return self._make_motion()

    def object_text(self, objects: int) -> str:
        """A set of objects in words."""
        return ", ".join(o.name for o in self.objects if objects >> o.id & 1) or "none"

    def event_text(self, events: int) -> str:
        """A set of events in words."""
        texts = [self._one_event_text(1 << i, event) for i, event in enumerate(self.events) if events >> i & 1]
        return "; ".join(texts) or "none"

    def event_sentences(self, events: int) -> tuple[str, ...]:
        """Each event of a set as a sentence; frames after the video are about right only."""
        members = [(1 << i, event) for i, event in enumerate(self.events) if events >> i & 1]
        sentences = []
        for bit, event in members:
            text = self._one_event_text(bit, event, "the ")
            sentences.append(text.replace("(frame", "(about frame") if bit & self._unseen else text)
        return tuple(sentences)

    def _one_event_text(self, bit: int, event: Event, article: str = "") -> str:
        if bit in (self.start, self.end):
            return f"{'start' if bit == self.start else 'end'} (frame {event.frame})"
        names = [article + self.objects[i].name for i in event.objects]
        what = {"in": "{} enters", "out": "{} exits", "collision": "{} and {} collide"}[event.kind].format(*names)
        return what if event.frame < 0 else f"{what} (frame {event.frame})"


def world_of(scene: Scene, simulate: Simulate | None = None) -> World:
    """The world of a scene with the paper's semantics; `simulate` is as of `nsdr.symbolic.quantities.Quantities`."""
    return World(
        scene.objects,
        scene.events,
        scene.unseen,
        scene.counterfactual,
        end_frame=scene.n_frames - 1,
        motion=lambda: _motion(scene),
        quantities=Quantities(scene, simulate),
    )


def _motion(scene: Scene) -> MotionTable:
    if scene.moving is None:
        raise ExecutionError("motion is not known in this scene (it was made from events alone)")
    visible_at, visible_ever = _bits_by_frame(scene.visible)
    moving_at, moving_ever = _bits_by_frame(scene.visible & scene.moving)
    return MotionTable(visible_at, moving_at, visible_ever, moving_ever)


class _Words(dict[str, int]):
    """Bit set of objects by attribute word; empty for words that no object has."""

    def __missing__(self, word: str) -> int:
        return 0


def _bits_by_frame(flags: NDArray[np.bool_]) -> tuple[list[int], int]:
    """(n, F) flags -> the bit set of objects of each frame, and their union."""
    at = [0] * flags.shape[1]
    ever = 0
    for first in range(0, len(flags), 8):  # `packbits` packs 8 flags into a byte
        packed = np.packbits(flags[first : first + 8], axis=0, bitorder="little")[0]
        ever |= int(np.bitwise_or.reduce(packed)) << first
        at = (
            [bits | byte << first for bits, byte in zip(at, packed.tolist(), strict=True)] if first else packed.tolist()
        )
    return at, ever

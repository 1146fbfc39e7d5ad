"""A scene prepared for execution: sets of objects and events as bits of integers.

Event bits, from low to high: observed events in order of time, unseen events, the video's start and end, every
possible event (for choices), and for each observed event a mark "takes part in the target" (see `World.ancestors`).
"""

from dataclasses import dataclass
from itertools import combinations

from nsdr.errors import ExecutionError
from nsdr.symbolic.causal import ancestor_sets
from nsdr.types import Event, Scene, SceneObject

__all__ = ["Motion", "World"]


@dataclass(frozen=True)
class Motion:
    """Bit sets of moving and visible objects: at each frame, and at any."""

    at: list[int]
    ever: int


class World:
    """Bit-set view of a `Scene`, built once and shared by all programs that run on it."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        n = len(scene.objects)
        self.all_objects = (1 << n) - 1
        self.with_word: dict[str, int] = _Words()
        for o in scene.objects:
            for word in (o.color, o.material, o.shape):
                self.with_word[word] |= 1 << o.id
        self._index_events()
        self._involving: dict[int, int] = {}
        self._participants: dict[int, int] = {}
        self._ancestors: dict[int, int] | None = None
        self._visible: list[int] | None = None
        self._motion: Motion | None = None

    def _index_events(self) -> None:
        scene = self.scene
        n = len(scene.objects)
        unseen = scene.unseen or ()
        start, end = Event("in", 0, (0,)), Event("in", scene.n_frames - 1, (0,))  # only their frame is read
        possible = [Event("collision", -1, pair) for pair in combinations(range(n), 2)]
        possible += [Event(kind, -1, (i,)) for kind in ("in", "out") for i in range(n)]
        self.events: list[Event] = [*scene.events, *unseen, start, end, *possible]
        n_observed, n_seen = len(scene.events), len(scene.events) + len(unseen)
        self.observed = (1 << n_observed) - 1
        self._unseen = ((1 << n_seen) - 1) & ~self.observed
        self.start, self.end = 1 << n_seen, 2 << n_seen
        self.possible = ((1 << len(possible)) - 1) << (n_seen + 2)
        self._mark = len(self.events)
        self.members = (1 << self._mark) - 1

        self.entering = self.exiting = self.colliding = 0
        self._of_object = [0] * n
        self._same: dict[tuple[str, tuple[int, ...]], int] = {}
        bit = 1
        for index, event in enumerate(self.events):
            if not n_seen <= index < n_seen + 2:
                if event.kind == "collision":
                    self.colliding |= bit
                elif event.kind == "in":
                    self.entering |= bit
                else:
                    self.exiting |= bit
                for i in event.objects:
                    self._of_object[i] |= bit
                key = (event.kind, event.objects)
                self._same[key] = self._same.get(key, 0) | bit
            bit <<= 1

    def event(self, bit: int) -> Event:
        """The event of a one-bit set."""
        return self.events[bit.bit_length() - 1]

    def attribute(self, bit: int) -> SceneObject:
        """The object of a one-bit set."""
        return self.scene.objects[bit.bit_length() - 1]

    def objects_of(self, event: int) -> int:
        """Objects that take part in an event, as a bit set."""
        if event in (self.start, self.end):
            return 0
        return sum(1 << i for i in self.event(event).objects)

    def frame_of(self, event: int) -> int:
        """Frame of an event of the video."""
        frame = self.event(event).frame
        if frame < 0:
            raise ExecutionError(f"{self.event_text(event)} is only possible: it has no frame")
        return frame

    def before(self, frame: int) -> int:
        """Observed and unseen events before a frame."""
        return sum(1 << i for i, e in enumerate(self.events[: self.start.bit_length() - 1]) if e.frame < frame)

    def after(self, frame: int) -> int:
        """Observed and unseen events after a frame."""
        return sum(1 << i for i, e in enumerate(self.events[: self.start.bit_length() - 1]) if e.frame > frame)

    def involving(self, objects: int, participants: bool = False) -> int:
        """Events in which any of the objects takes part; `participants` adds the marks of `ancestors`."""
        memo = self._participants if participants else self._involving
        if objects not in memo:
            memo[objects] = 0
            for i, events in enumerate(self._of_object):
                if objects >> i & 1:
                    memo[objects] |= events | ((events & self.observed) << self._mark if participants else 0)
        return memo[objects]

    def same_kind_and_objects(self, event: int) -> int:
        """All events of the same kind with the same objects, at whatever frame."""
        e = self.event(event)
        return self._same[e.kind, e.objects]

    def ancestors(self, events: int, event: int) -> int:
        """Observed events responsible for an event, and its mark.

        The paper lets an object be responsible by taking part in the event itself, which is no event responsible for
        itself: so the target is not in the set, but its mark is, and only membership of objects looks at marks.
        """
        if self._ancestors is None:
            self._ancestors = ancestor_sets(self.scene.events)
        if not event & self.observed:
            raise ExecutionError(f"{self.event_text(event)} was not observed: nothing is responsible for it")
        return (events & self._ancestors[event]) | event << self._mark

    def need_unseen(self) -> int:
        """Events after the video."""
        if self.scene.unseen is None:
            raise ExecutionError("the scene does not know what happens after the video")
        return self._unseen

    def need_counterfactual(self, removed: int) -> int:
        """Every event whose kind and objects happen in the course of the world without an object."""
        known = self.scene.counterfactual
        one = removed.bit_length() - 1
        if known is None or one not in known:
            raise ExecutionError(f"the scene does not know what happens without {self.object_text(removed)}")
        result = 0
        for event in known[one]:
            result |= self._same[event.kind, event.objects]
        return result

    @property
    def visible_at(self) -> list[int]:
        """Visible objects at each frame."""
        if self._visible is None:
            self._visible = _bits_by_frame(self.scene.visible)
        return self._visible

    @property
    def visible_ever(self) -> int:
        """Objects visible at any frame."""
        return _union(self.visible_at)

    def need_motion(self) -> Motion:
        """Objects visible and moving."""
        if self._motion is None:
            if self.scene.moving is None:
                raise ExecutionError("the scene does not know which objects move (it comes from events alone)")
            at = _bits_by_frame(self.scene.visible & self.scene.moving)
            self._motion = Motion(at, _union(at))
        return self._motion

    def object_text(self, objects: int) -> str:
        """Names of a set of objects."""
        return ", ".join(o.name for o in self.scene.objects if objects >> o.id & 1) or "none"

    def event_text(self, events: int) -> str:
        """A set of events in words."""
        texts = []
        for index, event in enumerate(self.events):
            if events >> index & 1:
                texts.append(self._one_event_text(1 << index, event))
        return "; ".join(texts) or "none"

    def _one_event_text(self, bit: int, event: Event) -> str:
        if bit in (self.start, self.end):
            return f"{'start' if bit == self.start else 'end'} (frame {event.frame})"
        names = [self.scene.objects[i].name for i in event.objects]
        what = {"in": "{} enters", "out": "{} exits", "collision": "{} and {} collide"}[event.kind].format(*names)
        return what if event.frame < 0 else f"{what} (frame {event.frame})"


class _Words(dict[str, int]):
    """Bit set of objects by attribute word; a word no object has is the empty set."""

    def __missing__(self, word: str) -> int:
        return 0


def _bits_by_frame(flags) -> list[int]:  # type: ignore[no-untyped-def]
    weights = [1 << i for i in range(len(flags))]
    return [sum(w for w, on in zip(weights, row, strict=True) if on) for row in flags.T.tolist()]


def _union(sets: list[int]) -> int:
    result = 0
    for one in sets:
        result |= one
    return result

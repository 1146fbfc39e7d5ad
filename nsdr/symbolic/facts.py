"""What program modules run on: a scene's objects, events and motion, and how values of programs are said.

An object is its id, an event an `Event`, a set of either a tuple: objects in order of their ids, events in order of time.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from nsdr.errors import ExecutionError
from nsdr.symbolic.causal import ancestor_sets
from nsdr.symbolic.quantities import Quantities, Simulate
from nsdr.symbolic.telling import description
from nsdr.types import Event, Scene, SceneObject
from nsdr.types.events import event_sentence

Objects = tuple[int, ...]
Events = tuple[Event, ...]


@dataclass(frozen=True)
class Boundary(Event):
    """The start or end of the video as an event without objects. It is in no set of events."""

    def __post_init__(self) -> None:
        """Nothing is checked, as this is not an event of a scene."""


class Causes(tuple[Event, ...]):
    """The events that are responsible for one, `target`.

    In the paper, taking part in an event makes an object responsible for it, but no event is responsible for itself.
    """

    target: Event

    @classmethod
    def of(cls, target: Event, events: Iterable[Event]) -> "Causes":
        """The causes of an event."""
        causes = cls(events)
        causes.target = target
        return causes


class Collisions(tuple[Event, ...]):
    """Events after the video, or with an object removed, of which only the collisions are known."""


class SceneFacts:
    """A scene as programs see it, by the rules of the paper and of CLEVRER's own answers.

    Args:
        scene: the scene.
        simulate: see `nsdr.symbolic.quantities.Quantities`.

    Attributes:
        objects: identities.
        all_objects: their ids.
        events: of the video, in order of time.
        start, end: the first and last frame of the video, as events.
        quantities: speeds, masses and changes, for questions beyond CLEVRER.
    """

    def __init__(self, scene: Scene, simulate: Simulate | None = None) -> None:
        self._scene = scene
        self.objects, self.events = scene.objects, scene.events
        self._names = [o.name for o in scene.objects]
        self.all_objects: Objects = tuple(range(len(scene.objects)))
        self.start, self.end = Boundary("start", 0, ()), Boundary("end", scene.n_frames - 1, ())
        self.quantities = Quantities(scene, simulate)

    @cached_property
    def possible(self) -> Events:
        """Every event that could happen. Their frames are -1."""
        pairs = [Event("collision", -1, pair) for pair in combinations(self.all_objects, 2)]
        return tuple(pairs + [Event(kind, -1, (i,)) for kind in ("in", "out") for i in self.all_objects])

    @property
    def unseen_events(self) -> Events:
        """Events after the video."""
        if self._scene.predicted is None:
            raise ExecutionError("events after the video are not known in this scene")
        return self._as_known(self._scene.predicted)

    def events_without(self, removed: int) -> Events:
        """Events of the video, and after it, without an object."""
        known = self._scene.counterfactual
        if known is None or removed not in known:
            raise ExecutionError(f"events without {self._names[removed]} are not known in this scene")
        return self._as_known(known[removed])

    def _as_known(self, events: Events) -> Events:
        return Collisions(events) if self._scene.collisions_only else events

    def object(self, one: int) -> SceneObject:
        """The object with an id."""
        return self.objects[one]

    def frame_of(self, event: Event) -> int:
        """Frame of an event of the video."""
        if event.frame < 0:
            raise ExecutionError(f"{self.event_text([event])} is only a possible event and has no frame")
        return event.frame

    def in_motion(self, objects: Objects, frame: int | None, wanted: bool) -> Objects:
        """Those of some objects that are visible and in motion, or not in motion if `wanted` is False.

        Args:
            objects: ids of the objects.
            frame: the frame at which they are; None for the whole video, in which an object is in motion if it ever moves.
            wanted: whether they are in motion.
        """
        visible, moving = self._scene.visible, self._scene.moving
        if moving is None:
            raise ExecutionError("motion is not known in this scene (it was made from events alone)")
        if frame is None:
            shown, moves = np.any(visible, axis=1), np.any(visible & moving, axis=1)
        elif 0 <= frame < self._scene.n_frames:
            shown, moves = visible[:, frame], moving[:, frame]
        else:
            raise ExecutionError(f"motion at frame {frame} is not known")
        return tuple([i for i in objects if shown[i] and moves[i] == wanted])

    @cached_property
    def _ancestors(self) -> list[set[int]]:
        return ancestor_sets(self.events)

    def causes(self, event: Event) -> set[Event]:
        """Direct and indirect causes of an observed event."""
        if event not in self.events:
            raise ExecutionError(f"{self.event_text([event])} was not observed, so its causes are not known")
        return {self.events[i] for i in self._ancestors[self.events.index(event)]}

    def object_text(self, objects: Sequence[int]) -> str:
        """A set of objects in words."""
        return ", ".join([self._names[i] for i in objects]) or "none"

    def event_text(self, events: Sequence[Event]) -> str:
        """A set of events in words."""
        if events == self.possible:
            return f"{len(events)} possible events"
        return "; ".join([event_sentence(e, self._names) for e in events]) or "none"

    def sentences(self, events: Sequence[Event]) -> tuple[str, ...]:
        """Each event of a set as a sentence. Frames after the video are approximate, and said to be."""
        names, n_frames = [f"the {name}" for name in self._names], self._scene.n_frames
        texts = [(e, event_sentence(e, names)) for e in events]
        return tuple(t if e.frame < n_frames else t.replace("(frame", "(about frame") for e, t in texts)

    def description(self, objects: Sequence[int], events: Sequence[Event]) -> str:
        """Objects in one line, and events in one line each."""
        return description(self._scene, objects, events)

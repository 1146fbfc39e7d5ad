"""Events, and which of them count: the rules for entering, leaving and colliding that reproduce CLEVRER's answers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta

from nsdr.validation import BoolArray, Checked, Count, expect, one_of

PARTICIPANTS = {"in": 1, "out": 1, "collision": 2}
"""Number of objects of each kind of event."""
EXPECTED_OBJECTS = {
    1: "a tuple of one object id, such as (0,)",
    2: "two different ids in ascending order, such as (0, 2)",
}
"""`Event.objects` by their number, in words."""
VERBS = {"in": "{} enters", "out": "{} exits", "collision": "{} and {} collide"}
"""What happens in each kind of event, with places for its objects."""
NO_FRAME = -1
"""`Event.frame` of an event that is only possible. Rollouts and scenes hold events at frames only."""
SAME_EVENT_FRAMES = 3
"""Events of one kind and one pair that are at most so many frames apart are taken as the same event."""


@dataclass(frozen=True)
class Event(Checked):
    """Something that happens at one frame.

    Attributes:
        kind: "in" (enters the image), "out" (leaves it) or "collision".
        frame: frame index; at or beyond the video's length for predicted events, -1 for events that are only possible.
        objects: object ids: one for "in" and "out", two in ascending order for "collision".
    """

    kind: Annotated[str, one_of(PARTICIPANTS)]
    frame: Annotated[int, Meta(ge=NO_FRAME)]
    objects: tuple[Count, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        n = PARTICIPANTS[self.kind]
        fits = len(self.objects) == n and self.objects[0] < self.objects[-1] + (n == 1)
        expect(fits, f"Event.objects of {self.kind}", EXPECTED_OBJECTS[n], self.objects)


def event_sentence(event: Event, names: Sequence[str], details: str = "") -> str:
    """An event as a sentence, such as "red metal cube enters (frame 12)".

    Args:
        event: the event.
        names: names of the scene's objects.
        details: what follows the frame, such as ", 84 %".
    """
    what = event_phrase(event, names)
    return what if event.frame < 0 else f"{what} (frame {event.frame}{details})"


def event_phrase(event: Event, names: Sequence[str]) -> str:
    """An event without its frame, such as "red metal cube enters"; `names` are those of the scene's objects."""
    return VERBS[event.kind].format(*[names[i] for i in event.objects]) if event.objects else event.kind


def in_order(events: Iterable[Event]) -> tuple[Event, ...]:
    """Events sorted by frame; at the same frame, entrances and exits come before collisions."""
    return tuple(sorted(events, key=lambda e: (e.frame, e.kind == "collision")))


def enter_exit_events(visible: BoolArray) -> list[Event]:
    """Entrances and exits, in order of object and frame.

    An object enters at a visible frame after an invisible one, and exits at an invisible frame after a visible one.

    Args:
        visible: (n_objects, n_frames) bool.
    """
    events = []
    change = np.diff(visible.astype(np.int8), axis=1)
    for i, frame in np.argwhere(change != 0):
        events.append(Event("in" if change[i, frame] > 0 else "out", int(frame) + 1, (int(i),)))
    return events


def visible_by(events: Sequence[Event], n_objects: int, n_frames: int) -> BoolArray:
    """(n_objects, n_frames) bool, when each object is in the image if its entrances and exits are all there are.

    It is the inverse of `enter_exit_events` for objects that enter or exit at all.
    """
    visible = np.ones((n_objects, n_frames), bool)
    for i, of_one in enumerate(visible):
        changes = in_order(e for e in events if e.kind != "collision" and e.objects == (i,))
        if changes:
            of_one[: changes[0].frame] = changes[0].kind == "out"
        for event in changes:
            of_one[event.frame :] = event.kind == "in"
    return visible


def collisions_in_view(collisions: Iterable[Event], visible: BoolArray) -> list[Event]:
    """Observed collisions as counted by the ground truth.

    A collision in which neither object is visible is dropped. If only one is visible, the collision is counted at the first
    later frame in which both are, and dropped if there is none.

    Args:
        collisions: events at their physical frames.
        visible: (n_objects, n_frames) bool.
    """
    kept = []
    for event in collisions:
        both = visible[event.objects[0]] & visible[event.objects[1]]
        either = visible[event.objects[0]] | visible[event.objects[1]]
        if event.frame >= len(both) or not either[event.frame]:
            continue
        if both[event.frame]:
            kept.append(event)
            continue
        frames = np.flatnonzero(both[event.frame :])
        if len(frames):
            kept.append(Event("collision", event.frame + int(frames[0]), event.objects))
    return kept

"""The result of interventions: the changed motion beside the original one."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from nsdr.types.answers import percent
from nsdr.types.arrays import ArrayHolder
from nsdr.types.events import SAME_EVENT_FRAMES, Event, event_sentence
from nsdr.types.interventions import Intervention, intervention_text
from nsdr.types.scenes import Rollout, Scene
from nsdr.types.tracks import SceneObject, check_objects
from nsdr.validation import Checked, Count, PositiveCount, Share, expect


@dataclass(frozen=True)
class EventChange(Checked):
    """How an event differs in the changed world. `Simulation.describe` puts it in words.

    Attributes:
        kind: "no longer", "new" or "other frame".
        event: the event, of the changed world except for "no longer".
        before: its frame in the original; None for "new".
        probability: that it happens in the changed world, in 0-1; None where it is not known.
    """

    kind: str
    event: Event
    before: int | None
    probability: Share | None


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(ArrayHolder):
    """A video and what follows it, as it is and with interventions. Ids are those of `objects` everywhere but in `scene`.

    Printed, it is what was changed, and a line for each event that differs. A pair's first collision after the intervention is
    reported, not its repetitions.

    Attributes:
        objects: identities: the video's, then the added ones.
        n_frames: number of frames of the video; rollouts continue beyond it.
        from_frame: frame of the interventions.
        interventions: what was changed; objects by their full names.
        original: the rollout without the interventions; added objects are absent.
        changed: the rollout with them; removed objects are absent from `from_frame` on.
        original_events, events: entrances, exits and collisions of both rollouts in order of time, also those after the video.
            That an object is removed, added or moved is no entrance or exit.
        scene: the changed world, for questions. It holds no objects that are removed from frame 0; ids count what it holds. It
            knows no counterfactual events: simulate again with a further `Remove`.
    """

    objects: tuple[SceneObject, ...]
    n_frames: PositiveCount
    from_frame: Count
    interventions: tuple[Intervention, ...]
    original: Rollout
    changed: Rollout
    original_events: tuple[Event, ...]
    events: tuple[Event, ...]
    scene: Scene

    def __post_init__(self) -> None:
        super().__post_init__()
        check_objects("Simulation", self.objects)
        for change in self.interventions:
            expect(isinstance(change, Intervention), "Simulation.interventions", "interventions", change)
        shape = len(self.objects), self.changed.visible.shape[1]
        for rollout in (self.original, self.changed):
            found = rollout.visible.shape
            expect(found == shape, "Simulation", f"rollouts of {shape[0]} objects and {shape[1]} frames", found)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about the simulation, one sentence each: the notes of `scene`."""
        return self.scene.notes

    @property
    def probabilities(self) -> Mapping[Event, float] | None:
        """How probable each event of the changed world is, also of those that count as ruled out but are possible.

        Events that happen for sure have 1. None where the backend knows no probabilities.
        """
        uncertain = self.changed.uncertain
        if uncertain is None:
            return None
        sure = dict.fromkeys(self.events, 1.0)
        return sure | {u.event: u.probability for u in uncertain}

    def differences(self) -> tuple[EventChange, ...]:
        """Events that happen in one of the worlds only, or in both more than 3 frames apart, in order of time.

        Several events of the same kind and objects are compared in order of time.
        """
        changes = [
            EventChange(kind, event, before, self._probability(event))
            for kind, event, before in compared(self.original_events, self.events)
            if kind != "still"
        ]
        return tuple(changes)

    def describe(self, change: EventChange) -> str:
        """A difference in words, such as "no longer: the red cube and the blue sphere collide (frame 48, <1 %)"."""
        names = [f"the {o.name}" for o in self.objects]
        before = change.before if change.kind == "other frame" else None
        return f"{change.kind}: {event_sentence(change.event, names, event_details(before, change.probability))}"

    @property
    def heading(self) -> str:
        """What was changed, such as "from frame 20: without the red metal cube"."""
        return f"from frame {self.from_frame}: {'; '.join(map(intervention_text, self.interventions))}"

    def __str__(self) -> str:
        lines = [self.describe(change) for change in self.differences()] or ["nothing else changes"]
        return "\n".join([self.heading, *(f"  {line}" for line in lines)])

    def _probability(self, event: Event) -> float | None:
        """That an event like this happens in the changed world."""
        known = self.probabilities
        if known is None:
            return None
        like = {e: p for e, p in known.items() if (e.kind, e.objects) == (event.kind, event.objects)}
        later = [p for e, p in like.items() if e.frame >= self.from_frame]
        return known.get(event, later[-1] if later else 0.0)


def event_details(before: int | None, probability: float | None) -> str:
    """What follows the frame of an event, such as " instead of 92, 97 %"; nothing for None."""
    frame = "" if before is None else f" instead of {before}"
    return frame + ("" if probability is None else f", {percent(probability)}")


def compared(original: Iterable[Event], changed: Iterable[Event]) -> list[tuple[str, Event, int | None]]:
    """Events of two worlds, in order of their frames, with how they differ.

    Several events of the same kind and objects are compared in order of time.

    Args:
        original: events of one world, in order of time.
        changed: events of the other.

    Returns:
        (kind, event, frame in the original world or None): "still" and "other frame" (more than 3 frames apart), "new", each
        with the event of the changed world, and "no longer" with that of the original.
    """
    before, after = _by_kind(original), _by_kind(changed)
    found: list[tuple[str, Event, int | None]] = []
    for key in before.keys() | after.keys():
        old, new = before.get(key, []), after.get(key, [])
        for a, b in zip(old, new, strict=False):
            found.append(("still" if abs(a.frame - b.frame) <= SAME_EVENT_FRAMES else "other frame", b, a.frame))
        found += [("no longer", e, e.frame) for e in old[len(new) :]]
        found += [("new", e, None) for e in new[len(old) :]]
    return sorted(found, key=lambda row: (row[1].frame, row[1].kind, row[1].objects))


def _by_kind(events: Iterable[Event]) -> dict[tuple[str, tuple[int, ...]], list[Event]]:
    found: dict[tuple[str, tuple[int, ...]], list[Event]] = {}
    for event in events:
        found.setdefault((event.kind, event.objects), []).append(event)
    return found

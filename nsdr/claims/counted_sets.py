"""What a step of an executed program collects, with the frames that its events turned out to have."""

from collections.abc import Sequence
from dataclasses import dataclass

from nsdr.symbolic.modules import Kind
from nsdr.symbolic.phrases import MOTION_FILTERS, OBJECT_FILTERS, attribute_words
from nsdr.symbolic.program import Step
from nsdr.types import TraceStep

__all__ = ["CountedSet", "counted_set"]

EVENT_FILTERS = {"filter_in": "in", "filter_out": "out", "filter_collision": "collision"}


@dataclass(frozen=True)
class CountedSet:
    """A set of objects, or of events of one kind.

    Attributes:
        words: attribute words of the objects, or of those that enter or exit.
        motion: "moving" or "stationary" for objects in motion or at rest, else "".
        event: kind of the events; "" for objects.
        who: id of the one object that takes part in the collisions; None for any.
        pair: ids of the two objects of a collision; None for any.
        frame: when the objects move, or the boundary of `relation`; None for the whole video.
        relation: "before" or "after" the frame; "" for the whole video.
        later: whether the events are those after the video.
    """

    words: tuple[str, ...] = ()
    motion: str = ""
    event: str = ""
    who: int | None = None
    pair: tuple[int, int] | None = None
    frame: int | None = None
    relation: str = ""
    later: bool = False


def counted_set(steps: Sequence[Step], trace: Sequence[TraceStep], index: int) -> CountedSet | None:
    """What a step collects; None for a set that is more than one class of objects, motion, kind of events and boundary in time.

    Args:
        steps: of a program.
        trace: its executed steps.
        index: of a step that gives objects or events.
    """
    return _objects(steps, trace, index) if trace[index].kind == Kind.OBJECTS else _events(steps, trace, index)


def _objects(steps: Sequence[Step], trace: Sequence[TraceStep], index: int) -> CountedSet | None:
    words = attribute_words(steps, index)
    motion, frame = "", None
    while steps[index].inputs:
        step = steps[index]
        if step.token in MOTION_FILTERS:
            if motion or trace[step.inputs[0]].kind != Kind.OBJECTS:
                return None
            motion, frame = MOTION_FILTERS[step.token], trace[step.inputs[1]].value
        elif step.token not in OBJECT_FILTERS or steps[step.inputs[1]].inputs:
            return None
        index = step.inputs[0]
    return CountedSet(words, motion, frame=frame) if steps[index].token == "objects" else None


def _events(steps: Sequence[Step], trace: Sequence[TraceStep], index: int) -> CountedSet | None:
    kinds: set[str] = set()
    classes: list[int] = []
    single: list[int] = []
    relation, frame = "", None
    while steps[index].inputs:
        step = steps[index]
        argument = step.inputs[-1]
        if step.token in EVENT_FILTERS:
            kinds.add(EVENT_FILTERS[step.token])
            if trace[argument].kind == Kind.OBJECT:
                single.append(trace[argument].value)
            elif steps[argument].token != "objects":
                classes.append(argument)
        elif step.token in ("filter_before", "filter_after") and not relation:
            relation, frame = step.token.removeprefix("filter_"), trace[argument].value.frame
        else:
            return None
        index = step.inputs[0]
    later = steps[index].token == "unseen_events"
    if len(kinds) != 1 or not (later or steps[index].token == "events") or (later and relation):
        return None
    (kind,) = kinds
    if kind == "collision":
        return _collisions(classes, single, relation, frame, later)
    if later or single or len(classes) > 1:
        return None
    members = _objects(steps, trace, classes[0]) if classes else CountedSet()
    if members is None or members.motion:
        return None
    return CountedSet(members.words, event=kind, frame=frame, relation=relation)


def _collisions(
    classes: list[int], single: list[int], relation: str, frame: int | None, later: bool
) -> CountedSet | None:
    if classes or len(single) > 2 or len(set(single)) < len(single):
        return None
    if len(single) == 2:
        return CountedSet(
            event="collision", pair=(min(single), max(single)), frame=frame, relation=relation, later=later
        )
    who = single[0] if single else None
    return CountedSet(event="collision", who=who, frame=frame, relation=relation, later=later)

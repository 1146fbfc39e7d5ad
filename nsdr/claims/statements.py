"""Statements of sentences about a video, before they are compared with a scene."""

from dataclasses import dataclass

PAST_KINDS = {"in": "entrance", "out": "exit", "collision": "collision"}
"""The kind of the statement that an event of each kind happens in the video."""
HAPPENING = (*PAST_KINDS.values(), "future", "counterfactual")
"""Kinds of statements that an event happens, or how many happen after the video."""
PLACES = {"first": 1, "second": 2, "last": -1}
"""Places in a sequence of events, as in `Statement.number`."""


@dataclass(frozen=True)
class ObjectPhrase:
    """A noun phrase for an object or a class of objects.

    Attributes:
        text: as it is written.
        words: attribute words, in the vocabulary's spelling.
        definite: whether it stands for one particular object ("the cube") and not for any object ("a cube").
        known: whether its words say which object is meant. Those of "it" do not.
    """

    text: str
    words: tuple[str, ...]
    definite: bool = True
    known: bool = True


@dataclass(frozen=True)
class EventPhrase:
    """An event that a sentence names.

    Attributes:
        kind: "in", "out" or "collision", as in `nsdr.types.Event`.
        objects: one object, or two for a collision. None for a collision of any objects.
        frame: the stated frame; None if there is none.
    """

    kind: str
    objects: tuple[ObjectPhrase, ...]
    frame: int | None = None


@dataclass(frozen=True)
class Statement:
    """One checkable fact of a sentence.

    Attributes:
        kind: "attribute", "presence", "count", "entrance", "exit", "collision", "order", "motion", "future", "counterfactual"
            or "cause".
        negated: whether the sentence denies it.
        objects: for "attribute" and "motion", the subject; for "count", the class that is counted; for "order", the class that
            is ordered and the object at the place; for "cause", the object that is responsible for the event.
        events: the event; for "order" and "cause", two events in the order in which the sentence names them.
        words: the stated attribute words; for motion and its counts "moving", "stationary", "ever moving" or "never moving".
        attribute: "color", "material" or "shape" if the sentence names it, else "".
        number: the stated count; for "order", the place: 1, 2, or -1 for the last.
        frame: the stated frame of a motion or count, or the boundary of `relation`; None for the whole video.
        relation: "before" or "after" if the event or the counted events are on this side of `frame`, or the first event is on
            this side of the second.
        removed: the object without which the event happens.
    """

    kind: str
    negated: bool = False
    objects: tuple[ObjectPhrase, ...] = ()
    events: tuple[EventPhrase, ...] = ()
    words: tuple[str, ...] = ()
    attribute: str = ""
    number: int | None = None
    frame: int | None = None
    relation: str = ""
    removed: ObjectPhrase | None = None

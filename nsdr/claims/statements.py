"""What a sentence says about a video, before it is compared with a scene."""

from dataclasses import dataclass

PAST_KINDS = {"in": "entrance", "out": "exit", "collision": "collision"}
"""Kind of the claim that an event of each kind happens in the video."""

HAPPENING = (*PAST_KINDS.values(), "future", "counterfactual")
"""Kinds of claims that an event happens, or how many do after the video."""
PLACES = {"first": 1, "second": 2, "last": -1}
"""Places in a row of events, as in `Statement.number`."""


@dataclass(frozen=True)
class ObjectPhrase:
    """A noun phrase for an object or a class of objects.

    Attributes:
        text: as it is written.
        words: attribute words, in the vocabulary's spelling.
        definite: whether it stands for one particular object ("the cube"), not for any ("a cube").
        known: whether its words say which object is meant; "it" does not.
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
        objects: one, or two for a collision; none for a collision of any objects.
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
        objects: the subject of an attribute or motion; the class that is counted or ordered, then who fills the place; the
            object that is responsible for an event.
        events: the event; for "order" and "cause" the earlier named and the later named one.
        words: stated attribute words; for motion and its counts "moving", "stationary", "ever moving" or "never moving".
        attribute: "color", "material" or "shape" where the sentence names it, else "".
        number: stated count; for an order the place: 1, 2 or -1 for the last.
        frame: stated frame of a motion or count, or the boundary of `relation`; None for the whole video.
        relation: "before" or "after": how the event or the counted events lie to `frame`, or the first event to the second.
        removed: the object without which it happens.
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

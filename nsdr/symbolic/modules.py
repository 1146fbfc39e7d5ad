"""The signature table: every program module with its argument types, result type and meaning.

Parsing, static type check, dispatch, the question parser's vocabulary and the documentation all read this table.

At run time sets of objects and of events are integers used as bit sets (bit i = object or event i of the `World`), and a
single object or event is a set of one. Types are known before the program runs, so values need no tags.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import product
from typing import Any

from nsdr.errors import ExecutionError
from nsdr.symbolic.world import World
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["ARITY", "DISPATCH", "MODULES", "WORDS", "Kind", "Module"]


class Kind(StrEnum):
    """Types of values in a program."""

    OBJECTS = "objects"
    EVENTS = "events"
    OBJECT = "object"
    EVENT = "event"
    FRAME = "frame"
    NUMBER = "number"
    BOOLEAN = "boolean"
    COLOR = "color"
    MATERIAL = "material"
    SHAPE = "shape"
    ORDER = "order"
    DIRECTION = "direction"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Module:
    """A row of the signature table.

    Attributes:
        name: the program token.
        arguments: for each argument the types it may have, first argument first (deepest on the stack).
        result: type of the result; None: `object` for a set of objects, `event` for a set of events.
        run: `run(world, *arguments)`.
        meaning: one line for the reader.
        in_data_set: CLEVRER's own programs use it; the others are the research executor's.
    """

    name: str
    arguments: tuple[tuple[Kind, ...], ...]
    result: Kind | None
    run: Callable[..., Any]
    meaning: str
    in_data_set: bool = True


def _unique(world: World, values: int) -> int:
    values &= world.members
    if values.bit_count() != 1:
        raise ExecutionError(f"expected exactly one, found {values.bit_count()}")
    return values


def _order(world: World, events: int, order: str) -> int:
    events &= world.members
    if order == "last":
        rest = events.bit_length() and 1 << (events.bit_length() - 1)
    else:
        rest = events if order == "first" else events & (events - 1)
        rest &= -rest
    if not rest:
        raise ExecutionError(f"no {order} event among {events.bit_count()}")
    return rest


def _before(world: World, events: int, event: int) -> int:
    return events & world.before(world.frame_of(event))


def _after(world: World, events: int, event: int) -> int:
    return events & world.after(world.frame_of(event))


def _partner(world: World, event: int, one: int) -> int:
    pair = world.objects_of(event)
    other = pair & ~one
    if not pair & one or other.bit_count() != 1:
        raise ExecutionError(
            f"{world.event_text(event)} is no collision of {world.object_text(one)} with another object"
        )
    return other


def _belongs(world: World, one: int, events: int) -> bool:
    return bool(world.same_kind_and_objects(one) & events)


def _object_belongs(world: World, one: int, events: int) -> bool:
    return bool(world.participation(one) & events)


def _get_object(world: World, event: int) -> int:
    objects = world.objects_of(event)
    if objects.bit_count() != 1:
        raise ExecutionError(f"{world.event_text(event)} has {objects.bit_count()} objects; expected one")
    return objects


_OBJECTS, _EVENTS, _OBJECT, _EVENT = (Kind.OBJECTS,), (Kind.EVENTS,), (Kind.OBJECT,), (Kind.EVENT,)
_SETS = (Kind.OBJECTS, Kind.EVENTS)
_WHO = (Kind.OBJECTS, Kind.OBJECT)
_FRAME = (Kind.FRAME,)
_COLOR, _MATERIAL, _SHAPE, _ORDER = (Kind.COLOR,), (Kind.MATERIAL,), (Kind.SHAPE,), (Kind.ORDER,)

_TABLE = [
    Module("objects", (), Kind.OBJECTS, lambda w: w.all_objects, "all objects of the video"),
    Module("events", (), Kind.EVENTS, lambda w: w.observed, "all events seen in the video"),
    Module("all_events", (), Kind.EVENTS, lambda w: w.possible, "every event that could happen: each pair's collision, each object's entrance and exit"),
    Module("unseen_events", (), Kind.EVENTS, lambda w: w.need_unseen(), "events after the video's end"),
    Module("start", (), Kind.EVENT, lambda w: w.start, "the video's first frame, as an event"),
    Module("end", (), Kind.EVENT, lambda w: w.end, "the video's last frame, as an event"),
    Module("null", (), Kind.FRAME, lambda w: None, "no particular frame: the whole video"),
    Module("unique", (_SETS,), None, _unique, "the only member of a set; an error when there are more or none"),
    Module("count", (_SETS,), Kind.NUMBER, lambda w, values: (values & w.members).bit_count(), "number of members"),
    Module("exist", (_SETS,), Kind.BOOLEAN, lambda w, values: bool(values & w.members), "whether the set has a member"),
    Module("negate", ((Kind.BOOLEAN,),), Kind.BOOLEAN, lambda w, value: not value, "not"),
    Module("query_color", (_OBJECT,), Kind.COLOR, lambda w, one: w.object(one).color, "its colour"),
    Module("query_material", (_OBJECT,), Kind.MATERIAL, lambda w, one: w.object(one).material, "its material"),
    Module("query_shape", (_OBJECT,), Kind.SHAPE, lambda w, one: w.object(one).shape, "its shape"),
    Module("get_frame", (_EVENT,), Kind.FRAME, lambda w, event: w.frame_of(event), "the frame an event happens at"),
    Module("get_object", (_EVENT,), Kind.OBJECT, _get_object, "the object that enters or exits"),
    Module("query_direction", (_OBJECT, _FRAME), Kind.DIRECTION, lambda w, one, frame: w.motion.direction(one, frame), "left, right, up or down, the way it moves", False),
    Module("counterfact_events", (_OBJECT,), Kind.EVENTS, lambda w, one: w.need_counterfactual(one) & w.possible, "collisions that happen when an object is removed", False),
    Module("filter_color", (_OBJECTS, _COLOR), Kind.OBJECTS, lambda w, objects, word: objects & w.with_word[word], "objects of a colour"),
    Module("filter_material", (_OBJECTS, _MATERIAL), Kind.OBJECTS, lambda w, objects, word: objects & w.with_word[word], "objects of a material"),
    Module("filter_shape", (_OBJECTS, _SHAPE), Kind.OBJECTS, lambda w, objects, word: objects & w.with_word[word], "objects of a shape"),
    Module("filter_moving", (_OBJECTS, _FRAME), Kind.OBJECTS, lambda w, objects, frame: w.motion.moving(objects, frame), "objects visible and moving at a frame; with `null`, at any"),
    Module("filter_stationary", (_OBJECTS, _FRAME), Kind.OBJECTS, lambda w, objects, frame: w.motion.stationary(objects, frame), "objects visible and at rest at a frame; with `null`, at all"),
    Module("filter_in", (_EVENTS, _WHO), Kind.EVENTS, lambda w, events, who: events & w.entering & w.involving(who), "entrances of any of the objects"),
    Module("filter_out", (_EVENTS, _WHO), Kind.EVENTS, lambda w, events, who: events & w.exiting & w.involving(who), "exits of any of the objects"),
    Module("filter_collision", (_EVENTS, _WHO), Kind.EVENTS, lambda w, events, who: events & w.colliding & w.involving(who), "collisions of any of the objects"),
    Module("filter_order", (_EVENTS, _ORDER), Kind.EVENT, _order, "the first, second or last event in time"),
    Module("filter_before", (_EVENTS, _EVENT), Kind.EVENTS, _before, "events before an event"),
    Module("filter_after", (_EVENTS, _EVENT), Kind.EVENTS, _after, "events after an event"),
    Module("filter_ancestor", (_EVENTS, _EVENT), Kind.EVENTS, lambda w, events, event: w.ancestors(events, event), "events responsible for an event, by the causal graph"),
    Module("get_col_partner", (_EVENT, _OBJECT), Kind.OBJECT, _partner, "the other object of a collision"),
    Module("get_counterfact", (_EVENTS, _OBJECT), Kind.EVENTS, lambda w, events, one: events & w.need_counterfactual(one), "events that happen when an object is removed"),
    Module("belong_to", ((Kind.EVENT, Kind.OBJECT), _EVENTS), Kind.BOOLEAN, _belongs, "whether an event (by kind and objects), or an object as a participant, is among events"),
]  # fmt: skip

MODULES: dict[str, Module] = {module.name: module for module in _TABLE}
"""The signature table by token."""

WORDS: dict[str, Kind] = {
    **{word: Kind(name) for name, words in ATTRIBUTES.items() for word in words},
    **dict.fromkeys(("first", "second", "last"), Kind.ORDER),
}
"""Tokens that stand for themselves: attribute words and orders."""

ARITY: dict[str, int] = {module.name: len(module.arguments) for module in _TABLE}
"""Number of arguments of each module."""


def _dispatch() -> dict[tuple[str | Kind, ...], tuple[Module, Kind]]:
    """(token, kind of each argument) -> module and kind of its result."""
    table: dict[tuple[str | Kind, ...], tuple[Module, Kind]] = {}
    of_objects = replace(MODULES["belong_to"], run=_object_belongs)
    for module in _TABLE:
        for kinds in product(*module.arguments):
            single = Kind.OBJECT if kinds[:1] == (Kind.OBJECTS,) else Kind.EVENT
            chosen = of_objects if module.name == "belong_to" and kinds[0] == Kind.OBJECT else module
            table[(module.name, *kinds)] = (chosen, module.result or single)
    return table


DISPATCH = _dispatch()
"""The signature table, unrolled for type check and execution."""

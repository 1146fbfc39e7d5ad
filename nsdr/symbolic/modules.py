"""The signature table: every program module with its argument types, result type and meaning.

Parsing, type checking, dispatch, the question parser's vocabulary and the documentation all use this table.

At run time, sets of objects and of events are integers used as bit sets (bit i = object or event i of the `World`), and a
single object or event is a one-bit set. Types are checked before a program runs, so values carry no type.
"""

from dataclasses import replace
from itertools import product

from nsdr.errors import ExecutionError
from nsdr.symbolic.extensions import EXTENSION_MODULES, EXTENSION_WORDS
from nsdr.symbolic.signature import Kind, Module
from nsdr.symbolic.world import World
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["ALL_WORDS", "ARITY", "DISPATCH", "EXTENSIONS", "MODULES", "WORDS", "Kind", "Module"]


def _unique(world: World, values: int) -> int:
    values &= world.members
    if values.bit_count() != 1:
        raise ExecutionError(f"expected exactly one, found {values.bit_count()}")
    return values


def _order(world: World, events: int, order: str) -> int:
    events &= world.members
    if order == "last":
        chosen = events.bit_length() and 1 << (events.bit_length() - 1)
    else:
        remaining = events if order == "first" else events & (events - 1)
        chosen = remaining & -remaining
    if not chosen:
        raise ExecutionError(f"no {order} event among {events.bit_count()}")
    return chosen


def _before(world: World, events: int, event: int) -> int:
    return events & world.before(world.frame_of(event))


def _after(world: World, events: int, event: int) -> int:
    return events & world.after(world.frame_of(event))


def _partner(world: World, event: int, one: int) -> int:
    pair = world.objects_of(event)
    other = pair & ~one
    if not pair & one or other.bit_count() != 1:
        raise ExecutionError(
            f"{world.event_text(event)} is not a collision of {world.object_text(one)} with another object"
        )
    return other


def _belongs(world: World, one: int, events: int) -> bool:
    if events & world.collisions_only and not one & world.colliding:
        raise ExecutionError(
            f"whether {world.event_text(one)} is not known: only collisions are, with an object changed"
        )
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
    Module("events", (), Kind.EVENTS, lambda w: w.observed, "all observed events, in order of time"),
    Module("all_events", (), Kind.EVENTS, lambda w: w.possible, "every possible event: the collision of each pair, and the entrance and exit of each object"),
    Module("unseen_events", (), Kind.EVENTS, lambda w: w.need_unseen(), "events after the video"),
    Module("start", (), Kind.EVENT, lambda w: w.start, "the video's first frame, as an event"),
    Module("end", (), Kind.EVENT, lambda w: w.end, "the video's last frame, as an event"),
    Module("null", (), Kind.FRAME, lambda w: None, "no particular frame; stands for the whole video"),
    Module("unique", (_SETS,), None, _unique, "the only member of a set; an error if it has none or several"),
    Module("count", (_SETS,), Kind.NUMBER, lambda w, values: (values & w.members).bit_count(), "number of members"),
    Module("exist", (_SETS,), Kind.BOOLEAN, lambda w, values: bool(values & w.members), "whether the set has any members"),
    Module("negate", ((Kind.BOOLEAN,),), Kind.BOOLEAN, lambda w, value: not value, "logical not"),
    Module("query_color", (_OBJECT,), Kind.COLOR, lambda w, one: w.object(one).color, "colour of an object"),
    Module("query_material", (_OBJECT,), Kind.MATERIAL, lambda w, one: w.object(one).material, "material of an object"),
    Module("query_shape", (_OBJECT,), Kind.SHAPE, lambda w, one: w.object(one).shape, "shape of an object"),
    Module("get_frame", (_EVENT,), Kind.FRAME, lambda w, event: w.frame_of(event), "frame of an event"),
    Module("get_object", (_EVENT,), Kind.OBJECT, _get_object, "object of an entrance or exit"),
    Module("query_direction", (_OBJECT, _FRAME), Kind.DIRECTION, lambda w, one, frame: w.quantities.direction(one, frame), "direction in which an object moves: left, right, towards or away from the camera; in the official semantics left, right, up or down", False),
    Module("counterfact_events", (_OBJECT,), Kind.EVENTS, lambda w, one: w.need_counterfactual(one) & w.possible, "collisions that happen without an object", False),
    Module("filter_color", (_OBJECTS, _COLOR), Kind.OBJECTS, lambda w, objects, word: objects & w.with_word[word], "objects of a colour"),
    Module("filter_material", (_OBJECTS, _MATERIAL), Kind.OBJECTS, lambda w, objects, word: objects & w.with_word[word], "objects of a material"),
    Module("filter_shape", (_OBJECTS, _SHAPE), Kind.OBJECTS, lambda w, objects, word: objects & w.with_word[word], "objects of a shape"),
    Module("filter_moving", (_WHO, _FRAME), Kind.OBJECTS, lambda w, objects, frame: w.motion.moving(objects, frame), "objects that are visible and move at a frame; with `null`, at any frame"),
    Module("filter_stationary", (_WHO, _FRAME), Kind.OBJECTS, lambda w, objects, frame: w.motion.stationary(objects, frame), "objects that are visible and at rest at a frame; with `null`, that never move while visible"),
    Module("filter_in", (_EVENTS, _WHO), Kind.EVENTS, lambda w, events, who: events & w.entering & w.involving(who), "entrances of the objects"),
    Module("filter_out", (_EVENTS, _WHO), Kind.EVENTS, lambda w, events, who: events & w.exiting & w.involving(who), "exits of the objects"),
    Module("filter_collision", (_EVENTS, _WHO), Kind.EVENTS, lambda w, events, who: events & w.colliding & w.involving(who), "collisions in which any of the objects takes part"),
    Module("filter_order", (_EVENTS, _ORDER), Kind.EVENT, _order, "first, second or last event in time"),
    Module("filter_before", (_EVENTS, _EVENT), Kind.EVENTS, _before, "events before an event"),
    Module("filter_after", (_EVENTS, _EVENT), Kind.EVENTS, _after, "events after an event"),
    Module("filter_ancestor", (_EVENTS, _EVENT), Kind.EVENTS, lambda w, events, event: w.ancestors(events, event), "events responsible for an event: its ancestors in the causal graph"),
    Module("get_col_partner", (_EVENT, _OBJECT), Kind.OBJECT, _partner, "other object of a collision"),
    Module("get_counterfact", (_EVENTS, _OBJECT), Kind.EVENTS, lambda w, events, one: events & w.need_counterfactual(one), "those of the events that happen without an object"),
    Module("belong_to", ((Kind.EVENT, Kind.OBJECT), _EVENTS), Kind.BOOLEAN, _belongs, "whether an event (by kind and objects) is among the events, or an object takes part in one of them"),
    *EXTENSION_MODULES,
]  # fmt: skip

MODULES: dict[str, Module] = {module.name: module for module in _TABLE}
"""The signature table by token."""

WORDS: dict[str, Kind] = {
    **{word: Kind(name) for name, words in ATTRIBUTES.items() for word in words},
    **dict.fromkeys(("first", "second", "last"), Kind.ORDER),
}
"""Tokens that are their own value: attribute words and orders."""

ALL_WORDS: dict[str, Kind] = WORDS | EXTENSION_WORDS
"""`WORDS` and those of questions beyond CLEVRER."""

EXTENSIONS = frozenset(EXTENSION_WORDS) | {"query_direction"} | {module.name for module in EXTENSION_MODULES}
"""Tokens that programs of CLEVRER's questions do not have, with a meaning in the paper's semantics."""

ARITY: dict[str, int] = {module.name: len(module.arguments) for module in _TABLE}
"""Number of arguments of each module."""


def _dispatch() -> dict[tuple[str | Kind, ...], tuple[Module, Kind]]:
    """(token, type of each argument) -> module and type of its result."""
    table: dict[tuple[str | Kind, ...], tuple[Module, Kind]] = {}
    of_objects = replace(MODULES["belong_to"], run=_object_belongs)
    for module in _TABLE:
        for kinds in product(*module.arguments):
            single = Kind.OBJECT if kinds[:1] == (Kind.OBJECTS,) else Kind.EVENT
            chosen = of_objects if module.name == "belong_to" and kinds[0] == Kind.OBJECT else module
            table[(module.name, *kinds)] = (chosen, module.result or single)
    return table


DISPATCH = _dispatch()
"""The signature table expanded by argument types, for type checking and execution."""

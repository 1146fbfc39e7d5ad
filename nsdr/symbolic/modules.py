"""The signature table: every program module with its argument types, result type and meaning.

Parsing, type checking, dispatch, the question parser's vocabulary and the documentation all use this table. Values of programs are
plain (`nsdr.symbolic.facts`). Types are checked before a program runs, so values carry no type.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from itertools import product
from typing import Any

from nsdr.errors import ExecutionError
from nsdr.symbolic.facts import Causes, Collisions, Events, Objects, SceneFacts
from nsdr.symbolic.quantities import CHANGES
from nsdr.types import Event
from nsdr.world.vocabulary import CLEVRER, Vocabulary


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
    SPEED = "speed"
    NAME = "name"
    CHANGE = "change"
    DESCRIPTION = "description"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Module:
    """A row of the signature table.

    Attributes:
        name: the program token.
        arguments: accepted types of each argument, first argument (deepest on the stack) first.
        result: type of the result; None for `unique`: `object` of a set of objects, `event` of a set of events.
        run: function called as `run(facts, *arguments)`.
        meaning: one line of documentation.
        in_data_set: whether CLEVRER's own programs use it; if not, the released executor has it, or it is an extension.
        extension: whether it is for questions beyond CLEVRER.
    """

    name: str
    arguments: tuple[tuple[Kind, ...], ...]
    result: Kind | None
    run: Callable[..., Any]
    meaning: str
    in_data_set: bool = True
    extension: bool = False


ORDERS = {"first": 0, "second": 1, "last": -1}
"""Index of an event in a set, by order word."""


def _unique(facts: SceneFacts, values: Objects | Events) -> int | Event:
    if len(values) != 1:
        raise ExecutionError(f"expected exactly one, found {len(values)}")
    return values[0]


def _with(attribute: str) -> Callable[[SceneFacts, Objects, str], Objects]:
    return lambda f, objects, word: tuple([i for i in objects if getattr(f.object(i), attribute) == word])


def _in_motion(wanted: bool) -> Callable[[SceneFacts, Objects | int, int | None], Objects]:
    return lambda f, who, frame: f.in_motion(as_set(who), frame, wanted)


def as_set(who: Objects | int) -> Objects:
    """A set of objects, or one of them as a set."""
    return who if isinstance(who, tuple) else (who,)


ONLY_COLLISIONS = "is not known in this scene: after the video, and with an object removed, only collisions are"


def _filtered(events: Events, fits: Callable[[Event], bool]) -> Events:
    """The events that fit. They are `Collisions` if the given events are."""
    found = [e for e in events if fits(e)]
    return Collisions(found) if isinstance(events, Collisions) else tuple(found)


def _of_kind(kind: str) -> Callable[[SceneFacts, Events, Objects | int], Events]:
    def run(facts: SceneFacts, events: Events, who: Objects | int) -> Events:
        objects = set(as_set(who))
        if isinstance(events, Collisions) and kind != "collision":
            raise ExecutionError(f"which objects {'enter' if kind == 'in' else 'exit'} {ONLY_COLLISIONS}")
        return _filtered(events, lambda e: e.kind == kind and not objects.isdisjoint(e.objects))

    return run


def _order(facts: SceneFacts, events: Events, order: str) -> Event:
    index = ORDERS[order]
    if len(events) <= max(index, 0):
        raise ExecutionError(f"no {order} event among {len(events)}")
    return events[index]


def _before(facts: SceneFacts, events: Events, event: Event) -> Events:
    frame = facts.frame_of(event)
    return _filtered(events, lambda e: 0 <= e.frame < frame)


def _after(facts: SceneFacts, events: Events, event: Event) -> Events:
    frame = facts.frame_of(event)
    return _filtered(events, lambda e: e.frame > frame)


def _ancestors(facts: SceneFacts, events: Events, event: Event) -> Causes:
    causes = facts.causes(event)
    return Causes.of(event, [e for e in events if e in causes])


def _partner(facts: SceneFacts, event: Event, one: int) -> int:
    if event.kind != "collision" or one not in event.objects:
        raise ExecutionError(
            f"{facts.event_text([event])} is not a collision of {facts.object_text([one])} with another object"
        )
    return _other(event.objects, one)


def _get_object(facts: SceneFacts, event: Event) -> int:
    if len(event.objects) != 1:
        raise ExecutionError(f"{facts.event_text([event])} has {len(event.objects)} objects; expected one")
    return event.objects[0]


def _like_any(events: Events, others: Events) -> Events:
    """Those of the events that are of the same kind and objects as one of the others, at any frame.

    They are `Collisions` if the others are.
    """
    found = {(e.kind, e.objects) for e in others}
    like = [e for e in events if (e.kind, e.objects) in found]
    return Collisions(like) if isinstance(others, Collisions) else tuple(like)


def _changed(facts: SceneFacts, events: Events, one: int, change: str) -> Events:
    return _like_any(events, facts.quantities.events_with(one, change))


def _without(facts: SceneFacts, events: Events, one: int) -> Events:
    return _like_any(events, facts.events_without(one))


def _belongs(facts: SceneFacts, one: Event | int, events: Events) -> bool:
    if isinstance(one, Event):
        if isinstance(events, Collisions) and one.kind != "collision":
            raise ExecutionError(f"whether the {facts.event_text([one])} {ONLY_COLLISIONS}")
        return bool(_like_any((one,), events))
    targets = [events.target] if isinstance(events, Causes) else []
    return any(one in e.objects for e in (*events, *targets))


def _other(pair: tuple[int, ...], one: int) -> int:
    """The other one of two objects."""
    return pair[pair[0] == one]


_OBJECTS, _EVENTS, _OBJECT, _EVENT = (Kind.OBJECTS,), (Kind.EVENTS,), (Kind.OBJECT,), (Kind.EVENT,)
_SETS = (Kind.OBJECTS, Kind.EVENTS)
_WHO = (Kind.OBJECTS, Kind.OBJECT)
_FRAME = (Kind.FRAME,)
_COLOR, _MATERIAL, _SHAPE, _ORDER = (Kind.COLOR,), (Kind.MATERIAL,), (Kind.SHAPE,), (Kind.ORDER,)
_BEYOND = {"in_data_set": False, "extension": True}

_TABLE = [
    Module("objects", (), Kind.OBJECTS, lambda f: f.all_objects, "all objects of the video"),
    Module("events", (), Kind.EVENTS, lambda f: f.events, "all observed events, in order of time"),
    Module("all_events", (), Kind.EVENTS, lambda f: f.possible, "every possible event: the collision of each pair, and the entrance and exit of each object"),
    Module("unseen_events", (), Kind.EVENTS, lambda f: f.unseen_events, "events after the video"),
    Module("start", (), Kind.EVENT, lambda f: f.start, "the video's first frame, as an event"),
    Module("end", (), Kind.EVENT, lambda f: f.end, "the video's last frame, as an event"),
    Module("null", (), Kind.FRAME, lambda f: None, "no particular frame; stands for the whole video"),
    Module("unique", (_SETS,), None, _unique, "the only member of a set; an error if it has none or several"),
    Module("count", (_SETS,), Kind.NUMBER, lambda f, values: len(values), "number of members"),
    Module("exist", (_SETS,), Kind.BOOLEAN, lambda f, values: bool(values), "whether the set has any members"),
    Module("negate", ((Kind.BOOLEAN,),), Kind.BOOLEAN, lambda f, value: not value, "logical not"),
    Module("query_color", (_OBJECT,), Kind.COLOR, lambda f, one: f.object(one).color, "colour of an object"),
    Module("query_material", (_OBJECT,), Kind.MATERIAL, lambda f, one: f.object(one).material, "material of an object"),
    Module("query_shape", (_OBJECT,), Kind.SHAPE, lambda f, one: f.object(one).shape, "shape of an object"),
    Module("get_frame", (_EVENT,), Kind.FRAME, lambda f, event: f.frame_of(event), "frame of an event"),
    Module("get_object", (_EVENT,), Kind.OBJECT, _get_object, "object of an entrance or exit"),
    Module("query_direction", (_OBJECT, _FRAME), Kind.DIRECTION, lambda f, one, frame: f.quantities.direction(one, frame), "direction in which an object moves: left, right, towards or away from the camera; in the released executor left, right, up or down", False),
    Module("counterfact_events", (_OBJECT,), Kind.EVENTS, lambda f, one: f.events_without(one), "events without an object, of the video and after it", False),
    Module("filter_color", (_OBJECTS, _COLOR), Kind.OBJECTS, _with("color"), "objects of a colour"),
    Module("filter_material", (_OBJECTS, _MATERIAL), Kind.OBJECTS, _with("material"), "objects of a material"),
    Module("filter_shape", (_OBJECTS, _SHAPE), Kind.OBJECTS, _with("shape"), "objects of a shape"),
    Module("filter_moving", (_WHO, _FRAME), Kind.OBJECTS, _in_motion(True), "objects that are visible and move at a frame; with `null`, at any frame"),
    Module("filter_stationary", (_WHO, _FRAME), Kind.OBJECTS, _in_motion(False), "objects that are visible and at rest at a frame; with `null`, that never move while visible"),
    Module("filter_in", (_EVENTS, _WHO), Kind.EVENTS, _of_kind("in"), "entrances of the objects"),
    Module("filter_out", (_EVENTS, _WHO), Kind.EVENTS, _of_kind("out"), "exits of the objects"),
    Module("filter_collision", (_EVENTS, _WHO), Kind.EVENTS, _of_kind("collision"), "collisions in which any of the objects takes part"),
    Module("filter_order", (_EVENTS, _ORDER), Kind.EVENT, _order, "first, second or last event in time"),
    Module("filter_before", (_EVENTS, _EVENT), Kind.EVENTS, _before, "events before an event"),
    Module("filter_after", (_EVENTS, _EVENT), Kind.EVENTS, _after, "events after an event"),
    Module("filter_ancestor", (_EVENTS, _EVENT), Kind.EVENTS, _ancestors, "events responsible for an event: its ancestors in the causal graph"),
    Module("get_col_partner", (_EVENT, _OBJECT), Kind.OBJECT, _partner, "other object of a collision"),
    Module("get_counterfact", (_EVENTS, _OBJECT), Kind.EVENTS, _without, "those of the events that happen without an object"),
    Module("belong_to", ((Kind.EVENT, Kind.OBJECT), _EVENTS), Kind.BOOLEAN, _belongs, "whether an event (by kind and objects) is among the events, or an object takes part in one of them"),
    Module("describe", (_OBJECTS, _EVENTS), Kind.DESCRIPTION, lambda f, objects, events: f.description(objects, events), "objects and events in words", **_BEYOND),
    Module("query_speed", (_OBJECT, _FRAME), Kind.SPEED, lambda f, one, frame: f.quantities.speed(one, frame), "speed of an object at a frame (world units per second)", **_BEYOND),
    Module("query_image_direction", (_OBJECT,), Kind.DIRECTION, lambda f, one: f.quantities.image_direction(one), "where an object moves in the image over the whole video, such as \"up and to the left\"; or \"stationary\"", **_BEYOND),
    Module("query_name", (_OBJECT,), Kind.NAME, lambda f, one: f.object(one).name, "color, material and shape of an object", **_BEYOND),
    Module("is_faster", (_OBJECT, _OBJECT, _FRAME), Kind.BOOLEAN, lambda f, a, b, frame: f.quantities.faster(a, b, frame) == a, "whether the first object is faster than the second at a frame", **_BEYOND),
    Module("get_faster", (_OBJECT, _OBJECT, _FRAME), Kind.OBJECT, lambda f, a, b, frame: f.quantities.faster(a, b, frame), "the faster of two objects at a frame", **_BEYOND),
    Module("get_slower", (_OBJECT, _OBJECT, _FRAME), Kind.OBJECT, lambda f, a, b, frame: _other((a, b), f.quantities.faster(a, b, frame)), "the slower of two objects at a frame", **_BEYOND),
    Module("filter_fastest", (_OBJECTS, _FRAME), Kind.OBJECTS, lambda f, objects, frame: f.quantities.extreme_speed(objects, frame, max), "the fastest of the objects that are visible at a frame; with `null`, by their highest speed while visible", **_BEYOND),
    Module("filter_slowest", (_OBJECTS, _FRAME), Kind.OBJECTS, lambda f, objects, frame: f.quantities.extreme_speed(objects, frame, min), "the slowest of these", **_BEYOND),
    Module("is_heavier", (_OBJECT, _OBJECT), Kind.BOOLEAN, lambda f, a, b: f.quantities.heavier(a, b) == a, "whether the first object is heavier than the second", **_BEYOND),
    Module("get_heavier", (_OBJECT, _OBJECT), Kind.OBJECT, lambda f, a, b: f.quantities.heavier(a, b), "the heavier of two objects", **_BEYOND),
    Module("get_lighter", (_OBJECT, _OBJECT), Kind.OBJECT, lambda f, a, b: _other((a, b), f.quantities.heavier(a, b)), "the lighter of two objects", **_BEYOND),
    Module("filter_heaviest", (_OBJECTS,), Kind.OBJECTS, lambda f, objects: f.quantities.extreme_mass(objects, max), "the heaviest of the objects", **_BEYOND),
    Module("filter_lightest", (_OBJECTS,), Kind.OBJECTS, lambda f, objects: f.quantities.extreme_mass(objects, min), "the lightest of the objects", **_BEYOND),
    Module("get_changed", (_EVENTS, _OBJECT, (Kind.CHANGE,)), Kind.EVENTS, _changed, "those of the events that happen with an object changed", **_BEYOND),
]  # fmt: skip

MODULES: dict[str, Module] = {module.name: module for module in _TABLE}
"""The signature table by token."""


@cache
def program_words(vocabulary: Vocabulary) -> dict[str, Kind]:
    """Tokens that are their own value: attribute words and orders."""
    return {word: Kind(name) for word, name in vocabulary.attributes.items()} | dict.fromkeys(ORDERS, Kind.ORDER)


WORDS = program_words(CLEVRER)
"""Those of CLEVRER's programs."""

EXTENSION_WORDS: dict[str, Kind] = dict.fromkeys(CHANGES, Kind.CHANGE)
"""Tokens that are their own value, for questions beyond CLEVRER: changes of an object."""

ALL_WORDS: dict[str, Kind] = WORDS | EXTENSION_WORDS

EXTENSIONS = frozenset(EXTENSION_WORDS) | {"query_direction"} | {m.name for m in _TABLE if m.extension}
"""Tokens that `nsdr.Executor` runs and programs of CLEVRER's questions do not have."""

ARITY: dict[str, int] = {module.name: len(module.arguments) for module in _TABLE}
"""Number of arguments of each module."""


def _result(module: Module, kinds: tuple[Kind, ...]) -> Kind:
    return module.result or (Kind.OBJECT if kinds == (Kind.OBJECTS,) else Kind.EVENT)


DISPATCH: dict[tuple[str | Kind, ...], tuple[Module, Kind]] = {
    (module.name, *kinds): (module, _result(module, kinds)) for module in _TABLE for kinds in product(*module.arguments)
}
"""(token, type of each argument) -> module and type of its result."""

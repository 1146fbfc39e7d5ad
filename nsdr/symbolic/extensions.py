"""Modules and words for questions beyond CLEVRER: speeds, directions, masses, and objects that are changed.

They are rows of the signature table that CLEVRER's programs, the trained question parser and its vocabulary do not have.
"""

from nsdr.symbolic.quantities import CHANGES
from nsdr.symbolic.signature import Kind, Module
from nsdr.symbolic.world import World

__all__ = ["EXTENSION_MODULES", "EXTENSION_WORDS"]

EXTENSION_WORDS: dict[str, Kind] = dict.fromkeys(CHANGES, Kind.CHANGE)
"""Words of the extension, which are their own value: changes of an object."""


def _named(world: World, one: int) -> str:
    return world.object(one).name


def _faster(world: World, one: int, other: int, frame: int | None) -> bool:
    return world.quantities.is_faster(one, other, frame)


def _heavier(world: World, one: int, other: int) -> bool:
    return world.quantities.is_heavier(one, other)


def _changed(world: World, events: int, one: int, change: str) -> int:
    return events & world.like_any(world.quantities.collisions_with(one, change)) | world.collisions_only


_OBJECTS, _EVENTS, _OBJECT, _FRAME = (Kind.OBJECTS,), (Kind.EVENTS,), (Kind.OBJECT,), (Kind.FRAME,)


def _row(name: str, arguments: tuple[tuple[Kind, ...], ...], result: Kind, run: object, meaning: str) -> Module:
    assert callable(run)
    return Module(name, arguments, result, run, meaning, in_data_set=False, extension=True)


EXTENSION_MODULES = (
    _row("query_speed", (_OBJECT, _FRAME), Kind.SPEED, lambda w, one, frame: w.quantities.speed(one, frame), "speed of an object at a frame (world units per second)"),
    _row("query_name", (_OBJECT,), Kind.NAME, _named, "color, material and shape of an object"),
    _row("is_faster", (_OBJECT, _OBJECT, _FRAME), Kind.BOOLEAN, _faster, "whether the first object is faster than the second at a frame"),
    _row("get_faster", (_OBJECT, _OBJECT, _FRAME), Kind.OBJECT, lambda w, a, b, frame: a if _faster(w, a, b, frame) else b, "the faster of two objects at a frame"),
    _row("get_slower", (_OBJECT, _OBJECT, _FRAME), Kind.OBJECT, lambda w, a, b, frame: b if _faster(w, a, b, frame) else a, "the slower of two objects at a frame"),
    _row("filter_fastest", (_OBJECTS, _FRAME), Kind.OBJECTS, lambda w, objects, frame: w.quantities.extreme_speed(objects, frame, "fastest"), "the fastest of the objects that are visible at a frame; with `null`, by their highest speed while visible"),
    _row("filter_slowest", (_OBJECTS, _FRAME), Kind.OBJECTS, lambda w, objects, frame: w.quantities.extreme_speed(objects, frame, "slowest"), "the slowest of these"),
    _row("is_heavier", (_OBJECT, _OBJECT), Kind.BOOLEAN, _heavier, "whether the first object is heavier than the second"),
    _row("get_heavier", (_OBJECT, _OBJECT), Kind.OBJECT, lambda w, a, b: a if _heavier(w, a, b) else b, "the heavier of two objects"),
    _row("get_lighter", (_OBJECT, _OBJECT), Kind.OBJECT, lambda w, a, b: b if _heavier(w, a, b) else a, "the lighter of two objects"),
    _row("filter_heaviest", (_OBJECTS,), Kind.OBJECTS, lambda w, objects: w.quantities.extreme_mass(objects, "heaviest"), "the heaviest of the objects"),
    _row("filter_lightest", (_OBJECTS,), Kind.OBJECTS, lambda w, objects: w.quantities.extreme_mass(objects, "lightest"), "the lightest of the objects"),
    _row("get_changed", (_EVENTS, _OBJECT, (Kind.CHANGE,)), Kind.EVENTS, _changed, "those of the events that happen with an object changed"),
)  # fmt: skip
"""Rows of the signature table."""

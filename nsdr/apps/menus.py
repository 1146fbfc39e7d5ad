"""Questions and interventions built from menus and sliders."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product

from nsdr.errors import DataError
from nsdr.types import Add, Event, Freeze, Move, Remove, Scene, SetMass, SetVelocity
from nsdr.types.interventions import MAX_POSITION_WORLD, MAX_SPEED_WORLD_PER_S, Intervention
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = [
    "CHANGES",
    "KINDS",
    "MAX_SLIDERS",
    "Built",
    "Change",
    "Slider",
    "build",
    "changed_objects",
    "entry",
    "examples",
    "intervention",
    "objects_menu",
    "time_menu",
    "verb_menu",
]

COUNT, EXIST, CAUSE, NEXT, WITHOUT = (
    "How many …",
    "Are there any …",
    "What caused …",
    "What happens next",
    "What if … were gone",
)
QUERIES = {f"Which {name} has …": name for name in ATTRIBUTES}
KINDS = (COUNT, EXIST, *QUERIES, CAUSE, NEXT, WITHOUT)
"""What the first menu offers."""
MOTIONS = {"are moving": "moving", "are stationary": "stationary"}
COLLIDE = "collide"
VERBS = ("enter the scene", "exit the scene", COLLIDE, *MOTIONS)
PARTNERS = {f"the {order} object to collide with it": order for order in ("first", "second", "last")}
ANYTHING, ANY_TIME = "objects", "in the whole video"
MAX_PAIRS = 6
"""Pairs of objects among the choices of a question about collisions."""


@dataclass(frozen=True)
class Built:
    """A question, and its choices; none for a descriptive question."""

    question: str
    choices: tuple[str, ...] = ()


def objects_menu(kind: str, scene: Scene) -> list[str]:
    """What a kind of question can be about: classes of objects, an object, or an event that has causes."""
    names = [o.name for o in scene.objects]
    if kind in (COUNT, EXIST):
        used = {word for name in names for word in name.split()}
        words = [word for values in ATTRIBUTES.values() for word in values if word in used]
        return [ANYTHING, *(f"{word}s" if word in ATTRIBUTES["shape"] else f"{word} objects" for word in words)]
    if kind == CAUSE:
        return [_event(e, scene) for e in _explained(scene)]
    return [] if kind == NEXT else names


def verb_menu(kind: str) -> list[str]:
    """What the objects do."""
    return [*VERBS] if kind in (COUNT, EXIST) else [*PARTNERS] if kind in QUERIES else []


def time_menu(kind: str, verb: str, scene: Scene) -> list[str]:
    """When they do it."""
    if kind not in (COUNT, EXIST):
        return []
    found = [ANY_TIME, *(["when the video begins", "when the video ends"] if verb in MOTIONS else [])]
    for event in scene.events:
        if event.kind != "collision":
            happens = f"the {scene.objects[event.objects[0]].name} {'enters' if event.kind == 'in' else 'exits'}"
            found += [f"{side} {happens}" for side in (("when",) if verb in MOTIONS else ("before", "after"))]
    return found


def build(kind: str, about: str, verb: str, time: str, scene: Scene) -> Built:
    """The question of the chosen entries of the four menus; entries that do not fit the others count as their first one.

    Raises:
        DataError: the scene has no object or event that this kind of question is about.
    """
    abouts = objects_menu(kind, scene)
    if not abouts and kind != NEXT:
        raise DataError("there is nothing in this clip to ask that about; choose another question")
    about = entry(about, abouts)
    verb = entry(verb, verb_menu(kind))
    time = entry(time, time_menu(kind, verb, scene))
    if kind == NEXT:
        return Built("What will happen next?", _pairs(scene))
    if kind == WITHOUT:
        return Built(f"What will happen without the {about}?", _pairs(scene, about))
    if kind == CAUSE:
        target = next(e for e in _explained(scene) if _event(e, scene) == about)
        presences = [f"The presence of the {o.name}" for o in scene.objects if o.id not in target.objects]
        earlier = [_event(e, scene) for e in _explained(scene) if e.kind == "collision" and e != target]
        question = f"Which of the following is responsible for t{about.removeprefix('T')}?"
        return Built(question, (*presences, *earlier))
    if kind in QUERIES:
        return Built(f"What is the {QUERIES[kind]} of the {PARTNERS[verb]} object to collide with the {about}?")
    when = "" if time == ANY_TIME else f" {time}" if time.startswith("when the video") else f" {time} the scene"
    if verb == COLLIDE:
        return Built(f"{'How many collisions happen' if kind == COUNT else 'Are there collisions'}{when}?")
    if verb in MOTIONS:
        moving = f"{MOTIONS[verb]} {about}"
        return Built(f"How many {moving} are there{when}?" if kind == COUNT else f"Are there any {moving}{when}?")
    return Built(f"{f'How many {about}' if kind == COUNT else f'Are there any {about} that'} {verb}{when}?")


def examples(scene: Scene) -> list[Built]:
    """Some questions of different kinds about a scene, for a start."""
    hit = next((e for e in scene.events if e.kind == "collision"), None)
    found = [build(COUNT, ANYTHING, COLLIDE, ANY_TIME, scene)]
    if hit is not None:
        found.append(build(next(iter(QUERIES)), scene.objects[hit.objects[0]].name, "", "", scene))
        found.append(build(CAUSE, objects_menu(CAUSE, scene)[-1], "", "", scene))
    if len(scene.objects) > 2:
        found.append(build(WITHOUT, scene.objects[hit.objects[0] if hit else 0].name, "", "", scene))
    return found


def entry(chosen: str, menu: Sequence[str]) -> str:
    """The chosen entry of a menu, or its first one if it has no such; "" for an empty menu."""
    return chosen if chosen in menu else next(iter(menu), "")


def _explained(scene: Scene) -> list[Event]:
    """Collisions and exits that are the only ones of their kind and objects."""
    kinds = [(e.kind, e.objects) for e in scene.events]
    return [e for e in scene.events if e.kind != "in" and kinds.count((e.kind, e.objects)) == 1]


def _event(event: Event, scene: Scene) -> str:
    names = [f"the {scene.objects[i].name}" for i in event.objects]
    return f"The collision between {' and '.join(names)}" if len(names) == 2 else f"T{names[0][1:]}'s exit"


def _pairs(scene: Scene, without: str = "") -> tuple[str, ...]:
    """Collisions of pairs: first those that happen in the video, after it or without an object, then the others."""
    names = {o.id: o.name for o in scene.objects if o.name != without}
    later = [*(scene.unseen or ()), *(e for events in (scene.counterfactual or {}).values() for e in events)]
    happening = dict.fromkeys(e.objects for e in (*later, *scene.events) if e.kind == "collision")
    pairs = [p for p in dict.fromkeys([*happening, *combinations(names, 2)]) if names.keys() >= set(p)]
    return tuple(f"The {names[i]} collides with the {names[j]}" for i, j in pairs[:MAX_PAIRS])


@dataclass(frozen=True)
class Slider:
    """A number to choose.

    Attributes:
        label: with the unit.
        low, high, step: what can be chosen.
        start: chosen at first.
    """

    label: str
    low: float
    high: float
    step: float
    start: float


@dataclass(frozen=True)
class Change:
    """A kind of intervention.

    Attributes:
        make: object and the sliders' numbers -> intervention.
        sliders: its numbers.
        adds: the object is a new one.
    """

    make: Callable[..., Intervention]
    sliders: tuple[Slider, ...] = ()
    adds: bool = False


def _added(name: str, *place_and_velocity: float) -> Add:
    color, material, shape = name.split()
    return Add(color, material, shape, *place_and_velocity)


PLACE = MAX_POSITION_WORLD
SPEED = MAX_SPEED_WORLD_PER_S
X_AXIS, Y_AXIS = "towards the camera", "to the right"
CHANGES = {
    "remove": Change(Remove),
    "heavier or lighter": Change(SetMass, (Slider("times the mass", 0.1, 10, 0.1, 3),)),
    "faster, slower or back": Change(
        lambda name, factor: SetVelocity(name, factor=factor), (Slider("times the velocity", -3, 3, 0.1, 2),)
    ),
    "other velocity": Change(
        lambda name, speed, direction: SetVelocity(name, speed=speed, direction=direction),
        (
            Slider("speed (world units/s)", 0, SPEED, 0.1, 2.8),
            Slider(f"direction (degrees: 0 {X_AXIS}, 90 {Y_AXIS})", -180, 180, 5, 0),
        ),
    ),
    "move": Change(
        lambda name, dx, dy: Move(name, dx=dx, dy=dy),
        (Slider(f"by, {X_AXIS} (world units)", -3, 3, 0.1, 0.5), Slider(f"by, {Y_AXIS} (world units)", -3, 3, 0.1, 0)),
    ),
    "fix to the ground": Change(Freeze),
    "add": Change(
        _added,
        (
            Slider(f"place {X_AXIS} of the middle (world units)", -PLACE, PLACE, 0.1, 2),
            Slider(f"place {Y_AXIS} of the middle (world units)", -PLACE, PLACE, 0.1, 0),
            Slider(f"velocity {X_AXIS} (world units/s)", -3, 3, 0.1, -2),
            Slider(f"velocity {Y_AXIS} (world units/s)", -3, 3, 0.1, 0),
        ),
        adds=True,
    ),
}
"""Every kind by the words of the menu."""
MAX_SLIDERS = max(len(change.sliders) for change in CHANGES.values())


def changed_objects(kind: str, scene: Scene) -> list[str]:
    """Names of the objects that a kind can be about: the scene's, or new ones."""
    names = [o.name for o in scene.objects]
    if not CHANGES[kind].adds:
        return names
    return [name for name in map(" ".join, product(*ATTRIBUTES.values())) if name not in names]


def intervention(kind: str, name: str | None, numbers: Sequence[float]) -> Intervention:
    """The intervention of a kind's object and its sliders' numbers; further numbers are left out.

    Raises:
        DataError: no object is chosen, or a number is impossible.
    """
    if not name:
        raise DataError("no object is chosen; pick or upload a clip, then choose one")
    change = CHANGES[kind]
    return change.make(name, *numbers[: len(change.sliders)])

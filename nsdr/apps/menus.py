"""Questions and interventions built from menus and sliders.

Questions are programs about a scene's objects and events, so that they always parse.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product

from nsdr.errors import DataError
from nsdr.language.texts import described, in_words
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
QUERIES = {f"Which {name} has …": f"query_{name}" for name in ATTRIBUTES}
KINDS = (COUNT, EXIST, *QUERIES, CAUSE, NEXT, WITHOUT)
"""What the first menu offers."""
MOTIONS = {"are moving": "filter_moving", "are stationary": "filter_stationary"}
COLLIDE = "collide"
HAPPENINGS = {"enter the scene": "filter_in", "exit the scene": "filter_out", COLLIDE: "filter_collision"}
ORDERS = ("first", "second", "last")
PARTNERS = {f"the {order} object to collide with it": order for order in ORDERS}
ANYTHING, ANY_TIME = "objects", "in the whole video"
MAX_PAIRS = 6
"""Pairs of objects among the choices of a question about collisions."""

Named = tuple[str, tuple[str, ...]]
"""A text and its program."""


@dataclass(frozen=True)
class Built:
    """A question with its program and those of its choices.

    Attributes:
        question: its text and program.
        choices: those of its choices; empty for a descriptive question.
    """

    question: Named
    choices: tuple[Named, ...] = ()


def objects_menu(kind: str, scene: Scene) -> list[str]:
    """What a kind of question can be about: classes of objects, an object, or an event that has causes."""
    names = [o.name for o in scene.objects]
    if kind in (COUNT, EXIST):
        words = [
            word for values in ATTRIBUTES.values() for word in values if any(word in name.split() for name in names)
        ]
        return [ANYTHING, *(described([word], plural=True)[0] for word in words)]
    if kind == CAUSE:
        return [_event(e, scene)[0] for e in _explained(scene)]
    return [] if kind == NEXT else names


def verb_menu(kind: str) -> list[str]:
    """What the objects do."""
    if kind in (COUNT, EXIST):
        return [*HAPPENINGS, *MOTIONS]
    return list(PARTNERS) if kind in QUERIES else []


def time_menu(kind: str, verb: str, scene: Scene) -> list[str]:
    """When they do it."""
    if kind not in (COUNT, EXIST):
        return []
    return [ANY_TIME, *_times(verb, scene)]


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
        return Built(_named(["unseen_events", "belong_to"]), _pairs(scene, range(len(scene.objects))))
    if kind == WITHOUT:
        gone = next(o.id for o in scene.objects if o.name == about)
        question = _named(["all_events", *_one(about), "get_counterfact", "belong_to"])
        return Built(question, _pairs(scene, [o.id for o in scene.objects if o.id != gone]))
    if kind == CAUSE:
        return _cause(about, scene)
    if kind in QUERIES:
        order = PARTNERS[verb]
        chosen = ["events", *_one(about), "filter_collision", order, "filter_order", *_one(about), "get_col_partner"]
        return Built(_named([*chosen, QUERIES[kind]]))
    words = [] if about == ANYTHING else [about.split()[0].removesuffix("s")]
    last = "count" if kind == COUNT else "exist"
    when = _times(verb, scene).get(time)
    if verb in MOTIONS:
        return Built(_named(["objects", *described(words)[1], *(when or ["null"]), MOTIONS[verb], last]))
    who = [] if verb == COLLIDE else described(words)[1]
    return Built(_named([*(when or ["events"]), "objects", *who, HAPPENINGS[verb], last]))


def examples(scene: Scene) -> list[Built]:
    """Some questions of different kinds about a scene, for a start."""
    hit = next((e for e in scene.events if e.kind == "collision"), None)
    found = [build(COUNT, ANYTHING, COLLIDE, ANY_TIME, scene)]
    if hit is not None:
        found.append(build(next(iter(QUERIES)), scene.objects[hit.objects[0]].name, "", "", scene))
        found.append(build(CAUSE, _event(_explained(scene)[-1], scene)[0], "", "", scene))
    if len(scene.objects) > 2:
        found.append(build(WITHOUT, scene.objects[hit.objects[0] if hit else 0].name, "", "", scene))
    return found


def entry(chosen: str, menu: Sequence[str]) -> str:
    """The chosen entry of a menu, or its first one if it has no such; "" for an empty menu."""
    return chosen if chosen in menu else next(iter(menu), "")


def _named(tokens: Sequence[str]) -> Named:
    return in_words(tokens), tuple(tokens)


def _one(name: str) -> list[str]:
    """Program of a single object by its color, material and shape."""
    return ["objects", *described(name.split())[1], "unique"]


def _times(verb: str, scene: Scene) -> dict[str, list[str]]:
    """Program of each time: a frame for motions, the events before or after another event for the others."""
    found: dict[str, list[str]] = {}
    if verb in MOTIONS:
        found = {"when the video begins": ["start", "get_frame"], "when the video ends": ["end", "get_frame"]}
    for event in scene.events:
        if event.kind == "collision":
            continue
        name, does = scene.objects[event.objects[0]].name, "enters" if event.kind == "in" else "exits"
        chosen = ["events", *_one(name), f"filter_{event.kind}", "unique"]
        if verb in MOTIONS:
            found[f"when the {name} {does}"] = [*chosen, "get_frame"]
        else:
            found |= {
                f"{side} the {name} {does}": ["events", *chosen, f"filter_{side}"] for side in ("before", "after")
            }
    return found


def _explained(scene: Scene) -> list[Event]:
    """Collisions and exits that are the only ones of their kind and objects."""
    kinds = [(e.kind, e.objects) for e in scene.events]
    return [e for e in scene.events if e.kind != "in" and kinds.count((e.kind, e.objects)) == 1]


def _event(event: Event, scene: Scene) -> Named:
    who = [_one(scene.objects[i].name) for i in event.objects]
    if event.kind == "collision":
        return _named(["events", *who[0], "filter_collision", *who[1], "filter_collision", "unique"])
    return _named(["events", *who[0], f"filter_{event.kind}", "unique"])


def _cause(about: str, scene: Scene) -> Built:
    target = next(e for e in _explained(scene) if _event(e, scene)[0] == about)
    question = _named(["events", *_event(target, scene)[1], "filter_ancestor", "belong_to"])
    presences = [_named(_one(o.name)) for o in scene.objects if o.id not in target.objects]
    earlier = [e for e in _explained(scene) if e.kind == "collision" and e != target]
    return Built(question, (*presences, *(_event(e, scene) for e in earlier)))


def _pairs(scene: Scene, ids: Sequence[int]) -> tuple[Named, ...]:
    """Collisions of pairs: first those that happen in the video, after it or without an object, then the others."""
    later = [*(scene.unseen or ()), *(e for events in (scene.counterfactual or {}).values() for e in events)]
    happening = dict.fromkeys(e.objects for e in (*later, *scene.events) if e.kind == "collision")
    pairs = [p for p in dict.fromkeys([*happening, *combinations(ids, 2)]) if set(p) <= set(ids)]
    both = [[_one(scene.objects[i].name) for i in pair] for pair in pairs[:MAX_PAIRS]]
    return tuple(_named(["all_events", *a, "filter_collision", *b, "filter_collision", "unique"]) for a, b in both)


# Interventions.


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

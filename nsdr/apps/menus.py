"""Questions about a clip, their choices, and interventions built from a menu and sliders."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

from nsdr.errors import DataError
from nsdr.types import Add, Event, Freeze, Move, Remove, Scene, SetMass, SetVelocity
from nsdr.types.interventions import Intervention
from nsdr.world.world import CLEVRER_WORLD, World

QUESTIONS = 3
"""Questions that are suggested at a time."""
MAX_CHOICES = 6
"""Choices that a question gets."""


def questions(scene: Scene) -> list[str]:
    """Up to `QUESTIONS` questions that a scene allows, for a start: about what happens, why, and what if."""
    names = [o.name for o in scene.objects]
    hit = next((e for e in scene.events if e.kind == "collision"), None)
    found = ["How many collisions happen?"]
    if events := _unique_events(scene):
        found.append(f"Which of the following is responsible for t{_event(events[-1], names).removeprefix('T')}?")
    if len(names) > 2:
        found.append(f"What will happen without the {names[hit.objects[0] if hit is not None else 0]}?")
    if len(names) > 1:
        found.append("What will happen next?")
    return found[:QUESTIONS]


def choices(question: str, program: Sequence[str], scene: Scene) -> list[str]:
    """Choices for a multiple-choice question that a visitor asks without any.

    Args:
        question: names objects as the scene does, or by fewer words.
        program: its tokens.
        scene: the choices name its objects and events.
    """
    names = [o.name for o in scene.objects]
    if "filter_ancestor" in program:
        present = [f"The presence of the {name}" for name in names if name not in question]
        hits = [_event(e, names) for e in _unique_events(scene) if e.kind == "collision"]
        return [*present[: MAX_CHOICES // 2], *(text for text in hits if text[1:] not in question)][:MAX_CHOICES]
    removed = next((name for name in names if name in question), "") if "get_counterfact" in program else ""
    return list(_pairs(scene, removed))


def _unique_events(scene: Scene) -> list[Event]:
    """Collisions and exits that are the only ones of their kind and objects."""
    kinds = [(e.kind, e.objects) for e in scene.events]
    return [e for e in scene.events if e.kind != "in" and kinds.count((e.kind, e.objects)) == 1]


def _event(event: Event, names: Sequence[str]) -> str:
    about = [f"the {names[i]}" for i in event.objects]
    return f"The collision between {' and '.join(about)}" if len(about) == 2 else f"T{about[0][1:]}'s exit"


def _pairs(scene: Scene, without: str = "") -> tuple[str, ...]:
    """Collisions of pairs: first those that happen in the video, after it or without an object, then the others."""
    names = {o.id: o.name for o in scene.objects if o.name != without}
    later = [*(scene.predicted or ()), *(e for events in (scene.counterfactual or {}).values() for e in events)]
    happening = dict.fromkeys(e.objects for e in (*later, *scene.events) if e.kind == "collision")
    pairs = [p for p in dict.fromkeys([*happening, *combinations(names, 2)]) if names.keys() >= set(p)]
    return tuple(f"The {names[i]} collides with the {names[j]}" for i, j in pairs[:MAX_CHOICES])


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
class ChangeKind:
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


X_AXIS, Y_AXIS = "towards the camera", "to the right"
MAX_SLIDERS = 4
"""Most sliders of a kind of change."""


@lru_cache
def changes(world: World) -> dict[str, ChangeKind]:
    """Every kind of change by the words of the menu. Lengths and speeds are in proportion to those of the world."""
    place, top_speed, scales = world.max_position_world, world.max_speed_world_per_s, world.scales
    shift, speed = (round(3 * scale, 1) for scale in (scales.size, scales.speed))
    by, start, fast = round(0.5 * scales.size, 1), round(2 * scales.speed, 1), round(2.8 * scales.speed, 1)
    far = min(round(2 * scales.size, 1), place)
    return {
        "remove": ChangeKind(Remove),
        "heavier or lighter": ChangeKind(SetMass, (Slider("times the mass", 0.1, 10, 0.1, 3),)),
        "faster, slower or back": ChangeKind(
            lambda name, factor: SetVelocity(name, factor=factor), (Slider("times the velocity", -3, 3, 0.1, 2),)
        ),
        "other velocity": ChangeKind(
            lambda name, speed, direction: SetVelocity(name, speed=speed, direction=direction),
            (
                Slider("speed (world units/s)", 0, top_speed, 0.1, fast),
                Slider(f"direction (degrees: 0 {X_AXIS}, 90 {Y_AXIS})", -180, 180, 5, 0),
            ),
        ),
        "move": ChangeKind(
            lambda name, dx, dy: Move(name, dx=dx, dy=dy),
            (
                Slider(f"by, {X_AXIS} (world units)", -shift, shift, 0.1, by),
                Slider(f"by, {Y_AXIS} (world units)", -shift, shift, 0.1, 0),
            ),
        ),
        "fix to the ground": ChangeKind(Freeze),
        "add": ChangeKind(
            _added,
            (
                Slider(f"place {X_AXIS} of the middle (world units)", -place, place, 0.1, far),
                Slider(f"place {Y_AXIS} of the middle (world units)", -place, place, 0.1, 0),
                Slider(f"velocity {X_AXIS} (world units/s)", -speed, speed, 0.1, -start),
                Slider(f"velocity {Y_AXIS} (world units/s)", -speed, speed, 0.1, 0),
            ),
            adds=True,
        ),
    }


KINDS = tuple(changes(CLEVRER_WORLD))
"""The words of the menu, which are the same in every world."""


def changed_objects(kind: str, scene: Scene) -> list[str]:
    """Names of the objects that a kind can be about: the scene's, or new ones."""
    names = [o.name for o in scene.objects]
    if not changes(scene.world)[kind].adds:
        return names
    return [name for name in map(" ".join, scene.world.vocabulary.triples) if name not in names]


def intervention(kind: str | None, name: str | None, numbers: Sequence[float]) -> Intervention:
    """The intervention of a kind's object and its sliders' numbers; further numbers are left out.

    Raises:
        DataError: no kind or no object is chosen, or a number is impossible.
    """
    if kind not in KINDS:
        raise DataError("no change is chosen")
    if not name:
        raise DataError("no object is chosen; pick or upload a clip, then choose one")
    change = changes(CLEVRER_WORLD)[kind]
    return change.make(name, *numbers[: len(change.sliders)])

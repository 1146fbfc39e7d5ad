"""Interventions on the objects of a video: which objects they refer to, and which of them contradict each other."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nsdr.errors import DataError
from nsdr.types import Add, Freeze, Move, Remove, SceneObject, SetMass, SetVelocity
from nsdr.types.interventions import Intervention
from nsdr.types.tracks import find_object
from nsdr.validation import BoolArray, expect
from nsdr.world.world import World

EXCLUSIVE = ({SetVelocity, Freeze}, {SetMass, Freeze}, {Move})
"""An object can have at most one intervention from each of these sets. `Remove` excludes all others."""


def check_changes(interventions: Sequence[Intervention], world: World) -> None:
    """Raise `DataError` unless added objects have words of a world, and places and speeds are possible in it."""
    known = world.vocabulary.words
    for change in interventions if isinstance(interventions, Sequence) else ():
        owner = type(change).__name__
        if isinstance(change, SetVelocity):
            check_speed(owner, change.speed or math.hypot(change.vx or 0.0, change.vy or 0.0), world)
        elif isinstance(change, Add):
            for name, word in zip(known, (change.color, change.material, change.shape), strict=True):
                expect(
                    word in known[name], f"Add {change.name}: {name}", f"one of {', '.join(known[name])}", repr(word)
                )
            check_position(owner, change.x, change.y, world)
            check_speed(owner, math.hypot(change.vx, change.vy), world)
        elif isinstance(change, Move) and change.x is not None and change.y is not None:
            check_position(owner, change.x, change.y, world)
        elif isinstance(change, Move):
            farthest, width = max(abs(change.dx or 0.0), abs(change.dy or 0.0)), 2 * world.max_position_world
            expect(farthest <= width, owner, f"dx and dy of up to {width:g}, the width of the ground", farthest)


def check_speed(owner: str, speed: float, world: World) -> None:
    """Raise `DataError` for a speed (world units/s) beyond `World.max_speed_world_per_s`."""
    most = world.max_speed_world_per_s
    expect(speed <= most, owner, f"a speed of up to {most:g} world units per second", speed)


def check_position(owner: str, x: float, y: float, world: World) -> None:
    """Raise `DataError` for a position (world units) that is not on the ground."""
    most = world.max_position_world
    expect(max(abs(x), abs(y)) <= most, owner, f"a position on the ground, from {-most:g} to {most:g}", (x, y))


def resolve(
    interventions: Sequence[Intervention],
    objects: Sequence[SceneObject],
    visible: BoolArray,
    from_frame: int,
    world: World,
) -> tuple[Intervention, ...]:
    """Replace the words of interventions by ids, and check the interventions against each other and the video.

    Args:
        interventions: changes of the scene.
        objects: objects of the video.
        visible: (n, F) bool, whether each object is in the image at each frame of the video.
        from_frame: frame at which the interventions happen.
        world: the world of the video, which says what is possible.

    Raises:
        DataError: `interventions` is not a list, `from_frame` is outside the video, an object is unknown or not in the image at
            that frame, a place or speed is impossible, interventions contradict each other, or an object like the added one is
            there already.
    """
    frames = visible.shape[1]
    if isinstance(from_frame, bool) or not isinstance(from_frame, int) or not 0 <= from_frame < frames:
        raise DataError(f"from_frame: expected a frame of the video, 0 to {frames - 1}, got {from_frame!r:.60}")
    if not isinstance(interventions, Sequence) or isinstance(interventions, str):
        raise DataError(f"interventions: expected a list, such as [nsdr.Remove('red cube')], got {interventions!r:.60}")
    check_changes(interventions, world)
    found: list[Intervention] = []
    for change in interventions:
        if isinstance(change, Add):
            found.append(change)
        elif isinstance(change, Remove | SetMass | SetVelocity | Move | Freeze):
            i = find_object(objects, change.object)
            _check_there(change, objects[i], visible[i], from_frame)
            found.append(replace(change, object=i))
        else:
            known = "Remove, SetMass, SetVelocity, Move, Freeze, Add"
            raise DataError(f"interventions: expected instances of {known}, got {change!r:.60}")
    _check_contradictions(found, with_added(objects, found), from_frame)
    return tuple(found)


def changed_ids(changes: Sequence[Intervention], objects: Sequence[SceneObject]) -> list[int]:
    """The id of the object that each intervention changes or adds.

    Args:
        changes: interventions whose `object` is an id.
        objects: objects of the video; added objects get the ids that follow.
    """
    added = iter(range(len(objects), len(objects) + len(changes)))
    return [next(added) if isinstance(change, Add) else int(change.object) for change in changes]


def with_added(objects: Sequence[SceneObject], changes: Sequence[Intervention]) -> tuple[SceneObject, ...]:
    """The objects of the video, followed by the objects that interventions add."""
    added = [change for change in changes if isinstance(change, Add)]
    return (*objects, *(SceneObject(len(objects) + k, a.color, a.material, a.shape) for k, a in enumerate(added)))


def _check_there(change: Intervention, o: SceneObject, visible: BoolArray, frame: int) -> None:
    """Raise `DataError` if an object is not in the image at a frame, unless it enters later and is removed or gets a mass."""
    seen, what = np.flatnonzero(visible), f"{type(change).__name__} {o.name}: it is"
    if not len(seen):
        raise DataError(f"{what} never in the image")
    enters_later = frame < seen[0]
    if not visible[frame] and not (enters_later and isinstance(change, Remove | SetMass)):
        when = f"enters at frame {seen[0]}" if enters_later else f"leaves after frame {seen[-1]}"
        expected = f"expected a from_frame from {seen[0]} to {seen[-1]}"
        raise DataError(f"{what} not in the image at frame {frame}, it {when}; {expected}")


def _check_contradictions(changes: Sequence[Intervention], objects: tuple[SceneObject, ...], from_frame: int) -> None:
    """Raise `DataError` if changes exclude each other; `objects` are those of the video and the added ones."""
    n_added = sum(isinstance(change, Add) for change in changes)
    kinds: dict[int, list[type]] = defaultdict(list)
    for i, change in zip(changed_ids(changes, objects[: len(objects) - n_added]), changes, strict=True):
        mine = kinds[i]
        mine.append(type(change))
        for one_of in (*EXCLUSIVE, set(mine) if Remove in mine else set()):
            names = [kind.__name__ for kind in mine if kind in one_of]
            if len(names) > 1:
                raise DataError(f"{objects[i].name}: {' and '.join(names)} contradict each other; give one of them")
    removed = [i for i, of in kinds.items() if Remove in of]
    if removed and len(removed) == len(objects):
        raise DataError(f"interventions: all {len(objects)} objects are removed; nothing is left to simulate")
    there: set[str] = set()
    for o in objects:
        if from_frame > 0 or o.id not in removed:
            if o.name in there:
                raise DataError(f"Add {o.name}: the scene has one already; objects differ in color, material or shape")
            there.add(o.name)

"""Interventions on the bodies of the simulator: their states in one frame are changed and checked."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.interventions import changed_ids, check_position, check_speed, with_added
from nsdr.dynamics.physics.bodies import body_records
from nsdr.dynamics.physics.body_state import POSITION, SPIN, STATE_SIZE, VELOCITY, X, Y
from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.dynamics.physics.simulator import BodyStates
from nsdr.errors import DataError
from nsdr.types import Add, Freeze, Move, Remove, SceneObject, SetMass, SetVelocity
from nsdr.types.interventions import Intervention
from nsdr.world.world import World

FROZEN_MASS = 1e9
"""Relative mass of frozen objects; other objects rebound from them as from a wall."""


@dataclass(frozen=True)
class ChangedBodies:
    """The n objects of a scene, including added ones, after interventions.

    Attributes:
        bodies: the bodies in the frame of the interventions.
        exists: (n,) bool, whether each object exists; False for removed objects.
        simulated: (n,) bool, whether the motion of each object differs from the video from that frame on: True for objects that
            are added, moved, frozen or given a velocity.
        reweighed: (n,) bool, whether the mass of each object is changed.
        exact: (n, 6) bool, the entries of the states that interventions set, which have no noise.
        exact_mass: (n,) bool, the masses that interventions set, which have no noise.
    """

    bodies: BodyStates
    exists: NDArray[np.bool_]
    simulated: NDArray[np.bool_]
    reweighed: NDArray[np.bool_]
    exact: NDArray[np.bool_]
    exact_mass: NDArray[np.bool_]


def change_bodies(
    bodies: BodyStates, objects: Sequence[SceneObject], changes: Sequence[Intervention], world: World
) -> ChangedBodies:
    """Apply interventions to the bodies.

    Args:
        bodies: the bodies of the scene in the frame of the interventions.
        objects: the objects of the scene.
        changes: interventions whose `object` is an id.
        world: the world of the scene.

    Raises:
        DataError: an object would overlap another one, leave the ground or be too fast, or it is at rest and so has no
            direction to keep.
    """
    everything, ids = with_added(objects, changes), changed_ids(changes, objects)
    n, extra, names = len(everything), len(everything) - len(objects), [o.name for o in everything]
    state, mass = np.pad(bodies.state, [(0, extra), (0, 0)]), np.pad(bodies.mass, (0, extra), constant_values=1.0)
    simulated, reweighed, exact_mass = np.zeros((3, n), bool)
    changed = ChangedBodies(
        BodyStates(body_records(everything, world), state, mass),
        np.ones(n, bool),
        simulated,
        reweighed,
        np.zeros((n, STATE_SIZE), bool),
        exact_mass,
    )
    for i, change in zip(ids, changes, strict=True):
        _apply(changed, i, change, names[i], world)
        if isinstance(change, Remove):
            changed.exists[i] = False
    for i, change in zip(ids, changes, strict=True):
        if isinstance(change, Move | Add):
            _check_free(changed, i, names)
    return changed


def _apply(changed: ChangedBodies, i: int, change: Intervention, name: str, world: World) -> None:
    """Change body i in place. Changes of one object concern different parts of its state, so their order does not matter."""
    state, mass, exact = changed.bodies.state[i], changed.bodies.mass, changed.exact[i]
    changed.simulated[i] |= isinstance(change, SetVelocity | Move | Freeze | Add)
    if isinstance(change, SetMass):
        mass[i] *= change.factor
        changed.reweighed[i] = change.factor != 1
    elif isinstance(change, SetVelocity):
        state[VELOCITY] = _velocity(change, state[VELOCITY], name, world)
        is_given = change.vx is not None or None not in (change.speed, change.direction)
        exact[VELOCITY] = is_given or not state[VELOCITY].any()
    elif isinstance(change, Move):
        if change.x is not None and change.y is not None:
            state[POSITION], exact[POSITION] = (change.x, change.y), True
        else:
            state[POSITION] += change.dx or 0.0, change.dy or 0.0
            check_position(f"Move {name}", float(state[X]), float(state[Y]), world)
    elif isinstance(change, Freeze):
        state[VELOCITY], state[SPIN], mass[i] = 0.0, 0.0, FROZEN_MASS
        changed.exact_mass[i] = True
    elif isinstance(change, Add):
        state[:], mass[i] = (change.x, change.y, change.vx, change.vy, change.yaw, 0.0), change.mass
        exact[POSITION], exact[VELOCITY], changed.exact_mass[i] = True, True, True


def _velocity(change: SetVelocity, now: NDArray[Any], name: str, world: World) -> NDArray[Any]:
    """The velocity (2,) of an object after an intervention, given its velocity `now` (2,) before it (world units/s)."""
    if change.vx is not None and change.vy is not None:
        return np.array([change.vx, change.vy])
    speed = float(np.hypot(*now))
    if 0 in (change.speed, change.factor):
        return np.zeros(2)
    if change.direction is None and speed < world.physics.moving_speed_world_per_s:
        raise DataError(
            f"SetVelocity {name}: it is at rest ({speed:.3f} world units per second), so it has no direction to keep; "
            "expected vx and vy, or speed and direction"
        )
    if change.factor is not None:
        check_speed(f"SetVelocity {name}", speed * abs(change.factor), world)
        return change.factor * now
    angle = math.atan2(now[1], now[0]) if change.direction is None else math.radians(change.direction)
    new_speed = speed if change.speed is None else change.speed
    return new_speed * np.array([math.cos(angle), math.sin(angle)])


def _check_free(changed: ChangedBodies, i: int, names: Sequence[str]) -> None:
    """Raise `DataError` if object i, which was moved or added, would overlap another object."""
    bodies = changed.bodies
    for j in np.flatnonzero(changed.exists).tolist():
        gap = float(outline_gap(bodies.body, bodies.state, i, j)[0]) if j != i else 0.0
        if gap < 0:
            (x, y), (other_x, other_y) = bodies.state[[i, j], POSITION].tolist()
            raise DataError(
                f"{names[i]} at ({x:.2f}, {y:.2f}): would overlap the {names[j]} at ({other_x:.2f}, {other_y:.2f}) by "
                f"{-gap:.2f} world units; expected a free place"
            )

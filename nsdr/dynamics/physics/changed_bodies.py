"""Interventions on the simulator's bodies: their state at one frame, changed and checked."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.interventions import Changes
from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.dynamics.physics.simulator import BodyStates
from nsdr.errors import DataError
from nsdr.types import Add, Freeze, Move, SetMass, SetVelocity
from nsdr.types.interventions import Intervention, check_position, check_speed
from nsdr.world.physics_constants import MOVING_SPEED_WORLD_PER_S
from nsdr.world.vocabulary import SHAPES

__all__ = ["ChangedBodies", "change_bodies"]

FROZEN_MASS = 1e9
"""Relative mass of frozen objects: what hits them rebounds as from a wall."""


@dataclass(frozen=True)
class ChangedBodies:
    """The objects of a scene and the added ones, n in all.

    Attributes:
        bodies: states at the frame of the interventions.
        exists: (n,) bool, False for removed objects.
        simulated: (n,) bool, whose motion is no longer that of the video: set, moved, frozen and added objects.
        reweighed: (n,) bool, whose mass is changed.
        exact_position, exact_velocity, exact_mass: (n,) bool, given by the interventions and so free of noise.
    """

    bodies: BodyStates
    exists: NDArray[np.bool_]
    simulated: NDArray[np.bool_]
    reweighed: NDArray[np.bool_]
    exact_position: NDArray[np.bool_]
    exact_velocity: NDArray[np.bool_]
    exact_mass: NDArray[np.bool_]


def change_bodies(bodies: BodyStates, changes: Changes) -> ChangedBodies:
    """The bodies with all interventions.

    Args:
        bodies: of the scene's objects, at the frame of the interventions.
        changes: the interventions.

    Raises:
        DataError: an object would overlap another one, leave the ground or be too fast, or has no direction to keep.
    """
    n = len(changes.objects)
    none = np.zeros((n - len(bodies.shape), 2))
    changed = ChangedBodies(
        BodyStates(
            np.array([SHAPES.index(o.shape) for o in changes.objects], np.int64),
            np.concatenate([bodies.position, none]),
            np.concatenate([bodies.velocity, none]),
            np.concatenate([bodies.yaw, none[:, 0]]),
            np.concatenate([bodies.spin, none[:, 0]]),
            np.concatenate([bodies.mass, none[:, 0] + 1]),
        ),
        np.ones(n, bool),
        *(np.zeros(n, bool) for _ in range(5)),
    )
    for i, change in changes.of:
        _apply(changed, i, change, changes.objects[i].name)
    changed.exists[changes.removed] = False
    for i, change in changes.of:
        if isinstance(change, Move | Add):
            _check_free(changed, i, changes)
    return changed


def _apply(changed: ChangedBodies, i: int, change: Intervention, name: str) -> None:
    """Change body i in place. Several changes of one object concern different parts of its state, so any order will do."""
    bodies = changed.bodies
    changed.simulated[i] |= isinstance(change, SetVelocity | Move | Freeze | Add)
    if isinstance(change, SetMass):
        bodies.mass[i] *= change.factor
        changed.reweighed[i] = change.factor != 1
    elif isinstance(change, SetVelocity):
        bodies.velocity[i] = _velocity(change, bodies.velocity[i], name)
        is_given = change.vx is not None or None not in (change.speed, change.direction)
        changed.exact_velocity[i] = is_given or not bodies.velocity[i].any()
    elif isinstance(change, Move):
        if change.x is not None and change.y is not None:
            bodies.position[i] = change.x, change.y
            changed.exact_position[i] = True
        else:
            bodies.position[i] += change.dx or 0.0, change.dy or 0.0
            check_position(f"Move {name}", *bodies.position[i].tolist())
    elif isinstance(change, Freeze):
        bodies.velocity[i], bodies.spin[i], bodies.mass[i] = 0.0, 0.0, FROZEN_MASS
        changed.exact_mass[i] = True
    elif isinstance(change, Add):
        bodies.position[i], bodies.velocity[i] = (change.x, change.y), (change.vx, change.vy)
        bodies.yaw[i], bodies.mass[i] = change.yaw, change.mass
        changed.exact_position[i] = changed.exact_velocity[i] = changed.exact_mass[i] = True


def _velocity(change: SetVelocity, now: NDArray[Any], name: str) -> NDArray[Any]:
    """The velocity (2,) that an intervention gives an object."""
    if change.vx is not None and change.vy is not None:
        return np.array([change.vx, change.vy])
    speed = float(np.hypot(*now))
    if 0 in (change.speed, change.factor):
        return np.zeros(2)
    if change.direction is None and speed < MOVING_SPEED_WORLD_PER_S:
        raise DataError(
            f"SetVelocity {name}: it rests ({speed:.3f} world units per second), so it has no direction to keep; "
            "expected vx and vy, or speed and direction"
        )
    if change.factor is not None:
        check_speed(f"SetVelocity {name}", speed * abs(change.factor))
        return change.factor * now
    angle = math.atan2(now[1], now[0]) if change.direction is None else math.radians(change.direction)
    new_speed = speed if change.speed is None else change.speed
    return new_speed * np.array([math.cos(angle), math.sin(angle)])


def _check_free(changed: ChangedBodies, i: int, changes: Changes) -> None:
    """Raise `DataError` where a placed object would overlap another one."""
    bodies, names = changed.bodies, [o.name for o in changes.objects]
    state = np.concatenate([bodies.position, bodies.velocity, bodies.yaw[:, None], bodies.spin[:, None]], 1)
    for j in np.flatnonzero(changed.exists).tolist():
        gap = float(outline_gap(bodies.shape, state, i, j)[0]) if j != i else 0.0
        if gap < 0:
            (x, y), (other_x, other_y) = bodies.position[[i, j]].tolist()
            raise DataError(
                f"{names[i]} at ({x:.2f}, {y:.2f}): would overlap the {names[j]} at ({other_x:.2f}, {other_y:.2f}) by "
                f"{-gap:.2f} world units; expected a free place"
            )

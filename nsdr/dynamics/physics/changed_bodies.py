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
    old, n = len(bodies.shape), len(changes.objects)
    extra = n - old
    bodies = BodyStates(
        np.array([SHAPES.index(o.shape) for o in changes.objects], np.int64),
        np.concatenate([bodies.position, np.zeros((extra, 2))]),
        np.concatenate([bodies.velocity, np.zeros((extra, 2))]),
        np.concatenate([bodies.yaw, np.zeros(extra)]),
        np.concatenate([bodies.spin, np.zeros(extra)]),
        np.concatenate([bodies.mass, np.ones(extra)]),
    )
    flags = {name: np.zeros(n, bool) for name in ("simulated", "reweighed", "position", "velocity", "mass")}
    for i, change in changes.of:
        _apply(bodies, i, change, changes.objects[i].name, flags)
    exists = np.ones(n, bool)
    exists[changes.removed] = False
    placed = [i for i, change in changes.of if isinstance(change, Move | Add)]
    for i in placed:
        _check_free(bodies, i, exists, changes)
    exact = (flags["position"], flags["velocity"], flags["mass"])
    return ChangedBodies(bodies, exists, flags["simulated"], flags["reweighed"], *exact)


def _apply(bodies: BodyStates, i: int, change: Intervention, name: str, flags: dict[str, NDArray[np.bool_]]) -> None:
    """Change body i in place. Several changes of one object concern different parts of its state, so any order will do."""
    flags["simulated"][i] |= isinstance(change, SetVelocity | Move | Freeze | Add)
    if isinstance(change, SetMass):
        bodies.mass[i] *= change.factor
        flags["reweighed"][i] = change.factor != 1
    elif isinstance(change, SetVelocity):
        bodies.velocity[i] = _velocity(change, bodies.velocity[i], name)
        flags["velocity"][i] = (
            change.vx is not None or None not in (change.speed, change.direction) or not bodies.velocity[i].any()
        )
    elif isinstance(change, Move):
        if change.x is not None and change.y is not None:
            bodies.position[i] = change.x, change.y
            flags["position"][i] = True
        else:
            bodies.position[i] += change.dx or 0.0, change.dy or 0.0
            check_position(f"Move {name}", *bodies.position[i].tolist())
    elif isinstance(change, Freeze):
        bodies.velocity[i], bodies.spin[i], bodies.mass[i] = 0.0, 0.0, FROZEN_MASS
        flags["mass"][i] = True
    elif isinstance(change, Add):
        bodies.position[i], bodies.velocity[i] = (change.x, change.y), (change.vx, change.vy)
        bodies.yaw[i], bodies.mass[i] = change.yaw, change.mass
        for part in ("position", "velocity", "mass"):
            flags[part][i] = True


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


def _check_free(bodies: BodyStates, i: int, exists: NDArray[np.bool_], changes: Changes) -> None:
    """Raise `DataError` where a placed object would overlap another one."""
    state = np.concatenate([bodies.position, bodies.velocity, bodies.yaw[:, None], bodies.spin[:, None]], 1)
    for j in np.flatnonzero(exists).tolist():
        if j == i:
            continue
        gap = float(outline_gap(bodies.shape, state, i, j)[0])
        if gap < 0:
            x, y = bodies.position[j]
            raise DataError(
                f"{changes.objects[i].name} at ({bodies.position[i, 0]:.2f}, {bodies.position[i, 1]:.2f}): would overlap the "
                f"{changes.objects[j].name} at ({x:.2f}, {y:.2f}) by {-gap:.2f} world units; expected a free place"
            )

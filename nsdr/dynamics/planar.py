"""A fast planar simulator of CLEVRER's physics: rigid bodies on the ground plane with Bullet's contact rule, compiled by Numba.

All objects stand upright at one height, so what Bullet does in space happens in the plane: they slide, lose speed, and cubes
turn. Bullet steps 0.004 s at a time and lets bodies meet at a distance: once the gap is below a threshold, the speed after a
contact is at most the rebound minus gap / step. So one and the same meeting rebounds with anything from nothing to 0.64 of the
approach, by where in a step it falls. `rebound` replaces this rule for a pair by a given rebound at a given gap, so that motion
is a smooth function of the start, as fits need it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nsdr.dynamics.outlines import CUBE, FLAT, HALF, MARGIN, ROUND, SPHERE, outline_gap

__all__ = ["NO_CONTACT", "PlanarBodies", "PlanarMotion", "Script", "planar_motion"]

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]

NO_CONTACT = -1
STEPS_PER_FRAME, STEP = 7, 0.004
CORNER, NEAR = 0.07, 0.03
"""How far a cube's corner lies beyond the radius of round bodies, and the way of two fast bodies in a step."""
THRESHOLD = 0.02 * 0.348
"""Bullet's contact threshold: a share of the hulls' angular motion disc."""
RESTITUTION, SLOW = 0.64, 0.2
"""Rebound, and the approach below which there is none."""
ERP = 0.08
DAMPING = 0.04
FRICTION, SPINNING = 0.03 * 9.81, 0.01 * 9.81
"""Deceleration by the ground, and torque per mass by its resistance to turning."""
INERTIA = 2 * (2 * (HALF + MARGIN)) ** 2 / 12
"""Per mass: Bullet takes the bounding box's."""
FIT_GAP = 0.003
"""Gap at which given rebounds happen: the mean one of Bullet's rule at usual speeds."""


@dataclass(frozen=True)
class PlanarBodies:
    """Objects at the start of a run.

    Attributes:
        shape: (n,) int, index into `nsdr.clevrer.vocab.SHAPES`.
        place: (n, 2) world units.
        velocity: (n, 2) world units per second.
        yaw, spin: (n,) radians, radians per second.
        mass: (n,) relative.
    """

    shape: IntArray
    place: FloatArray
    velocity: FloatArray
    yaw: FloatArray
    spin: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class Script:
    """Motion that objects keep until something that is not scripted meets them.

    Attributes:
        place, velocity: (n, F, 2) at every frame of a video.
        yaw, spin: (n, F).
        until: (n,) int, the frame from which each object is free; 0 for an object without script.
        collisions: (E, 3) int, (i, j, frame) of scripted collisions in order of time. If either object is not there or free
            when one comes up, the other is free from the frame before.
    """

    place: FloatArray
    velocity: FloatArray
    yaw: FloatArray
    spin: FloatArray
    until: IntArray
    collisions: IntArray


@dataclass(frozen=True)
class PlanarMotion:
    """What a run gives; zero before its first frame.

    Attributes:
        place, velocity: (n, F, 2).
        yaw, spin: (n, F).
        contact: (n, n) int, the frame of each pair's first contact, `NO_CONTACT` for none.
        free_from: (n,) int, the frame from which each object is free of its script.
    """

    place: FloatArray
    velocity: FloatArray
    yaw: FloatArray
    spin: FloatArray
    contact: IntArray
    free_from: IntArray


def planar_motion(
    bodies: PlanarBodies,
    exists: NDArray[np.bool_],
    n_frames: int,
    rebound: FloatArray | None = None,
    script: Script | None = None,
    start: int = 0,
) -> PlanarMotion:
    """Run the bodies from frame `start` to frame `n_frames - 1`.

    Args:
        bodies: their state at frame `start`.
        exists: (n,) bool; the others are not there.
        n_frames: end of the run.
        rebound: (n, n) share of the approach that a pair rebounds with, NaN for Bullet's rule; None for that everywhere.
        script: what holds for scripted objects until they are free.
        start: first frame.
    """
    n = len(bodies.shape)
    if rebound is None:
        rebound = np.full((n, n), np.nan)
    if script is None:
        nothing = np.zeros((n, 1))
        script = Script(
            np.zeros((n, 1, 2)),
            np.zeros((n, 1, 2)),
            nothing,
            nothing,
            np.zeros(n, np.int64),
            np.zeros((0, 3), np.int64),
        )
    motion = _run(
        np.asarray(bodies.shape, np.int64),
        np.array(bodies.place, float),
        np.array(bodies.velocity, float),
        np.array(bodies.yaw, float),
        np.array(bodies.spin, float),
        np.asarray(bodies.mass, float),
        np.asarray(exists, np.bool_),
        np.ascontiguousarray(rebound, float),
        np.ascontiguousarray(script.place, float),
        np.ascontiguousarray(script.velocity, float),
        np.ascontiguousarray(script.yaw, float),
        np.ascontiguousarray(script.spin, float),
        np.array(script.until, np.int64),
        np.ascontiguousarray(script.collisions, np.int64),
        start,
        n_frames,
    )
    return PlanarMotion(*motion)


@njit(cache=True)
def _slow_down(shape, velocity, spin, yaw, i):  # type: ignore[no-untyped-def]
    """Damping and friction of one step."""
    speed = np.sqrt(velocity[i, 0] ** 2 + velocity[i, 1] ** 2)
    loss = DAMPING * speed + DAMPING * speed * speed
    turning = abs(spin[i])
    spin[i] -= STEP * DAMPING * spin[i] * (1 + turning)
    if shape[i] == SPHERE:
        if speed > 0:
            factor = 1 - STEP * loss / speed
            velocity[i, 0] *= factor
            velocity[i, 1] *= factor
        return
    if turning < 1e-3 or speed + 0.2 * turning < STEP * FRICTION:
        factor = max(0.0, 1 - STEP * (loss + FRICTION) / speed) if speed > 0 else 0.0
        velocity[i, 0] *= factor
        velocity[i, 1] *= factor
        spin[i] = 0.0
        return
    c, s = np.cos(yaw[i]), np.sin(yaw[i])
    fx, fy, torque = 0.0, 0.0, 0.0
    for k in range(4):  # a quarter of the weight on each corner of the flat face
        kx, ky = (FLAT if k % 2 else -FLAT), (FLAT if k // 2 else -FLAT)
        rx, ry = c * kx - s * ky, s * kx + c * ky
        ux, uy = velocity[i, 0] - spin[i] * ry, velocity[i, 1] + spin[i] * rx
        u = max(np.sqrt(ux * ux + uy * uy), 2 * STEP * FRICTION)
        gx, gy = -FRICTION / 4 * ux / u, -FRICTION / 4 * uy / u
        fx += gx
        fy += gy
        torque += rx * gy - ry * gx
    if speed > 0:
        velocity[i, 0] *= 1 - STEP * loss / speed
        velocity[i, 1] *= 1 - STEP * loss / speed
    velocity[i, 0] += STEP * fx
    velocity[i, 1] += STEP * fy
    spin[i] += STEP * torque / INERTIA
    brake = STEP * SPINNING / INERTIA
    spin[i] = np.copysign(max(abs(spin[i]) - brake, 0.0), spin[i])


@njit(cache=True)
def _meet(shape, place, velocity, yaw, spin, mass, i, j, given, used):  # type: ignore[no-untyped-def]
    """Let two bodies push each other if they do in this step.

    With a given rebound they do so at a moment within the step, otherwise at its start. Returns whether they met.
    """
    dx, dy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
    reach = 2 * ROUND + NEAR
    reach += (CORNER if shape[i] == CUBE else 0.0) + (CORNER if shape[j] == CUBE else 0.0)
    if dx * dx + dy * dy > reach * reach:
        return False
    gap, apart, nx, ny, ci, cj = _approach(shape, place, velocity, yaw, spin, i, j)
    before = 0.0
    if np.isnan(given):
        if gap > THRESHOLD:
            return False
        wanted = -RESTITUTION * apart if apart < -SLOW else 0.0
        wanted -= gap / STEP if gap > 0 else gap * ERP / STEP
    else:
        if apart >= 0 or gap + apart * STEP > FIT_GAP:
            return False
        if gap > FIT_GAP:  # up to the contact they move as before
            before = (gap - FIT_GAP) / -apart
            _advance(place, velocity, yaw, spin, i, j, before)
            _, apart, nx, ny, ci, cj = _approach(shape, place, velocity, yaw, spin, i, j)
        wanted = 0.0 if used else -given * apart
    if wanted <= apart:
        _advance(place, velocity, yaw, spin, i, j, -before)
        return False
    turn_i = ci * ci / (INERTIA * mass[i]) if shape[i] == CUBE else 0.0
    turn_j = cj * cj / (INERTIA * mass[j]) if shape[j] == CUBE else 0.0
    impulse = (wanted - apart) / (1 / mass[i] + 1 / mass[j] + turn_i + turn_j)
    velocity[i, 0] -= impulse * nx / mass[i]
    velocity[i, 1] -= impulse * ny / mass[i]
    velocity[j, 0] += impulse * nx / mass[j]
    velocity[j, 1] += impulse * ny / mass[j]
    if shape[i] == CUBE:
        spin[i] -= impulse * ci / (INERTIA * mass[i])
    if shape[j] == CUBE:
        spin[j] += impulse * cj / (INERTIA * mass[j])
    _advance(place, velocity, yaw, spin, i, j, -before)
    return True


@njit(cache=True)
def _approach(shape, place, velocity, yaw, spin, i, j):  # type: ignore[no-untyped-def]
    """Gap, speed of parting, normal from i to j, and the levers of the contact point's normal about both centres."""
    gap, nx, ny, px, py = outline_gap(shape, place, yaw, i, j)
    ix, iy = px - place[i, 0], py - place[i, 1]
    jx, jy = px - place[j, 0], py - place[j, 1]
    ux = velocity[j, 0] - spin[j] * jy - velocity[i, 0] + spin[i] * iy
    uy = velocity[j, 1] + spin[j] * jx - velocity[i, 1] - spin[i] * ix
    return gap, ux * nx + uy * ny, nx, ny, ix * ny - iy * nx, jx * ny - jy * nx


@njit(cache=True)
def _advance(place, velocity, yaw, spin, i, j, seconds):  # type: ignore[no-untyped-def]
    for body in (i, j):
        for k in range(2):
            place[body, k] += seconds * velocity[body, k]
        yaw[body] += seconds * spin[body]


@njit(cache=True)
def _run(  # type: ignore[no-untyped-def]
    shape,
    place,
    velocity,
    yaw,
    spin,
    mass,
    exists,
    rebound,
    s_place,
    s_velocity,
    s_yaw,
    s_spin,
    until,
    s_collisions,
    start,
    n_frames,
):
    n = len(shape)
    places, velocities = np.zeros((n, n_frames, 2)), np.zeros((n, n_frames, 2))
    turns, spins = np.zeros((n, n_frames)), np.zeros((n, n_frames))
    contact = np.full((n, n), NO_CONTACT)
    met = np.zeros((n, n), np.bool_)
    free_from = until.copy()
    step_number = start * STEPS_PER_FRAME
    for frame in range(start, n_frames):
        for e in range(len(s_collisions)):
            i, j, when = s_collisions[e, 0], s_collisions[e, 1], s_collisions[e, 2]
            if when - 1 == frame:
                if exists[i] and exists[j] and frame < free_from[i] and frame < free_from[j]:
                    contact[i, j] = contact[j, i] = when
                    met[i, j] = True
                else:
                    free_from[i] = min(free_from[i], frame)
                    free_from[j] = min(free_from[j], frame)
        for i in range(n):
            if frame <= free_from[i] and until[i] > 0:
                for k in range(2):
                    place[i, k] = s_place[i, frame, k]
                    velocity[i, k] = s_velocity[i, frame, k]
                yaw[i] = s_yaw[i, frame]
                spin[i] = s_spin[i, frame]
            places[i, frame], velocities[i, frame] = place[i], velocity[i]
            turns[i, frame], spins[i, frame] = yaw[i], spin[i]
        if frame == n_frames - 1:
            break
        near = np.zeros((n, n), np.bool_)
        any_free = False
        for i in range(n):
            any_free |= exists[i] and frame >= free_from[i]
            for j in range(i + 1, n):
                if exists[i] and exists[j]:
                    dx, dy = place[i, 0] - place[j, 0], place[i, 1] - place[j, 1]
                    near[i, j] = dx * dx + dy * dy < 0.8**2
        if not any_free:
            step_number += STEPS_PER_FRAME
            continue
        for _ in range(STEPS_PER_FRAME):
            step_number += 1
            for i in range(n):
                if exists[i] and frame >= free_from[i]:
                    _slow_down(shape, velocity, spin, yaw, i)
            for sweep in range(2):
                hits = 0
                for i in range(n):
                    for j in range(i + 1, n):
                        if not near[i, j] or (frame < free_from[i] and frame < free_from[j]):
                            continue
                        used = met[i, j] and sweep == 0
                        if _meet(shape, place, velocity, yaw, spin, mass, i, j, rebound[i, j], used):
                            hits += 1
                            met[i, j] = True
                            if contact[i, j] == NO_CONTACT:
                                contact[i, j] = contact[j, i] = int(step_number / STEPS_PER_FRAME + 0.5)
                            free_from[i] = min(free_from[i], frame)
                            free_from[j] = min(free_from[j], frame)
                if hits < 2:  # one contact needs no second look; several may press on each other
                    break
            for i in range(n):
                if exists[i]:
                    for k in range(2):
                        place[i, k] += STEP * velocity[i, k]
                    yaw[i] += STEP * spin[i]
    return places, velocities, turns, spins, contact, free_from

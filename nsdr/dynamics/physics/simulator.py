"""A fast planar simulator of CLEVRER's physics: rigid bodies on the ground plane with Bullet's contact rule, compiled by Numba.

All objects stand upright at one height, so what Bullet does in space happens in the plane: they slide, lose speed, and cubes
spin. Bullet steps 0.004 s at a time and handles contacts at a distance: once the gap is below a threshold, the speed after a
contact is at most the rebound minus gap / step. So the same collision rebounds with anything from 0 to 0.64 of the approach
speed, depending on where in a step it falls. `rebound` replaces this rule for a pair by a given rebound at a given gap, so that
the motion is a smooth function of the initial state, as a fit needs it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.physics.contact_geometry import CUBE, FLAT, ROUND, SPHERE, outline_gap
from nsdr.dynamics.physics.numba_cache import cached_njit
from nsdr.world.physics_constants import (
    ANGULAR_DAMPING,
    CONTACT_THRESHOLD_WORLD,
    ERROR_REDUCTION,
    GRAVITY,
    GROUND_FRICTION,
    LINEAR_DAMPING,
    MIN_REBOUND_SPEED,
    PAIR_RESTITUTION,
    SPINNING_FRICTION,
    STEP_SECONDS,
    STEPS_PER_FRAME,
)

__all__ = ["NO_CONTACT", "BodyStates", "PrescribedMotion", "SimulatedMotion", "simulate"]

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]

NO_CONTACT = -1
"""Frame of the first contact of a pair that never touches."""
FIT_GAP_WORLD = 0.003
"""Gap at which given rebounds happen: the mean gap of Bullet's rule at usual speeds."""
_DECELERATION = GROUND_FRICTION["cube"] * GRAVITY
_SPINNING_DECELERATION = SPINNING_FRICTION * GRAVITY
"""Torque per mass by which the ground resists spinning (world units²/s²)."""
_INERTIA = 2 * (2 * ROUND) ** 2 / 12
"""Moment of inertia per mass; Bullet takes that of the bounding box (world units²)."""
_CORNER_WORLD = 0.07
"""How far a cube's corner extends beyond `ROUND` (world units, rounded up)."""
_STEP_REACH_WORLD = 0.03
"""Distance that two fast bodies cover in a step (world units, rounded up)."""
_NEAR_WORLD = 0.8
"""Centres farther apart than this at a frame's start do not touch within the frame."""
_SPIN_SLIDING_WORLD = 0.2
"""Lever (world units) by which spin adds to the speed over the ground in the test for rest."""
_MIN_SPIN_RAD_PER_S = 1e-3
"""Slower spin counts as none."""
_MAX_SWEEPS = 2
"""Passes over the contacts of a step: a second one where several press on each other."""


@dataclass(frozen=True)
class BodyStates:
    """State of the objects at the start of a run.

    Attributes:
        shape: (n,) int, index into `nsdr.world.vocabulary.SHAPES`.
        position: (n, 2) world units.
        velocity: (n, 2) world units per second.
        yaw, spin: (n,) radians, radians per second.
        mass: (n,) relative.
    """

    shape: IntArray
    position: FloatArray
    velocity: FloatArray
    yaw: FloatArray
    spin: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class PrescribedMotion:
    """Motion that objects keep until one that does not keep its own collides with them.

    Attributes:
        position, velocity: (n, F, 2) at every frame of a video.
        yaw, spin: (n, F).
        until: (n,) int, the frame from which each object is simulated; 0 for an object that is simulated from the start.
        collisions: (E, 3) int, (i, j, frame) of prescribed collisions in order of time. If either object is absent or already
            simulated by then, the other is simulated from the frame before.
    """

    position: FloatArray
    velocity: FloatArray
    yaw: FloatArray
    spin: FloatArray
    until: IntArray
    collisions: IntArray


@dataclass(frozen=True)
class SimulatedMotion:
    """Result of a run; zero before its first frame.

    Attributes:
        position, velocity: (n, F, 2).
        yaw, spin: (n, F).
        contact: (n, n) int, the frame of each pair's first contact, `NO_CONTACT` for none.
        free_from: (n,) int, the frame from which each object is simulated.
    """

    position: FloatArray
    velocity: FloatArray
    yaw: FloatArray
    spin: FloatArray
    contact: IntArray
    free_from: IntArray


def simulate(
    bodies: BodyStates,
    exists: NDArray[np.bool_],
    n_frames: int,
    rebound: FloatArray | None = None,
    prescribed: PrescribedMotion | None = None,
    start: int = 0,
) -> SimulatedMotion:
    """Run the bodies from frame `start` to frame `n_frames - 1`.

    Args:
        bodies: their state at frame `start`.
        exists: (n,) bool; the others are absent.
        n_frames: end of the run.
        rebound: (n, n) rebound of each pair as a share of its approach speed; NaN for Bullet's rule, None for it everywhere.
        prescribed: motion of objects until they are simulated.
        start: first frame.
    """
    n = len(bodies.shape)
    if rebound is None:
        rebound = np.full((n, n), np.nan)
    if prescribed is None:
        nothing = np.zeros((n, 1))
        prescribed = PrescribedMotion(
            np.zeros((n, 1, 2)),
            np.zeros((n, 1, 2)),
            nothing,
            nothing,
            np.zeros(n, np.int64),
            np.zeros((0, 3), np.int64),
        )
    motion = _run(
        np.asarray(bodies.shape, np.int64),
        np.array(bodies.position, float),
        np.array(bodies.velocity, float),
        np.array(bodies.yaw, float),
        np.array(bodies.spin, float),
        np.asarray(bodies.mass, float),
        np.asarray(exists, np.bool_),
        np.ascontiguousarray(rebound, float),
        np.ascontiguousarray(prescribed.position, float),
        np.ascontiguousarray(prescribed.velocity, float),
        np.ascontiguousarray(prescribed.yaw, float),
        np.ascontiguousarray(prescribed.spin, float),
        np.array(prescribed.until, np.int64),
        np.ascontiguousarray(prescribed.collisions, np.int64),
        start,
        n_frames,
    )
    return SimulatedMotion(*motion)


@cached_njit
def _slow_down(shape, velocity, spin, yaw, i):  # type: ignore[no-untyped-def]
    """Damping and friction of one step."""
    speed = np.sqrt(velocity[i, 0] ** 2 + velocity[i, 1] ** 2)
    loss = LINEAR_DAMPING * speed + LINEAR_DAMPING * speed * speed
    abs_spin = abs(spin[i])
    spin[i] -= STEP_SECONDS * ANGULAR_DAMPING * spin[i] * (1 + abs_spin)
    if shape[i] == SPHERE:
        if speed > 0:
            factor = 1 - STEP_SECONDS * loss / speed
            velocity[i, 0] *= factor
            velocity[i, 1] *= factor
        return
    if abs_spin < _MIN_SPIN_RAD_PER_S or speed + _SPIN_SLIDING_WORLD * abs_spin < STEP_SECONDS * _DECELERATION:
        factor = max(0.0, 1 - STEP_SECONDS * (loss + _DECELERATION) / speed) if speed > 0 else 0.0
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
        u = max(np.sqrt(ux * ux + uy * uy), 2 * STEP_SECONDS * _DECELERATION)
        gx, gy = -_DECELERATION / 4 * ux / u, -_DECELERATION / 4 * uy / u
        fx += gx
        fy += gy
        torque += rx * gy - ry * gx
    if speed > 0:
        velocity[i, 0] *= 1 - STEP_SECONDS * loss / speed
        velocity[i, 1] *= 1 - STEP_SECONDS * loss / speed
    velocity[i, 0] += STEP_SECONDS * fx
    velocity[i, 1] += STEP_SECONDS * fy
    spin[i] += STEP_SECONDS * torque / _INERTIA
    brake = STEP_SECONDS * _SPINNING_DECELERATION / _INERTIA
    spin[i] = np.copysign(max(abs(spin[i]) - brake, 0.0), spin[i])


@cached_njit
def _approach(shape, position, velocity, yaw, spin, i, j):  # type: ignore[no-untyped-def]
    """Gap, separation speed, normal from i to j, and the levers of the contact point's normal about both centres."""
    gap, nx, ny, px, py = outline_gap(shape, position, yaw, i, j)
    ix, iy = px - position[i, 0], py - position[i, 1]
    jx, jy = px - position[j, 0], py - position[j, 1]
    ux = velocity[j, 0] - spin[j] * jy - velocity[i, 0] + spin[i] * iy
    uy = velocity[j, 1] + spin[j] * jx - velocity[i, 1] - spin[i] * ix
    return gap, ux * nx + uy * ny, nx, ny, ix * ny - iy * nx, jx * ny - jy * nx


@cached_njit
def _advance(position, velocity, yaw, spin, i, j, seconds):  # type: ignore[no-untyped-def]
    for body in (i, j):
        for k in range(2):
            position[body, k] += seconds * velocity[body, k]
        yaw[body] += seconds * spin[body]


@cached_njit
def _collide(shape, position, velocity, yaw, spin, mass, i, j, given, used):  # type: ignore[no-untyped-def]
    """Apply the impulse of two bodies on each other if they touch in this step.

    With a given rebound it acts at a moment within the step, otherwise at its start. Returns whether they touched.
    """
    dx, dy = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1]
    reach = 2 * ROUND + _STEP_REACH_WORLD
    reach += (_CORNER_WORLD if shape[i] == CUBE else 0.0) + (_CORNER_WORLD if shape[j] == CUBE else 0.0)
    if dx * dx + dy * dy > reach * reach:
        return False
    gap, apart, nx, ny, ci, cj = _approach(shape, position, velocity, yaw, spin, i, j)
    before = 0.0
    if np.isnan(given):
        if gap > CONTACT_THRESHOLD_WORLD:
            return False
        wanted = -PAIR_RESTITUTION * apart if apart < -MIN_REBOUND_SPEED else 0.0
        wanted -= gap / STEP_SECONDS if gap > 0 else gap * ERROR_REDUCTION / STEP_SECONDS
    else:
        if apart >= 0 or gap + apart * STEP_SECONDS > FIT_GAP_WORLD:
            return False
        if gap > FIT_GAP_WORLD:  # up to the contact they move as before
            before = (gap - FIT_GAP_WORLD) / -apart
            _advance(position, velocity, yaw, spin, i, j, before)
            _, apart, nx, ny, ci, cj = _approach(shape, position, velocity, yaw, spin, i, j)
        wanted = 0.0 if used else -given * apart
    if wanted <= apart:
        _advance(position, velocity, yaw, spin, i, j, -before)
        return False
    spin_i = ci * ci / (_INERTIA * mass[i]) if shape[i] == CUBE else 0.0
    spin_j = cj * cj / (_INERTIA * mass[j]) if shape[j] == CUBE else 0.0
    impulse = (wanted - apart) / (1 / mass[i] + 1 / mass[j] + spin_i + spin_j)
    velocity[i, 0] -= impulse * nx / mass[i]
    velocity[i, 1] -= impulse * ny / mass[i]
    velocity[j, 0] += impulse * nx / mass[j]
    velocity[j, 1] += impulse * ny / mass[j]
    if shape[i] == CUBE:
        spin[i] -= impulse * ci / (_INERTIA * mass[i])
    if shape[j] == CUBE:
        spin[j] += impulse * cj / (_INERTIA * mass[j])
    _advance(position, velocity, yaw, spin, i, j, -before)
    return True


@cached_njit
def _run(  # type: ignore[no-untyped-def]
    shape,
    position,
    velocity,
    yaw,
    spin,
    mass,
    exists,
    rebound,
    s_position,
    s_velocity,
    s_yaw,
    s_spin,
    until,
    s_collisions,
    start,
    n_frames,
):
    n = len(shape)
    positions, velocities = np.zeros((n, n_frames, 2)), np.zeros((n, n_frames, 2))
    yaws, spins = np.zeros((n, n_frames)), np.zeros((n, n_frames))
    contact = np.full((n, n), NO_CONTACT)
    touched = np.zeros((n, n), np.bool_)
    free_from = until.copy()
    step_number = start * STEPS_PER_FRAME
    for frame in range(start, n_frames):
        for e in range(len(s_collisions)):
            i, j, when = s_collisions[e, 0], s_collisions[e, 1], s_collisions[e, 2]
            if when - 1 == frame:
                if exists[i] and exists[j] and frame < free_from[i] and frame < free_from[j]:
                    contact[i, j] = contact[j, i] = when
                    touched[i, j] = True
                else:
                    free_from[i] = min(free_from[i], frame)
                    free_from[j] = min(free_from[j], frame)
        for i in range(n):
            if frame <= free_from[i] and until[i] > 0:
                for k in range(2):
                    position[i, k] = s_position[i, frame, k]
                    velocity[i, k] = s_velocity[i, frame, k]
                yaw[i] = s_yaw[i, frame]
                spin[i] = s_spin[i, frame]
            positions[i, frame], velocities[i, frame] = position[i], velocity[i]
            yaws[i, frame], spins[i, frame] = yaw[i], spin[i]
        if frame == n_frames - 1:
            break
        near = np.zeros((n, n), np.bool_)
        any_free = False
        for i in range(n):
            any_free |= exists[i] and frame >= free_from[i]
            for j in range(i + 1, n):
                if exists[i] and exists[j]:
                    dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
                    near[i, j] = dx * dx + dy * dy < _NEAR_WORLD**2
        if not any_free:
            step_number += STEPS_PER_FRAME
            continue
        for _ in range(STEPS_PER_FRAME):
            step_number += 1
            for i in range(n):
                if exists[i] and frame >= free_from[i]:
                    _slow_down(shape, velocity, spin, yaw, i)
            for sweep in range(_MAX_SWEEPS):
                hits = 0
                for i in range(n):
                    for j in range(i + 1, n):
                        if not near[i, j] or (frame < free_from[i] and frame < free_from[j]):
                            continue
                        used = touched[i, j] and sweep == 0
                        if _collide(shape, position, velocity, yaw, spin, mass, i, j, rebound[i, j], used):
                            hits += 1
                            touched[i, j] = True
                            if contact[i, j] == NO_CONTACT:
                                contact[i, j] = contact[j, i] = int(step_number / STEPS_PER_FRAME + 0.5)
                            free_from[i] = min(free_from[i], frame)
                            free_from[j] = min(free_from[j], frame)
                if hits < 2:  # one contact needs no second look; several may press on each other
                    break
            for i in range(n):
                if exists[i]:
                    for k in range(2):
                        position[i, k] += STEP_SECONDS * velocity[i, k]
                    yaw[i] += STEP_SECONDS * spin[i]
    return positions, velocities, yaws, spins, contact, free_from

"""Resimulation of a released annotation from its first frame, which shows how closely the simulator follows CLEVRER's.

The annotation files hold no masses. They are estimated from the momentum exchanged in each collision, and refined until the
simulated positions are close to the annotated ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from nsdr.generate.physics.bullet import Body, BulletMotion, Simulator

FloatArray = NDArray[np.floating[Any]]
LOG_MASS_RATIO_STD = 0.24
"""Standard deviation of the log ratio of two masses uniform in 0.7-1.3; width of the prior."""
MAX_ERROR_WORLD = 0.5
"""Larger position errors count as this (world units)."""
MAX_DELAY_FRAMES = 10
"""Larger errors of a collision's frame, and missing and extra collisions, count as this (frames)."""
DELAY_WEIGHT = 0.02
"""Weight of a collision's error (frames) beside the position error (world units) in the cost of a fit."""
PRIOR_WEIGHT = 0.01
"""Weight of the prior in the cost of a fit."""
START_SCALES = (1.0, 0.5, 0.0)
"""The fit starts from the masses by momentum with their logarithms scaled by each of these; the best result is kept."""
SIMPLEX_SIZE = 0.1
"""Edge of the first Nelder-Mead simplex (log mass)."""
MOMENTUM_FRAMES = 2
"""Momentum is compared this many frames before and after a collision."""
MOMENTUM_PRIOR = 0.01
"""Weight of log mass 0 in the estimate by momentum; objects without collisions stay at mass 1."""
MAX_LOG_MASS = 0.6
"""Estimates by momentum are clipped to this absolute value (log mass); log(1.3 / 0.7) is 0.62."""


@dataclass(frozen=True)
class Resimulation:
    """A simulation compared with the annotation it started from.

    Attributes:
        mass: (n,) relative masses, 1 for the first colliding object.
        motion: the simulated motion and collisions.
        frames: (annotated frame, simulated frame or None) of each pair that collides in the annotation.
        extra: pairs that collide in the simulation only.
        error_world: (n, F) distance from the annotated positions on the ground (world units).
    """

    mass: FloatArray
    motion: BulletMotion
    frames: Mapping[tuple[int, int], tuple[int, int | None]]
    extra: tuple[tuple[int, int], ...]
    error_world: FloatArray


def resimulate(annotation: Mapping[str, Any], simulator: Simulator, evaluations: int = 40) -> Resimulation:
    """Simulate an annotation from frame 0, with fitted masses.

    Args:
        annotation: content of an annotation file, see `nsdr.clevrer.files.annotations.read_annotation`.
        simulator: a simulator with CLEVRER's parameters.
        evaluations: approximate max number of simulations for the refinement from each of `START_SCALES`.
    """
    frames = [sorted(frame["objects"], key=lambda o: o["object_id"]) for frame in annotation["motion_trajectory"]]
    bodies = [
        Body(
            p["shape"],
            tuple(row["location"]),
            tuple(row["orientation"]),
            tuple(row["velocity"]),
            tuple(row["angular_velocity"]),
        )
        for p, row in zip(annotation["object_property"], frames[0], strict=True)
    ]
    position = np.array([[row["location"][:2] for row in frame] for frame in frames]).swapaxes(0, 1)
    velocity = np.array([[row["velocity"][:2] for row in frame] for frame in frames]).swapaxes(0, 1)
    collisions: dict[tuple[int, int], int] = {}
    for c in annotation["collision"]:
        i, j = sorted(c["object_ids"])
        collisions.setdefault((i, j), c["frame_id"])

    def run(log_mass: FloatArray) -> Resimulation:
        mass = np.exp(log_mass)
        motion = simulator.run([replace(b, mass=float(m)) for b, m in zip(bodies, mass, strict=True)], len(frames))
        first: dict[tuple[int, int], int] = {}
        for contact in motion.contacts:
            first.setdefault(contact.bodies, contact.frame)
        error = np.linalg.norm(motion.location_world[..., :2] - position, axis=-1)
        pairs = {pair: (frame, first.get(pair)) for pair, frame in collisions.items()}
        return Resimulation(mass, motion, pairs, tuple(p for p in first if p not in collisions), error)

    start = _log_mass_by_momentum(velocity, collisions)
    free = sorted({i for pair in collisions for i in pair})[1:]
    if not free:
        return run(start)

    def with_free(x: FloatArray) -> FloatArray:
        log_mass = np.zeros(len(bodies))
        log_mass[free] = x
        return log_mass

    def cost(x: FloatArray) -> float:
        result = run(with_free(x))
        delays = [
            MAX_DELAY_FRAMES if b is None else min(abs(b - a), MAX_DELAY_FRAMES) for a, b in result.frames.values()
        ]
        delay = float(np.mean(delays)) + MAX_DELAY_FRAMES * len(result.extra)
        distance = float(np.minimum(result.error_world[[0, *free]], MAX_ERROR_WORLD).mean())
        return distance + DELAY_WEIGHT * delay + PRIOR_WEIGHT * float(np.mean((x / LOG_MASS_RATIO_STD) ** 2))

    fits = []
    for scale in START_SCALES:
        first = scale * start[free]
        simplex = np.vstack([first, first + SIMPLEX_SIZE * np.eye(len(free))])
        options = {"maxfev": evaluations, "initial_simplex": simplex}
        fits.append(minimize(cost, first, method="Nelder-Mead", options=options))
    return run(with_free(min(fits, key=lambda fit: float(fit.fun)).x))


def _log_mass_by_momentum(velocity: FloatArray, collisions: Mapping[tuple[int, int], int]) -> FloatArray:
    """Log masses (n,) relative to the first colliding object, from the velocities (n, F, 2) around each collision."""
    n, last = velocity.shape[0], velocity.shape[1] - 1
    rows, values = [], []
    for (i, j), frame in collisions.items():
        before, after = max(frame - MOMENTUM_FRAMES, 0), min(frame + MOMENTUM_FRAMES, last)
        change = np.linalg.norm(velocity[:, after] - velocity[:, before], axis=-1)
        if change[i] > 0 and change[j] > 0:
            row = np.zeros(n)
            row[i], row[j] = 1, -1
            rows.append(row)
            values.append(np.log(change[j] / change[i]))
    if not rows:
        return np.zeros(n)
    prior = MOMENTUM_PRIOR * np.eye(n)
    solution = np.linalg.lstsq(np.vstack([*rows, prior]), np.concatenate([values, np.zeros(n)]), rcond=None)[0]
    first = min(i for pair in collisions for i in pair)
    return np.asarray(np.clip(solution - solution[first], -MAX_LOG_MASS, MAX_LOG_MASS))

"""Simulating a released annotation again from its first frame: how closely the simulator follows the original one.

Masses are not in the files. They follow from the momentum exchanged in each collision, and are refined so that the
simulated positions come near the annotated ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from nsdr.generate.physics.bullet import Body, BulletMotion, Simulator

__all__ = ["Resimulation", "resimulate"]

FloatArray = NDArray[np.floating[Any]]
MASS_LOG_DEVIATION = 0.24
"""Of uniform(0.7, 1.3) masses' ratios: a weak prior."""
MAX_ERROR_WORLD, MAX_LATE_FRAMES = 0.5, 10
"""Beyond these a simulation is as wrong as can be."""


@dataclass(frozen=True)
class Resimulation:
    """A simulation beside the annotation it started from.

    Attributes:
        mass: (n,) relative masses, 1 for the first object.
        motion: the simulation.
        frames: for each annotated colliding pair, (annotated frame, simulated frame or None).
        extra: simulated collisions of pairs that do not collide in the annotation.
        error_world: (n, F) distance on the ground from the annotated positions.
    """

    mass: FloatArray
    motion: BulletMotion
    frames: Mapping[tuple[int, int], tuple[int, int | None]]
    extra: tuple[tuple[int, int], ...]
    error_world: FloatArray


def resimulate(annotation: Mapping[str, Any], simulator: Simulator, evaluations: int = 40) -> Resimulation:
    """Simulate an annotation file's content (see `nsdr.clevrer.read_annotation`) from frame 0, masses fitted.

    Args:
        annotation: checked content.
        simulator: with CLEVRER's parameters.
        evaluations: about how many simulations the masses' refinement may take, from each of three starts.
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
        late = [MAX_LATE_FRAMES if b is None else min(abs(b - a), MAX_LATE_FRAMES) for a, b in result.frames.values()]
        wrong = float(np.mean(late)) + MAX_LATE_FRAMES * len(result.extra)
        near = float(np.minimum(result.error_world[[0, *free]], MAX_ERROR_WORLD).mean())
        return near + 0.02 * wrong + 0.01 * float(np.mean((x / MASS_LOG_DEVIATION) ** 2))

    fits = []
    for scale in (1.0, 0.5, 0.0):
        first = scale * start[free]
        simplex = np.vstack([first, first + 0.1 * np.eye(len(free))])
        options = {"maxfev": evaluations, "initial_simplex": simplex}
        fits.append(minimize(cost, first, method="Nelder-Mead", options=options))
    return run(with_free(min(fits, key=lambda fit: float(fit.fun)).x))


def _log_mass_by_momentum(velocity: FloatArray, collisions: Mapping[tuple[int, int], int]) -> FloatArray:
    """(n,) log masses relative to the first colliding object, from velocities (n, F, 2) around each collision."""
    n, last = velocity.shape[0], velocity.shape[1] - 1
    rows, values = [], []
    for (i, j), frame in collisions.items():
        before, after = max(frame - 2, 0), min(frame + 2, last)
        change = np.linalg.norm(velocity[:, after] - velocity[:, before], axis=-1)
        if change[i] > 0 and change[j] > 0:
            row = np.zeros(n)
            row[i], row[j] = 1, -1
            rows.append(row)
            values.append(np.log(change[j] / change[i]))
    if not rows:
        return np.zeros(n)
    prior = 0.01 * np.eye(n)  # leaves objects that meet nothing at mass 1
    solution = np.linalg.lstsq(np.vstack([*rows, prior]), np.concatenate([values, np.zeros(n)]), rcond=None)[0]
    first = min(i for pair in collisions for i in pair)
    return np.asarray(np.clip(solution - solution[first], -0.6, 0.6))

"""States of the objects in a truth file, exact or with errors, as start states for Bullet."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.generate.physics.bullet import Body

VELOCITY_ERROR_PER_S, YAW_ERROR_PER_WORLD, LOG_MASS_ERROR_PER_WORLD = 1.5, 40.0, 25.0
"""Errors of velocities (world units/s), yaws (radians) and log masses that go with an error of 1 world unit in positions. Their
ratios are about those of the errors of the fitted simulator (`python -m benchmarks.precision` prints them), and of yaws in
`PhysicsConfig`."""


def states_at(truth: Mapping[str, Any], frame: int) -> NDArray[np.float64]:
    """(n, 13) location, Euler angles, velocity, angular velocity and mass of all objects of a truth file, by id.

    Args:
        truth: validated content of the file; it has four decimals.
        frame: of the file.
    """
    listed: tuple[list[Any], list[Any]] = truth["objects"], truth["frames"][frame]["objects"]
    objects, rows = (sorted(x, key=lambda o: int(o["object_id"])) for x in listed)
    states = [
        [*r["location"], *r["orientation"], *r["velocity"], *r["angular_velocity"], o["mass"]]
        for o, r in zip(objects, rows, strict=True)
    ]
    return np.array(states, float)


def disturbed(states: NDArray[np.float64], error_world: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """States (n, 13) with normally distributed errors. Objects at rest stay at rest.

    Args:
        states: see `states_at`.
        error_world: standard deviation of each coordinate of positions (world units). Velocities, yaws and masses have errors
            in proportion.
        rng: source of the errors.
    """
    states, n = states.copy(), len(states)
    moves = np.linalg.norm(states[:, 6:8], axis=1, keepdims=True) > 0
    states[:, 0:2] += error_world * rng.normal(size=(n, 2))
    states[:, 6:8] += error_world * VELOCITY_ERROR_PER_S * rng.normal(size=(n, 2)) * moves
    states[:, 5] += error_world * YAW_ERROR_PER_WORLD * rng.normal(size=n)
    states[:, 12] *= np.exp(error_world * LOG_MASS_ERROR_PER_WORLD * rng.normal(size=n))
    return states


def bodies_of(shapes: Sequence[str], states: NDArray[np.float64], materials: Sequence[str] | None = None) -> list[Body]:
    """Bodies of these shapes and materials in the states (n, 13) of `states_at`; None for the first material of the world."""
    words: Sequence[str | None] = [None] * len(shapes) if materials is None else materials
    bodies = []
    for shape, material, row in zip(shapes, words, states.tolist(), strict=True):
        location, orientation, velocity, spin = (tuple(row[k : k + 3]) for k in (0, 3, 6, 9))
        bodies.append(Body(shape, location, orientation, velocity, spin, row[12], material=material))
    return bodies

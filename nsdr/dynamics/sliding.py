"""Free sliding: the law of deceleration in closed form, and fits of it to stretches of a track.

CLEVRER's objects slide in straight lines and lose a + b v + c v² of their speed per second: a is friction times gravity (none
for spheres), b and c are Bullet's damping. Speeds come more exactly from such a fit than from differences of positions.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.world.physics_constants import FRAME_SECONDS, GRAVITY, GROUND_FRICTION, LINEAR_DAMPING

__all__ = ["fit_sliding", "slide"]

FloatArray = NDArray[np.floating[Any]]
MAX_SPEED_WORLD_PER_S = 6.0
"""Upper end of the tables; twice CLEVRER's fastest start."""
NOISE_WORLD = 0.01
"""Residuals beyond three times this noise are weighted down."""
ROUNDS = 8
"""Reweighted least-squares rounds of a fit."""
MIN_WEIGHT = 1e-3
"""Least weight of a position in a fit, so that it is never singular."""


@lru_cache(maxsize=4)
def _table(deceleration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speeds from 0 up, the time (s) until an object of that speed stops, and the distance it slides until then."""
    v = np.concatenate([np.linspace(0, 0.2, 400), np.linspace(0.2, MAX_SPEED_WORLD_PER_S, 1200)[1:]])
    middle, step = (v[1:] + v[:-1]) / 2, np.diff(v)
    loss = deceleration + LINEAR_DAMPING * middle + LINEAR_DAMPING * middle**2
    time, distance = np.cumsum(step / loss), np.cumsum(middle * step / loss)
    return v, np.concatenate([[0], time]), np.concatenate([[0], distance])


def slide(shape: str, speed: FloatArray, seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance that freely sliding objects cover (world units), and their speed afterwards (world units/s); broadcast.

    Args:
        shape: "cube", "sphere" or "cylinder".
        speed: at time 0 (world units/s).
        seconds: simulated time, positive for later and negative for earlier.
    """
    speed, seconds = np.broadcast_arrays(np.minimum(speed, MAX_SPEED_WORLD_PER_S), seconds)
    deceleration = GROUND_FRICTION[shape] * GRAVITY
    if deceleration == 0:
        # v / (1 + v) decays exponentially, and the distance is the logarithm of the (1 + v) lost.
        fastest = MAX_SPEED_WORLD_PER_S / (1 + MAX_SPEED_WORLD_PER_S)
        ratio = np.minimum(speed / (1 + speed) * np.exp(-LINEAR_DAMPING * seconds), fastest)
        final_speed = ratio / (1 - ratio)
        return (np.log1p(speed) - np.log1p(final_speed)) / LINEAR_DAMPING, final_speed
    v, time, distance = _table(deceleration)
    remaining = np.interp(speed, v, time) - seconds
    final_speed = np.interp(remaining, time, v)
    return np.interp(speed, v, distance) - np.interp(final_speed, v, distance), final_speed


def fit_sliding(
    shape: str, frame_index: NDArray[Any], location_world: FloatArray, weight: FloatArray, reference: float
) -> tuple[FloatArray, FloatArray, float]:
    """Robust fit of free sliding.

    Args:
        shape: "cube", "sphere" or "cylinder".
        frame_index: (N,) frames.
        location_world: (N, 2) measured positions.
        weight: (N,) weight of each position, 0-1.
        reference: frame that the result refers to.

    Returns:
        Position (2,) and velocity (2,) at the reference frame, and the weighted median distance of the measured positions.
    """
    seconds = (np.asarray(frame_index) - reference) * FRAME_SECONDS
    terms = np.stack([np.ones(len(seconds)), seconds], 1)
    position, velocity = np.zeros(2), np.zeros(2)
    weights = np.maximum(weight, MIN_WEIGHT)
    for k in range(ROUNDS):
        speed = float(np.hypot(*velocity))
        direction = velocity / speed if speed > 1e-6 else np.zeros(2)
        # How far the law falls short of constant velocity; zero in the first round, which fits a straight line.
        lag = (slide(shape, np.array(speed), seconds)[0] - speed * seconds)[:, None] * direction if k else 0.0
        root = np.sqrt(weights)[:, None]
        solution = np.linalg.lstsq(terms * root, (location_world - lag) * root, rcond=None)[0]
        position, velocity = solution[0], solution[1]
        residual = np.linalg.norm(location_world - lag - terms @ solution, axis=1)
        weights = np.maximum(weight, MIN_WEIGHT) / (1 + (residual / (3 * NOISE_WORLD)) ** 2)
    order = np.argsort(residual)
    share = np.cumsum(weight[order]) / max(weight.sum(), 1e-9)
    return position, velocity, float(residual[order[min(int(np.searchsorted(share, 0.5)), len(order) - 1)]])

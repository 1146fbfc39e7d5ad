"""Undisturbed motion: the law of deceleration in closed form, and fits of it to stretches of a track.

CLEVRER's objects slide in straight lines and lose a + b v + c v^2 of their speed a second: a is friction times gravity (none
for spheres), b and c are Bullet's damping. Speeds come much more exactly from such a fit than from differences of places.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.camera import FRAME_SECONDS

__all__ = ["fit_flight", "fly"]

FloatArray = NDArray[np.floating[Any]]
DAMPING = 0.04
"""b and c; recovered from the release's annotations."""
FRICTION = {"cube": 0.03 * 9.81, "cylinder": 0.03 * 9.81, "sphere": 0.0}
"""a, world units per second squared."""
FASTEST = 6.0
NOISE_WORLD = 0.01
"""Residuals beyond three times that count less and less."""
ROUNDS = 8


@lru_cache(maxsize=4)
def _table(friction: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speeds from 0 up; the time in which an object of that speed stops, and how far it slides until then."""
    v = np.concatenate([np.linspace(0, 0.2, 400), np.linspace(0.2, FASTEST, 1200)[1:]])
    middle, step = (v[1:] + v[:-1]) / 2, np.diff(v)
    loss = friction + DAMPING * middle + DAMPING * middle**2
    time, way = np.cumsum(step / loss), np.cumsum(middle * step / loss)
    return v, np.concatenate([[0], time]), np.concatenate([[0], way])


def fly(shape: str, speed: FloatArray, seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far undisturbed objects slide, and their speed then (broadcast).

    Args:
        shape: "cube", "sphere" or "cylinder".
        speed: at time 0, world units per second.
        seconds: later (positive) or earlier (negative).
    """
    speed, seconds = np.broadcast_arrays(np.minimum(speed, FASTEST), seconds)
    friction = FRICTION[shape]
    if friction == 0:
        # v / (1 + v) decays exponentially, and the way is the logarithm of (1 + v) lost.
        share = np.minimum(speed / (1 + speed) * np.exp(-DAMPING * seconds), FASTEST / (1 + FASTEST))
        then = share / (1 - share)
        return (np.log1p(speed) - np.log1p(then)) / DAMPING, then
    v, time, way = _table(friction)
    left = np.interp(speed, v, time) - seconds
    then = np.interp(left, time, v)
    return np.interp(speed, v, way) - np.interp(then, v, way), then


def fit_flight(
    shape: str, frame_index: NDArray[Any], location_world: FloatArray, weight: FloatArray, reference: float
) -> tuple[FloatArray, FloatArray, float]:
    """Robust fit of undisturbed motion.

    Args:
        shape: "cube", "sphere" or "cylinder".
        frame_index: (N,) frames.
        location_world: (N, 2) measured places.
        weight: (N,) trust in each, 0-1.
        reference: frame that the result is about.

    Returns:
        Place (2,) and velocity (2,) at the reference frame, and the weighted median distance of the measured places.
    """
    seconds = (np.asarray(frame_index) - reference) * FRAME_SECONDS
    terms = np.stack([np.ones(len(seconds)), seconds], 1)
    place, velocity = np.zeros(2), np.zeros(2)
    trust = np.maximum(weight, 1e-3)
    for k in range(ROUNDS):
        speed = float(np.hypot(*velocity))
        direction = velocity / speed if speed > 1e-6 else np.zeros(2)
        # What the law takes off a steady motion; zero in the first round, a straight line.
        lag = (fly(shape, np.array(speed), seconds)[0] - speed * seconds)[:, None] * direction if k else 0.0
        root = np.sqrt(trust)[:, None]
        solution = np.linalg.lstsq(terms * root, (location_world - lag) * root, rcond=None)[0]
        place, velocity = solution[0], solution[1]
        residual = np.linalg.norm(location_world - lag - terms @ solution, axis=1)
        trust = np.maximum(weight, 1e-3) / (1 + (residual / (3 * NOISE_WORLD)) ** 2)
    order = np.argsort(residual)
    share = np.cumsum(weight[order]) / max(weight.sum(), 1e-9)
    return place, velocity, float(residual[order[min(int(np.searchsorted(share, 0.5)), len(order) - 1)]])

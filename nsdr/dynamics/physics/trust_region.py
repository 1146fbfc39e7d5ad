"""Minimisation of the fit's objective by Gauss and Newton's steps within a trust region.

Differs from `scipy.optimize.least_squares`: the objective returns its gradient and curvature, and its steps are solved without
linear algebra libraries, so results do not depend on their threads.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.fit_objective import FitProblem, evaluate

__all__ = ["minimise", "trust_region_step"]

FloatArray = NDArray[np.floating[Any]]

FIRST_RADIUS = 1.0
"""First trust region (units of the parameters)."""
MIN_STEP = 1e-3
"""Steps shorter than this end the search (units of the parameters)."""
MIN_GAIN = 1e-4
"""Steps that lower the cost by a smaller share end the search."""
_RIDGE = 1e-9
"""Share of the largest curvature that is added to all, so that parameters without data stay where they are."""
_BOUNDARY = 0.1
"""A step may be this share longer or shorter than the trust region."""
_MULTIPLIERS = 10
"""Largest number of trials for a step at the boundary."""


@cached_njit
def _cholesky(matrix, added, factor):  # type: ignore[no-untyped-def]
    """Write the lower factor of a symmetric positive matrix with a number added to its diagonal to `factor`."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j] + (added if i == j else 0.0)
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(max(total, 1e-30)) if i == j else total / factor[j, j]


@cached_njit
def _solve_lower(factor, vector):  # type: ignore[no-untyped-def]
    """Solve for a vector (P,) in place, with a lower factor (P, P)."""
    for i in range(len(vector)):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]


@cached_njit
def _solve_upper(factor, vector):  # type: ignore[no-untyped-def]
    """The same with the transpose of a lower factor."""
    for i in range(len(vector) - 1, -1, -1):
        for k in range(i + 1, len(vector)):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@cached_njit
def _square(vector):  # type: ignore[no-untyped-def]
    total = 0.0
    for value in vector:
        total += value * value
    return total


@cached_njit
def trust_region_step(gradient, curvature, radius):  # type: ignore[no-untyped-def]
    """The step (P,) that lowers a quadratic model most and is at most about `radius` long (Moré and Sorensen, 1983)."""
    n, multiplier = len(gradient), 0.0
    factor, step, bent = np.empty((n, n)), np.empty(n), np.empty(n)
    for i in range(n):
        multiplier = max(multiplier, _RIDGE * curvature[i, i])
    for trial in range(_MULTIPLIERS):
        _cholesky(curvature, multiplier, factor)
        for i in range(n):
            step[i] = -gradient[i]
        _solve_lower(factor, step)
        _solve_upper(factor, step)
        length = np.sqrt(_square(step))
        if length <= radius * (1 + _BOUNDARY) and (trial == 0 or length >= radius * (1 - _BOUNDARY)):
            break
        for i in range(n):
            bent[i] = step[i]
        _solve_lower(factor, bent)
        change = length * length / _square(bent) * (length - radius) / radius
        multiplier = max(multiplier + change, multiplier / 10)
    return step


def minimise(p: FitProblem, x: FloatArray, n_frames: int, evaluations: int) -> tuple[FloatArray, float]:
    """Parameters (P,) of a local minimum near a start, and the mean loss there.

    Args:
        p: a `FitProblem`.
        x: (P,) start.
        n_frames: frames that are fitted.
        evaluations: maximum number of evaluations.
    """
    step, gradient, curvature = np.zeros_like(x), np.zeros_like(x), np.zeros((len(x), len(x)))
    cost, radius = float("inf"), FIRST_RADIUS
    for evaluation in range(evaluations):
        new_cost, new_gradient, new_curvature, _, _ = evaluate(p, x + step, n_frames)
        gain, length = cost - new_cost, float(np.sqrt(step @ step))
        promised = -gradient @ step - 0.5 * step @ curvature @ step
        if gain < 0.25 * promised:
            radius = 0.25 * length
        elif gain > 0.75 * promised and length > (1 - 2 * _BOUNDARY) * radius:
            radius *= 2
        done = length < MIN_STEP or (gain < MIN_GAIN * cost and gain >= 0.25 * promised)
        if gain > 0:
            x, cost, gradient, curvature = x + step, new_cost, new_gradient, new_curvature
        if done and evaluation > 0:
            break
        step = trust_region_step(gradient, curvature, radius)
    return x, cost

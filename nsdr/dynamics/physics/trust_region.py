"""Minimisation of the fit's objective by Gauss and Newton's steps within a trust region, compiled by Numba.

Differs from `scipy.optimize.least_squares`: the objective returns its gradient and curvature, and everything runs in one
compiled call, without linear algebra libraries, so results do not depend on their threads.
"""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.fit_objective import evaluate

__all__ = ["minimise", "trust_region_step"]

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
def _forward(factor, right):  # type: ignore[no-untyped-def]
    solution = right.copy()
    for i in range(len(right)):
        for k in range(i):
            solution[i] -= factor[i, k] * solution[k]
        solution[i] /= factor[i, i]
    return solution


@cached_njit
def _backward(factor, right):  # type: ignore[no-untyped-def]
    solution = right.copy()
    for i in range(len(right) - 1, -1, -1):
        for k in range(i + 1, len(right)):
            solution[i] -= factor[k, i] * solution[k]
        solution[i] /= factor[i, i]
    return solution


@cached_njit
def _dot(first, second):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(len(first)):
        total += first[i] * second[i]
    return total


@cached_njit
def trust_region_step(gradient, curvature, radius):  # type: ignore[no-untyped-def]
    """The step (P,) that lowers a quadratic model most and is at most about `radius` long (Moré and Sorensen, 1983)."""
    factor = np.zeros_like(curvature)
    multiplier = 0.0
    for i in range(len(gradient)):
        multiplier = max(multiplier, _RIDGE * curvature[i, i])
    step = np.zeros_like(gradient)
    for trial in range(_MULTIPLIERS):
        _cholesky(curvature, multiplier, factor)
        step = _backward(factor, _forward(factor, -gradient))
        length = np.sqrt(_dot(step, step))
        if length <= radius * (1 + _BOUNDARY) and (trial == 0 or length >= radius * (1 - _BOUNDARY)):
            break
        bent = _forward(factor, step)
        change = length * length / _dot(bent, bent) * (length - radius) / radius
        multiplier = max(multiplier + change, multiplier / 10)
    return step


@cached_njit
def minimise(p, x, n_frames, evaluations):  # type: ignore[no-untyped-def]
    """Parameters (P,) of a local minimum near a start, and the mean loss there.

    Args:
        p: a `FitProblem`.
        x: (P,) start.
        n_frames: frames that are fitted.
        evaluations: maximum number of evaluations.
    """
    step, gradient, curvature = np.zeros_like(x), np.zeros_like(x), np.zeros((len(x), len(x)))
    cost, radius = np.inf, FIRST_RADIUS
    for evaluation in range(evaluations):
        new = evaluate(p, x + step, n_frames)
        gain, promised, length = cost - new[0], -_dot(gradient, step), np.sqrt(_dot(step, step))
        for a in range(len(step)):
            promised -= 0.5 * step[a] * _dot(curvature[a], step)
        if gain < 0.25 * promised:
            radius = 0.25 * length
        elif gain > 0.75 * promised and length > (1 - 2 * _BOUNDARY) * radius:
            radius *= 2
        done = length < MIN_STEP or (gain < MIN_GAIN * cost and gain >= 0.25 * promised)
        if gain > 0:
            x, cost, gradient, curvature = x + step, new[0], new[1], new[2]
        if done and evaluation > 0:
            break
        step = trust_region_step(gradient, curvature, radius)
    return x, cost

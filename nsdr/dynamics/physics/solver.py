"""The solution of a fit: Gauss and Newton's steps within a trust region, and how far the fitted masses can be trusted.

Differs from `scipy.optimize.least_squares`: the objective returns its gradient and curvature, not its residuals.
"""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import CUBE
from nsdr.dynamics.physics.fit_objective import LOG_MASS, FitProblem, evaluate
from nsdr.validation import FloatArray
from nsdr.world.physics_constants import LOG_MASS_STD

FIRST_RADIUS = 1.0
"""First trust region (units of the parameters)."""
MIN_STEP = 1e-3
"""Steps shorter than this end the search (units of the parameters)."""
MIN_GAIN = 1e-4
"""Steps that lower the cost by a smaller share end the search."""
RIDGE = 1e-9
"""Share of the largest curvature that is added to all, so that parameters without data have one, and stay where they are."""
BOUNDARY = 0.1
"""A step may be this share longer or shorter than the trust region."""
MULTIPLIERS = 10
"""Largest number of trials for a step at the boundary."""
DATA_ERROR_SCALE = 5.0
"""How many times larger than assumed by the fit the errors of the data act: they are alike in neighbouring frames, and the
simulator is not exact. Chosen so that about 95 % of the errors of fitted mass ratios are within 1.645 standard deviations:
`python benchmarks/extensions.py DATA PROPOSALS --scenes 70 --errors`."""
MAX_COST = 1.0
"""A fit with a higher cost does not explain the video, so it says nothing about masses. Set on the same videos, where 63 of 70
fits cost less: without a limit (`inf`) the command prints 2.4 standard deviations in place of 1.6."""


@cached_njit
def trust_region_step(gradient, curvature, radius):  # type: ignore[no-untyped-def]
    """The step (P,) that lowers a quadratic model most and is at most about `radius` long (Moré and Sorensen, 1983)."""
    step, multiplier = np.zeros_like(gradient), RIDGE * np.diag(curvature).max()
    for trial in range(MULTIPLIERS):
        damped = curvature + multiplier * np.eye(len(gradient))
        step = np.linalg.solve(damped, -gradient)
        length = np.sqrt(step @ step)
        if length <= radius * (1 + BOUNDARY) and (trial == 0 or length >= radius * (1 - BOUNDARY)):
            break
        change = length * length / (step @ np.linalg.solve(damped, step)) * (length - radius) / radius
        multiplier = max(multiplier + change, multiplier / 10)
    return step


def minimise(p: FitProblem, x: FloatArray, n_frames: int, evaluations: int) -> tuple[FloatArray, float]:
    """Parameters (P,) of a local minimum near a start, and the mean loss there.

    Args:
        p: what is fitted.
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
        elif gain > 0.75 * promised and length > (1 - 2 * BOUNDARY) * radius:
            radius *= 2
        done = length < MIN_STEP or (gain < MIN_GAIN * cost and gain >= 0.25 * promised)
        if gain > 0:
            x, cost, gradient, curvature = x + step, new_cost, new_gradient, new_curvature
        if done and evaluation > 0:
            break
        step = trust_region_step(gradient, curvature, radius)
    return x, cost


def log_mass_covariance(problem: FitProblem, curvature: FloatArray, cost: float) -> FloatArray:
    """Covariance (n, n) of the errors of the fitted log masses, by Laplace's approximation.

    The data count as if their noise were `DATA_ERROR_SCALE` times that of the fit; priors count as they are. Masses that are
    not fitted, of objects without a collision, have the variance of the prior, as have all where the fit failed.

    Args:
        problem: of the fit.
        curvature: (P, P) of the mean loss at the solution.
        cost: the mean loss there.
    """
    result = LOG_MASS_STD**2 * np.eye(len(problem.shape))
    if cost > MAX_COST:
        return result
    deviation = problem.prior[:, 1] / problem.unit
    prior = np.where(np.isfinite(deviation), deviation, 1.0) ** -2.0 * np.isfinite(deviation)
    measured = problem.root_weight > 0
    n_data = 2 * int(measured.sum()) + 2 * int(measured[problem.shape == CUBE].sum())
    total = (n_data + np.count_nonzero(prior)) * np.asarray(curvature)
    prior = np.diag(np.minimum(prior, np.diagonal(total)))
    information = (total - prior) / DATA_ERROR_SCALE**2 + prior
    inverse = np.linalg.inv(information + RIDGE * float(information.max()) * np.eye(len(information)))
    at = np.flatnonzero(problem.parameters[:, 0] == LOG_MASS)
    of = problem.parameters[at, 1]
    result[np.ix_(of, of)] = inverse[np.ix_(at, at)] * LOG_MASS_STD**2
    return result

"""The optimiser of a fit, Gauss-Newton steps in a trust region, and the covariance of the fitted masses.

Unlike in `scipy.optimize.least_squares`, the objective returns its gradient and curvature instead of its residuals.
"""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.fit_objective import LOG_MASS, FitProblem, evaluate
from nsdr.validation import FloatArray

FIRST_RADIUS = 1.0
"""Initial radius of the trust region (units of the parameters)."""
MIN_STEP = 1e-3
"""A step shorter than this ends the search (units of the parameters)."""
MIN_GAIN = 1e-4
"""A step that lowers the cost by a smaller share of it ends the search."""
RIDGE = 1e-9
"""This share of the largest curvature is added to the whole diagonal, so that parameters without data have a curvature and keep
their values."""
BOUNDARY = 0.1
"""Relative tolerance of the length of a step at the boundary of the trust region."""
MULTIPLIERS = 10
"""Largest number of multipliers that are tried for a step at the boundary of the trust region."""
DATA_ERROR_SCALE = 5.0
"""Factor by which the errors of the data are effectively larger than the fit assumes, because they are correlated between
neighbouring frames and the simulator is not exact. Chosen so that about 95 % of the errors of fitted mass ratios are within
1.645 standard deviations: `python -m benchmarks.extensions DATA PROPOSALS --scenes 70 --errors`."""
MAX_COST = 1.0
"""A fit with a higher cost does not explain the video, so its masses are not used. Set on the videos of `DATA_ERROR_SCALE`,
where 63 of 70 fits cost less; without a limit (`inf`) the command prints 2.4 standard deviations instead of 1.6."""


@cached_njit
def trust_region_step(gradient, curvature, radius):  # type: ignore[no-untyped-def]
    """The step (P,) of length at most about `radius` that minimises the quadratic model (Moré and Sorensen, 1983).

    The step solves (curvature + multiplier · I) step = -gradient.
    """
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
    """Find a local minimum of the objective.

    Args:
        p: the problem.
        x: (P,) parameters at the start.
        n_frames: number of frames that are fitted.
        evaluations: maximum number of evaluations.

    Returns:
        The parameters (P,) at the minimum, and the mean loss there.
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


def log_mass_covariance(problem: FitProblem, curvature: FloatArray, cost: float, log_mass_std: float) -> FloatArray:
    """Covariance (n, n) of the errors of the fitted log masses, by the Laplace approximation.

    covariance = (information of the data / `DATA_ERROR_SCALE`² + information of the prior)⁻¹

    Masses of objects without a collision are not fitted and have the variance of the prior. If the fit failed, all masses have.

    Args:
        problem: the problem that was solved.
        curvature: (P, P) curvature of the mean loss at the solution.
        cost: mean loss at the solution.
        log_mass_std: standard deviation of the prior of log masses, which is the unit of their parameters.
    """
    result = log_mass_std**2 * np.eye(len(problem.body))
    if cost > MAX_COST:
        return result
    deviation = problem.prior[:, 1] / problem.unit
    prior = np.where(np.isfinite(deviation), deviation, 1.0) ** -2.0 * np.isfinite(deviation)
    measured = problem.root_weight > 0
    n_data = 2 * int(measured.sum()) + 2 * int(measured[problem.body["is_box"]].sum())
    total = (n_data + np.count_nonzero(prior)) * np.asarray(curvature)
    prior = np.diag(np.minimum(prior, np.diagonal(total)))
    information = (total - prior) / DATA_ERROR_SCALE**2 + prior
    inverse = np.linalg.inv(information + RIDGE * float(information.max()) * np.eye(len(information)))
    at = np.flatnonzero(problem.parameters[:, 0] == LOG_MASS)
    of = problem.parameters[at, 1]
    result[np.ix_(of, of)] = inverse[np.ix_(at, at)] * log_mass_std**2
    return result

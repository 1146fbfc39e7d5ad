"""How far the fitted masses can be trusted."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.physics.contact_geometry import CUBE
from nsdr.dynamics.physics.fit_objective import FitProblem
from nsdr.world.physics_constants import LOG_MASS_STD

__all__ = ["log_mass_covariance"]

FloatArray = NDArray[np.floating[Any]]
RIDGE = 1e-9
"""Share of the largest curvature that is added to all, so that parameters without data have one, too."""
DATA_ERROR_SCALE = 5.0
"""How many times larger than assumed by the fit the errors of the data act: they are alike in neighbouring frames, and the
simulator is not exact. Chosen so that about 95 % of the errors of fitted mass ratios are within 1.645 standard deviations:
`python benchmarks/extensions.py DATA PROPOSALS --scenes 70 --errors`."""
MAX_COST = 1.0
"""A fit with a higher cost does not explain the video, so it says nothing about masses. Set on the same videos, where 63 of 70
fits cost less: without a limit (`inf`) the command prints 2.4 standard deviations in place of 1.6."""


def log_mass_covariance(
    problem: FitProblem, names: Sequence[tuple[str, int, int]], curvature: FloatArray, cost: float
) -> FloatArray:
    """Covariance (n, n) of the errors of the fitted log masses, by Laplace's approximation.

    The data count as if their noise were `DATA_ERROR_SCALE` times that of the fit; priors count as they are. Masses that are
    not fitted, of objects without a collision, have the variance of the prior, as have all where the fit failed.

    Args:
        problem: of the fit.
        names: kind and objects of each parameter.
        curvature: (P, P) of the mean loss at the solution.
        cost: the mean loss there.
    """
    result = LOG_MASS_STD**2 * np.eye(len(problem.shape))
    if cost > MAX_COST:
        return result
    deviation = problem.prior[:, 1] / problem.unit
    prior = np.where(np.isfinite(deviation), deviation, 1.0) ** -2.0 * np.isfinite(deviation)
    per_object = np.diff(problem.first)
    n_data = 2 * int(per_object.sum()) + 2 * int(per_object[problem.shape == CUBE].sum())
    total = (n_data + np.count_nonzero(prior)) * np.asarray(curvature)
    prior = np.diag(np.minimum(prior, np.diagonal(total)))
    information = (total - prior) / DATA_ERROR_SCALE**2 + prior
    inverse = np.linalg.inv(information + RIDGE * float(information.max()) * np.eye(len(information)))
    at = [(k, i) for k, (kind, i, _) in enumerate(names) if kind == "log_mass"]
    for k, i in at:
        for m, j in at:
            result[i, j] = inverse[k, m] * problem.unit[k] * problem.unit[m]
    return result

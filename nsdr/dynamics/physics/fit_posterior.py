"""How well a fit knows its video: other runs, drawn from the posterior of its parameters."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.physics.fit_objective import FitProblem, evaluate
from nsdr.dynamics.physics.trust_region import lower_factor, solve_upper

__all__ = ["FitPosterior", "draw_runs"]

FloatArray = NDArray[np.floating[Any]]

HALVINGS = 3
"""A draw whose run explains the tracks much worse than its normal distribution says is halved this often, then given up."""
TOLERANCE = 3.0
"""How much worse: a draw's loss may rise by what the curvature promises, this many times."""


class FitPosterior(NamedTuple):
    """Normal distribution of a fit's parameters.

    Attributes:
        problem: what was fitted.
        x: (P,) parameters of the fit.
        n_frames: of the run.
    """

    problem: FitProblem
    x: FloatArray
    n_frames: int


def draw_runs(posterior: FitPosterior, normal: FloatArray, widening: float) -> tuple[FloatArray, FloatArray]:
    """Runs of drawn parameters, as differences from the fitted run.

    The covariance is the inverse of the summed loss's curvature (Gauss and Newton's), times the square of `widening`: residuals
    of following frames err alike, so that they say less than their number.

    Args:
        posterior: of the fit.
        normal: (R, P) standard normal numbers.
        widening: factor of all standard deviations.

    Returns:
        Differences (R, n, F, 6) of the states, and (R, n) of the log masses.
    """
    p, x, n_frames = posterior
    cost, _, curvature, states, _ = evaluate(p, x, n_frames)
    number = _residuals(p)
    factor = lower_factor(number * curvature)
    differences, log_mass = np.zeros((len(normal), *states.shape)), np.zeros((len(normal), len(p.shape)))
    massive = np.flatnonzero(p.log_mass_at >= 0)
    for k, draw in enumerate(normal):
        step = widening * solve_upper(factor, draw)
        for _ in range(HALVINGS + 1):
            drawn_cost, _, _, drawn, _ = evaluate(p, x + step, n_frames)
            promised = 0.5 * float(step @ curvature @ step)
            if drawn_cost - cost <= TOLERANCE * promised:
                differences[k] = drawn - states
                at = p.log_mass_at[massive]
                log_mass[k, massive] = step[at] * p.unit[at]
                break
            step = step / 2
    return differences, log_mass


def _residuals(p: FitProblem) -> int:
    """Number of residuals whose mean is the loss."""
    edges = np.isfinite(p.edges_px[:, 0]).sum()
    return int(2 * len(p.frame) + 2 * edges + np.isfinite(p.prior[:, 1]).sum())

"""How likely a collision is, by what the network says and by how well the fitted simulator explains the video with it."""

import math
from dataclasses import dataclass

import numpy as np

from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.dynamics.physics.trajectory_fit import TrajectoryFit
from nsdr.validation import Finite, NotNegative, Settings

__all__ = ["MAX_GAP_WORLD", "MAX_LOG_ODDS", "Evidence", "EvidenceWeights", "closest_gap", "log_odds"]

MAX_LOG_ODDS = 12.0
"""The network's log-odds are clamped to this: beyond, a probability of 0 or 1 says no more."""
MAX_LOG_RATIO = 3.0
"""Logarithms of ratios of costs are clamped to this."""
GOOD_COST = 0.4
"""Cost of a fit that explains a video half (`TrajectoryFitConfig.good_cost` is the same)."""
_MIN_COST = 1e-9
FAR_GAP_WORLD = 0.1
"""Bodies that stay this far apart do not nearly touch (world units)."""
MAX_GAP_WORLD = 0.3
"""Gaps are clamped to this (world units)."""
NEAREST_FRAMES = 3
"""Frames with the nearest centres in which the gap of outlines is measured."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for a collision, given the other collisions of its video.

    What the fits say is weighted by the share 0-1 to which the fit with the collision explains the video (1 / (1 + (cost /
    `GOOD_COST`)²)): one that did not converge is no evidence.

    Attributes:
        network: log-odds of the detector.
        gap: how close the bodies come in the run fitted with the collision (world units), weighted; 0 where they touch.
        fit: logarithm of the fit's cost without the collision, divided by that with it, weighted; down to 0 where the bodies
            stay `FAR_GAP_WORLD` apart in the run with it: such a run explains nothing by the collision.
    """

    network: float
    gap: float
    fit: float

    @classmethod
    def of(cls, pair: tuple[int, ...], probability: float, given: TrajectoryFit, without: TrajectoryFit) -> "Evidence":
        """Of two fits that differ in one collision.

        Args:
            pair: the objects.
            probability: of the detector.
            given: the fit with the collision.
            without: the fit without it.
        """
        trust, gap = 1 / (1 + (given.cost / GOOD_COST) ** 2), closest_gap(given, pair)
        ratio = math.log(max(without.cost, _MIN_COST) / max(given.cost, _MIN_COST))
        ratio = min(max(ratio, -MAX_LOG_RATIO), MAX_LOG_RATIO)
        return cls(log_odds(probability), trust * gap, trust * max(1 - gap / FAR_GAP_WORLD, 0.0) * ratio)


@dataclass(frozen=True)
class EvidenceWeights(Settings):
    """Weights of a logistic regression on `Evidence`, fitted on held-out scenes of `train`: `python benchmarks/collisions.py
    --proposals FILE.npz --truth FILE.json.gz --every 5 --weights` prints them.

    Attributes:
        bias: constant part.
        network: weight of the detector's log-odds.
        gap: weight of the gap (for a world unit), which speaks against the collision.
        fit: weight of the logarithm of the costs' ratio.
    """

    bias: Finite = 0.396
    network: NotNegative = 0.719
    gap: NotNegative = 31.1
    fit: NotNegative = 1.968

    def log_odds(self, evidence: Evidence) -> float:
        """Of the collision, by all evidence."""
        return self.bias + self.network * evidence.network - self.gap * evidence.gap + self.fit * evidence.fit

    def probability(self, evidence: Evidence) -> float:
        """Of the collision, by all evidence."""
        return (1 + math.tanh(self.log_odds(evidence) / 2)) / 2


def log_odds(probability: float) -> float:
    """Of a probability, within `MAX_LOG_ODDS`."""
    p = min(max(probability, 1e-12), 1 - 1e-12)
    return min(max(math.log(p / (1 - p)), -MAX_LOG_ODDS), MAX_LOG_ODDS)


def closest_gap(fit: TrajectoryFit, pair: tuple[int, ...]) -> float:
    """Smallest gap of two bodies' outlines during a fitted run (world units), up to `MAX_GAP_WORLD`; 0 where they touch."""
    if fit.motion.contact[pair] != NO_CONTACT:
        return 0.0
    i, j = pair
    motion = fit.motion
    apart = np.linalg.norm(motion.position[i] - motion.position[j], axis=-1)
    state = np.zeros((2, 6))
    gaps = [MAX_GAP_WORLD]
    for frame in np.argsort(apart)[:NEAREST_FRAMES].tolist():
        state[:, :2], state[:, 4] = motion.position[[i, j], frame], motion.yaw[[i, j], frame]
        gaps.append(float(outline_gap(fit.bodies.shape[[i, j]], state, 0, 1)[0]))
    return max(min(gaps), 0.0)

"""How likely a collision is, by what the network says and by how well the fitted simulator explains the video with it."""

import math
from dataclasses import dataclass

from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.dynamics.physics.trajectory_fit import TrajectoryFit

__all__ = ["MAX_LOG_ODDS", "Evidence", "EvidenceWeights", "log_odds"]

MAX_LOG_ODDS = 12.0
"""The network's log-odds are clamped to this: beyond, a probability of 0 or 1 says no more."""
MAX_LOG_RATIO = 3.0
"""Logarithms of ratios of costs are clamped to this."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for a collision, given the other collisions of its video.

    Attributes:
        network: log-odds of the detector.
        fit: logarithm of the fit's cost without the collision, divided by that with it. The costs of fits that explain nothing
            either way are alike, so they are no evidence.
        met_with: the bodies touch in the run that was fitted with the collision.
        met_without: the bodies touch in the run that was fitted without it.
    """

    network: float
    fit: float
    met_with: bool
    met_without: bool

    @classmethod
    def of(cls, pair: tuple[int, ...], probability: float, given: TrajectoryFit, without: TrajectoryFit) -> "Evidence":
        """Of two fits that differ in one collision.

        Args:
            pair: the objects.
            probability: of the detector.
            given: the fit with the collision.
            without: the fit without it.
        """
        ratio = math.log(max(without.cost, 1e-9) / max(given.cost, 1e-9))
        return cls(
            log_odds(probability),
            min(max(ratio, -MAX_LOG_RATIO), MAX_LOG_RATIO),
            bool(given.motion.contact[pair] != NO_CONTACT),
            bool(without.motion.contact[pair] != NO_CONTACT),
        )


@dataclass(frozen=True)
class EvidenceWeights:
    """Weights of a logistic regression on `Evidence`, fitted on held-out scenes of `train`: `python benchmarks/collisions.py
    --proposals FILE.npz --truth FILE.json.gz --weights` prints them.

    Attributes:
        bias: constant part.
        network: weight of the detector's log-odds.
        fit: weight of the logarithm of the costs' ratio.
        met_with: added if the bodies touch in the run fitted with the collision.
        met_without: added if they touch in the run fitted without it.
    """

    bias: float = 0.0
    network: float = 1.0
    fit: float = 1.0
    met_with: float = 0.0
    met_without: float = 0.0

    def log_odds(self, evidence: Evidence) -> float:
        """Of the collision, by all evidence."""
        e = evidence
        met = self.met_with * e.met_with + self.met_without * e.met_without
        return self.bias + self.network * e.network + self.fit * e.fit + met


def log_odds(probability: float) -> float:
    """Of a probability, within `MAX_LOG_ODDS`."""
    p = min(max(probability, 1e-12), 1 - 1e-12)
    return min(max(math.log(p / (1 - p)), -MAX_LOG_ODDS), MAX_LOG_ODDS)

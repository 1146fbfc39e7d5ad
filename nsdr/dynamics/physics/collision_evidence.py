"""How likely a collision is, by what the network says and by how well the fitted simulator explains the video with it."""

import math
from dataclasses import dataclass

import numpy as np

from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.dynamics.physics.trajectory_fit import TrajectoryFit

__all__ = ["MAX_GAP_WORLD", "MAX_LOG_ODDS", "Evidence", "EvidenceWeights", "closest_gap", "log_odds"]

MAX_LOG_ODDS = 12.0
"""The network's log-odds are clamped to this: beyond, a probability of 0 or 1 says no more."""
MAX_LOG_RATIO = 3.0
"""Logarithms of ratios of costs are clamped to this."""
MAX_GAP_WORLD = 0.3
"""Gaps are clamped to this (world units)."""
NEAREST_FRAMES = 3
"""Frames with the nearest centres in which the gap of outlines is measured."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for a collision, given the other collisions of its video.

    Attributes:
        network: log-odds of the detector.
        gap_with: how close the bodies come in the run that was fitted with the collision (world units); 0 where they touch.
        gap_without: the same in the run that was fitted without it.
        fit: logarithm of the fit's cost without the collision, divided by that with it; 0 where the bodies do not touch in the
            run with it, which then explains nothing. The costs of fits that fail either way are alike, so they are no evidence.
    """

    network: float
    gap_with: float
    gap_without: float
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
        gaps = closest_gap(given, pair), closest_gap(without, pair)
        ratio = math.log(max(without.cost, 1e-9) / max(given.cost, 1e-9)) if gaps[0] == 0 else 0.0
        return cls(log_odds(probability), *gaps, min(max(ratio, -MAX_LOG_RATIO), MAX_LOG_RATIO))


@dataclass(frozen=True)
class EvidenceWeights:
    """Weights of a logistic regression on `Evidence`, fitted on held-out scenes of `train`: `python benchmarks/collisions.py
    --proposals FILE.npz --truth FILE.json.gz --every 5 --weights` prints them.

    Attributes:
        bias: constant part.
        network: weight of the detector's log-odds.
        gap_with: weight of the gap with the collision (for a world unit).
        gap_without: weight of the gap without it (for a world unit).
        fit: weight of the logarithm of the costs' ratio.
    """

    bias: float = 0.0
    network: float = 1.0
    gap_with: float = -20.0
    gap_without: float = 0.0
    fit: float = 0.0

    def log_odds(self, evidence: Evidence) -> float:
        """Of the collision, by all evidence."""
        e = evidence
        gaps = self.gap_with * e.gap_with + self.gap_without * e.gap_without
        return self.bias + self.network * e.network + gaps + self.fit * e.fit


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

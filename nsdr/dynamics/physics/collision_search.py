"""The search for the collisions that explain a video best, by the evidence of the detector and of fitted simulations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.body_state import POSITION
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.dynamics.physics.trajectory_fit import GOOD_COST, TrajectoryFit, fit_trajectories
from nsdr.types import Event

Pair = tuple[int, ...]
"""Ids of two objects, the smaller one first."""
EventSet = frozenset[Event]
"""Collisions of one video. A pair may collide more than once."""
TRIED_FROM = 0.01
"""Candidates whose probability is between this and 1 - this are tried both ways. The others are accepted or rejected at
once."""
BIAS, NETWORK_WEIGHT, GAP_WEIGHT = 0.623, 0.636, -42.6
"""Weights of a logistic regression on `CollisionEvidence`, which has no unit: log-odds, and a gap in proportion to the sizes of
a world's objects. So they are the same in each world. Fitted on left-out scenes of `train`: `python -m benchmarks.collisions
--proposals FILE.npz --truth FILE.json.gz --every 5 --weights` prints them."""
MAX_LOG_ODDS = 12.0
"""The log-odds of the detector are clamped to ± this value."""
MAX_GAP_WORLD = 0.3
"""Upper limit to which gaps are clamped (world units in CLEVRER)."""
NEAREST_FRAMES = 3
"""Number of frames, those with the nearest centres, in which the gap between outlines is computed."""


@dataclass(frozen=True)
class CollisionEvidence:
    """The evidence for a collision, given the other collisions of the video.

    Attributes:
        network: log-odds by the detector.
        gap: smallest gap between the bodies in the run fitted with the collision (0 if they touch; world units in CLEVRER,
            elsewhere in proportion to the size of objects), times the weight 1 / (1 + (cost / `GOOD_COST`)²). So a fit that did
            not converge gives no evidence.
    """

    network: float
    gap: float

    @classmethod
    def of(cls, pair: Pair, probability: float, given: TrajectoryFit, size: float) -> "CollisionEvidence":
        """The evidence for a collision of a pair.

        Args:
            pair: ids of the two objects.
            probability: probability of the collision by the detector.
            given: the fit with the collision.
            size: see `nsdr.world.world.Scales`.
        """
        return cls(log_odds(probability), closest_gap(given, pair, size) / (1 + (given.cost / GOOD_COST) ** 2))

    @property
    def probability(self) -> float:
        """The probability of the collision by all evidence."""
        odds = BIAS + NETWORK_WEIGHT * self.network + GAP_WEIGHT * self.gap
        return (1 + math.tanh(odds / 2)) / 2


def log_odds(probability: float) -> float:
    """The log-odds of a probability, clamped to ± `MAX_LOG_ODDS`."""
    p = min(max(probability, 1e-12), 1 - 1e-12)
    return min(max(math.log(p / (1 - p)), -MAX_LOG_ODDS), MAX_LOG_ODDS)


def closest_gap(fit: TrajectoryFit, pair: Pair, size: float) -> float:
    """Smallest gap between two outlines in a fitted run, at most `MAX_GAP_WORLD`; 0 if the pair touches.

    It is in world units divided by `size` (see `nsdr.world.world.Scales`).
    """
    if _meet(fit, pair):
        return 0.0
    two = list(pair)
    apart = np.diff(fit.states[two, :, POSITION], axis=0)[0]
    nearest = np.argsort(np.linalg.norm(apart, axis=-1))[:NEAREST_FRAMES]
    gaps = [float(outline_gap(fit.bodies.body[two], fit.states[two, frame], 0, 1)[0]) for frame in nearest]
    return max(min(MAX_GAP_WORLD, *(gap / size for gap in gaps)), 0.0)


def _meet(fit: TrajectoryFit, pair: Pair) -> bool:
    """Whether a pair touches in a fitted run."""
    return bool(fit.contact[pair] != NO_CONTACT)


class CollisionSearch:
    """Fits of one video with different sets of collisions.

    Args:
        states: motion states of at least one object.
        candidates: possible collisions with their probabilities, in order of time.
        config: numbers of trials and restarts.

    Attributes:
        probability: probability of each candidate by the detector.
        uncertain: candidates that are tried both ways, the most uncertain first.
        probable: candidates that are more probable than not.
    """

    def __init__(
        self,
        states: MotionStates,
        candidates: Sequence[tuple[Event, float]],
        config: PhysicsConfig | None = None,
    ) -> None:
        self.states, self.config = states, config or PhysicsConfig()
        self.probability = dict(candidates)
        self.probable: EventSet = frozenset(event for event, p in candidates if p > 0.5)
        tried = [(abs(p - 0.5), event.objects, event) for event, p in candidates if TRIED_FROM < p < 1 - TRIED_FROM]
        self.uncertain = [event for _, _, event in sorted(tried, key=lambda one: one[:2])]
        self._fits: dict[EventSet, TrajectoryFit] = {}
        self._repeated: set[EventSet] = set()

    def can_try(self, collisions: EventSet) -> bool:
        """Whether the fit with these collisions exists already, or the number of trials permits another fit."""
        return collisions in self._fits or max(len(self._fits), 1) <= self.config.trials

    def fitted(self, collisions: EventSet, near: TrajectoryFit | None = None) -> TrajectoryFit:
        """The fit with these collisions. A new fit starts from the fit `near`, or from a first guess if that is None."""
        if collisions not in self._fits:
            self._fits[collisions] = self._fit(collisions, near)
        return self._fits[collisions]

    def _fit(self, collisions: EventSet, near: TrajectoryFit | None) -> TrajectoryFit:
        """Make a new fit."""
        return fit_trajectories(self.states, self.in_order(collisions), self.config.restarts, near)

    def in_order(self, collisions: EventSet) -> list[Event]:
        """The collisions in order of time; collisions in the same frame keep the order of the candidates."""
        return sorted((event for event in self.probability if event in collisions), key=lambda e: e.frame)

    def evidence(self, event: Event, chosen: EventSet) -> CollisionEvidence:
        """The evidence for a collision, given the other chosen collisions."""
        given, without, pair = chosen | {event}, chosen - {event}, event.objects
        first = self.fitted(chosen)
        if event not in chosen and _meet(first, pair):
            self.fitted(given, first)
        stuck = not _meet(self.fitted(given), pair) and _meet(self.fitted(without), pair)
        if stuck and given not in self._repeated:
            # The run without the collision has the contact nevertheless; only its rebound is not fitted.
            self._repeated.add(given)
            again = self._fit(given, self.fitted(without))
            if again.cost < self.fitted(given).cost:
                self._fits[given] = again
        return CollisionEvidence.of(pair, self.probability[event], self.fitted(given), self.states.world.scales.size)


class FoundCollisions(NamedTuple):
    """Result of `search_collisions`.

    Attributes:
        collisions: the chosen collisions of the video, in order of time.
        fit: the simulation fitted with the chosen collisions.
        candidates: all candidates with their probabilities: by all evidence, given the other collisions, for candidates that
            were tried both ways, and by the detector for the rest.
    """

    collisions: list[Event]
    fit: TrajectoryFit
    candidates: list[tuple[Event, float]]


def search_collisions(
    states: MotionStates, candidates: Sequence[tuple[Event, float]], config: PhysicsConfig | None = None
) -> FoundCollisions:
    """Find the collisions during a video and the simulation fitted with them.

    The search starts from the candidates that are more probable than not. Uncertain candidates are added or dropped one by one
    as long as the evidence, given the other collisions, favours the change.

    Args:
        states: motion states of at least one object.
        candidates: possible collisions with their probabilities, in order of time.
        config: numbers of trials and restarts; None for the defaults.
    """
    search = CollisionSearch(states, candidates, config)
    probability = dict(search.probability)
    chosen, seen, changed = search.probable, {search.probable}, True
    while changed:
        changed = False
        for event in search.uncertain:
            other = chosen ^ {event}
            if other in seen or not search.can_try(other):
                continue
            probability[event] = search.evidence(event, chosen).probability
            if (probability[event] > 0.5) != (event in chosen):
                chosen, changed = other, True
                seen.add(chosen)
    judged = [(event, probability[event]) for event, _ in candidates]
    return FoundCollisions(search.in_order(chosen), search.fitted(chosen), judged)

"""Which collisions explain a video best: the detector's evidence and that of fitted simulations are added up."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.contact_geometry import outline_gap
from nsdr.dynamics.physics.forces import POSITION
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.dynamics.physics.trajectory_fit import GOOD_COST, TrajectoryFit, fit_trajectories
from nsdr.types import Event

Pair = tuple[int, ...]
EventSet = frozenset[Event]
"""Of one video; a pair may collide more than once."""
TRIED_FROM = 0.01
"""Candidates with a probability between this and 1 minus this are tried both ways; the others are taken as they are."""
BIAS, NETWORK_WEIGHT, GAP_WEIGHT = 0.623, 0.636, -42.6
"""Weights of a logistic regression on `CollisionEvidence`, fitted on held-out scenes of `train`: `python
benchmarks/collisions.py --proposals FILE.npz --truth FILE.json.gz --every 5 --weights` prints them."""
MAX_LOG_ODDS = 12.0
"""The network's log-odds are clamped to this: beyond, a probability of 0 or 1 says no more."""
MAX_GAP_WORLD = 0.3
"""Gaps are clamped to this (world units)."""
NEAREST_FRAMES = 3
"""Frames with the nearest centres in which the gap of outlines is measured."""


@dataclass(frozen=True)
class CollisionEvidence:
    """What speaks for a collision, given the other collisions of its video.

    Attributes:
        network: log-odds of the detector.
        gap: how close the bodies come in the run fitted with the collision (world units); 0 where they touch. It is weighted by
            the share 0-1 to which the fit explains the video, 1 / (1 + (cost / `GOOD_COST`)²): one that did not converge says
            nothing.
    """

    network: float
    gap: float

    @classmethod
    def of(cls, pair: Pair, probability: float, given: TrajectoryFit) -> "CollisionEvidence":
        """Of a pair's collision with a probability by the detector, and the fit with it."""
        return cls(log_odds(probability), closest_gap(given, pair) / (1 + (given.cost / GOOD_COST) ** 2))

    @property
    def probability(self) -> float:
        """Of the collision, by all evidence."""
        odds = BIAS + NETWORK_WEIGHT * self.network + GAP_WEIGHT * self.gap
        return (1 + math.tanh(odds / 2)) / 2


def log_odds(probability: float) -> float:
    """Of a probability, within `MAX_LOG_ODDS`."""
    p = min(max(probability, 1e-12), 1 - 1e-12)
    return min(max(math.log(p / (1 - p)), -MAX_LOG_ODDS), MAX_LOG_ODDS)


def closest_gap(fit: TrajectoryFit, pair: Pair) -> float:
    """Smallest gap of two bodies' outlines during a fitted run (world units), up to `MAX_GAP_WORLD`; 0 where they touch."""
    if _meet(fit, pair):
        return 0.0
    two = list(pair)
    apart = np.diff(fit.states[two, :, POSITION], axis=0)[0]
    nearest = np.argsort(np.linalg.norm(apart, axis=-1))[:NEAREST_FRAMES]
    gaps = [float(outline_gap(fit.bodies.shape[two], fit.states[two, frame], 0, 1)[0]) for frame in nearest]
    return max(min(MAX_GAP_WORLD, *gaps), 0.0)


def _meet(fit: TrajectoryFit, pair: Pair) -> bool:
    return bool(fit.contact[pair] != NO_CONTACT)


class CollisionSearch:
    """Fits of one video with different collisions.

    Args:
        states: of at least one object.
        candidates: collisions with their probabilities, in order of time.
        config: number of trials and restarts.

    Attributes:
        probability: of each candidate, by the detector.
        uncertain: collisions that are tried both ways, the most uncertain first.
        probable: collisions that are more probable than not.
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
        """Whether a fit with these collisions is there already, or may still be made."""
        return collisions in self._fits or max(len(self._fits), 1) <= self.config.trials

    def fitted(self, collisions: EventSet, near: TrajectoryFit | None = None) -> TrajectoryFit:
        """The fit with these collisions; where it is new, it starts from `near`, None for a first guess."""
        if collisions not in self._fits:
            self._fits[collisions] = self._fit(collisions, near)
        return self._fits[collisions]

    def _fit(self, collisions: EventSet, near: TrajectoryFit | None) -> TrajectoryFit:
        return fit_trajectories(self.states, self.in_order(collisions), self.config.restarts, near)

    def in_order(self, collisions: EventSet) -> list[Event]:
        """The collisions in order of time, those of one frame in the order of the candidates."""
        return sorted((event for event in self.probability if event in collisions), key=lambda e: e.frame)

    def evidence(self, event: Event, chosen: EventSet) -> CollisionEvidence:
        """For a collision, given the others among the chosen ones."""
        given, without, pair = chosen | {event}, chosen - {event}, event.objects
        first = self.fitted(chosen)
        if event not in chosen and _meet(first, pair):
            self.fitted(given, first)
        stuck = not _meet(self.fitted(given), pair) and _meet(self.fitted(without), pair)
        if stuck and given not in self._repeated:
            # The run without the collision makes it all the same, and its rebound alone is not fitted.
            self._repeated.add(given)
            again = self._fit(given, self.fitted(without))
            if again.cost < self.fitted(given).cost:
                self._fits[given] = again
        return CollisionEvidence.of(pair, self.probability[event], self.fitted(given))


class FoundCollisions(NamedTuple):
    """Result of `search_collisions`.

    Attributes:
        collisions: those of the video, in order of time.
        fit: the simulation fitted with them.
        candidates: all candidates with their probabilities: by all evidence for those that were tried both ways, given the
            others; the detector's for the rest.
    """

    collisions: list[Event]
    fit: TrajectoryFit
    candidates: list[tuple[Event, float]]


def search_collisions(
    states: MotionStates, candidates: Sequence[tuple[Event, float]], config: PhysicsConfig | None = None
) -> FoundCollisions:
    """Collisions during the video, and the simulation fitted with them.

    Starting from those that are more probable than not, uncertain collisions are added and dropped one by one as long as the
    evidence, given the others, is for it.

    Args:
        states, candidates, config: see `CollisionSearch`.
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

"""Which collisions explain a video best: the detector's evidence and that of fitted simulations are added up."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

from msgspec import Meta

from nsdr.dynamics.motion_states import MeasurementConfig, MotionStates
from nsdr.dynamics.physics.collision_evidence import Evidence, EvidenceWeights
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.dynamics.physics.trajectory_fit import TrajectoryFit, TrajectoryFitConfig, fit_trajectories
from nsdr.types import Event
from nsdr.validation import Count, Settings

__all__ = ["CollisionSearch", "CollisionSearchConfig", "FoundCollisions", "search_collisions"]

Pair = tuple[int, ...]


@dataclass(frozen=True)
class CollisionSearchConfig(Settings):
    """How collisions are found by fitting.

    Attributes:
        min_probability: candidates that are more probable than this, and less than 1 minus this, are tried both ways; the
            others are taken as they are.
        trials: maximum number of fits beside the first.
        weights: of the evidence.
        fit: of the simulator.
    """

    min_probability: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.01
    trials: Count = 8
    weights: EvidenceWeights = field(default_factory=EvidenceWeights)
    fit: TrajectoryFitConfig = field(default_factory=TrajectoryFitConfig)


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


class CollisionSearch:
    """Fits of one video with different collisions.

    Args:
        states: of at least one object.
        candidates: collisions with their probabilities, in order of time.
        config: how to search.
        measurement: how far measured positions are trusted.

    Attributes:
        uncertain: pairs that are tried both ways, the most uncertain first.
        probable: pairs that collide more probably than not.
    """

    def __init__(
        self,
        states: MotionStates,
        candidates: Sequence[tuple[Event, float]],
        config: CollisionSearchConfig | None = None,
        measurement: MeasurementConfig | None = None,
    ) -> None:
        self.config = config or CollisionSearchConfig()
        self.states, self.measurement = states, measurement
        self.events = {event.objects: event for event, _ in candidates}
        self.probability = {event.objects: p for event, p in candidates}
        self.probable: frozenset[Pair] = frozenset(pair for pair, p in self.probability.items() if p > 0.5)
        low, high = self.config.min_probability, 1 - self.config.min_probability
        uncertain = sorted((abs(p - 0.5), pair) for pair, p in self.probability.items() if low < p < high)
        self.uncertain = [pair for _, pair in uncertain]
        self._fits: dict[frozenset[Pair], TrajectoryFit] = {}
        self._repeated: set[frozenset[Pair]] = set()

    @property
    def trials(self) -> int:
        """Number of fits beside the first."""
        return max(len(self._fits) - 1, 0)

    def can_try(self, pairs: frozenset[Pair]) -> bool:
        """Whether a fit with these collisions is there already, or may still be made."""
        return pairs in self._fits or self.trials < self.config.trials

    def fitted(self, pairs: frozenset[Pair], near: TrajectoryFit | None = None) -> TrajectoryFit:
        """The fit with these collisions; where it is new, it starts from `near`, None for a first guess."""
        if pairs not in self._fits:
            self._fits[pairs] = self._fit(pairs, near)
        return self._fits[pairs]

    def _fit(self, pairs: frozenset[Pair], near: TrajectoryFit | None) -> TrajectoryFit:
        return fit_trajectories(self.states, self.collisions(pairs), self.config.fit, self.measurement, near)

    def collisions(self, pairs: frozenset[Pair]) -> list[Event]:
        """The events of pairs, in order of time."""
        return sorted((self.events[pair] for pair in pairs), key=lambda e: e.frame)

    def evidence(self, pair: Pair, chosen: frozenset[Pair]) -> Evidence:
        """For a pair's collision, given the others among the chosen ones."""
        given, without = chosen | {pair}, chosen - {pair}
        first = self.fitted(chosen)
        if pair not in chosen and _meet(first, pair):
            self.fitted(given, first)
        stuck = _meet(self.fitted(without), pair) and not _meet(self.fitted(given), pair)
        if stuck and given not in self._repeated:
            # The run without the collision makes it all the same, and its rebound alone is not fitted.
            self._repeated.add(given)
            again = self._fit(given, self.fitted(without))
            if again.cost < self.fitted(given).cost:
                self._fits[given] = again
        return Evidence.of(pair, self.probability[pair], self.fitted(given), self.fitted(without))


def _meet(fit: TrajectoryFit, pair: Pair) -> bool:
    return bool(fit.motion.contact[pair] != NO_CONTACT)


def search_collisions(
    states: MotionStates,
    candidates: Sequence[tuple[Event, float]],
    config: CollisionSearchConfig | None = None,
    measurement: MeasurementConfig | None = None,
) -> FoundCollisions:
    """Collisions during the video, and the simulation fitted with them.

    Starting from those that are more probable than not, uncertain collisions are added and dropped one by one as long as the
    evidence (`EvidenceWeights`), given the others, is for it.

    Args:
        states: of at least one object.
        candidates: collisions with their probabilities, in order of time.
        config: how to search.
        measurement: how far measured positions are trusted.
    """
    search = CollisionSearch(states, candidates, config, measurement)
    probability = dict(search.probability)
    chosen, seen, changed = search.probable, {search.probable}, True
    while changed:
        changed = False
        for pair in search.uncertain:
            other = chosen ^ {pair}
            if other in seen or not search.can_try(other):
                continue
            probability[pair] = search.config.weights.probability(search.evidence(pair, chosen))
            collides = probability[pair] > 0.5
            if collides != (pair in chosen):
                chosen, changed = other, True
                seen.add(chosen)
    candidates = [(event, probability[event.objects]) for event, _ in candidates]
    return FoundCollisions(search.collisions(chosen), search.fitted(chosen), candidates)

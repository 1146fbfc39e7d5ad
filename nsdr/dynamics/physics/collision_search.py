"""Which collisions explain a video best: candidates are judged by how well a simulation with them fits the tracks."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from nsdr.dynamics.motion_states import MeasurementConfig, MotionStates
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.dynamics.physics.trajectory_fit import TrajectoryFit, TrajectoryFitConfig, fit_trajectories
from nsdr.io.validation import COUNT, NOT_NEGATIVE, check_ranges
from nsdr.types import Event

__all__ = ["CollisionSearchConfig", "search_collisions"]


@dataclass(frozen=True)
class CollisionSearchConfig:
    """How collisions are found by fitting. The limits were set on left-out scenes of `train`.

    Attributes:
        doubt: candidates with a probability in (doubt, 1 - doubt) are tried both ways; the others are taken as they are.
        min_gain: a further collision that is less probable than not must lower the fit's cost by this much.
        max_loss: without a collision in which the fitted objects do not touch, and with a probable one in which they do, the
            cost may rise by at most this much.
        trials: maximum number of fits beside the first.
        fit: of the simulator.
    """

    doubt: float = 0.01
    min_gain: float = 0.3
    max_loss: float = 0.1
    trials: int = 8
    fit: TrajectoryFitConfig = field(default_factory=TrajectoryFitConfig)

    def __post_init__(self) -> None:
        check_ranges(self, doubt=(0.0, 0.5), min_gain=NOT_NEGATIVE, max_loss=NOT_NEGATIVE, trials=COUNT)


def search_collisions(
    states: MotionStates,
    candidates: Sequence[tuple[Event, float]],
    config: CollisionSearchConfig | None = None,
    measurement: MeasurementConfig | None = None,
) -> tuple[list[Event], TrajectoryFit]:
    """Collisions during the video, and the simulation fitted with them.

    A doubtful collision is dropped when the fitted objects do not touch and the tracks are explained as well without it; one
    is added when the objects touch and the tracks are explained much better with it, or as well if it is probable.

    Args:
        states: of at least one object.
        candidates: collisions with their probabilities, in order of time.
        config: how to search.
        measurement: how far measured positions are trusted.
    """
    config = config or CollisionSearchConfig()
    events = {event.objects: event for event, _ in candidates}
    chosen = {event.objects for event, p in candidates if p > 0.5}

    probable = set(chosen)

    def fitted(pairs: set[tuple[int, ...]], start: TrajectoryFit | None = None) -> TrajectoryFit:
        collisions = sorted((events[p] for p in pairs), key=lambda e: e.frame)
        return fit_trajectories(states, collisions, config.fit, measurement, start)

    current = fitted(chosen)
    doubtful = sorted((abs(p - 0.5), e.objects) for e, p in candidates if config.doubt < p < 1 - config.doubt)
    tried = {(frozenset(chosen), False)}
    changed = True
    while changed:
        changed = False
        for _, pair in doubtful:
            touch, listed = current.motion.contact[pair] != NO_CONTACT, pair in chosen
            other = chosen ^ {pair}
            settled = touch if listed else not touch and current.cost < config.fit.good_cost
            from_current = touch and not listed  # the collision is in the run already, its rebound is not fitted
            attempt = (frozenset(other), from_current)
            if settled or attempt in tried or len(tried) > config.trials:
                continue
            tried.add(attempt)
            trial = fitted(other, current if from_current else None)
            if listed:
                better = trial.cost < current.cost + config.max_loss
            else:
                margin = config.max_loss if pair in probable else -config.min_gain
                better = trial.motion.contact[pair] != NO_CONTACT and trial.cost < current.cost + margin
            if better:
                chosen, current, changed = other, trial, True
    return sorted((events[p] for p in chosen), key=lambda e: e.frame), current

"""Which collisions explain a video best: candidates are judged by how well a simulation with them fits the tracks."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from nsdr.dynamics.fit import FitConfig, FittedMotion, fit_motion
from nsdr.dynamics.planar import NO_CONTACT
from nsdr.dynamics.states import MotionStates
from nsdr.types import Event

__all__ = ["ExplainConfig", "explain"]


@dataclass(frozen=True)
class ExplainConfig:
    """How collisions are found by fitting. The limits were set on left-out scenes of the `train` part.

    Attributes:
        doubt: candidates less probable than this, or more than 1 - doubt, are taken as they are; the others are tried.
        least_gain: the fit's cost must fall by so much for a further collision.
        most_loss: and rise by no more than this without a collision that the fitted objects do not meet in.
        trials: fits beside the first, at most.
        fit: of the fits.
    """

    doubt: float = 0.01
    least_gain: float = 0.3
    most_loss: float = 0.1
    trials: int = 4
    fit: FitConfig = field(default_factory=FitConfig)


def explain(
    states: MotionStates,
    candidates: Sequence[tuple[Event, float]],
    config: ExplainConfig | None = None,
) -> tuple[list[Event], FittedMotion]:
    """Collisions during the video, and the run that fits.

    A doubtful collision goes when the fitted objects do not meet and the tracks are explained as well without; one is
    added when the objects meet and the tracks are explained much better with it.

    Args:
        states: of at least one object.
        candidates: collisions with their probabilities, in order of time.
        config: how to search.
    """
    config = config or ExplainConfig()
    events = {event.objects: event for event, _ in candidates}
    chosen = {event.objects for event, p in candidates if p > 0.5}

    def fitted(pairs: set[tuple[int, ...]]) -> FittedMotion:
        return fit_motion(states, sorted((events[p] for p in pairs), key=lambda e: e.frame), config.fit)

    best = current = fitted(chosen)
    doubtful = sorted((abs(p - 0.5), e.objects) for e, p in candidates if config.doubt < p < 1 - config.doubt)
    tried = {frozenset(chosen)}
    changed = True
    while changed:
        changed = False
        for _, pair in doubtful:
            met, listed = current.motion.contact[pair] != NO_CONTACT, pair in chosen
            other = chosen ^ {pair}
            settled = met if listed else not met and current.cost < config.fit.good_cost
            if settled or frozenset(other) in tried or len(tried) > config.trials:
                continue
            tried.add(frozenset(other))
            trial = fitted(other)
            if listed:
                better = trial.cost < current.cost + config.most_loss
            else:
                better = trial.motion.contact[pair] != NO_CONTACT and trial.cost < current.cost - config.least_gain
            if better:
                chosen, current, changed = other, trial, True
            best = min(best, trial, key=lambda fit: fit.cost)
    return sorted((events[p] for p in chosen), key=lambda e: e.frame), best

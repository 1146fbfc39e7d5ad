"""The causal graph of observed events (paper, section 3.3)."""

from collections.abc import Sequence

from nsdr.types import Event

__all__ = ["ancestor_sets", "direct_causes"]


def direct_causes(events: Sequence[Event]) -> list[list[int]]:
    """For each event (in order of time) the indices of its direct causes.

    Every object has a line of events in order of time; the causes of an event are its immediate predecessors on the
    lines of its objects.
    """
    latest: dict[int, int] = {}
    causes: list[list[int]] = []
    for index, event in enumerate(events):
        causes.append(sorted({latest[i] for i in event.objects if i in latest}))
        latest.update(dict.fromkeys(event.objects, index))
    return causes


def ancestor_sets(events: Sequence[Event]) -> dict[int, int]:
    """All (transitive) causes of each event, as bit sets by the event's bit: bit i stands for `events[i]`."""
    ancestors: list[int] = []
    for causes in direct_causes(events):
        bits = 0
        for cause in causes:
            bits |= ancestors[cause] | 1 << cause
        ancestors.append(bits)
    return {1 << index: bits for index, bits in enumerate(ancestors)}

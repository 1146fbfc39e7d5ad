"""The causal graph of observed events (paper, section 3.3)."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence

from nsdr.types import Event


def direct_causes(events: Sequence[Event]) -> list[list[int]]:
    """Indices of the direct causes of each event: for each of its objects, the latest earlier event of that object.

    Args:
        events: in order of time.
    """
    latest: dict[int, int] = {}
    causes: list[list[int]] = []
    for index, event in enumerate(events):
        causes.append(sorted({latest[i] for i in event.objects if i in latest}))
        latest.update(dict.fromkeys(event.objects, index))
    return causes


def ancestor_sets(events: Sequence[Event]) -> list[set[int]]:
    """Indices of the direct and indirect causes of each event.

    Args:
        events: in order of time.
    """
    ancestors: list[set[int]] = []
    for causes in direct_causes(events):
        ancestors.append(set(causes).union(*(ancestors[cause] for cause in causes)))
    return ancestors


def causal_path(events: Sequence[Event], starts: Callable[[Event], bool], target: Event) -> list[Event] | None:
    """The shortest chain of direct causes that ends in an event; None if there is none.

    Args:
        events: in order of time.
        starts: whether a chain may start at an event.
        target: one of the events. If `starts` accepts it, the chain consists of it alone.
    """
    causes = direct_causes(events)
    end = events.index(target)
    effect: dict[int, int | None] = {end: None}  # the next event of the shortest chain from each event that was reached
    frontier = deque([end])
    while frontier:
        index = frontier.popleft()
        if starts(events[index]):
            return [events[i] for i in _chain(index, effect)]
        for cause in causes[index]:
            if cause not in effect:
                effect[cause] = index
                frontier.append(cause)
    return None


def _chain(start: int, effect: Mapping[int, int | None]) -> Iterator[int]:
    index: int | None = start
    while index is not None:
        yield index
        index = effect[index]

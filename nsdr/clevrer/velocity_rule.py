"""The released executor's rule that detects collisions from motion alone (its variant NE), on samples of prediction files."""

from collections.abc import Sequence

from nsdr.types import Event

__all__ = ["GridPath", "GridPosition", "velocity_collisions"]

GridPosition = tuple[float, float]
"""Position (row, column) on the 100x150 grid."""
GridPath = dict[int, GridPosition]
"""Grid position by sample frame."""

MIN_CHANGE_GRID_PER_FRAME, MAX_CHANGE_GRID_PER_FRAME = 0.1, 5.0
"""Range of velocity changes that count as a collision (grid units per frame). Source: the released executor."""
PARTNER_DISTANCE_GRID = 20.0
"""Distance between two objects from which on they do not collide (grid units). Source: the released executor."""


def velocity_collisions(paths: Sequence[GridPath]) -> list[Event]:
    """Detect collisions from motion alone (NE).

    An object collides at samples where its change of velocity is a strict local maximum between 0.1 and 5 grid units per
    frame, except the first and last sample. Its partner is the nearest visible object closer than 20 grid units.

    Args:
        paths: grid positions of each object, in order of id.

    Returns:
        One event per pair, in order of detection: by object, then by frame.
    """
    found: dict[tuple[int, int], int] = {}
    for i, path in enumerate(paths):
        times = sorted(path)
        changes = {}
        for before, now, after in zip(times, times[1:], times[2:], strict=False):
            ahead = [(b - a) / (after - now) for a, b in zip(path[now], path[after], strict=True)]
            behind = [(b - a) / (now - before) for a, b in zip(path[before], path[now], strict=True)]
            changes[now] = ((ahead[0] - behind[0]) ** 2 + (ahead[1] - behind[1]) ** 2) ** 0.5
        for before, now, after in zip(times, times[1:], times[2:], strict=False):
            change = changes[now]
            if not MIN_CHANGE_GRID_PER_FRAME < change < MAX_CHANGE_GRID_PER_FRAME:
                continue
            if change <= changes.get(before, 0.0) or change <= changes.get(after, 0.0):
                continue
            partner = _nearest(paths, i, now)
            if partner is not None:
                found.setdefault((min(i, partner), max(i, partner)), now)
    return [Event("collision", frame, pair) for pair, frame in found.items()]


def _nearest(paths: Sequence[GridPath], i: int, time: int) -> int | None:
    x, y = paths[i][time]
    distances = [
        ((p[time][0] - x) ** 2 + (p[time][1] - y) ** 2, j) for j, p in enumerate(paths) if j != i and time in p
    ]
    nearest = min(distances, default=(PARTNER_DISTANCE_GRID**2, -1))
    return nearest[1] if nearest[0] < PARTNER_DISTANCE_GRID**2 else None

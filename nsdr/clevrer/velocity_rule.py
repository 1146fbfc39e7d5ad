"""The released executor's velocities on samples of prediction files, and its rule that detects collisions from them (NE)."""

from collections.abc import Sequence
from itertools import pairwise
from math import dist

from nsdr.types import Event

__all__ = ["GridPath", "GridPosition", "sampled_velocity", "velocity_collisions"]

GridPosition = tuple[float, float]
"""Position (row, column) on the 100x150 grid."""
GridPath = dict[int, GridPosition]
"""Grid position by sample frame."""

MIN_CHANGE_GRID_PER_FRAME, MAX_CHANGE_GRID_PER_FRAME = 0.1, 5.0
"""Range of velocity changes that count as a collision (grid units per frame). Source: the released executor."""
PARTNER_DISTANCE_GRID = 20.0
"""Distance between two objects from which on they do not collide (grid units). Source: the released executor."""


def sampled_velocity(path: GridPath, frame: int, step: int) -> GridPosition:
    """Velocity (grid units per frame) at a sample: the mean of the differences to the samples before and after.

    Args:
        path: an object's positions.
        frame: the sample.
        step: frames from one sample to the next.

    Returns:
        Without a sample before or after, the difference to the other one; without both, zero.
    """
    pairs = [(path[a], path[b]) for a, b in ((frame - step, frame), (frame, frame + step)) if a in path and b in path]
    if not pairs:
        return 0.0, 0.0
    rows, columns = zip(*(((b[0] - a[0]) / step, (b[1] - a[1]) / step) for a, b in pairs), strict=True)
    return sum(rows) / len(pairs), sum(columns) / len(pairs)


def velocity_collisions(paths: Sequence[GridPath], step: int) -> list[Event]:
    """Detect collisions from motion alone (NE).

    An object's change of velocity at a sample is the distance between its velocities there and at its sample before. It
    collides where that change is a strict local maximum between 0.1 and 5 grid units per frame, except at its first and last
    sample. Its partner is the nearest visible object closer than 20 grid units.

    Args:
        paths: grid positions of each object, in order of id.
        step: frames from one sample to the next.

    Returns:
        One event per pair, in order of detection: by object, then by frame.
    """
    found: dict[tuple[int, int], int] = {}
    for i, path in enumerate(paths):
        frames = sorted(path)
        velocities = [sampled_velocity(path, frame, step) for frame in frames]
        changes = [0.0, *(dist(a, b) for a, b in pairwise(velocities))]
        for before, frame, change, after in zip(changes, frames[1:], changes[1:], changes[2:], strict=False):
            if max(before, after, MIN_CHANGE_GRID_PER_FRAME) < change < MAX_CHANGE_GRID_PER_FRAME:
                partner = _nearest(paths, i, frame)
                if partner is not None:
                    found.setdefault((min(i, partner), max(i, partner)), frame)
    return [Event("collision", frame, pair) for pair, frame in found.items()]


def _nearest(paths: Sequence[GridPath], i: int, frame: int) -> int | None:
    distances = [(dist(p[frame], paths[i][frame]), j) for j, p in enumerate(paths) if j != i and frame in p]
    distance, nearest = min(distances, default=(PARTNER_DISTANCE_GRID, None))
    return nearest if distance < PARTNER_DISTANCE_GRID else None

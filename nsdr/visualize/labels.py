"""Labels of a Matplotlib figure that cover neither each other nor what is drawn."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["place_labels"]

DISTANCES_PT = (12, 22, 34, 50, 70, 95)
"""Distances between a label and its point that are tried (points)."""
DIRECTIONS = 16
"""Number of directions that are tried at each distance."""
LEADER_FROM_PT = 30
"""Labels that are farther than this from their point get a line to it (points)."""
PADDING_PX = 2.0
"""Space around a label (pixels of the figure)."""
COSTS = {"label": 100.0, "outside": 100.0, "mark": 20.0, "line": 3.0}
"""What it costs a label to cover another label, to lie outside of the axes, to cover a mark, and to cover a point of a line;
a point of distance costs 0.1."""


def place_labels(
    axes: Any,
    labels: Sequence[tuple[str, tuple[float, float], dict[str, Any]]],
    lines: Sequence[NDArray[np.floating[Any]]],
) -> None:
    """Write labels beside their points, each in the free place that is nearest, the first ones first.

    Args:
        axes: Matplotlib axes whose limits are final.
        labels: (text, point in data coordinates, keyword arguments of the text); the points are marks, not to be covered.
        lines: (N, 2) points in data coordinates of what is better not covered.
    """
    figure = axes.figure
    figure.draw_without_rendering()
    pixels = figure.dpi / 72
    window = axes.get_window_extent()
    points = [axes.transData.transform(point) for _, point, _ in labels]
    dense = [axes.transData.transform(line[np.isfinite(line).all(1)]) for line in lines]
    covered = np.concatenate([*dense, np.zeros((0, 2))])
    taken: list[NDArray[np.floating[Any]]] = []
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS - np.pi / 4
    for (text, point, style), at in zip(labels, points, strict=True):
        note = axes.annotate(text, point, (0, 0), textcoords="offset points", ha="center", va="center", **style)
        note.set_in_layout(False)
        size = np.array(note.get_window_extent().size) + 2 * PADDING_PX
        best, best_cost = np.zeros(2), np.inf
        for distance in DISTANCES_PT:
            for angle in angles:
                direction = np.array([np.cos(angle), np.sin(angle)])
                center = (
                    at
                    + direction * distance * pixels
                    + np.sign(direction.round(6)) * size / 2 * abs(direction).round(1)
                )
                box = np.concatenate([center - size / 2, center + size / 2])
                cost = 0.1 * distance + COSTS["label"] * sum(_overlap(box, other) for other in taken)
                cost += COSTS["outside"] * _outside(box, window)
                cost += COSTS["mark"] * _inside(np.array(points), box, 8 * pixels)
                cost += COSTS["line"] * _inside(covered, box, 0)
                if cost < best_cost:
                    best, best_cost = center - at, cost
        taken.append(np.concatenate([at + best - size / 2, at + best + size / 2]))
        note.set_position(tuple(best / pixels))
        nearest = np.clip(np.zeros(2), best - size / 2, best + size / 2)
        if np.hypot(*nearest) / pixels > LEADER_FROM_PT:
            axes.annotate(
                "", point, tuple(nearest / pixels), textcoords="offset points", zorder=3,
                arrowprops={"arrowstyle": "-", "color": "0.5", "lw": 0.7, "shrinkA": 0, "shrinkB": 6},
            ).set_in_layout(False)  # fmt: skip


def _overlap(box: NDArray[Any], other: NDArray[Any]) -> bool:
    """Whether two boxes (x0, y0, x1, y1) overlap."""
    return bool((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all())


def _outside(box: NDArray[Any], window: Any) -> bool:
    return bool(box[0] < window.x0 or box[1] < window.y0 or box[2] > window.x1 or box[3] > window.y1)


def _inside(points: NDArray[Any], box: NDArray[Any], margin: float) -> int:
    """Number of points in a box that is widened by a margin."""
    return int(((points > box[:2] - margin) & (points < box[2:] + margin)).all(1).sum())

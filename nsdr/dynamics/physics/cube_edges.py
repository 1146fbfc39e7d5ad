"""The left and right edges of a box in the image, which show its yaw. Compiled by Numba."""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.bodies import CYCLE
from nsdr.world.camera import Camera

EDGES_PX = (-0.3, -0.6)
"""Offsets of the left and right edges of real masks of cubes from those of the drawn outline (pixels; medians of ten
scenes)."""
_MIN_DEPTH_WORLD = 0.1
"""Smallest depth that is projected (world units)."""


def projection_rows(camera: Camera) -> tuple[float, ...]:
    """The rows (8 numbers) of the projection that give image columns and depths, as a tuple, which Numba reads fastest."""
    return tuple(camera.matrix[[0, 2]].ravel().tolist())


@cached_njit
def _column(projection, outline, x, y, c, s, k, z):  # type: ignore[no-untyped-def]
    """Image column and depth of point k, at height z, of the outline of a box at (x, y) with yaw cosine c and sine s."""
    kx, ky = outline[CYCLE[k], 0], outline[CYCLE[k], 1]
    px, py = x + c * kx - s * ky, y + s * kx + c * ky
    depth = projection[4] * px + projection[5] * py + projection[6] * z + projection[7]
    depth = max(depth, _MIN_DEPTH_WORLD)
    column = projection[0] * px + projection[1] * py + projection[2] * z + projection[3]
    return column / depth, depth


@cached_njit
def box_edges_px(projection, box, x, y, yaw, start, derivatives):  # type: ignore[no-untyped-def]
    """Left and right edges of a box in the image (pixels).

    The outline is convex, so its outermost points are found by climbing along it.

    Args:
        projection: rows of the projection, see `projection_rows`.
        box: its record of `BODY`.
        x, y, yaw: position and yaw of the box (world units, radians).
        start: (2, 2) int, outline points at the left and right edge (first index), at the bottom and top of the box (second
            index), from which the search starts. They are replaced by the points that are found.
        derivatives: (2, 3) derivatives of the edges with respect to x, y and yaw, which are written.
    """
    c, s, n, outline = np.cos(yaw), np.sin(yaw), len(CYCLE), box.outline
    edges = (np.inf, np.inf)
    for side in range(2):
        sign, best = (1.0 if side else -1.0), -np.inf
        for top in range(2):
            k, z = start[side, top], box.height * top
            column, depth = _column(projection, outline, x, y, c, s, k, z)
            for turn in (1, n - 1):
                while True:
                    following = (k + turn) % n
                    other, other_depth = _column(projection, outline, x, y, c, s, following, z)
                    if sign * other <= sign * column:
                        break
                    k, column, depth = following, other, other_depth
            start[side, top] = k
            if sign * column > best:
                best = sign * column
                by_x = (projection[0] - column * projection[4]) / depth
                by_y = (projection[1] - column * projection[5]) / depth
                kx, ky = outline[CYCLE[k], 0], outline[CYCLE[k], 1]
                derivatives[side, 0], derivatives[side, 1] = by_x, by_y
                derivatives[side, 2] = by_x * (-s * kx - c * ky) + by_y * (c * kx - s * ky)
        edges = (edges[1], sign * best)
    return edges[0] + EDGES_PX[0], edges[1] + EDGES_PX[1]


@cached_njit
def drawn_edges_px(projection, box, position, yaws):  # type: ignore[no-untyped-def]
    """(Y, N, 2) left and right edges of a box in the image (pixels) at positions (N, 2), for each of some yaws (Y,)."""
    edges, start, derivatives = np.empty((len(yaws), len(position), 2)), np.zeros((2, 2), np.int64), np.empty((2, 3))
    for k in range(len(yaws)):
        for t in range(len(position)):
            edges[k, t] = box_edges_px(projection, box, position[t, 0], position[t, 1], yaws[k], start, derivatives)
    return edges

"""The outlines of CLEVRER's objects seen from above, and the gap between two of them. Compiled by Numba."""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.body_state import YAW, X, Y
from nsdr.world.physics_constants import HULL_MARGIN_WORLD, OBJECT_RADIUS_WORLD
from nsdr.world.shapes import CUBE_EDGE_WORLD, CUBE_EXPONENT, CUBE_STEPS
from nsdr.world.vocabulary import SHAPES

CUBE, SPHERE = SHAPES.index("cube"), SHAPES.index("sphere")
_HALF, _MARGIN = OBJECT_RADIUS_WORLD, HULL_MARGIN_WORLD
FLAT = OBJECT_RADIUS_WORLD - CUBE_EDGE_WORLD
"""Half the length of the flat part of a side of a cube (world units)."""
ROUND = OBJECT_RADIUS_WORLD + HULL_MARGIN_WORLD
"""Radius of spheres and cylinders, including Bullet's margin (world units)."""
CORNER_WORLD = 0.07
"""Distance by which the corners of a cube extend beyond `ROUND` (world units, rounded up)."""

_ANGLES = np.pi / 2 * np.arange(CUBE_STEPS + 1) / CUBE_STEPS
_ARC = FLAT + CUBE_EDGE_WORLD * np.abs(np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)) ** (2 / CUBE_EXPONENT)
CUBE_OUTLINE = np.concatenate([_ARC * s for s in ((1, 1), (1, -1), (-1, 1), (-1, -1))])
"""(28, 2) points on the outline of a cube seen from above, corner by corner (world units)."""
_INDEX = np.arange(len(CUBE_OUTLINE)).reshape(4, -1)
CUBE_CYCLE = np.concatenate([_INDEX[0], _INDEX[2, ::-1], _INDEX[3], _INDEX[1, ::-1]])
"""(28,) indices of the points of `CUBE_OUTLINE` in the order of their angles."""


@cached_njit
def _cube_gap(x, y):  # type: ignore[no-untyped-def]
    """Signed distance of a point from the outline of a cube, and the normal of the outline there, in the frame of the cube."""
    ax, ay = abs(x), abs(y)
    if ax <= FLAT or ay <= FLAT:
        if ax > ay:
            return ax - _HALF, np.copysign(1.0, x), 0.0
        return ay - _HALF, 0.0, np.copysign(1.0, y)
    best, nx, ny = 1e9, 0.0, 0.0
    for k in range(CUBE_STEPS):
        bx, by = _ARC[k, 0], _ARC[k, 1]
        ex, ey = _ARC[k + 1, 0] - bx, _ARC[k + 1, 1] - by
        t = ((ax - bx) * ex + (ay - by) * ey) / (ex * ex + ey * ey)
        t = min(max(t, 0.0), 1.0)
        dx, dy = ax - bx - t * ex, ay - by - t * ey
        d = np.sqrt(dx * dx + dy * dy)
        if d < abs(best):
            outside = dx * ey - dy * ex > 0  # the arc runs anticlockwise
            if outside and d > 1e-9:
                best, nx, ny = d, dx / d, dy / d
            else:
                length = np.sqrt(ex * ex + ey * ey)
                best, nx, ny = (d if outside else -d), ey / length, -ex / length
    return best, np.copysign(nx, x), np.copysign(ny, y)


@cached_njit
def outline_gap(shape, state, i, j):  # type: ignore[no-untyped-def]
    """Gap between bodies i and j (world units), the normal from i to j (x, y), and the point (x, y) where they (nearly) touch.

    Args:
        shape: (n,) int, index into `nsdr.world.vocabulary.SHAPES`.
        state: (n, 6) states of the bodies, of which only positions and yaws are read.
        i, j: indices of the two bodies.
    """
    dx, dy = state[j, X] - state[i, X], state[j, Y] - state[i, Y]
    if shape[i] != CUBE and shape[j] != CUBE:
        d = max(np.sqrt(dx * dx + dy * dy), 1e-9)
        nx, ny = dx / d, dy / d
        return d - 2 * ROUND, nx, ny, state[i, X] + ROUND * nx, state[i, Y] + ROUND * ny
    if shape[i] == CUBE and shape[j] == CUBE:
        best, bx, by, px, py = 1e9, 1.0, 0.0, 0.0, 0.0
        for side in range(2):
            a, b = (i, j) if side == 0 else (j, i)  # corners of a against the outline of b
            ca, sa, cb, sb = np.cos(state[a, YAW]), np.sin(state[a, YAW]), np.cos(state[b, YAW]), np.sin(state[b, YAW])
            for k in range(len(CUBE_OUTLINE)):
                facing = (ca * CUBE_OUTLINE[k, 0] - sa * CUBE_OUTLINE[k, 1]) * dx + (
                    sa * CUBE_OUTLINE[k, 0] + ca * CUBE_OUTLINE[k, 1]
                ) * dy
                if (facing < 0) == (side == 0):
                    continue
                vx = ca * CUBE_OUTLINE[k, 0] - sa * CUBE_OUTLINE[k, 1] + state[a, X]
                vy = sa * CUBE_OUTLINE[k, 0] + ca * CUBE_OUTLINE[k, 1] + state[a, Y]
                rx, ry = vx - state[b, X], vy - state[b, Y]
                lx, ly = cb * rx + sb * ry, -sb * rx + cb * ry
                if max(abs(lx), abs(ly)) - _HALF >= best:
                    continue
                d, nx, ny = _cube_gap(lx, ly)
                if d < best:
                    best = d
                    wx, wy = cb * nx - sb * ny, sb * nx + cb * ny  # from b to a
                    bx, by = (-wx, -wy) if side == 0 else (wx, wy)
                    px, py = vx, vy
        return best - 2 * _MARGIN, bx, by, px, py
    c, o = (i, j) if shape[i] == CUBE else (j, i)
    cc, sc = np.cos(state[c, YAW]), np.sin(state[c, YAW])
    rx, ry = state[o, X] - state[c, X], state[o, Y] - state[c, Y]
    d, nx, ny = _cube_gap(cc * rx + sc * ry, -sc * rx + cc * ry)
    wx, wy = cc * nx - sc * ny, sc * nx + cc * ny  # from the cube to the other body
    px, py = state[o, X] - _HALF * wx, state[o, Y] - _HALF * wy
    if c != i:
        wx, wy = -wx, -wy
    return d - _HALF - 2 * _MARGIN, wx, wy, px, py

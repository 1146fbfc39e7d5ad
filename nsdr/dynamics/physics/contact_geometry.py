"""The gap between two bodies seen from above. Compiled by Numba."""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.bodies import OUTLINE_POINTS
from nsdr.dynamics.physics.body_state import YAW, X, Y
from nsdr.dynamics.physics.bullet_rules import HULL_MARGIN_WORLD
from nsdr.world.shapes import CUBE_STEPS

_MARGIN = HULL_MARGIN_WORLD


@cached_njit
def _box_gap(box, x, y):  # type: ignore[no-untyped-def]
    """Signed distance of a point from the outline of a box, and the normal of the outline there, in the frame of the box."""
    ax, ay, half_x, half_y, arc = abs(x), abs(y), box.half[0], box.half[1], box.outline
    if ax <= box.flat[0] or ay <= box.flat[1]:
        if ax - ay > half_x - half_y:
            return ax - half_x, np.copysign(1.0, x), 0.0
        return ay - half_y, 0.0, np.copysign(1.0, y)
    best, nx, ny = 1e9, 0.0, 0.0
    for k in range(CUBE_STEPS):
        bx, by = arc[k, 0], arc[k, 1]
        ex, ey = arc[k + 1, 0] - bx, arc[k + 1, 1] - by
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
def outline_gap(body, state, i, j):  # type: ignore[no-untyped-def]
    """Gap between bodies i and j (world units), the normal from i to j (x, y), and the point (x, y) where they (nearly) touch.

    Args:
        body: (n,) records of `BODY`.
        state: (n, 6) states of the bodies, of which only positions and yaws are read.
        i, j: indices of the two bodies.
    """
    dx, dy = state[j, X] - state[i, X], state[j, Y] - state[i, Y]
    if not body[i].is_box and not body[j].is_box:
        d = max(np.sqrt(dx * dx + dy * dy), 1e-9)
        nx, ny, radius = dx / d, dy / d, body[i].round
        return d - (radius + body[j].round), nx, ny, state[i, X] + radius * nx, state[i, Y] + radius * ny
    if body[i].is_box and body[j].is_box:
        best, bx, by, px, py = 1e9, 1.0, 0.0, 0.0, 0.0
        for side in range(2):
            a, b = (i, j) if side == 0 else (j, i)  # corners of a against the outline of b
            ca, sa, cb, sb = np.cos(state[a, YAW]), np.sin(state[a, YAW]), np.cos(state[b, YAW]), np.sin(state[b, YAW])
            outline, box = body[a].outline, body[b]
            half_x, half_y = box.half[0], box.half[1]
            is_square = half_x == half_y and body[a].half[0] == body[a].half[1]
            for k in range(OUTLINE_POINTS):
                facing = (ca * outline[k, 0] - sa * outline[k, 1]) * dx + (sa * outline[k, 0] + ca * outline[k, 1]) * dy
                if is_square and (facing < 0) == (side == 0):  # the far corners of other boxes may be the nearest
                    continue
                vx = ca * outline[k, 0] - sa * outline[k, 1] + state[a, X]
                vy = sa * outline[k, 0] + ca * outline[k, 1] + state[a, Y]
                rx, ry = vx - state[b, X], vy - state[b, Y]
                lx, ly = cb * rx + sb * ry, -sb * rx + cb * ry
                if max(abs(lx) - half_x, abs(ly) - half_y) >= best:
                    continue
                d, nx, ny = _box_gap(box, lx, ly)
                if d < best:
                    best = d
                    wx, wy = cb * nx - sb * ny, sb * nx + cb * ny  # from b to a
                    bx, by = (-wx, -wy) if side == 0 else (wx, wy)
                    px, py = vx, vy
        return best - 2 * _MARGIN, bx, by, px, py
    c, o = (i, j) if body[i].is_box else (j, i)
    cc, sc, radius = np.cos(state[c, YAW]), np.sin(state[c, YAW]), body[o].half[0]
    rx, ry = state[o, X] - state[c, X], state[o, Y] - state[c, Y]
    d, nx, ny = _box_gap(body[c], cc * rx + sc * ry, -sc * rx + cc * ry)
    wx, wy = cc * nx - sc * ny, sc * nx + cc * ny  # from the box to the other body
    px, py = state[o, X] - radius * wx, state[o, Y] - radius * wy
    if c != i:
        wx, wy = -wx, -wy
    return d - radius - 2 * _MARGIN, wx, wy, px, py

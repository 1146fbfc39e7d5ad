"""Compiled soft shadows: which share of a lamp a solid hides from a point, and the shadows on the ground.

`lights` is an array (4, LIGHT) of the three lamps and the sun, which is a lamp far away: centre, direction in which it faces,
linear RGB intensity, side, and the directions of its sides, of a side's length.
"""

import math

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.generate.render.rays import BOUND_WORLD, direction_in, hit, point_in
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD

__all__ = ["GRID_PX", "LIGHT", "blocked", "blocked_roughly", "cast_shadows", "find_reach"]

LIGHT = 16
"""Numbers that describe a light."""
LAMP_SIDE_POINTS = 4
"""Points along each side of a lamp that shadows are averaged over."""
GRID_PX = 2
"""Shadows are computed on every n-th pixel along each axis and interpolated in between."""
R = OBJECT_RADIUS_WORLD
HALF_DIAGONAL = math.sqrt(0.5)
"""Half of a square's diagonal (sides)."""
SHADOW_DEPTH = 0.93
"""Share of a lamp's light that a solid takes from the ground behind it; objects return the rest to the ground around them."""
MIN_LAMP_HEIGHT_WORLD = 0.5
"""Lower lamps cast shadows as long as from this height above an object."""
MIN_WINDOW_DEPTH_WORLD = 0.6
"""Shadows with a point nearer to the camera are looked for in the whole image."""


@cached_njit
def _beam(solids, lights, j, k, p):  # type: ignore[no-untyped-def]
    """How a solid lies to the beam from a point to a lamp's centre.

    Returns the squared distance of the solid's centre from the beam's axis, infinity when it is behind, and the beam's radius.
    """
    ax, ay, az = solids[j, 1] - p[0], solids[j, 2] - p[1], solids[j, 3] - p[2]
    lx, ly, lz = lights[k, 0] - p[0], lights[k, 1] - p[1], lights[k, 2] - p[2]
    along = (ax * lx + ay * ly + az * lz) / (lx * lx + ly * ly + lz * lz)
    if along <= 0.0:
        return math.inf, 0.0
    dx, dy, dz = ax - along * lx, ay - along * ly, az - along * lz
    return dx * dx + dy * dy + dz * dz, along * lights[k, 9] * HALF_DIAGONAL


@cached_njit
def blocked(solids, lights, j, k, p):  # type: ignore[no-untyped-def]
    """Share (0-1) of lamp `k` that solid `j` hides from the point `p`."""
    aside, width = _beam(solids, lights, j, k, p)
    if aside >= (BOUND_WORLD + width) ** 2:
        return 0.0
    if width < R and aside <= (R - width) ** 2:
        return 1.0
    kind = solids[j, 0]
    o = point_in(solids, j, p)
    x, y, z = direction_in(solids, j, (lights[k, 0] - p[0], lights[k, 1] - p[1], lights[k, 2] - p[2]))
    ax, ay, az = direction_in(solids, j, (lights[k, 10], lights[k, 11], lights[k, 12]))
    bx, by, bz = direction_in(solids, j, (lights[k, 13], lights[k, 14], lights[k, 15]))
    n = 0
    for row in range(LAMP_SIDE_POINTS):
        a = (row + 0.5) / LAMP_SIDE_POINTS - 0.5
        for column in range(LAMP_SIDE_POINTS):
            b = (column + 0.5) / LAMP_SIDE_POINTS - 0.5
            if hit(kind, o, (x + a * ax + b * bx, y + a * ay + b * by, z + a * az + b * bz)) < 1.0:
                n += 1
    return n / LAMP_SIDE_POINTS**2


@cached_njit
def blocked_roughly(solids, lights, j, k, p):  # type: ignore[no-untyped-def]
    """As `blocked`, of the sphere of the object's radius, without sampling: for what is seen in mirrors."""
    aside, width = _beam(solids, lights, j, k, p)
    if aside >= (R + width) ** 2:
        return 0.0
    return min((R + width - math.sqrt(aside)) / (2.0 * width), 1.0)


@cached_njit
def find_reach(solids, lights, reach):  # type: ignore[no-untyped-def]
    """Set `reach` (n, n, 4): whether solid `j` may hide a part of light `k` from some point of solid `i`."""
    for i in range(len(solids)):
        for j in range(len(solids)):
            for k in range(len(lights)):
                aside, width = _beam(solids, lights, j, k, (solids[i, 1], solids[i, 2], solids[i, 3]))
                near = (solids[i, 1] - solids[j, 1]) ** 2 + (solids[i, 2] - solids[j, 2]) ** 2 < (
                    3.0 * BOUND_WORLD
                ) ** 2
                reach[i, j, k] = i != j and (near or aside < (2.0 * BOUND_WORLD + width) ** 2)


@cached_njit
def _window(camera, size, foot, tip, radius):  # type: ignore[no-untyped-def]
    """Box (left, top, right, bottom) in grid points around two circles on the ground."""
    height, width = size
    left, top, right, bottom = math.inf, math.inf, -math.inf, -math.inf
    for x, y in (foot, tip):
        for dx in (-radius, radius):
            for dy in (-radius, radius):
                px, py, pz = x + dx - camera[0], y + dy - camera[1], -camera[2]
                depth = camera[9] * px + camera[10] * py + camera[11] * pz
                if depth < MIN_WINDOW_DEPTH_WORLD:
                    return 0, 0, width, height
                column = (
                    (camera[3] * px + camera[4] * py + camera[5] * pz) / depth * camera[12] + camera[13]
                ) / GRID_PX
                row = ((camera[6] * px + camera[7] * py + camera[8] * pz) / depth * camera[12] + camera[14]) / GRID_PX
                left, right, top, bottom = min(left, column), max(right, column), min(top, row), max(bottom, row)
    return (
        max(math.floor(left), 0),
        max(math.floor(top), 0),
        min(math.ceil(right) + 2, width),
        min(math.ceil(bottom) + 2, height),
    )


@cached_njit
def _hidden(ids, r, c):  # type: ignore[no-untyped-def]
    """Whether no ground is seen around a point of the grid, so that its shadow does not matter."""
    y, x = r * GRID_PX, c * GRID_PX
    if not (GRID_PX <= y < ids.shape[0] - GRID_PX and GRID_PX <= x < ids.shape[1] - GRID_PX):
        return False
    for dy in (-GRID_PX, 0, GRID_PX):
        for dx in (-GRID_PX, 0, GRID_PX):
            if ids[y + dy, x + dx] < 0:
                return False
    return True


@cached_njit
def cast_shadows(solids, lights, camera, ground, ids, light_share, touched):  # type: ignore[no-untyped-def]
    """Multiply the shares of light by what the solids let through; updates `light_share` and `touched` in place.

    Args:
        solids: the solids.
        lights: the lights.
        camera: the camera, as `nsdr.generate.render.painting` describes it.
        ground: (rows, columns, 2) points on the ground at every `GRID_PX`-th pixel; NaN where the ground is not seen.
        ids: (height, width) index of the solid at each pixel, -1 for none.
        light_share: (rows, columns, 4) share (0-1) of each light that arrives there.
        touched: (rows, columns) bool, whether a shadow is there.
    """
    for j in range(len(solids)):
        for k in range(len(lights)):
            x, y, top = solids[j, 1], solids[j, 2], solids[j, 3] + BOUND_WORLD
            reach = top / max(lights[k, 2] - top, MIN_LAMP_HEIGHT_WORLD)
            tip = (x + (x - lights[k, 0]) * reach, y + (y - lights[k, 1]) * reach)
            radius = (BOUND_WORLD + 0.5 * lights[k, 9] * reach) * (1.0 + 0.5 * reach)
            left, upper, right, lower = _window(camera, touched.shape, (x, y), tip, radius)
            for r in range(upper, lower):
                for c in range(left, right):
                    gx, gy = ground[r, c, 0], ground[r, c, 1]
                    if gx != gx or _hidden(ids, r, c):
                        continue
                    share = blocked(solids, lights, j, k, (gx, gy, 0.0))
                    if share > 0.0:
                        light_share[r, c, k] *= 1.0 - SHADOW_DEPTH * share
                        touched[r, c] = True

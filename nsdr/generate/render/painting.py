"""Compiled passes over the image: what is nearest at each pixel, and its colour, with smooth outlines.

`camera` is an array (CAMERA,): eye, the rows of the axes as of `nsdr.world.camera.Camera`, focal length and image centre in
pixels. Other arrays are described in `nsdr.generate.render.rays`, `shadows` and `shading`.
"""

import math

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.generate.render.lamps import GROUND_REFLECTANCE
from nsdr.generate.render.rays import direction_in, hit, near_edge, point_in, rounded_normal
from nsdr.generate.render.shading import AMBIENT, background_point, irradiance, object_radiance
from nsdr.generate.render.shadows import GRID_PX

__all__ = ["SRGB_STEPS", "empty_scene", "find_nearest", "grid_points", "paint"]

SRGB_STEPS = 16384
"""Steps of linear light in the table of sRGB values."""
SAMPLES_PER_SIDE = 4
"""Samples along each side of a pixel on an outline."""
MAX_IN_PIXEL = 9
"""Most objects that are looked for in one pixel on an outline: those of the pixel and its neighbours."""


@cached_njit
def _ray(camera, column, row):  # type: ignore[no-untyped-def]
    """Direction in the world, of depth 1, through a place in the image (pixels)."""
    x, y = (column - camera[13]) / camera[12], (row - camera[14]) / camera[12]
    return (
        camera[3] * x + camera[6] * y + camera[9],
        camera[4] * x + camera[7] * y + camera[10],
        camera[5] * x + camera[8] * y + camera[11],
    )


@cached_njit
def empty_scene(lights, camera, by_light):  # type: ignore[no-untyped-def]
    """Fill `by_light` (height, width, 4, 3) with the linear RGB of each light that the empty scene reflects."""
    eye = (camera[0], camera[1], camera[2])
    for r in range(by_light.shape[0]):
        for c in range(by_light.shape[1]):
            q, n, met = background_point(eye, _ray(camera, c + 0.5, r + 0.5))
            for k in range(len(lights)):
                light = irradiance(lights, k, q, n)[0] * GROUND_REFLECTANCE / math.pi if met else 0.0
                for channel in range(3):
                    by_light[r, c, k, channel] = light * lights[k, 6 + channel]


@cached_njit
def grid_points(camera, ground):  # type: ignore[no-untyped-def]
    """Fill `ground` (rows, columns, 2) with the point on the ground at every `GRID_PX`-th pixel; NaN where there is none."""
    eye = (camera[0], camera[1], camera[2])
    for r in range(ground.shape[0]):
        for c in range(ground.shape[1]):
            q, n, met = background_point(eye, _ray(camera, c * GRID_PX + 0.5, r * GRID_PX + 0.5))
            on_ground = met and n[2] == 1.0
            ground[r, c, 0] = q[0] if on_ground else math.nan
            ground[r, c, 1] = q[1] if on_ground else math.nan


@cached_njit
def find_nearest(solids, boxes, camera, ids, depth):  # type: ignore[no-untyped-def]
    """Update `ids` and `depth` (height, width) with the solid that is nearest at each pixel's centre.

    Args:
        solids: the solids.
        boxes: (n, 4) left, top, right and bottom of each solid in pixels, end exclusive.
        camera: the camera.
        ids: index of the nearest solid so far, -1 for none.
        depth: its depth, infinite for none.
    """
    for i in range(len(solids)):
        kind, o = solids[i, 0], point_in(solids, i, (camera[0], camera[1], camera[2]))
        for r in range(boxes[i, 1], boxes[i, 3]):
            for c in range(boxes[i, 0], boxes[i, 2]):
                t = hit(kind, o, direction_in(solids, i, _ray(camera, c + 0.5, r + 0.5)))
                if t < depth[r, c]:
                    depth[r, c], ids[r, c] = t, i


@cached_njit
def _neighbours(ids, r, c, found):  # type: ignore[no-untyped-def]
    """Write the solids at a pixel and its eight neighbours into `found`; returns their number and whether ground is seen."""
    n, ground = 0, False
    for y in range(max(r - 1, 0), min(r + 2, ids.shape[0])):
        for x in range(max(c - 1, 0), min(c + 2, ids.shape[1])):
            i = ids[y, x]
            if i < 0:
                ground = True
                continue
            known = False
            for k in range(n):
                known = known or found[k] == i
            if not known:
                found[n] = i
                n += 1
    return n, ground


@cached_njit
def _seen(solids, camera, i, column, row):  # type: ignore[no-untyped-def]
    """Depth of solid `i` at a place in the image; infinite where it is not."""
    o = point_in(solids, i, (camera[0], camera[1], camera[2]))
    return hit(solids[i, 0], o, direction_in(solids, i, _ray(camera, column, row)))


@cached_njit
def _colour(solids, lights, surfaces, reach, camera, i, column, row, t):  # type: ignore[no-untyped-def]
    """Linear RGB of solid `i` at a place in the image where its depth is `t`."""
    x, y, z = _ray(camera, column, row)
    p = (camera[0] + t * x, camera[1] + t * y, camera[2] + t * z)
    length = math.sqrt(x * x + y * y + z * z)
    n = rounded_normal(solids, i, p)
    return object_radiance(solids, lights, surfaces, reach, i, p, n, (x / length, y / length, z / length))


@cached_njit
def _inside(solids, lights, surfaces, reach, camera, i, r, c, t):  # type: ignore[no-untyped-def]
    """Linear RGB of a pixel of which solid `i` fills all; where its edges are, the mean of four places."""
    x, y, z = _ray(camera, c + 0.5, r + 0.5)
    p = (camera[0] + t * x, camera[1] + t * y, camera[2] + t * z)
    if not near_edge(solids, i, p, t / camera[12]):
        return _colour(solids, lights, surfaces, reach, camera, i, c + 0.5, r + 0.5, t)
    red = green = blue = 0.0
    for row in (r + 0.25, r + 0.75):
        for column in (c + 0.25, c + 0.75):
            depth = _seen(solids, camera, i, column, row)
            depth = depth if depth < math.inf else t
            colour = _colour(solids, lights, surfaces, reach, camera, i, column, row, depth)
            red += 0.25 * colour[0]
            green += 0.25 * colour[1]
            blue += 0.25 * colour[2]
    return red, green, blue


@cached_njit
def _ground(by_light, light_share, r, c):  # type: ignore[no-untyped-def]
    """Linear RGB of the ground at a pixel, with shadows interpolated in the grid."""
    y, x = r // GRID_PX, c // GRID_PX
    b, a = (r - y * GRID_PX) / GRID_PX, (c - x * GRID_PX) / GRID_PX
    red = green = blue = AMBIENT
    for k in range(by_light.shape[2]):
        upper = (1.0 - a) * light_share[y, x, k] + a * light_share[y, x + 1, k]
        lower = (1.0 - a) * light_share[y + 1, x, k] + a * light_share[y + 1, x + 1, k]
        share = (1.0 - b) * upper + b * lower
        red += share * by_light[r, c, k, 0]
        green += share * by_light[r, c, k, 1]
        blue += share * by_light[r, c, k, 2]
    return red, green, blue


@cached_njit
def _write(image, srgb, r, c, colour):  # type: ignore[no-untyped-def]
    for channel in range(3):
        value = colour[channel] if colour[channel] > 0.0 else 0.0
        image[r, c, channel] = srgb[int(min(value, 1.0) * (SRGB_STEPS - 1) + 0.5)]


@cached_njit
def _outline(solids, lights, surfaces, reach, camera, sums, found, n, r, c, ground):  # type: ignore[no-untyped-def]
    """Linear RGB of a pixel on an outline: each solid's colour by the share of the pixel that it covers, the rest ground."""
    sums[:] = 0.0
    for a in range(SAMPLES_PER_SIDE):
        for b in range(SAMPLES_PER_SIDE):
            column, row = c + (a + 0.5) / SAMPLES_PER_SIDE, r + (b + 0.5) / SAMPLES_PER_SIDE
            nearest, which = math.inf, -1
            for k in range(n):
                t = _seen(solids, camera, found[k], column, row)
                if t < nearest:
                    nearest, which = t, k
            if which >= 0:
                sums[which, 0] += 1.0
                sums[which, 1] += column
                sums[which, 2] += row
    red = green = blue = 0.0
    rest = 1.0
    for k in range(n):
        if sums[k, 0] == 0.0:
            continue
        share = sums[k, 0] / SAMPLES_PER_SIDE**2
        column, row = sums[k, 1] / sums[k, 0], sums[k, 2] / sums[k, 0]
        t = _seen(solids, camera, found[k], column, row)
        if t == math.inf:
            continue
        colour = _colour(solids, lights, surfaces, reach, camera, found[k], column, row, t)
        rest -= share
        red += share * colour[0]
        green += share * colour[1]
        blue += share * colour[2]
    return red + rest * ground[0], green + rest * ground[1], blue + rest * ground[2]


@cached_njit
def paint(solids, lights, surfaces, reach, camera, boxes, ids, depth, by_light, light_share, touched, srgb, image):  # type: ignore[no-untyped-def]
    """Paint shadows and objects over the image of the empty scene, in place.

    Args:
        solids: the solids.
        lights: the lights.
        surfaces: the objects' surfaces.
        reach: (n, n, 4) which lights solids may hide from each other.
        camera: the camera.
        boxes: (n, 4) left, top, right and bottom of each solid in pixels, end exclusive.
        ids: (height, width) index of the nearest solid, -1 for none.
        depth: (height, width) its depth.
        by_light: (height, width, 4, 3) the empty scene's light.
        light_share: (rows, columns, 4) share of each light in the grid of shadows.
        touched: (rows, columns) where there are shadows.
        srgb: (SRGB_STEPS,) uint8 table.
        image: (height, width, 3) uint8, of the empty scene.
    """
    height, width = ids.shape
    for y in range((height + GRID_PX - 1) // GRID_PX):
        for x in range((width + GRID_PX - 1) // GRID_PX):
            if not (touched[y, x] or touched[y + 1, x] or touched[y, x + 1] or touched[y + 1, x + 1]):
                continue
            for r in range(y * GRID_PX, min((y + 1) * GRID_PX, height)):
                for c in range(x * GRID_PX, min((x + 1) * GRID_PX, width)):
                    if ids[r, c] < 0:
                        _write(image, srgb, r, c, _ground(by_light, light_share, r, c))
    found, sums = np.empty(MAX_IN_PIXEL, np.int64), np.empty((MAX_IN_PIXEL, 3))
    done = np.zeros(ids.shape, np.bool_)
    for i in range(len(boxes)):
        for r in range(max(boxes[i, 1] - 1, 0), min(boxes[i, 3] + 1, height)):
            for c in range(max(boxes[i, 0] - 1, 0), min(boxes[i, 2] + 1, width)):
                if done[r, c]:
                    continue
                done[r, c] = True
                n, ground = _neighbours(ids, r, c, found)
                if n == 0:
                    continue
                if n == 1 and not ground:
                    colour = _inside(solids, lights, surfaces, reach, camera, found[0], r, c, depth[r, c])
                else:
                    under = _ground(by_light, light_share, r, c)
                    colour = _outline(solids, lights, surfaces, reach, camera, sums, found, n, r, c, under)
                _write(image, srgb, r, c, colour)

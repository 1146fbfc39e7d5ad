"""Boxes, spheres and cylinders met by rays: what the preview renderer, exact masks and optical flow are made from.

Points and directions in compiled functions are (x, y, z) tuples in world units; directions have length 1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit, inlined_njit
from nsdr.validation import FloatArray
from nsdr.world.camera import Camera
from nsdr.world.shapes import shape_of
from nsdr.world.vocabulary import Shape

BOX, SPHERE, CYLINDER = 0, 1, 2
KINDS = {"box": BOX, "sphere": SPHERE, "cylinder": CYLINDER}
KIND, CENTRE, AXES, HALF, BOUND, INNER, EDGE = 0, 1, 4, 13, 16, 17, 18
"""Columns of an array of solids: kind, centre, directions of the axes, half of the size along each of them, the radii of a
sphere around the solid and of one inside it, and the width of the edges (world units)."""
PLACE, FACING, COLOR, RIGHT, UP, HALF_DIAGONAL = 0, 3, 6, 9, 12, 15
"""Columns of an array of lights: centre, direction in which it shines, linear RGB intensity, directions of its sides, of a
side's length, and half of its diagonal (world units)."""
EDGE_SHARE = {"box": 0.12, "sphere": 0.0, "cylinder": 0.03}
"""Width of the strip along the edges in which the normal turns from one face to the next, as a share of the smallest half
of the size. CLEVR's shapes have rounded edges there; the outlines stay those of the exact masks."""
BOUND_SHARE = 1.75
"""Radius of the sphere around a solid, in largest halves of its size; a cube's corner is at sqrt(3)."""
MIN_DISTANCE = 1e-9
"""Hits nearer to the start of a ray do not count (multiples of the direction's length)."""
SHADOW_DEPTH = 0.93
"""Share of a lamp's light that a solid blocks. The rest stands for the light that it reflects to its surroundings."""
LAMP_SIDE_POINTS = 4
"""Points along each side of a lamp over which soft shadows are averaged."""


@dataclass(frozen=True)
class Solid:
    """Geometry of an object in one frame.

    Attributes:
        shape: a shape, or the word of one of CLEVRER's.
        location_world: (3,) centre.
        rotation: (3, 3) rotation matrix from the object's axes to the world's.
    """

    shape: Shape | str
    location_world: FloatArray
    rotation: FloatArray


def solids_of(solids: Sequence[Solid]) -> NDArray[np.float64]:
    """(n, 19) the solids of a frame for compiled functions, with the columns `KIND` to `EDGE`."""
    rows = []
    for solid in solids:
        shape = shape_of(solid.shape)
        half = [edge / 2 for edge in shape.size_world]
        sizes = [*half, BOUND_SHARE * max(half), min(half), EDGE_SHARE[shape.solid] * min(half)]
        rows.append([KINDS[shape.solid], *solid.location_world, *solid.rotation.T.ravel(), *sizes])
    return np.array(rows, float).reshape(-1, 19)


def eye_of(camera: Camera) -> NDArray[np.float64]:
    """(5, 3) a camera for compiled functions: its position, its three axes, and its focal length and image centre (pixels)."""
    return np.array([camera.eye_world, *camera.axes, (camera.focal_px, camera.width / 2, camera.height / 2)])


@inlined_njit
def three(array, i, start):  # type: ignore[no-untyped-def]
    """Three numbers of row `i`, from column `start` on. A tuple, because a view of the array costs more than the arithmetic."""
    return array[i, start], array[i, start + 1], array[i, start + 2]


@inlined_njit
def dot(a, b):  # type: ignore[no-untyped-def]
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined_njit
def added(a, share, b):  # type: ignore[no-untyped-def]
    """`a + share * b`."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@inlined_njit
def _unit(a):  # type: ignore[no-untyped-def]
    share = 1.0 / math.sqrt(dot(a, a))
    return share * a[0], share * a[1], share * a[2]


@inlined_njit
def ray(eye, column, line):  # type: ignore[no-untyped-def]
    """Direction from the camera through a place in the image (pixels)."""
    focal, middle_column, middle_row = three(eye, 4, 0)
    d = added(three(eye, 3, 0), (column - middle_column) / focal, three(eye, 1, 0))
    return _unit(added(d, (line - middle_row) / focal, three(eye, 2, 0)))


@inlined_njit
def _inward(solids, i, d):  # type: ignore[no-untyped-def]
    """A direction in the world, expressed in the axes of solid `i`."""
    x, y, z = three(solids, i, AXES), three(solids, i, AXES + 3), three(solids, i, AXES + 6)
    return dot(x, d), dot(y, d), dot(z, d)


@inlined_njit
def _slab(half, o, d):  # type: ignore[no-untyped-def]
    """Where a ray enters and leaves the space between two opposite faces of a box (multiples of the direction's length)."""
    if d == 0.0:
        return (-math.inf, math.inf) if abs(o) < half else (math.inf, -math.inf)
    a, b = (-half - o) / d, (half - o) / d
    return (a, b) if a < b else (b, a)


@inlined_njit
def _hit(kind, half, o, d):  # type: ignore[no-untyped-def]
    """Distance of the first hit of a ray from outside, in multiples of the direction's length; infinite for a miss.

    The start `o`, the direction `d` and half of the solid's size are along the solid's axes.
    """
    r, _, height = half
    ox, oy, oz = o
    dx, dy, dz = d
    if kind == BOX:
        enter_x, leave_x = _slab(half[0], ox, dx)
        enter_y, leave_y = _slab(half[1], oy, dy)
        enter_z, leave_z = _slab(half[2], oz, dz)
        enter, leave = max(enter_x, enter_y, enter_z), min(leave_x, leave_y, leave_z)
        return enter if MIN_DISTANCE < enter < leave else math.inf
    if kind == SPHERE:
        a, b, c = dx * dx + dy * dy + dz * dz, dx * ox + dy * oy + dz * oz, ox * ox + oy * oy + oz * oz - r * r
        h = b * b - a * c
        t = (-b - math.sqrt(h)) / a if h > 0.0 else -1.0
        return t if t > MIN_DISTANCE else math.inf
    best = math.inf
    a, b, c = dx * dx + dy * dy, dx * ox + dy * oy, ox * ox + oy * oy - r * r
    h = b * b - a * c
    if h > 0.0 and a > 0.0:
        t = (-b - math.sqrt(h)) / a
        if t > MIN_DISTANCE and abs(oz + t * dz) <= height:
            best = t
    if dz != 0.0:
        t = ((height if dz < 0.0 else -height) - oz) / dz
        x, y = ox + t * dx, oy + t * dy
        if MIN_DISTANCE < t < best and x * x + y * y <= r * r:
            best = t
    return best


@inlined_njit
def first_hit(solids, p, d, besides):  # type: ignore[no-untyped-def]
    """Index of the solid that a ray from `p` meets first and the distance; -1 and infinity for none.

    The solid `besides` is left out; -1 leaves out none.
    """
    nearest, index = math.inf, -1
    for i in range(len(solids)):
        o = added(p, -1.0, three(solids, i, CENTRE))
        along = dot(o, d)
        if i == besides or along > 0.0 or dot(o, o) - along * along > solids[i, BOUND] ** 2:
            continue
        t = _hit(solids[i, KIND], three(solids, i, HALF), _inward(solids, i, o), _inward(solids, i, d))
        if t < nearest:
            nearest, index = t, i
    return index, nearest


@cached_njit
def _hidden(solids, i, p, way, lights, k):  # type: ignore[no-untyped-def]
    """Share (0-1) of the points of light `k` that solid `i` hides from a point; `way` leads to the light's centre."""
    o, d = _inward(solids, i, added(p, -1.0, three(solids, i, CENTRE))), _inward(solids, i, way)
    right, up = _inward(solids, i, three(lights, k, RIGHT)), _inward(solids, i, three(lights, k, UP))
    half, hits = three(solids, i, HALF), 0
    for line in range(LAMP_SIDE_POINTS):
        start = added(d, (line + 0.5) / LAMP_SIDE_POINTS - 0.5, up)
        for column in range(LAMP_SIDE_POINTS):
            place = added(start, (column + 0.5) / LAMP_SIDE_POINTS - 0.5, right)
            hits += _hit(solids[i, KIND], half, o, place) < 1.0
    return hits / LAMP_SIDE_POINTS**2


@inlined_njit
def find_light(solids, lights, p, n, besides, found):  # type: ignore[no-untyped-def]
    """Fill `found` (number of lights,) with the irradiance, relative to each light's intensity, that reaches a point.

    The surface there has the normal `n`. The solid `besides` casts no shadow; -1 for none.
    """
    for k in range(len(lights)):
        way = added(three(lights, k, PLACE), -1.0, p)
        nearness = 1.0 / dot(way, way)
        # The cosines at both ends, times the length of `way`.
        received, sent = max(dot(way, n), 0.0), max(-dot(way, three(lights, k, FACING)), 0.0)
        light = received * sent * nearness * nearness
        for i in range(len(solids)):
            o = added(p, -1.0, three(solids, i, CENTRE))
            along = -dot(o, way) * nearness
            if along <= 0.0 or i == besides:
                continue
            aside, radius = added(o, along, way), along * lights[k, HALF_DIAGONAL]
            squared, inner = dot(aside, aside), max(solids[i, INNER] - radius, 0.0)
            if squared < inner * inner:  # the solid's inner sphere fills the beam from the point to the light
                light *= 1.0 - SHADOW_DEPTH
            elif squared < (solids[i, BOUND] + radius) ** 2:
                light *= 1.0 - SHADOW_DEPTH * _hidden(solids, i, p, way, lights, k)
        found[k] = light


@inlined_njit
def normal_at(solids, i, p):  # type: ignore[no-untyped-def]
    """Outward normal at a point of a solid's surface; near edges it turns from one face to the next."""
    x, y, z = _inward(solids, i, added(p, -1.0, three(solids, i, CENTRE)))
    half, edge = three(solids, i, HALF), solids[i, EDGE]
    if solids[i, KIND] == BOX:
        x = math.copysign(max(abs(x) - (half[0] - edge), 0.0), x)
        y = math.copysign(max(abs(y) - (half[1] - edge), 0.0), y)
        z = math.copysign(max(abs(z) - (half[2] - edge), 0.0), z)
    elif solids[i, KIND] == CYLINDER:
        radius = math.sqrt(x * x + y * y)
        share = max(radius - (half[0] - edge), 0.0) / radius if radius > 0.0 else 0.0
        x, y, z = x * share, y * share, math.copysign(max(abs(z) - (half[2] - edge), 0.0), z)
    n = added(added((0.0, 0.0, 0.0), x, three(solids, i, AXES)), y, three(solids, i, AXES + 3))
    return _unit(added(n, z, three(solids, i, AXES + 6)))


@cached_njit
def _look(solids, eye, ids, distance):  # type: ignore[no-untyped-def]
    """Fill `ids` and `distance` (height, width) with `first_hit` of the ray through each pixel's centre."""
    p = three(eye, 0, 0)
    for r in range(ids.shape[0]):
        for c in range(ids.shape[1]):
            ids[r, c], distance[r, c] = first_hit(solids, p, ray(eye, c + 0.5, r + 0.5), -1)


def _seen(solids: Sequence[Solid], camera: Camera) -> tuple[NDArray[np.int64], FloatArray]:
    """`instance_ids`, and the distance (height, width) from the camera, infinite where there is none."""
    ids = np.empty((camera.height, camera.width), np.int64)
    distance = np.empty(ids.shape)
    _look(solids_of(solids), eye_of(camera), ids, distance)
    return ids, distance


def instance_ids(solids: Sequence[Solid], camera: Camera) -> NDArray[np.int64]:
    """Index (height, width) of the solid seen at each pixel's centre, -1 for none."""
    return _seen(solids, camera)[0]


def optical_flow(now: Sequence[Solid], following: Sequence[Solid], camera: Camera) -> NDArray[np.float32]:
    """Displacement of what is seen, from one frame to the next.

    The ground does not move, even if a shadow moves over it. The next position of a point may be hidden or outside the image.

    Args:
        now: the solids of a frame.
        following: the same solids in the next one.
        camera: the camera, which does not move.

    Returns:
        (height, width, 2) columns to the right and rows down (pixels).
    """
    ids, distance = _seen(now, camera)
    flow = np.zeros((*ids.shape, 2), np.float32)
    for i, (solid, moved) in enumerate(zip(now, following, strict=True)):
        rows, columns = np.nonzero(ids == i)
        rays = camera.rays(columns + 0.5, rows + 0.5)
        points = np.array(camera.eye_world) + distance[rows, columns, None] * rays
        in_object = (points - solid.location_world) @ solid.rotation
        next_points = in_object @ moved.rotation.T + moved.location_world
        flow[rows, columns] = camera.pixels(next_points) - camera.pixels(points)
    return flow

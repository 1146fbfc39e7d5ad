"""A renderer without Blender: a ray tracer with the world's lamps, soft shadows, and metal that mirrors what is around it."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit, inlined_njit
from nsdr.generate.render.geometry import CENTRE, Solid, eye_of, ray, solids_of, three
from nsdr.generate.render.shading import background, trace
from nsdr.generate.render.view import SUN_ANGLE, SUN_DIRECTION, SUN_STRENGTH, View
from nsdr.types import SceneObject
from nsdr.world.look import Look
from nsdr.world.shapes import rendered_rotation
from nsdr.world.vocabulary import Vocabulary

FloatArray = NDArray[np.float64]
POWER_PER_INTENSITY = 4.0
"""Power of a lamp (W) that shines straight ahead with unit intensity, as in Blender. Conservation of energy demands pi; but
with pi, the empty scene differs from the released background by 2.8 of 255 at the best ambient light, and with this by 1.8."""
AMBIENT_SHARE = 0.039 / 0.8
"""Radiance that reaches every point after many bounces, as a share of the ground's reflectance (linear). On CLEVR's ground it
is 0.039, the best of 0.02 to 0.06 on the released background."""
SUN_DISTANCE_WORLD = 2000.0
"""Distance of the lamp that represents the sun. At 100, its light would vary by a tenth over the image."""
SAMPLES_PER_SIDE = 3
"""Samples along each side of a pixel that is smoothed."""
SMOOTHED_CONTRAST = 0.05
"""Pixels that differ by more from a neighbour, in linear light, are smoothed, as are those on outlines."""


def render_preview(objects: Sequence[SceneObject], solids: Sequence[Solid], view: View) -> NDArray[np.uint8]:
    """Render one frame.

    Args:
        objects: colours and materials.
        solids: shapes, positions and rotations, in the same order.
        view: camera and lamps.

    Returns:
        (height, width, 3) uint8 RGB.
    """
    height, width = view.camera.height, view.camera.width
    lights, ground, packed = _lights(view), _ground(view.world.look), solids_of(solids)
    surfaces = _surfaces(objects, view.world.vocabulary, packed, lights, ground)
    eye = eye_of(view.camera)
    ids, sharp = np.empty((height, width), np.int64), np.empty((height, width, 3), np.float32)
    _paint(packed, lights, ground, surfaces, eye, ids, sharp)
    image = sharp.copy()
    _smooth(packed, lights, ground, surfaces, eye, ids, sharp, image)
    light = np.clip(image, 0.0, 1.0)
    srgb = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)  # the standard's curve
    return (255 * srgb + 0.5).astype(np.uint8)


def render_motion(
    objects: Sequence[SceneObject],
    location_world: NDArray[np.floating[Any]],
    yaw: NDArray[np.floating[Any]],
    view: View,
) -> Iterator[NDArray[np.uint8]]:
    """Frames of motion on the ground.

    Args:
        objects: shapes, colours and materials.
        location_world: (n, F, 2) positions on the ground; NaN where an object is absent.
        yaw: (n, F) rotations about the vertical axis (radians).
        view: camera and lamps.

    Yields:
        (height, width, 3) uint8 RGB, F times.
    """
    for frame in range(location_world.shape[1]):
        there = [o for o in objects if np.isfinite(location_world[o.id, frame]).all()]
        solids = []
        for o in there:
            shape = view.world.vocabulary.shape(o.shape)
            tilt = np.pi / 2 if shape.solid == "cylinder" else 0.0  # as annotated cylinders stand
            rotation = rendered_rotation(shape, np.array([tilt, 0.0, yaw[o.id, frame]])).as_matrix()
            solids.append(Solid(shape, np.array([*location_world[o.id, frame], shape.height_world]), rotation))
        yield render_preview(there, solids, view)


def _lights(view: View) -> FloatArray:
    """(n, 16) the lamps for compiled functions; the last is the sun, a lamp far away. All face the world's origin."""
    lamps = view.world.look.lamps
    shifted = [np.add(lamp.location_world, by) for lamp, by in zip(lamps, view.lamp_shift_world, strict=True)]
    place = np.array([*shifted, SUN_DISTANCE_WORLD * np.array(SUN_DIRECTION)])
    colors = [lamp.power / POWER_PER_INTENSITY * np.array(lamp.color) for lamp in lamps]
    sides = np.array([*(lamp.side_world for lamp in lamps), SUN_ANGLE * SUN_DISTANCE_WORLD])[:, None]
    facing = -place / np.linalg.norm(place, axis=1, keepdims=True)
    right = np.cross(facing, [0.0, 0.0, 1.0])
    right *= sides / np.linalg.norm(right, axis=1, keepdims=True)
    sun = np.full(3, SUN_STRENGTH * SUN_DISTANCE_WORLD**2)
    return np.hstack([place, facing, [*colors, sun], right, np.cross(facing, right), sides / np.sqrt(2)])


def _ground(look: Look) -> FloatArray:
    """(2, 3) the ground for compiled functions; the rows are those of `nsdr.generate.render.shading`."""
    return np.array([look.ground, [AMBIENT_SHARE * share for share in look.ground]])


def _surfaces(
    objects: Sequence[SceneObject], vocabulary: Vocabulary, solids: FloatArray, lights: FloatArray, ground: FloatArray
) -> FloatArray:
    """(n, 8) the surfaces of objects, for compiled functions; the columns are those of `nsdr.generate.render.shading`."""
    rows = []
    for o, solid in zip(objects, solids, strict=True):
        below = background(
            solids[:0], lights, ground, tuple(solid[CENTRE : CENTRE + 3]), (0.0, 0.0, -1.0), np.empty(len(lights))
        )
        color, material = np.array(vocabulary.color(o.color).srgb) / 255, vocabulary.material(o.material)
        rows.append([*color, *below, material.metallic, material.roughness])
    return np.array(rows, float).reshape(-1, 8)


@cached_njit
def _paint(solids, lights, ground, surfaces, eye, ids, image):  # type: ignore[no-untyped-def]
    """Fill `ids` (height, width) and `image` (height, width, 3) with what is seen at each pixel's centre."""
    p, found = three(eye, 0, 0), np.empty(len(lights))
    for r in range(ids.shape[0]):
        for c in range(ids.shape[1]):
            ids[r, c], color = trace(solids, lights, ground, surfaces, p, ray(eye, c + 0.5, r + 0.5), found)
            image[r, c, 0], image[r, c, 1], image[r, c, 2] = color


@inlined_njit
def _is_rough(ids, image, r, c):  # type: ignore[no-untyped-def]
    """Whether a pixel with an object, or beside one, differs from one of its neighbours."""
    for y, x in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
        if 0 <= y < ids.shape[0] and 0 <= x < ids.shape[1]:
            if ids[y, x] != ids[r, c]:
                return True
            for channel in range(3):
                if ids[r, c] >= 0 and abs(image[y, x, channel] - image[r, c, channel]) > SMOOTHED_CONTRAST:
                    return True
    return False


@cached_njit
def _smooth(solids, lights, ground, surfaces, eye, ids, sharp, image):  # type: ignore[no-untyped-def]
    """Give pixels of `image` that differ from a neighbour in `sharp` the mean of more rays."""
    p, found = three(eye, 0, 0), np.empty(len(lights))
    for r in range(ids.shape[0]):
        for c in range(ids.shape[1]):
            if not _is_rough(ids, sharp, r, c):
                continue
            red = green = blue = 0.0
            for a in range(SAMPLES_PER_SIDE):
                for b in range(SAMPLES_PER_SIDE):
                    column, row = c + (a + 0.5) / SAMPLES_PER_SIDE, r + (b + 0.5) / SAMPLES_PER_SIDE
                    color = trace(solids, lights, ground, surfaces, p, ray(eye, column, row), found)[1]
                    red, green, blue = red + color[0], green + color[1], blue + color[2]
            n = SAMPLES_PER_SIDE**2
            image[r, c, 0], image[r, c, 1], image[r, c, 2] = red / n, green / n, blue / n

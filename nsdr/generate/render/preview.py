"""A fast renderer without Blender: analytic shapes, CLEVR's lamps with soft shadows, metal that mirrors what is around it.

For training, tests and notebooks. Only what changes between frames is computed for each frame; the light on the empty scene is
kept for each view.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.generate.render.lamps import SUN_ANGLE, SUN_DIRECTION, SUN_STRENGTH, lamps_of
from nsdr.generate.render.painting import SRGB_STEPS, empty_scene, find_nearest, grid_points, paint
from nsdr.generate.render.raycast import Solid, image_box
from nsdr.generate.render.rays import CUBE, CYLINDER, SOLID, SPHERE
from nsdr.generate.render.shading import AMBIENT, SURFACE, background_radiance
from nsdr.generate.render.shadows import GRID_PX, LIGHT, cast_shadows, find_reach
from nsdr.generate.render.view import N_LAMPS, View
from nsdr.types import SceneObject
from nsdr.world.camera import Camera
from nsdr.world.vocabulary import COLORS_RGB

__all__ = ["render_preview"]

FloatArray = NDArray[np.float64]
POWER_PER_INTENSITY = 4.0
"""Power of a lamp (W) that shines with unit intensity straight ahead, in Blender. With pi, which energy would ask for, the
empty scene differs from the released background by 2.8 of 255 at the best `AMBIENT`, with this by 1.8 (`AMBIENT` 0.039)."""
SUN_DISTANCE_WORLD = 2000.0
"""Distance of the lamp that stands for the sun; at 100, its light would vary by a tenth over the image."""
KINDS = {"cube": CUBE, "sphere": SPHERE, "cylinder": CYLINDER}


class _EmptyScene(NamedTuple):
    """What all frames of a view have in common.

    Attributes:
        camera: the camera as `nsdr.generate.render.painting` describes it.
        lights: the lights as `nsdr.generate.render.shadows` describes them.
        by_light: (height, width, 4, 3) linear RGB of each light on the empty scene.
        ground: (rows, columns, 2) points on the ground in the grid of shadows.
        image: (height, width, 3) uint8 sRGB.
    """

    camera: FloatArray
    lights: FloatArray
    by_light: NDArray[np.float32]
    ground: FloatArray
    image: NDArray[np.uint8]


def render_preview(objects: Sequence[SceneObject], solids: Sequence[Solid], view: View) -> NDArray[np.uint8]:
    """Render one frame.

    Args:
        objects: colours and materials.
        solids: shapes, positions and rotations, in the same order.
        view: camera and lamps.

    Returns:
        (height, width, 3) uint8 RGB.
    """
    empty = _empty_scene(view)
    image = empty.image.copy()
    if not solids:
        return image
    packed = _pack(solids)
    boxes = np.array([image_box(solid, view.camera) or (0, 0, 0, 0) for solid in solids], np.int64)
    ids = np.full(image.shape[:2], -1, np.int16)
    depth = np.full(image.shape[:2], np.inf, np.float32)
    find_nearest(packed, boxes, empty.camera, ids, depth)
    light_share = np.ones((*empty.ground.shape[:2], len(empty.lights)), np.float32)
    touched = np.zeros(empty.ground.shape[:2], np.bool_)
    cast_shadows(packed, empty.lights, empty.camera, empty.ground, ids, light_share, touched)
    reach = np.empty((len(packed), len(packed), len(empty.lights)), np.bool_)
    find_reach(packed, empty.lights, reach)
    surfaces = _surfaces(objects, packed, empty.lights)
    passes = (empty.by_light, light_share, touched, _srgb_table(), image)
    paint(packed, empty.lights, surfaces, reach, empty.camera, boxes, ids, depth, *passes)
    return image


def _pack(solids: Sequence[Solid]) -> FloatArray:
    """The solids as `nsdr.generate.render.rays` describes them."""
    packed = np.empty((len(solids), SOLID))
    for row, solid in zip(packed, solids, strict=True):
        row[0], row[1:4], row[4:] = KINDS[solid.shape], solid.location_world, np.ravel(solid.rotation)
    return packed


def _surfaces(objects: Sequence[SceneObject], packed: FloatArray, lights: FloatArray) -> FloatArray:
    """The surfaces as `nsdr.generate.render.shading` describes them."""
    surfaces = np.empty((len(objects), SURFACE))
    for row, o, solid in zip(surfaces, objects, packed, strict=True):
        row[:3], row[3] = np.array(COLORS_RGB[o.color]) / 255.0, o.material == "metal"
        row[4:] = background_radiance(packed[:0], lights, (solid[1], solid[2], solid[3]), (0.0, 0.0, -1.0))
    return surfaces


@lru_cache(maxsize=4)
def _empty_scene(view: View) -> _EmptyScene:
    camera, lights = _camera(view.camera), _lights(view)
    height, width = view.camera.height, view.camera.width
    by_light = np.empty((height, width, len(lights), 3), np.float32)
    empty_scene(lights, camera, by_light)
    # One row and one column more than pixels need, for interpolation.
    ground = np.empty(((height - 1) // GRID_PX + 2, (width - 1) // GRID_PX + 2, 2))
    grid_points(camera, ground)
    steps = np.clip(by_light.sum(2) + AMBIENT, 0, 1) * (SRGB_STEPS - 1) + 0.5
    image = _srgb_table()[steps.astype(np.int64)]
    return _EmptyScene(camera, lights, by_light, ground, image)


def _camera(camera: Camera) -> FloatArray:
    return np.array([*camera.eye_world, *camera.axes.ravel(), camera.focal_px, camera.width / 2, camera.height / 2])


def _lights(view: View) -> FloatArray:
    """The three lamps and the sun, which all face the world's origin."""
    lights = np.empty((N_LAMPS + 1, LIGHT))
    for row, lamp in zip(lights, lamps_of(view), strict=False):
        row[:3], row[6:9], row[9] = (
            lamp.location_world,
            lamp.power / POWER_PER_INTENSITY * np.array(lamp.color),
            lamp.side_world,
        )
    sun = lights[-1]
    sun[:3], sun[6:9] = SUN_DISTANCE_WORLD * np.array(SUN_DIRECTION), SUN_STRENGTH * SUN_DISTANCE_WORLD**2
    sun[9] = SUN_ANGLE * SUN_DISTANCE_WORLD
    for row in lights:
        row[3:6] = -row[:3] / np.linalg.norm(row[:3])
        right = np.cross(row[3:6], [0.0, 0.0, 1.0])
        row[10:13] = row[9] * right / np.linalg.norm(right)
        row[13:] = np.cross(row[3:6], row[10:13])
    return lights


@lru_cache(maxsize=1)
def _srgb_table() -> NDArray[np.uint8]:
    """sRGB values (SRGB_STEPS,) of linear light from 0 to 1, by the piecewise curve of the sRGB standard."""
    x = np.linspace(0.0, 1.0, SRGB_STEPS)
    values = np.where(x < 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055) * 255
    return (values + 0.5).astype(np.uint8)

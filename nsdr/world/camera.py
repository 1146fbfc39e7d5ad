"""CLEVRER's camera, and conversions between world, pixels and the 100x150 grid of the released prediction files.

World: z up, x towards the camera, y to the right of the image; object centres are at z = 0.2. Pixels: (column, row) of the
480x320 image, pixel centres at +0.5. Grid: (row, column); one grid unit is 3.2 pixels.
"""

import math
import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD

__all__ = [
    "CLEVRER_CAMERA",
    "EYE_VARIABLE",
    "EYE_WORLD",
    "HEIGHT_PX",
    "LENS_MM",
    "SENSOR_MM",
    "WIDTH_PX",
    "Camera",
    "eye_of",
    "grid_from_pixels",
    "ground_from_pixels",
    "on_ground",
    "pixels_from_grid",
    "pixels_from_world",
]

WIDTH_PX, HEIGHT_PX = 480, 320
"""Size of the released videos (pixels)."""
EYE_VARIABLE = "NSDR_CAMERA_EYE"
"""Environment variable with another position of the camera, such as "5.0,0.5,3.0" (docs/other_cameras.md)."""
MIN_HEIGHT_WORLD, MIN_ASIDE_WORLD = 0.5, 0.1
"""The camera's least height, and least distance from the vertical through the origin, where images have no upward direction
(world units)."""


def eye_of(text: str) -> tuple[float, float, float]:
    """The position (x, y, z) that `EYE_VARIABLE` has, in world units; CLEVRER's for "".

    Raises:
        ValueError: not three numbers, or no place from which a camera sees the ground.
    """
    if not text:
        return 4.330127, 0.0, 2.5
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x, y, z = math.nan, math.nan, math.nan
    if not (z >= MIN_HEIGHT_WORLD and math.inf > math.hypot(x, y) >= MIN_ASIDE_WORLD and z < math.inf):
        raise ValueError(
            f"{EYE_VARIABLE}={text}: expected the camera's place as X,Y,Z with Z of at least {MIN_HEIGHT_WORLD} and not right "
            "above the origin, such as 5.0,0.5,3.0"
        )
    return x, y, z


EYE_WORLD = eye_of(os.environ.get(EYE_VARIABLE, ""))
"""Position (x, y, z) of the camera, which looks at the origin (world units). With CLEVRER's, a render of CLEVR's base scene
differs from a released background by 1.8 of 255 on average."""
LENS_MM, SENSOR_MM = 35.0, 32.0
"""Focal length and sensor width of CLEVR's camera (mm); the focal length is 525 px for a width of 480 px."""
_GRID_PER_PIXEL = 1 / 3.2
"""Grid units per pixel: 320x480 pixels are 100x150 grid units."""

FloatArray = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that looks at the origin.

    Attributes:
        eye_world: position (x, y, z) (world units).
        width: image width (pixels).
        height: image height (pixels).
    """

    eye_world: tuple[float, float, float] = EYE_WORLD
    width: int = WIDTH_PX
    height: int = HEIGHT_PX

    @cached_property
    def axes(self) -> FloatArray:
        """(3, 3): rows are the camera's right, down and forward directions in the world."""
        forward = -np.array(self.eye_world) / np.linalg.norm(self.eye_world)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def focal_px(self) -> float:
        """Focal length (pixels)."""
        return self.width * LENS_MM / SENSOR_MM

    @cached_property
    def matrix(self) -> FloatArray:
        """(3, 4) projection: world (x, y, z, 1) -> (u w, v w, w), with u the column, v the row (pixels) and w the depth."""
        intrinsic = np.array([[self.focal_px, 0, self.width / 2], [0, self.focal_px, self.height / 2], [0, 0, 1]])
        linear = intrinsic @ self.axes
        return np.c_[linear, -linear @ np.array(self.eye_world)]

    def depth(self, location_world: ArrayLike) -> FloatArray:
        """Depth (...) of world points (..., 3) along the viewing direction (world units)."""
        return np.asarray((np.asarray(location_world, float) - np.array(self.eye_world)) @ self.axes[2])

    def pixels(self, location_world: ArrayLike) -> FloatArray:
        """World (..., 3) -> pixels (..., 2) as (column, row); NaN for points behind the camera."""
        xyz = np.asarray(location_world, float)
        homogeneous = xyz @ self.matrix[:, :3].T + self.matrix[:, 3]
        depth = homogeneous[..., 2:]
        return homogeneous[..., :2] / np.where(depth > 0, depth, np.nan)

    def ground(self, pixels: ArrayLike, z_world: float = OBJECT_RADIUS_WORLD) -> FloatArray:
        """Pixels (..., 2) as (column, row) -> world (..., 2) as (x, y) on the plane of height `z_world`."""
        p = np.asarray(pixels, float)
        plane = np.c_[self.matrix[:, :2], self.matrix[:, 2] * z_world + self.matrix[:, 3]]
        inverse = np.linalg.inv(plane)
        homogeneous = p @ inverse[:, :2].T + inverse[:, 2]
        return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])

    def rays(self, columns: FloatArray, rows: FloatArray) -> FloatArray:
        """Unit directions (..., 3) in the world from the camera through the pixels at `columns` and `rows` (...)."""
        across = (columns - self.width / 2) / self.focal_px
        down = (rows - self.height / 2) / self.focal_px
        directions = np.stack([across, down, np.ones_like(across)], -1) @ self.axes
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


CLEVRER_CAMERA = Camera()
"""The camera of every released video, unless `EYE_VARIABLE` says otherwise."""


def pixels_from_world(location_world: ArrayLike) -> FloatArray:
    """`CLEVRER_CAMERA.pixels`: world (..., 3) -> pixels (..., 2) as (column, row)."""
    return CLEVRER_CAMERA.pixels(location_world)


def ground_from_pixels(pixels: ArrayLike, z_world: float = OBJECT_RADIUS_WORLD) -> FloatArray:
    """`CLEVRER_CAMERA.ground`: pixels (..., 2) as (column, row) -> world (..., 2) as (x, y) at height `z_world`."""
    return CLEVRER_CAMERA.ground(pixels, z_world)


def on_ground(location_world: ArrayLike) -> FloatArray:
    """Ground-plane positions (..., 2) -> centres (..., 3) of objects standing there."""
    xy = np.asarray(location_world, float)
    return np.concatenate([xy, np.full((*xy.shape[:-1], 1), OBJECT_RADIUS_WORLD)], -1)


def grid_from_pixels(pixels: ArrayLike) -> FloatArray:
    """Pixels (..., 2) as (column, row) -> grid (..., 2) as (row, column) in 0-100 and 0-150."""
    return np.asarray(pixels, float)[..., ::-1] * _GRID_PER_PIXEL


def pixels_from_grid(grid: ArrayLike) -> FloatArray:
    """Grid (..., 2) as (row, column) -> pixels (..., 2) as (column, row); inverse of `grid_from_pixels`."""
    return np.asarray(grid, float)[..., ::-1] / _GRID_PER_PIXEL

"""Cameras, and conversions between world, pixels and the 100x150 grid of the released prediction files.

World: z up, x towards the camera, y to the right of the image; object centres are at z = 0.2. Pixels: (column, row) of the
480x320 image, pixel centres at +0.5. Grid: (row, column); one grid unit is 3.2 pixels.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nsdr.world.physics_constants import GROUND_HALF_WIDTH_WORLD, OBJECT_RADIUS_WORLD

WIDTH_PX, HEIGHT_PX = 480, 320
"""Size of the released videos (pixels)."""
SENSOR_MM = 32.0
"""Width of the sensor of CLEVR's camera (mm)."""
MIN_HEIGHT_WORLD, MIN_ASIDE_WORLD = 0.5, 0.1
"""The camera's least height, and its least distance from the vertical through its target, where images have no upward direction
(world units)."""
FAR_WORLD = 2 * GROUND_HALF_WIDTH_WORLD
"""The ground is looked at up to this depth: beyond, on the way to the horizon, there are no objects (world units)."""
_GRID_PER_PIXEL = 1 / 3.2
"""Grid units per pixel: 320x480 pixels are 100x150 grid units."""

FloatArray = NDArray[np.floating[Any]]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera at rest, upright; the defaults are CLEVRER's.

    With these, a render of CLEVR's base scene differs from a released background by 1.8 of 255 on average.

    Attributes:
        eye_world: position (x, y, z) (world units).
        target_world: the point that it looks at, in the middle of the image (world units).
        lens_mm: focal length for a sensor `SENSOR_MM` wide; CLEVR's is 525 px long for a width of 480 px.
        width: image width (pixels).
        height: image height (pixels).

    Raises:
        ValueError: the camera has no place from which it sees the ground, looks above the ground, or has no size.
    """

    eye_world: Point = (4.330127, 0.0, 2.5)
    target_world: Point = (0.0, 0.0, 0.0)
    lens_mm: float = 35.0
    width: int = WIDTH_PX
    height: int = HEIGHT_PX

    def __post_init__(self) -> None:
        (x, y, z), target = self.eye_world, self.target_world
        aside = math.hypot(x - target[0], y - target[1])
        if not (MIN_HEIGHT_WORLD <= z < math.inf and MIN_ASIDE_WORLD <= aside < math.inf and math.isfinite(target[2])):
            raise ValueError(
                f"camera: eye_world {self.eye_world}, target_world {target}: expected the camera's place and the point that it "
                f"looks at as x, y, z, the place at least {MIN_HEIGHT_WORLD} high and not right above the point"
            )
        if not (0 < self.lens_mm < math.inf and self.width > 0 and self.height > 0):
            raise ValueError(
                f"camera: expected lens_mm, width and height above 0, got {self.lens_mm}, {self.width} and {self.height}"
            )
        if self.far_row_px >= self.height:
            raise ValueError(
                f"camera: eye_world {self.eye_world}, target_world {self.target_world}: looks above the ground; expected a "
                f"target whose surroundings on the ground, up to {FAR_WORLD:g} away, are in the image"
            )

    @cached_property
    def axes(self) -> FloatArray:
        """(3, 3): rows are the camera's right, down and forward directions in the world."""
        forward = np.array(self.target_world) - np.array(self.eye_world)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def focal_px(self) -> float:
        """Focal length (pixels)."""
        return self.width * self.lens_mm / SENSOR_MM

    @property
    def far_row_px(self) -> float:
        """The image row, below the horizon, at which centres of objects on the ground are `FAR_WORLD` deep."""
        (x, y, z), (to_x, to_y, to_z) = self.eye_world, self.target_world
        aside, above = math.hypot(to_x - x, to_y - y), z - OBJECT_RADIUS_WORLD
        tilt = math.atan2(to_z - z, aside)  # upwards
        return self.height / 2 + self.focal_px * (above / FAR_WORLD + math.sin(tilt)) / math.cos(tilt)

    @cached_property
    def matrix(self) -> FloatArray:
        """(3, 4) projection: world (x, y, z, 1) -> (u w, v w, w), with u the column, v the row (pixels) and w the depth."""
        intrinsic = np.array([[self.focal_px, 0, self.width / 2], [0, self.focal_px, self.height / 2], [0, 0, 1]])
        linear = intrinsic @ self.axes
        return np.c_[linear, -linear @ np.array(self.eye_world)]

    @cached_property
    def border_planes(self) -> FloatArray:
        """(4, 4): world points (x, y, z, 1) times a row are positive inside the image's left, top, right and bottom border."""
        across, down, depth = self.matrix
        return np.stack([across, down, self.width * depth - across, self.height * depth - down])

    def depth(self, location_world: ArrayLike) -> FloatArray:
        """Depth (...) of world points (..., 3) along the viewing direction (world units)."""
        return np.asarray((np.asarray(location_world, float) - np.array(self.eye_world)) @ self.axes[2])

    def pixels(self, location_world: ArrayLike) -> FloatArray:
        """World points -> pixels (..., 2) as (column, row); NaN for points behind the camera.

        Args:
            location_world: points (..., 3) as (x, y, z); or positions on the ground (..., 2) as (x, y), which stand for the
                centres of objects there, `OBJECT_RADIUS_WORLD` high, so that `ground` is the inverse (world units).
        """
        xyz = np.asarray(location_world, float)
        if xyz.shape[-1:] == (2,):
            xyz = on_ground(xyz)
        homogeneous = xyz @ self.matrix[:, :3].T + self.matrix[:, 3]
        depth = homogeneous[..., 2:]
        return homogeneous[..., :2] / np.where(depth > 0, depth, np.nan)

    def ground(self, pixels: ArrayLike, z_world: float = OBJECT_RADIUS_WORLD) -> FloatArray:
        """Pixels (..., 2) as (column, row) -> world (..., 2) as (x, y) at a height of `z_world`; NaN above the horizon."""
        p = np.asarray(pixels, float)
        plane = np.c_[self.matrix[:, :2], self.matrix[:, 2] * z_world + self.matrix[:, 3]]
        inverse = np.linalg.inv(plane)
        homogeneous = p @ inverse[:, :2].T + inverse[:, 2]
        inverse_depth = homogeneous[..., 2:]
        return np.asarray(homogeneous[..., :2] / np.where(inverse_depth > 0, inverse_depth, np.nan))

    def rays(self, columns: FloatArray, rows: FloatArray) -> FloatArray:
        """Unit directions (..., 3) in the world from the camera through the pixels at `columns` and `rows` (...)."""
        across = (columns - self.width / 2) / self.focal_px
        down = (rows - self.height / 2) / self.focal_px
        directions = np.stack([across, down, np.ones_like(across)], -1) @ self.axes
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


CLEVRER_CAMERA = Camera()
"""The camera of every released video."""


def check_release_size(camera: Camera) -> None:
    """Raise `ValueError` unless a camera's images have the size of the released ones, to which all videos are scaled."""
    if (camera.width, camera.height) != (WIDTH_PX, HEIGHT_PX):
        raise ValueError(f"camera: expected images of {WIDTH_PX}x{HEIGHT_PX}, got {camera.width}x{camera.height}")


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

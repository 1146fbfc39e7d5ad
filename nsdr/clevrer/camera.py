"""CLEVRER's camera, and conversion between world, pixels and the release's 100x150 grid.

The camera stands at (4.3301, 0, 2.5), looks at the origin, 30 degrees down, focal length 525 px (measured against a real
background). World: z up, object centres at z = 0.2. Pixels: (column, row) of the 480x320 picture, with pixel centres at
+0.5. Grid: (row, column) as in the released prediction files, 1/3.2 of a pixel.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "CAMERA_MATRIX",
    "FPS",
    "FRAME_SECONDS",
    "HEIGHT_PX",
    "OBJECT_RADIUS_WORLD",
    "WIDTH_PX",
    "grid_from_pixels",
    "ground_from_pixels",
    "pixels_from_grid",
    "pixels_from_world",
]

WIDTH_PX, HEIGHT_PX = 480, 320
FPS = 25
FRAME_SECONDS = 0.028
"""Simulated seconds between two frames (7 physics steps of 0.004 s), the time unit of every velocity."""
OBJECT_RADIUS_WORLD = 0.2
"""Half-size of every object, and the height of its centre above the ground."""
GRID_PER_PIXEL = 1 / 3.2

CAMERA_MATRIX = np.array(
    [
        [-207.8461456, 525.0, -120.0, 1200.0],
        [123.9359589, 0.0, -534.6633301, 799.9999390],
        [-0.8660254, 0.0, -0.5, 5.0],
    ]
)
"""(3, 4): world (x, y, z, 1) -> (u w, v w, w), with u the column and v the row in pixels, w the depth."""

FloatArray = NDArray[np.floating[Any]]


def pixels_from_world(location_world: ArrayLike) -> FloatArray:
    """World (..., 3) -> pixels (..., 2) as (column, row). Points behind the camera give NaN."""
    xyz = np.asarray(location_world, float)
    homogeneous = xyz @ CAMERA_MATRIX[:, :3].T + CAMERA_MATRIX[:, 3]
    depth = homogeneous[..., 2:]
    return homogeneous[..., :2] / np.where(depth > 0, depth, np.nan)


def ground_from_pixels(pixels: ArrayLike, z_world: float = OBJECT_RADIUS_WORLD) -> FloatArray:
    """Pixels (..., 2) as (column, row) -> world (..., 2) as (x, y) on the plane of height `z_world`."""
    p = np.asarray(pixels, float)
    rows = CAMERA_MATRIX[:2] - p[..., None] * CAMERA_MATRIX[2]
    solution = np.linalg.solve(rows[..., :2], -(rows[..., 2:3] * z_world + rows[..., 3:4]))
    return solution[..., 0]


def grid_from_pixels(pixels: ArrayLike) -> FloatArray:
    """Pixels (..., 2) as (column, row) -> grid (..., 2) as (row, column) in 0-100 and 0-150."""
    return np.asarray(pixels, float)[..., ::-1] * GRID_PER_PIXEL


def pixels_from_grid(grid: ArrayLike) -> FloatArray:
    """Grid (..., 2) as (row, column) -> pixels (..., 2) as (column, row); inverse of `grid_from_pixels`."""
    return np.asarray(grid, float)[..., ::-1] / GRID_PER_PIXEL

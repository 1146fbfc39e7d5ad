"""The camera that scenes are seen with: CLEVRER's, or one moved a little."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nsdr.clevrer.camera import HEIGHT_PX, OBJECT_RADIUS_WORLD, WIDTH_PX

__all__ = ["EYE_WORLD", "View", "drawn_rotation", "surface_points"]

FloatArray = NDArray[np.floating[Any]]
FOCAL_PER_WIDTH = 35 / 32
"""35 mm lens on a 32 mm sensor."""
EYE_WORLD = (4.330127, 0.0, 2.5)


@dataclass(frozen=True)
class View:
    """A camera that looks at the origin, and how far each lamp is shifted.

    Attributes:
        eye_world: where it stands.
        width: of the picture in pixels.
        height: of the picture in pixels.
        lamp_shift_world: (3 lamps x 3) shifts.
    """

    eye_world: tuple[float, float, float] = EYE_WORLD
    width: int = WIDTH_PX
    height: int = HEIGHT_PX
    lamp_shift_world: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),) * 3

    @cached_property
    def axes(self) -> FloatArray:
        """(3, 3): rows are the camera's right, down and forward in the world."""
        forward = -np.array(self.eye_world) / np.linalg.norm(self.eye_world)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def focal_px(self) -> float:
        """Focal length."""
        return self.width * FOCAL_PER_WIDTH

    def pixels(self, location_world: FloatArray) -> FloatArray:
        """World (..., 3) -> pixels (..., 2) as (column, row); NaN behind the camera."""
        seen = (np.asarray(location_world, float) - np.array(self.eye_world)) @ self.axes.T
        depth = np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        return seen[..., :2] / depth * self.focal_px + np.array([self.width / 2, self.height / 2])

    def rays(self, columns: FloatArray, rows: FloatArray) -> FloatArray:
        """Unit directions (..., 3) from the camera through pixels."""
        across = (columns - self.width / 2) / self.focal_px
        down = (rows - self.height / 2) / self.focal_px
        directions = np.stack([across, down, np.ones_like(across)], -1) @ self.axes
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def shows(self, shape: str, location_world: FloatArray, yaw: FloatArray) -> NDArray[np.bool_]:
        """In which frames (F,) some of an object's outline lies in the picture: CLEVRER's `inside_camera_view`.

        With CLEVRER's camera this agrees with 6,394 of 6,400 values in ten of the release's annotation files; the others
        are one frame off.

        Args:
            shape: "cube", "sphere" or "cylinder".
            location_world: (F, 3).
            yaw: (F,) radians.
        """
        depth = (location_world - np.array(self.eye_world)) @ self.axes[2]
        centre = self.pixels(location_world)
        size = np.array([self.width, self.height])
        with np.errstate(invalid="ignore"):
            reach = 2 * OBJECT_RADIUS_WORLD / np.maximum(depth, 0.01)[:, None] * self.focal_px
            near = ((centre > -reach) & (centre < size + reach)).all(1) & (depth > 3 * OBJECT_RADIUS_WORLD)
            inside = ((centre > 0) & (centre < size)).all(1) & near
        for f in np.flatnonzero(near & ~inside):
            outline = self.pixels(surface_points(shape, float(yaw[f])) + location_world[f])
            inside[f] = bool((outline.max(0) > 0).all() and (outline.min(0) < size).all())
        return np.asarray(inside)


def surface_points(shape: str, yaw: float = 0.0) -> FloatArray:
    """Points (N, 3) in world units around an object's centre, whose hull is the object."""
    r = OBJECT_RADIUS_WORLD
    if shape == "cube":
        c, s = r * np.cos(yaw), r * np.sin(yaw)
        corners = np.array([(c - s, s + c), (-c - s, -s + c), (-c + s, -s - c), (c + s, s - c)])
        return np.concatenate([np.c_[corners, np.full(4, z)] for z in (-r, r)])
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    if shape == "cylinder":
        return np.concatenate([np.c_[r * np.cos(angle), r * np.sin(angle), np.full(48, z)] for z in (-r, r)])
    polar = np.linspace(0, np.pi, 24)[:, None]
    x, y = r * np.sin(polar) * np.cos(angle), r * np.sin(polar) * np.sin(angle)
    return np.stack([x, y, r * np.cos(polar) + 0 * angle], -1).reshape(-1, 3)


def drawn_rotation(shape: str, orientation: FloatArray) -> Rotation:
    """Rotation of a drawn shape, whose axis is z, from annotated Euler angles (3,); annotated cylinders lie along local y."""
    turn = Rotation.from_euler("xyz", orientation)
    return turn * Rotation.from_euler("x", -np.pi / 2) if shape == "cylinder" else turn

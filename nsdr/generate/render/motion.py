"""Motion on the ground, rendered frame by frame."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.raycast import Solid
from nsdr.generate.render.view import View
from nsdr.types import SceneObject
from nsdr.world.camera import on_ground
from nsdr.world.shapes import rendered_rotation

__all__ = ["render_motion"]

FloatArray = NDArray[np.floating[Any]]


def render_motion(
    objects: Sequence[SceneObject], location_world: FloatArray, yaw: FloatArray, view: View
) -> Iterator[NDArray[np.uint8]]:
    """Frames of the preview renderer.

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
        yield render_preview(there, [_solid(o, location_world[o.id, frame], yaw[o.id, frame]) for o in there], view)


def _solid(o: SceneObject, place: FloatArray, yaw: float) -> Solid:
    tilt = np.pi / 2 if o.shape == "cylinder" else 0.0  # as annotated cylinders stand
    rotation = rendered_rotation(o.shape, np.array([tilt, 0.0, yaw])).as_matrix()
    return Solid(o.shape, on_ground(place), rotation)

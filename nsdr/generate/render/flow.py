"""Exact optical flow of a simulated scene: where the surface seen at each pixel is in the next frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.generate.render.raycast import Solid, cast, instance_ids
from nsdr.world.camera import Camera

__all__ = ["optical_flow"]


def optical_flow(now: Sequence[Solid], following: Sequence[Solid], camera: Camera) -> NDArray[np.float32]:
    """Displacement of what is seen, from one frame to the next.

    The ground is at rest, whatever shadow moves over it. A point's next place may be hidden or outside the image.

    Args:
        now: the solids of a frame.
        following: the same solids in the next one.
        camera: at rest.

    Returns:
        (height, width, 2) columns to the right and rows down (pixels).
    """
    ids = instance_ids(list(now), camera)
    flow = np.zeros((camera.height, camera.width, 2), np.float32)
    for i, (solid, moved) in enumerate(zip(now, following, strict=True)):
        rows, columns = np.nonzero(ids == i)
        if not len(rows):
            continue
        points = _surface(solid, rows + 0.5, columns + 0.5, camera)
        in_object = (points - solid.location_world) @ solid.rotation
        next_points = in_object @ moved.rotation.T + moved.location_world
        flow[rows, columns] = camera.pixels(next_points) - camera.pixels(points)
    return flow


def _surface(solid: Solid, rows: NDArray[Any], columns: NDArray[Any], camera: Camera) -> NDArray[np.floating[Any]]:
    """(N, 3) points of the solid that are seen at pixels."""
    eye, rays = np.array(camera.eye_world), camera.rays(columns, rows)
    distance, _ = cast(solid, eye, rays)
    return np.asarray(eye + distance[:, None] * rays)

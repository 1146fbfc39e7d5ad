"""The ground seen from above, frame by frame, drawn fast enough for videos; `figures.plan_figure` draws a still one."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.types import Rollout, SceneObject
from nsdr.types.scenes import yaws
from nsdr.validation import FloatArray
from nsdr.world.camera import CLEVRER_CAMERA, HEIGHT_PX, WIDTH_PX, Camera
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.vocabulary import COLORS_RGB

PX_PER_WORLD = 64.0
"""Scale of the plan (pixels per world unit): it is 7.5 units wide."""
TOP_X_WORLD = -2.8
"""World x at the plan's upper border (world units); y is 0 in its middle."""
FAR_EDGE_PX = 60
"""Image row up to which the visible ground is bright (pixels from the top of the video)."""
SUBPIXEL_BITS = 4
"""Fraction bits of OpenCV's coordinates."""
GROUND, OUTSIDE_GREY, INK, GHOST = (244, 244, 244), 222, (40, 40, 40), (170, 170, 170)
STAR_COLOR = (255, 200, 40)
COLLISION_FRAMES = 10
"""Frames for which a collision is marked."""
CORNERS = OBJECT_RADIUS_WORLD * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])


def draw_plan(
    objects: Sequence[SceneObject],
    rollout: Rollout,
    frame: int,
    ghost: Rollout | None = None,
    camera: Camera = CLEVRER_CAMERA,
) -> NDArray[np.uint8]:
    """One frame of a rollout from above: objects with their trails, and a star where two have just collided.

    World y points to the right and x down, as in the video. The bright part of the ground is what the camera sees. Objects of
    metal have a double outline.

    Args:
        objects: shapes and colours.
        rollout: positions and collisions.
        frame: which one.
        ghost: another rollout, whose outlines are drawn in grey.
        camera: the camera that sees the bright part.

    Returns:
        (320, 480, 3) uint8 RGB.
    """
    image = np.full((HEIGHT_PX, WIDTH_PX, 3), OUTSIDE_GREY, np.uint8)
    far = max(FAR_EDGE_PX, camera.far_row_px)
    corners = [(0, far), (0, HEIGHT_PX), (WIDTH_PX, HEIGHT_PX), (WIDTH_PX, far)]
    cv2.fillPoly(image, [_pixels(camera.ground(np.array(corners), 0.0))], GROUND, cv2.LINE_AA, SUBPIXEL_BITS)
    if ghost is not None:
        for o in objects:
            _draw_object(image, o, ghost.location_world[o.id, frame], yaws(ghost)[o.id, frame], None)
    for o in objects:
        trail = rollout.location_world[o.id, : frame + 1]
        trail = trail[np.isfinite(trail).all(1)]
        if len(trail) > 1 and np.isfinite(rollout.location_world[o.id, frame]).all():
            cv2.polylines(image, [_pixels(trail)], False, COLORS_RGB[o.color], 1, cv2.LINE_AA, SUBPIXEL_BITS)
    for o in objects:
        _draw_object(image, o, rollout.location_world[o.id, frame], yaws(rollout)[o.id, frame], COLORS_RGB[o.color])
    for event in rollout.collisions:
        places = rollout.location_world[list(event.objects), event.frame]
        if 0 <= frame - event.frame < COLLISION_FRAMES and np.isfinite(places).all():
            at = tuple(int(v) for v in _pixels(places.mean(0)) >> SUBPIXEL_BITS)
            cv2.drawMarker(image, at, INK, cv2.MARKER_STAR, 22, 4, cv2.LINE_AA)
            cv2.drawMarker(image, at, STAR_COLOR, cv2.MARKER_STAR, 20, 2, cv2.LINE_AA)
    return image


def _pixels(location_world: FloatArray) -> NDArray[np.int32]:
    """Ground positions (..., 2) as OpenCV's (column, row)."""
    x, y = location_world[..., 0], location_world[..., 1]
    pixels = np.stack([WIDTH_PX / 2 + PX_PER_WORLD * y, PX_PER_WORLD * (x - TOP_X_WORLD)], -1)
    most = 2.0**15  # OpenCV's coordinates are limited
    return np.round(np.clip(pixels, -most, most) * 2**SUBPIXEL_BITS).astype(np.int32)


def _draw_object(
    image: NDArray[np.uint8], o: SceneObject, place: FloatArray, yaw: float, fill: tuple[int, int, int] | None
) -> None:
    """Draw an object; without `fill` only its outline, as a ghost."""
    if not np.isfinite(place).all():
        return
    ink = GHOST if fill is None else INK
    outlines = [1.0, 0.72] if o.material == "metal" and fill is not None else [1.0]
    for share in outlines:
        points = _outline(o.shape, yaw) * share + place
        if fill is not None and share == 1.0:
            cv2.fillPoly(image, [_pixels(points)], fill, cv2.LINE_AA, SUBPIXEL_BITS)
        color = ink if share == 1.0 else (255, 255, 255)
        cv2.polylines(image, [_pixels(points)], True, color, 1, cv2.LINE_AA, SUBPIXEL_BITS)


def _outline(shape: str, yaw: float) -> FloatArray:
    """(N, 2) corners of a shape around its centre (world units): a hexagon stands for a cylinder, as in `plan_figure`."""
    if shape == "cube":
        c, s = np.cos(yaw), np.sin(yaw)
        return np.asarray(CORNERS @ np.array([(c, s), (-s, c)]))
    angle = np.linspace(0, 2 * np.pi, 6 if shape == "cylinder" else 32, endpoint=False)
    return OBJECT_RADIUS_WORLD * np.stack([np.cos(angle), np.sin(angle)], -1)

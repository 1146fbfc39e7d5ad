"""The ground seen from above, frame by frame, drawn fast enough for videos; `figures.plan_figure` draws a still one."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.types import Rollout, SceneObject
from nsdr.types.scenes import yaws
from nsdr.validation import FloatArray
from nsdr.world.camera import Camera
from nsdr.world.vocabulary import Shape
from nsdr.world.world import CLEVRER_WORLD, World

PLAN_WIDTH_WORLD = 7.5
"""Width of the plan (world units in CLEVRER, see `reach`)."""
TOP_X_WORLD = -2.8
"""World x at the plan's upper border (world units in CLEVRER); y is 0 in its middle."""
FAR_EDGE = 60 / 320
"""Share of the video's height above which the visible ground is not bright."""
SUBPIXEL_BITS = 4
"""Fraction bits of OpenCV's coordinates."""
GROUND, OUTSIDE_GREY, INK, GHOST = (244, 244, 244), 222, (40, 40, 40), (170, 170, 170)
STAR_COLOR = (255, 200, 40)
COLLISION_FRAMES = 10
"""Frames for which a collision is marked."""
CORNERS = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])


def draw_plan(
    objects: Sequence[SceneObject],
    rollout: Rollout,
    frame: int,
    world: World,
    ghost: Rollout | None = None,
) -> NDArray[np.uint8]:
    """One frame of a rollout from above: objects with their trails, and a star where two have just collided.

    World y points to the right and x down, as in the video. The bright part of the ground is what the camera sees. Metallic
    objects have a double outline.

    Args:
        objects: shapes and colours.
        rollout: positions and collisions.
        frame: which one.
        world: the world of the objects, whose camera sees the bright part.
        ghost: another rollout, whose outlines are drawn in grey.

    Returns:
        (height, width, 3) uint8 RGB, of the size of the world's videos.
    """
    image = np.full((world.camera.height, world.camera.width, 3), OUTSIDE_GREY, np.uint8)
    cv2.fillPoly(image, [_pixels(seen_ground(world.camera), world)], GROUND, cv2.LINE_AA, SUBPIXEL_BITS)
    if ghost is not None:
        for o in objects:
            _draw_object(image, o, ghost.location_world[o.id, frame], yaws(ghost)[o.id, frame], world, is_ghost=True)
    for o in objects:
        trail = rollout.location_world[o.id, : frame + 1]
        trail = trail[np.isfinite(trail).all(1)]
        if len(trail) > 1 and np.isfinite(rollout.location_world[o.id, frame]).all():
            color = world.vocabulary.color(o.color).srgb
            cv2.polylines(image, [_pixels(trail, world)], False, color, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    for o in objects:
        _draw_object(image, o, rollout.location_world[o.id, frame], yaws(rollout)[o.id, frame], world)
    for event in rollout.collisions:
        places = rollout.location_world[list(event.objects), event.frame]
        if 0 <= frame - event.frame < COLLISION_FRAMES and np.isfinite(places).all():
            at = tuple(int(v) for v in _pixels(places.mean(0), world) >> SUBPIXEL_BITS)
            cv2.drawMarker(image, at, INK, cv2.MARKER_STAR, 22, 4, cv2.LINE_AA)
            cv2.drawMarker(image, at, STAR_COLOR, cv2.MARKER_STAR, 20, 2, cv2.LINE_AA)
    return image


def seen_ground(camera: Camera) -> FloatArray:
    """(4, 2) corners of the ground that a camera sees well (world units)."""
    far, width, height = max(FAR_EDGE * camera.height, camera.far_row_px), camera.width, camera.height
    return camera.ground(np.array([(0, far), (0, height), (width, height), (width, far)]), 0.0)


def reach(world: World) -> float:
    """How far from the middle of the table objects start, as a multiple of CLEVRER's: what plans are scaled by."""
    return world.layout.start_distance_world[1] / CLEVRER_WORLD.layout.start_distance_world[1]


def _pixels(location_world: FloatArray, world: World) -> NDArray[np.int32]:
    """Ground positions (..., 2) as OpenCV's (column, row)."""
    x, y, width = location_world[..., 0], location_world[..., 1], world.camera.width
    px_per_world = width / (PLAN_WIDTH_WORLD * reach(world))
    pixels = np.stack([width / 2 + px_per_world * y, px_per_world * (x - TOP_X_WORLD * reach(world))], -1)
    most = 2.0**15  # OpenCV's coordinates are limited
    return np.round(np.clip(pixels, -most, most) * 2**SUBPIXEL_BITS).astype(np.int32)


def _draw_object(
    image: NDArray[np.uint8], o: SceneObject, place: FloatArray, yaw: float, world: World, is_ghost: bool = False
) -> None:
    """Draw an object; of a ghost only its outline."""
    if not np.isfinite(place).all():
        return
    words, ink = world.vocabulary, GHOST if is_ghost else INK
    outlines = [1.0, 0.72] if words.material(o.material).metallic and not is_ghost else [1.0]
    for share in outlines:
        points = outline(words.shape(o.shape), yaw) * share + place
        if not is_ghost and share == 1.0:
            fill = words.color(o.color).srgb
            cv2.fillPoly(image, [_pixels(points, world)], fill, cv2.LINE_AA, SUBPIXEL_BITS)
        color = ink if share == 1.0 else (255, 255, 255)
        cv2.polylines(image, [_pixels(points, world)], True, color, 1, cv2.LINE_AA, SUBPIXEL_BITS)


def outline(shape: Shape, yaw: float) -> FloatArray:
    """(N, 2) corners of a shape around its centre (world units): a hexagon stands for a cylinder, as in `plan_figure`."""
    if shape.solid == "box":
        c, s = np.cos(yaw), np.sin(yaw)
        return np.asarray(CORNERS * shape.size_world[:2] / 2 @ np.array([(c, s), (-s, c)]))
    angle = np.linspace(0, 2 * np.pi, 6 if shape.solid == "cylinder" else 32, endpoint=False)
    return shape.radius_world * np.stack([np.cos(angle), np.sin(angle)], -1)

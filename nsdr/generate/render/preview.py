"""A fast renderer without Blender: analytic shapes, CLEVR's lamps, soft shadows. For tests, notebooks and pre-training."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.generate.render.lamps import GROUND_REFLECTANCE, SUN_DIRECTION, SUN_STRENGTH, Lamp, lamps_of
from nsdr.generate.render.raycast import Solid, cast, image_box
from nsdr.generate.render.view import View
from nsdr.types import SceneObject
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.vocabulary import COLORS_RGB

__all__ = ["render_preview"]

FloatArray = NDArray[np.floating[Any]]
INDIRECT = 1.22
"""All light on the ground over that of the lamps themselves; measured on the release's empty scene."""
SKY = 0.02
"""What a mirror sees above the horizon, away from the lamps (linear)."""
SHADOW_STEP_PX = 3
"""Shadows are computed on every such pixel, and smoothed between."""
LAMP_CORNERS = ((-0.4, -0.4), (-0.4, 0.4), (0.4, -0.4), (0.4, 0.4))
"""Points of a lamp, in its sides, that shadows are averaged over."""
SUPERSAMPLING = 2
METAL_MIRROR, RUBBER_SHINE = 0.6, 0.05
"""Shares of light that are reflected rather than scattered."""
METAL_HIGHLIGHT, RUBBER_HIGHLIGHT = 300.0, 20.0
"""Sharpness of the lamps' images."""


def render_preview(objects: Sequence[SceneObject], solids: Sequence[Solid], view: View) -> NDArray[np.uint8]:
    """Image (height, width, 3) uint8 RGB of objects as they stand.

    Args:
        objects: colours and materials.
        solids: shapes, positions and turns, in the same order.
        view: camera and lamps.
    """
    by_lamp = _ground_light(view)
    linear = INDIRECT * np.asarray(by_lamp.sum(0))
    lamps = lamps_of(view)
    for solid in solids:
        _darken(linear, by_lamp, solid, lamps, view)
    image = _srgb(linear)
    nearest = np.full((view.camera.height * SUPERSAMPLING, view.camera.width * SUPERSAMPLING), np.inf, np.float32)
    for i in sorted(range(len(solids)), key=lambda i: -_depth(solids[i], view)):
        _paint(image, nearest, objects[i], solids[i], lamps, view)
    return np.clip(image + 0.5, 0, 255).astype(np.uint8)


def _depth(solid: Solid, view: View) -> float:
    return float(view.camera.depth(solid.location_world))


@lru_cache(maxsize=4)
def _ground_positions(view: View) -> FloatArray:
    """(height, width, 3): where each pixel's ray meets the ground."""
    columns, rows = np.meshgrid(np.arange(view.camera.width) + 0.5, np.arange(view.camera.height) + 0.5)
    rays = view.camera.rays(columns, rows)
    reach = np.where(rays[..., 2] < 0, -view.camera.eye_world[2] / np.minimum(rays[..., 2], -1e-6), 40.0)
    return np.array(view.camera.eye_world) + np.minimum(reach, 40.0)[..., None] * rays


@lru_cache(maxsize=4)
def _ground_light(view: View) -> FloatArray:
    """(4, height, width, 3): linear RGB that the ground sends back of each lamp's and the sun's light."""
    positions = _ground_positions(view)
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), positions.shape)
    parts = [_lamp_light(lamp, positions, up) for lamp in lamps_of(view)]
    parts.append(np.full(positions.shape, SUN_STRENGTH * SUN_DIRECTION[2]))
    return (np.stack(parts) * GROUND_REFLECTANCE / np.pi).astype(np.float32)


def _lamp_light(lamp: Lamp, positions: FloatArray, normals: FloatArray) -> FloatArray:
    """Irradiance (..., 3) of a downward lamp on surfaces."""
    way = np.array(lamp.location_world) - positions
    squared = (way * way).sum(-1)
    distance = np.sqrt(squared)
    leaves, arrives = np.maximum(way[..., 2] / distance, 0), np.maximum((way * normals).sum(-1) / distance, 0)
    strength = lamp.power / np.pi * leaves * arrives / squared
    return strength[..., None] * np.array(lamp.color)


def _darken(linear: FloatArray, by_lamp: FloatArray, solid: Solid, lamps: Sequence[Lamp], view: View) -> None:
    """Take from the ground the light that a solid keeps from it."""
    foot = solid.location_world * np.array([1.0, 1.0, 0.0])
    for k in range(len(lamps) + 1):
        if k < len(lamps):
            lamp = lamps[k]
            points = [np.array(lamp.location_world) + lamp.side_world * np.array([a, b, 0.0]) for a, b in LAMP_CORNERS]
            away = foot - np.array([*lamp.location_world[:2], 0.0])
            reach = 2.0 * OBJECT_RADIUS_WORLD / max(lamp.location_world[2], 0.5)
            tip = foot + away * reach * 1.3
        else:
            points = [foot + 100 * np.array(SUN_DIRECTION)]
            tip = foot - 0.6 * np.array([SUN_DIRECTION[0], SUN_DIRECTION[1], 0.0])
        window = _window(np.stack([foot, tip]), view)
        if window is None:
            continue
        left, top, right, bottom = window
        positions = _ground_positions(view)[top:bottom:SHADOW_STEP_PX, left:right:SHADOW_STEP_PX]
        flat = positions.reshape(-1, 3)
        kept = np.mean([np.isfinite(cast(solid, flat, point - flat)[0]) for point in points], 0)
        if not kept.any():
            continue
        small = kept.reshape(positions.shape[:2]).astype(np.float32)
        share = cv2.resize(small, (right - left, bottom - top), interpolation=cv2.INTER_LINEAR)
        linear[top:bottom, left:right] -= share[..., None] * by_lamp[k, top:bottom, left:right]


def _window(points_world: FloatArray, view: View) -> tuple[int, int, int, int] | None:
    """Pixels around ground points, with room for an object's width; None outside the image."""
    if (view.camera.depth(points_world) < 0.6).any():
        return None
    pixels = view.camera.pixels(points_world)
    room = 2.2 * OBJECT_RADIUS_WORLD / view.camera.depth(points_world).min() * view.camera.focal_px
    left, top = np.maximum((pixels.min(0) - room).astype(int), 0)
    right, bottom = np.minimum((pixels.max(0) + room).astype(int) + 1, [view.camera.width, view.camera.height])
    return (int(left), int(top), int(right), int(bottom)) if right - left > 1 and bottom - top > 1 else None


def _paint(
    image: FloatArray, nearest: FloatArray, o: SceneObject, solid: Solid, lamps: Sequence[Lamp], view: View
) -> None:
    box = image_box(solid, view.camera)
    if box is None:
        return
    left, top, right, bottom = box
    s = SUPERSAMPLING
    columns, rows = np.meshgrid((np.arange(left * s, right * s) + 0.5) / s, (np.arange(top * s, bottom * s) + 0.5) / s)
    rays = view.camera.rays(columns, rows).reshape(-1, 3)
    eye = np.array(view.camera.eye_world)
    t, normal = cast(solid, eye, rays)
    window = np.s_[top * s : bottom * s, left * s : right * s]
    shown = np.isfinite(t) & (t < nearest[window].ravel())
    if not shown.any():
        return
    color = _shade(o, eye + t[shown, None] * rays[shown], normal[shown] @ solid.rotation.T, rays[shown], lamps)
    depths = nearest[window].ravel()
    depths[shown] = t[shown]
    nearest[window] = depths.reshape(columns.shape)
    layer = np.zeros((len(t), 4), np.float32)
    layer[shown, :3], layer[shown, 3] = color, 1.0
    size = (right - left, bottom - top)
    small = cv2.resize(layer.reshape(*columns.shape, 4), size, interpolation=cv2.INTER_AREA)
    part = image[top:bottom, left:right]
    part *= 1 - small[..., 3:]
    part += small[..., :3]


def _shade(
    o: SceneObject, positions: FloatArray, normals: FloatArray, rays: FloatArray, lamps: Sequence[Lamp]
) -> FloatArray:
    """sRGB 0-255 (N, 3) of surface points."""
    base = (np.array(COLORS_RGB[o.color]) / 255.0).astype(np.float32)
    metal = o.material == "metal"
    sun = np.array(SUN_DIRECTION)
    light = sum(_lamp_light(lamp, positions, normals) for lamp in lamps)
    light = light + SUN_STRENGTH * np.maximum(normals @ sun, 0)[:, None]
    bounce = 0.5 * (1 - normals[:, 2:]) * 0.9  # from the lit ground
    mirrored = rays - 2 * (rays * normals).sum(1, keepdims=True) * normals
    facing = 1 + (rays * normals).sum(1, keepdims=True)
    sharpness = METAL_HIGHLIGHT if metal else RUBBER_HIGHLIGHT
    shine = np.where(mirrored[:, 2:] < 0, 0.24 * np.clip(-4 * mirrored[:, 2:], 0, 1), SKY)
    for lamp in lamps:
        way = np.array(lamp.location_world) - positions
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        along = np.clip((mirrored * way).sum(1, keepdims=True), 0, 1)
        shine = shine + lamp.power / 78.5 * (2.5 if metal else 0.6) * along**sharpness
    scattered = (light / np.pi + 0.22 * bounce) * base
    if metal:
        return _srgb(METAL_MIRROR * shine * base * 1.3 + (1 - METAL_MIRROR) * scattered * 1.2)
    return _srgb(scattered + (RUBBER_SHINE + 0.25 * facing**4) * shine * 0.6)


def _srgb(linear: FloatArray) -> FloatArray:
    """Linear light 0-1 -> sRGB 0-255."""
    x = np.clip(linear, 0, 1).astype(np.float32)
    return np.asarray(np.where(x < 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055) * 255, np.float32)

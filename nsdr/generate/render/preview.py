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
UP = np.array([0.0, 0.0, 1.0])
MAX_RAY_WORLD = 40.0
"""Rays that meet the ground farther away, or not at all, end at this distance."""
MIN_SLOPE = 1e-6
"""Min downward component of a ray that meets the ground; keeps a division finite."""
SUPERSAMPLING = 2
"""Samples per pixel along each axis on objects."""

INDIRECT = 1.22
"""All light on the ground relative to that of the lamps alone; measured on the release's empty scene."""
SKY = 0.02
"""Radiance that a mirror reflects from above the horizon, lamps excluded (linear)."""
MIRRORED_GROUND = 0.24
"""Radiance that a mirror reflects from the ground (linear)."""
HORIZON_SHARPNESS = 4
"""The mirrored ground reaches its full radiance when the downward component of the reflected ray is 1 / this."""
GROUND_BRIGHTNESS = 0.9
"""Brightness of the lit ground as seen by objects (linear)."""
BOUNCE_SHARE = 0.22
"""Share of the ground's brightness that an object's surface scatters."""
REFERENCE_POWER_W = 78.5
"""A lamp of this power has a highlight of unit strength, about the key lamp's."""

METAL_MIRROR = 0.6
"""Share of light that metal reflects rather than scatters."""
METAL_REFLECTION_GAIN, METAL_SCATTER_GAIN = 1.3, 1.2
"""Factors on the reflected and the scattered light of metal."""
METAL_HIGHLIGHT, METAL_HIGHLIGHT_EXPONENT = 2.5, 300.0
"""Strength and sharpness of a lamp's highlight on metal."""
RUBBER_SHINE, RUBBER_GRAZING_SHINE = 0.05, 0.25
"""Share of light that rubber reflects when seen head-on, and what is added at grazing angles."""
GRAZING_EXPONENT = 4
"""How sharply the reflection grows towards grazing angles."""
RUBBER_REFLECTION_GAIN = 0.6
"""Factor on the reflected light of rubber."""
RUBBER_HIGHLIGHT, RUBBER_HIGHLIGHT_EXPONENT = 0.6, 20.0
"""Strength and sharpness of a lamp's highlight on rubber."""

SHADOW_STEP_PX = 3
"""Shadows are computed on every n-th pixel along each axis and interpolated in between."""
LAMP_POINTS = ((-0.4, -0.4), (-0.4, 0.4), (0.4, -0.4), (0.4, 0.4))
"""Points of a lamp that shadows are averaged over, relative to its centre (lamp sides)."""
MIN_LAMP_HEIGHT_WORLD = 0.5
"""Lower lamps cast shadows as long as from this height."""
SHADOW_MARGIN = 1.3
"""Factor on a shadow's length for the window in which it is computed."""
SUN_DISTANCE_WORLD = 100
"""Distance of the point that stands for the sun."""
SUN_SHADOW_WORLD = 0.6
"""Extent of the window for the sun's shadow, before its projection on the ground."""
MIN_WINDOW_DEPTH_WORLD = 0.6
"""Shadows with a point nearer to the camera are left out."""
WINDOW_MARGIN_RADII = 2.2
"""Margin around a shadow's ends (object radii)."""


def render_preview(objects: Sequence[SceneObject], solids: Sequence[Solid], view: View) -> NDArray[np.uint8]:
    """Render one frame.

    Args:
        objects: colours and materials.
        solids: shapes, positions and rotations, in the same order.
        view: camera and lamps.

    Returns:
        (height, width, 3) uint8 RGB.
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
    """World point (height, width, 3) at which the ray of each pixel meets the ground."""
    columns, rows = np.meshgrid(np.arange(view.camera.width) + 0.5, np.arange(view.camera.height) + 0.5)
    rays = view.camera.rays(columns, rows)
    distance = -view.camera.eye_world[2] / np.minimum(rays[..., 2], -MIN_SLOPE)
    distance = np.where(rays[..., 2] < 0, distance, MAX_RAY_WORLD)
    return np.array(view.camera.eye_world) + np.minimum(distance, MAX_RAY_WORLD)[..., None] * rays


@lru_cache(maxsize=4)
def _ground_light(view: View) -> FloatArray:
    """Linear RGB (4, height, width, 3) that the ground reflects from each of the three lamps and the sun."""
    positions = _ground_positions(view)
    up = np.broadcast_to(UP, positions.shape)
    parts = [_lamp_light(lamp, positions, up) for lamp in lamps_of(view)]
    parts.append(np.full(positions.shape, SUN_STRENGTH * SUN_DIRECTION[2]))
    return (np.stack(parts) * GROUND_REFLECTANCE / np.pi).astype(np.float32)


def _lamp_light(lamp: Lamp, positions: FloatArray, normals: FloatArray) -> FloatArray:
    """Irradiance (..., 3) of a lamp that faces down, at surface points with the given normals."""
    to_lamp = np.array(lamp.location_world) - positions
    squared = (to_lamp * to_lamp).sum(-1)
    distance = np.sqrt(squared)
    cos_lamp = np.maximum(to_lamp[..., 2] / distance, 0)
    cos_surface = np.maximum((to_lamp * normals).sum(-1) / distance, 0)
    strength = lamp.power / np.pi * cos_lamp * cos_surface / squared
    return strength[..., None] * np.array(lamp.color)


def _darken(linear: FloatArray, by_lamp: FloatArray, solid: Solid, lamps: Sequence[Lamp], view: View) -> None:
    """Subtract from the ground's light, in place, what a solid blocks."""
    foot = solid.location_world * np.array([1.0, 1.0, 0.0])
    for k in range(len(lamps) + 1):
        if k < len(lamps):
            lamp = lamps[k]
            points = [np.array(lamp.location_world) + lamp.side_world * np.array([a, b, 0.0]) for a, b in LAMP_POINTS]
            away = foot - np.array([*lamp.location_world[:2], 0.0])
            length = 2.0 * OBJECT_RADIUS_WORLD / max(lamp.location_world[2], MIN_LAMP_HEIGHT_WORLD)
            tip = foot + away * length * SHADOW_MARGIN
        else:
            points = [foot + SUN_DISTANCE_WORLD * np.array(SUN_DIRECTION)]
            tip = foot - SUN_SHADOW_WORLD * np.array([SUN_DIRECTION[0], SUN_DIRECTION[1], 0.0])
        window = _window(np.stack([foot, tip]), view)
        if window is None:
            continue
        left, top, right, bottom = window
        positions = _ground_positions(view)[top:bottom:SHADOW_STEP_PX, left:right:SHADOW_STEP_PX]
        flat = positions.reshape(-1, 3)
        blocked = np.mean([np.isfinite(cast(solid, flat, point - flat)[0]) for point in points], 0)
        if not blocked.any():
            continue
        small = blocked.reshape(positions.shape[:2]).astype(np.float32)
        share = cv2.resize(small, (right - left, bottom - top), interpolation=cv2.INTER_LINEAR)
        linear[top:bottom, left:right] -= share[..., None] * by_lamp[k, top:bottom, left:right]


def _window(points_world: FloatArray, view: View) -> tuple[int, int, int, int] | None:
    """Box (left, top, right, bottom) in pixels around ground points and an object's width; None outside the image."""
    if (view.camera.depth(points_world) < MIN_WINDOW_DEPTH_WORLD).any():
        return None
    pixels = view.camera.pixels(points_world)
    margin = WINDOW_MARGIN_RADII * OBJECT_RADIUS_WORLD / view.camera.depth(points_world).min() * view.camera.focal_px
    left, top = np.maximum((pixels.min(0) - margin).astype(int), 0)
    right, bottom = np.minimum((pixels.max(0) + margin).astype(int) + 1, [view.camera.width, view.camera.height])
    return (int(left), int(top), int(right), int(bottom)) if right - left > 1 and bottom - top > 1 else None


def _paint(
    image: FloatArray, nearest: FloatArray, o: SceneObject, solid: Solid, lamps: Sequence[Lamp], view: View
) -> None:
    """Draw an object over the image where it is nearest to the camera; updates `image` and `nearest` in place."""
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
    """sRGB colours (N, 3), 0-255, of surface points."""
    base = (np.array(COLORS_RGB[o.color]) / 255.0).astype(np.float32)
    metal = o.material == "metal"
    sun = np.array(SUN_DIRECTION)
    light = sum(_lamp_light(lamp, positions, normals) for lamp in lamps)
    light = light + SUN_STRENGTH * np.maximum(normals @ sun, 0)[:, None]
    bounce = 0.5 * (1 - normals[:, 2:]) * GROUND_BRIGHTNESS
    mirrored = rays - 2 * (rays * normals).sum(1, keepdims=True) * normals
    highlight = METAL_HIGHLIGHT if metal else RUBBER_HIGHLIGHT
    exponent = METAL_HIGHLIGHT_EXPONENT if metal else RUBBER_HIGHLIGHT_EXPONENT
    shine = np.where(mirrored[:, 2:] < 0, MIRRORED_GROUND * np.clip(-HORIZON_SHARPNESS * mirrored[:, 2:], 0, 1), SKY)
    for lamp in lamps:
        to_lamp = np.array(lamp.location_world) - positions
        to_lamp /= np.linalg.norm(to_lamp, axis=1, keepdims=True)
        alignment = np.clip((mirrored * to_lamp).sum(1, keepdims=True), 0, 1)
        shine = shine + lamp.power / REFERENCE_POWER_W * highlight * alignment**exponent
    scattered = (light / np.pi + BOUNCE_SHARE * bounce) * base
    if metal:
        reflected = METAL_MIRROR * shine * base * METAL_REFLECTION_GAIN
        return _srgb(reflected + (1 - METAL_MIRROR) * scattered * METAL_SCATTER_GAIN)
    grazing = 1 + (rays * normals).sum(1, keepdims=True)
    mirror = RUBBER_SHINE + RUBBER_GRAZING_SHINE * grazing**GRAZING_EXPONENT
    return _srgb(scattered + mirror * shine * RUBBER_REFLECTION_GAIN)


def _srgb(linear: FloatArray) -> FloatArray:
    """Linear light 0-1 -> sRGB 0-255, by the piecewise curve of the sRGB standard."""
    x = np.clip(linear, 0, 1).astype(np.float32)
    return np.asarray(np.where(x < 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055) * 255, np.float32)

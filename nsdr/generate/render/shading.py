"""Compiled light and materials: what ground, backdrop and objects look like at one point.

`surfaces` is an array (n, SURFACE): linear RGB of an object's colour, 1 for metal and 0 for rubber, and linear RGB of the
ground below the object. Other arrays are described in `nsdr.generate.render.rays` and `shadows`.
"""

import math

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.generate.render.lamps import GROUND_REFLECTANCE
from nsdr.generate.render.materials import (
    METAL_ROUGH,
    METAL_SHARP,
    METAL_SHARP_SHARE,
    RUBBER_GLOSS_IOR,
    RUBBER_GLOSS_ROUGHNESS,
)
from nsdr.generate.render.rays import first_hit, rounded_normal
from nsdr.generate.render.shadows import blocked, blocked_roughly

__all__ = ["SURFACE", "background_point", "background_radiance", "irradiance", "object_radiance"]

SURFACE = 7
"""Numbers that describe a surface."""
AMBIENT = 0.039
"""Radiance that reaches everything from afar, by many bounces (linear); the best of 0.02 to 0.06 on the released background."""
BACKDROP_NORMAL = (0.904, -0.428)
"""Direction (x, y) in which the wall behind CLEVR's scene faces. Its ground curves up to it."""
BACKDROP_DISTANCE_WORLD = 13.0
"""Distance of the wall from the world's origin."""
ROUGH_HORIZON = 0.35
"""Half of the range of the reflected ray's upward component over which a rough mirror blends ground and sky."""
SKY = 0.012
"""Radiance that a rough mirror reflects from above the horizon, lamps excluded (linear)."""
RUBBER_MATT = 0.9
"""Share of light that rubber scatters; with more, rubber is brighter than Blender's (`python benchmarks/preview.py`)."""
MIRRORED_METAL = 0.5
"""Brightness of metal relative to rubber's when seen in a mirror."""
MIN_COS = 0.25
"""Smallest cosine between view and surface in the formulas of gloss. Smaller ones make bright lines where a rounded edge turns
away from the camera, which the sharp outlines here would show and round ones hide."""


@cached_njit
def irradiance(lights, k, p, n):  # type: ignore[no-untyped-def]
    """Irradiance relative to the light's intensity, of a surface at `p` with the normal `n`, and the direction to the light."""
    x, y, z = lights[k, 0] - p[0], lights[k, 1] - p[1], lights[k, 2] - p[2]
    squared = x * x + y * y + z * z
    distance = math.sqrt(squared)
    x, y, z = x / distance, y / distance, z / distance
    cos_surface = x * n[0] + y * n[1] + z * n[2]
    cos_lamp = -(x * lights[k, 3] + y * lights[k, 4] + z * lights[k, 5])
    return max(cos_surface, 0.0) * max(cos_lamp, 0.0) / squared, (x, y, z), distance


@cached_njit
def background_point(p, d):  # type: ignore[no-untyped-def]
    """Where a ray meets the ground or the backdrop, the normal there, and whether it meets any."""
    aside = d[0] * BACKDROP_NORMAL[0] + d[1] * BACKDROP_NORMAL[1]
    wall = math.inf
    if aside < 0.0:
        wall = -(BACKDROP_DISTANCE_WORLD + p[0] * BACKDROP_NORMAL[0] + p[1] * BACKDROP_NORMAL[1]) / aside
    floor = -p[2] / d[2] if d[2] < 0.0 else math.inf
    t = min(wall, floor)
    if not 0.0 <= t < math.inf:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), False
    q = (p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2])
    if floor <= wall:
        return q, (0.0, 0.0, 1.0), True
    return q, (BACKDROP_NORMAL[0], BACKDROP_NORMAL[1], 0.0), True


@cached_njit
def background_radiance(solids, lights, p, d):  # type: ignore[no-untyped-def]
    """Linear RGB of the ground or the backdrop that a mirrored ray meets, with rough shadows."""
    q, n, met = background_point(p, d)
    if not met:
        return 0.0, 0.0, 0.0
    red = green = blue = 0.0
    for k in range(len(lights)):
        light = irradiance(lights, k, q, n)[0] * GROUND_REFLECTANCE / math.pi
        for j in range(len(solids)):
            light *= 1.0 - blocked_roughly(solids, lights, j, k, q)
        red += light * lights[k, 6]
        green += light * lights[k, 7]
        blue += light * lights[k, 8]
    return red + AMBIENT, green + AMBIENT, blue + AMBIENT


@cached_njit
def _gloss(alpha, cos_half_squared, cos_view, cos_light):  # type: ignore[no-untyped-def]
    """GGX reflection of a small light (per unit irradiance); alpha is the squared roughness."""
    a = alpha * alpha
    spread = cos_half_squared * (a - 1.0) + 1.0
    half = 0.5 * alpha
    masking = (cos_view * (1.0 - half) + half) * (cos_light * (1.0 - half) + half)
    return a / (math.pi * spread * spread * 4.0 * masking)


@cached_njit
def _fresnel(ior, cos_view):  # type: ignore[no-untyped-def]
    """Share of light that a dielectric reflects."""
    g = math.sqrt(ior * ior - 1.0 + cos_view * cos_view)
    a = (g - cos_view) / (g + cos_view)
    b = (cos_view * (g + cos_view) - 1.0) / (cos_view * (g - cos_view) + 1.0)
    return 0.5 * a * a * (1.0 + b * b)


@cached_njit
def _diffuse(lights, surfaces, i, p, n):  # type: ignore[no-untyped-def]
    """Linear RGB that an object's matt surface scatters, without shadows; for what is seen in mirrors."""
    up = 0.5 * (1.0 - n[2])
    red, green, blue = AMBIENT + up * surfaces[i, 4], AMBIENT + up * surfaces[i, 5], AMBIENT + up * surfaces[i, 6]
    for k in range(len(lights)):
        light = irradiance(lights, k, p, n)[0] / math.pi
        red += light * lights[k, 6]
        green += light * lights[k, 7]
        blue += light * lights[k, 8]
    return red * surfaces[i, 0], green * surfaces[i, 1], blue * surfaces[i, 2]


@cached_njit
def _mirrored(solids, lights, surfaces, i, p, d):  # type: ignore[no-untyped-def]
    """Linear RGB of what a ray from object `i` meets: another object, the ground, or the backdrop."""
    j, t = first_hit(solids, p, d, i)
    if j < 0:
        return background_radiance(solids, lights, p, d)
    q = (p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2])
    red, green, blue = _diffuse(lights, surfaces, j, q, rounded_normal(solids, j, q))
    share = MIRRORED_METAL if surfaces[j, 3] > 0.0 else 1.0
    return share * red, share * green, share * blue


@cached_njit
def object_radiance(solids, lights, surfaces, reach, i, p, n, v):  # type: ignore[no-untyped-def]
    """Linear RGB of an object.

    Args:
        solids: the solids.
        lights: the lights.
        surfaces: the objects' surfaces.
        reach: (n, n, 4) which lights solids may hide from each other.
        i: which object.
        p: the point.
        n: the normal there.
        v: unit direction of the view.
    """
    cos_view = max(-(v[0] * n[0] + v[1] * n[1] + v[2] * n[2]), 0.0)
    alpha = RUBBER_GLOSS_ROUGHNESS**2
    matt_red = matt_green = matt_blue = 0.0
    shiny_red = shiny_green = shiny_blue = 0.0
    for k in range(len(lights)):
        light, to_light, distance = irradiance(lights, k, p, n)
        if light <= 0.0:
            continue
        for j in range(len(solids)):
            if reach[i, j, k]:
                light *= 1.0 - blocked(solids, lights, j, k, p)
        if light <= 0.0:
            continue
        cos_light = to_light[0] * n[0] + to_light[1] * n[1] + to_light[2] * n[2]
        cos_between = to_light[0] * v[0] + to_light[1] * v[1] + to_light[2] * v[2]
        half = (cos_light + cos_view) ** 2 / (2.0 - 2.0 * cos_between)
        wider = 0.25 * lights[k, 9] / distance
        if surfaces[i, 3] > 0.0:
            sharp = _gloss(METAL_SHARP**2 + wider, half, max(cos_view, MIN_COS), cos_light)
            rough = _gloss(METAL_ROUGH**2 + wider, half, max(cos_view, MIN_COS), cos_light)
            shine = light * (METAL_SHARP_SHARE * sharp + (1.0 - METAL_SHARP_SHARE) * rough)
        else:
            shine = light * _gloss(alpha + wider, half, max(cos_view, MIN_COS), cos_light)
        shiny_red += shine * lights[k, 6]
        shiny_green += shine * lights[k, 7]
        shiny_blue += shine * lights[k, 8]
        light /= math.pi
        matt_red += light * lights[k, 6]
        matt_green += light * lights[k, 7]
        matt_blue += light * lights[k, 8]
    mx, my, mz = v[0] + 2.0 * cos_view * n[0], v[1] + 2.0 * cos_view * n[1], v[2] + 2.0 * cos_view * n[2]
    ground = min(max(0.5 - 0.5 * mz / ROUGH_HORIZON, 0.0), 1.0)
    rough_red = SKY + ground * surfaces[i, 4]
    rough_green = SKY + ground * surfaces[i, 5]
    rough_blue = SKY + ground * surfaces[i, 6]
    if surfaces[i, 3] > 0.0:
        red, green, blue = _mirrored(solids, lights, surfaces, i, p, (mx, my, mz))
        rest = 1.0 - METAL_SHARP_SHARE
        return (
            surfaces[i, 0] * (shiny_red + METAL_SHARP_SHARE * red + rest * rough_red),
            surfaces[i, 1] * (shiny_green + METAL_SHARP_SHARE * green + rest * rough_green),
            surfaces[i, 2] * (shiny_blue + METAL_SHARP_SHARE * blue + rest * rough_blue),
        )
    gloss = _fresnel(RUBBER_GLOSS_IOR, max(cos_view, MIN_COS))
    matt, up = RUBBER_MATT * (1.0 - gloss), 0.5 * (1.0 - n[2])
    return (
        matt * surfaces[i, 0] * (matt_red + AMBIENT + up * surfaces[i, 4]) + gloss * (shiny_red + rough_red),
        matt * surfaces[i, 1] * (matt_green + AMBIENT + up * surfaces[i, 5]) + gloss * (shiny_green + rough_green),
        matt * surfaces[i, 2] * (matt_blue + AMBIENT + up * surfaces[i, 6]) + gloss * (shiny_blue + rough_blue),
    )

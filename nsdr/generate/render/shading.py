"""Compiled functions for light and materials: the colour that a ray sees. Colours are tuples of linear red, green and blue."""

import math

from nsdr.dynamics.numba_cache import cached_njit, inlined_njit
from nsdr.generate.render.geometry import (
    COLOR,
    HALF_DIAGONAL,
    PLACE,
    added,
    dot,
    find_light,
    first_hit,
    normal_at,
    three,
)

SURFACE_COLOR, BELOW, METAL, ROUGHNESS = 0, 3, 6, 7
"""Columns of an array of surfaces: linear RGB of an object's colour and of the ground below it, 1 for metal, and the roughness
of the gloss."""
REFLECTANCE, AMBIENT = 0, 1
"""Rows of an array of a ground: reflectance, and radiance that reaches every point after many bounces (linear RGB)."""
BACKDROP_NORMAL = (0.904, -0.428, 0.0)
"""Direction in which the wall behind CLEVR's scene faces. Its ground curves up to it."""
BACKDROP_DISTANCE_WORLD = 13.0
"""Distance of the wall from the world's origin."""
SCATTERED = 1.0 / math.pi
"""Radiance of a matt white surface per unit irradiance."""
LAMP_BLUR = 0.25 * math.sqrt(2.0)
"""How much a lamp widens a highlight: squared roughness for each ratio of half the lamp's diagonal to its distance."""
ROUGH_HORIZON = 0.35
"""Half of the range of the reflected ray's upward component over which a rough mirror blends ground and sky."""
SKY = 0.012
"""Radiance that a rough mirror reflects from above the horizon, lamps excluded (linear)."""
RUBBER_GLOSS_IOR = 1.25
"""Refractive index of the Fresnel factor that mixes in rubber's gloss, as in CLEVR's material."""
METAL_ROUGH = 0.447
"""Roughness of the second, rougher gloss of CLEVR's metal."""
METAL_SHARP_SHARE = 0.6
"""Share of metal's first gloss."""
RUBBER_MATT = 0.9
"""Share of light that rubber scatters; with more, rubber is brighter than Blender's (`python -m benchmarks.generate`)."""
MIN_COS = 0.25
"""Smallest cosine between view and surface in the formulas for gloss. Smaller ones make bright lines where a rounded edge turns
away from the camera; really round outlines would hide these lines, but the outlines here are sharp."""


@inlined_njit
def _times(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inlined_njit
def background(solids, lights, ground, p, d, found):  # type: ignore[no-untyped-def]
    """Colour of the ground or the wall behind it where a ray meets them, with the solids' shadows."""
    towards = -dot(d, BACKDROP_NORMAL)
    wall = (BACKDROP_DISTANCE_WORLD + dot(p, BACKDROP_NORMAL)) / towards if towards > 0.0 else math.inf
    floor = -p[2] / d[2] if d[2] < 0.0 else math.inf
    t = min(wall, floor)
    if not 0.0 <= t < math.inf:
        return 0.0, 0.0, 0.0
    q = added(p, t, d)
    n = (0.0, 0.0, 1.0) if floor <= wall else BACKDROP_NORMAL
    color, reflectance = three(ground, AMBIENT, 0), three(ground, REFLECTANCE, 0)
    find_light(solids, lights, q, n, -1, found)
    for k in range(len(lights)):
        light, lamp = found[k] * SCATTERED, three(lights, k, COLOR)
        color = (
            color[0] + light * reflectance[0] * lamp[0],
            color[1] + light * reflectance[1] * lamp[1],
            color[2] + light * reflectance[2] * lamp[2],
        )
    return color


@inlined_njit
def _gloss(alpha, cos_half_squared, cos_view, cos_light):  # type: ignore[no-untyped-def]
    """GGX reflection of a small light (per unit irradiance); alpha is the squared roughness."""
    a = alpha * alpha
    spread = cos_half_squared * (a - 1.0) + 1.0
    half = 0.5 * alpha
    masking = (cos_view * (1.0 - half) + half) * (cos_light * (1.0 - half) + half)
    return a / (math.pi * spread * spread * 4.0 * masking)


@inlined_njit
def _fresnel(ior, cos_view):  # type: ignore[no-untyped-def]
    """Share of light that a dielectric reflects."""
    g = math.sqrt(ior * ior - 1.0 + cos_view * cos_view)
    a = (g - cos_view) / (g + cos_view)
    b = (cos_view * (g + cos_view) - 1.0) / (cos_view * (g - cos_view) + 1.0)
    return 0.5 * a * a * (1.0 + b * b)


@inlined_njit
def _lamps(solids, lights, i, metal, roughness, p, n, d, found):  # type: ignore[no-untyped-def]
    """Light of the lamps that solid `i` scatters in all directions, and light that its gloss reflects back along the ray."""
    cos_view = -dot(d, n)
    find_light(solids, lights, p, n, i, found)
    matt = shiny = (0.0, 0.0, 0.0)
    for k in range(len(lights)):
        light = found[k]
        if light <= 0.0:
            continue
        way = added(three(lights, k, PLACE), -1.0, p)
        near = 1.0 / math.sqrt(dot(way, way))
        cos_light = dot(way, n) * near
        half = (cos_light + cos_view) ** 2 / (2.0 - 2.0 * dot(way, d) * near)
        wider = LAMP_BLUR * lights[k, HALF_DIAGONAL] * near
        if metal:
            sharp = _gloss(roughness**2 + wider, half, max(cos_view, MIN_COS), cos_light)
            rough = _gloss(METAL_ROUGH**2 + wider, half, max(cos_view, MIN_COS), cos_light)
            gloss = METAL_SHARP_SHARE * sharp + (1.0 - METAL_SHARP_SHARE) * rough
        else:
            gloss = _gloss(roughness**2 + wider, half, max(cos_view, MIN_COS), cos_light)
        matt = added(matt, light * SCATTERED, three(lights, k, COLOR))
        shiny = added(shiny, light * gloss, three(lights, k, COLOR))
    return matt, shiny


@inlined_njit
def _mirrored(n, d):  # type: ignore[no-untyped-def]
    """Direction of a ray after a mirror with the normal `n`."""
    return added(d, -2.0 * dot(d, n), n)


@inlined_njit
def _blurred(below, d):  # type: ignore[no-untyped-def]
    """Colour of ground and sky that a rough mirror shows in the direction `d`."""
    return added((SKY, SKY, SKY), min(max(0.5 - 0.5 * d[2] / ROUGH_HORIZON, 0.0), 1.0), below)


@inlined_njit
def _colored(solids, lights, ground, surfaces, i, p, n, d, mirrored, found):  # type: ignore[no-untyped-def]
    """Colour of solid `i`; metal reflects the colour `mirrored`."""
    color, below = three(surfaces, i, SURFACE_COLOR), three(surfaces, i, BELOW)
    is_metal, roughness = surfaces[i, METAL] > 0.0, surfaces[i, ROUGHNESS]
    matt, shiny = _lamps(solids, lights, i, is_metal, roughness, p, n, d, found)
    rough = _blurred(below, _mirrored(n, d))
    if is_metal:
        light = added(added(shiny, METAL_SHARP_SHARE, mirrored), 1.0 - METAL_SHARP_SHARE, rough)
        return _times(light, color)
    gloss = _fresnel(RUBBER_GLOSS_IOR, max(-dot(d, n), MIN_COS))
    matt = added(added(matt, 0.5 * (1.0 - n[2]), below), 1.0, three(ground, AMBIENT, 0))
    scattered = _times(added((0.0, 0.0, 0.0), RUBBER_MATT * (1.0 - gloss), matt), color)
    return added(scattered, gloss, added(shiny, 1.0, rough))


@cached_njit
def _seen(solids, lights, ground, surfaces, i, p, d, found):  # type: ignore[no-untyped-def]
    """Colour of solid `i` at a point of it, seen in the direction `d`."""
    n = normal_at(solids, i, p)
    mirrored = (0.0, 0.0, 0.0)
    if surfaces[i, METAL] > 0.0:
        e = _mirrored(n, d)
        j, t = first_hit(solids, p, e, i)
        if j < 0:
            mirrored = background(solids, lights, ground, p, e, found)
        else:
            q = added(p, t, e)
            m = normal_at(solids, j, q)
            blurred = _blurred(three(surfaces, j, BELOW), _mirrored(m, e))
            mirrored = _colored(solids, lights, ground, surfaces, j, q, m, e, blurred, found)
    return _colored(solids, lights, ground, surfaces, i, p, n, d, mirrored, found)


@inlined_njit
def trace(solids, lights, ground, surfaces, p, d, found):  # type: ignore[no-untyped-def]
    """Index of the solid that a ray from the camera at `p` meets, -1 for none, and the colour that it sees.

    `find_light` uses `found` as its buffer.
    """
    i, t = first_hit(solids, p, d, -1)
    if i < 0:
        return i, background(solids, lights, ground, p, d, found)
    return i, _seen(solids, lights, ground, surfaces, i, added(p, t, d), d, found)

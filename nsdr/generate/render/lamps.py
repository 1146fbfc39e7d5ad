"""Lights and ground of CLEVR's base scene: three square area lamps, a weak sun and a plain grey ground."""

from dataclasses import dataclass

from nsdr.generate.render.view import View

__all__ = ["GROUND_REFLECTANCE", "LAMPS", "SUN_ANGLE", "SUN_DIRECTION", "SUN_STRENGTH", "Lamp", "lamps_of"]


@dataclass(frozen=True)
class Lamp:
    """A square area lamp. In CLEVR's base scene it faces the origin; in the substitutes for it, down.

    Attributes:
        name: "key", "fill" or "back".
        location_world: centre (x, y, z).
        side_world: side length (world units).
        power: radiant power (W).
        color: linear RGB (0-1).
    """

    name: str
    location_world: tuple[float, float, float]
    side_world: float
    power: float
    color: tuple[float, float, float]


LAMPS = (
    Lamp("key", (6.447, -2.905, 4.258), 0.5, 78.54, (1.0, 0.932, 0.817)),
    Lamp("fill", (-4.671, -4.014, 3.011), 0.5, 23.56, (0.762, 0.818, 1.0)),
    Lamp("back", (-1.169, 2.646, 5.816), 1.0, 39.27, (1.0, 1.0, 1.0)),
)
"""The lamps of CLEVR's base scene."""
SUN_STRENGTH = 0.45
"""Irradiance of the sun (W/m², Blender's strength of a sun lamp)."""
SUN_ANGLE = 0.2
"""Angular diameter of the sun (rad)."""
SUN_DIRECTION = (0.4146, -0.1946, 0.889)
"""Unit vector towards the sun."""
GROUND_REFLECTANCE = 0.8
"""Diffuse reflectance of the ground (0-1)."""


def lamps_of(view: View) -> tuple[Lamp, ...]:
    """The lamps, shifted by the view's jitter."""
    lamps = []
    for lamp, shift in zip(LAMPS, view.lamp_shift_world, strict=True):
        x, y, z = (a + b for a, b in zip(lamp.location_world, shift, strict=True))
        lamps.append(Lamp(lamp.name, (x, y, z), lamp.side_world, lamp.power, lamp.color))
    return tuple(lamps)

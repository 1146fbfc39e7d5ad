"""What a world's table and lamps look like, for the renderers."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from nsdr.validation import Checked, Finite, NotNegative, Positive, Share

GroundPoint = tuple[Finite, Finite, Positive]
"""A point (x, y, z) above the table (world units)."""


@dataclass(frozen=True)
class Lamp(Checked):
    """A square area lamp, which faces the origin.

    Attributes:
        name: the name of the lamp, and of the object in CLEVR's base scene for Blender.
        location_world: centre (x, y, z).
        side_world: side length (world units).
        power: radiant power (W).
        color: linear RGB (0-1).
    """

    name: str
    location_world: GroundPoint
    side_world: Positive
    power: NotNegative
    color: tuple[Share, Share, Share] = (1.0, 1.0, 1.0)


_LAMPS = (
    Lamp("Lamp_Key", (6.447, -2.905, 4.258), 0.5, 78.54, (1.0, 0.932, 0.817)),
    Lamp("Lamp_Fill", (-4.671, -4.014, 3.011), 0.5, 23.56, (0.762, 0.818, 1.0)),
    Lamp("Lamp_Back", (-1.169, 2.646, 5.816), 1.0, 39.27, (1.0, 1.0, 1.0)),
)
"""The lamps of CLEVR's base scene."""


@dataclass(frozen=True)
class Look(Checked):
    """What the table and the lamps look like. The defaults are CLEVR's base scene; a weak sun belongs to each look.

    Attributes:
        ground: diffuse reflectance of the table for red, green and blue (linear, 0-1).
        lamps: the lamps.
    """

    ground: tuple[Share, Share, Share] = (0.8, 0.8, 0.8)
    lamps: Annotated[tuple[Lamp, ...], Meta(min_length=1, max_length=20)] = _LAMPS

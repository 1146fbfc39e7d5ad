"""How many objects scenes have, and where these start."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.validation import Checked, Finite, NotNegative, Positive

MIN_OBJECTS, MAX_OBJECTS = 2, 32
"""Fewest and most objects of a scene: the first collision needs two."""
START_SPACING = 0.83 / 0.4
"""Least distance between the centres of two objects at the start, as a multiple of the sum of half their widths; in CLEVRER's
release it is 0.83 world units, and objects are 0.4 wide."""


@dataclass(frozen=True)
class Layout(Checked):
    """How many objects generated scenes have, and where these start. CLEVRER's values were measured on its annotations.

    Attributes:
        objects: pairs of a number of objects and its probability (normalised before use).
        participants: number of objects that take part in collisions; the others rest as bystanders.
        area_world: min x, max x, min y and max y of planned collisions and of objects at rest (world units).
        start_distance_world: min and max distance from the origin at which the first object starts (world units).
        far_world: max distance from the origin at which any object starts (world units).
    """

    objects: Annotated[
        tuple[tuple[Annotated[int, Meta(ge=MIN_OBJECTS, le=MAX_OBJECTS)], NotNegative], ...], Meta(min_length=1)
    ] = ((4, 0.36), (5, 0.335), (6, 0.305))
    participants: Annotated[int, Meta(ge=MIN_OBJECTS)] = 4
    area_world: tuple[Finite, Finite, Finite, Finite] = (-2.25, 1.15, -1.6, 1.5)
    start_distance_world: tuple[Positive, Positive] = (3.15, 3.91)
    far_world: Positive = 10.5

    def __post_init__(self) -> None:
        super().__post_init__()
        x0, x1, y0, y1 = self.area_world
        if not (x0 < x1 and y0 < y1):
            raise DataError(f"layout: area_world {list(self.area_world)}: expected min x, max x, min y, max y")
        near, far = self.start_distance_world
        if not near <= far <= self.far_world:
            raise DataError(
                f"layout: start_distance_world {[near, far]}: expected the smaller one first, and far_world "
                f"{self.far_world:g} not below them"
            )
        if not any(share for _, share in self.objects):
            raise DataError("layout: objects: expected a probability above 0 of one number of objects at least")
        if self.participants > self.most_objects:
            raise DataError(
                f"layout: participants {self.participants}: expected the number of objects in the largest scenes "
                f"(layout.objects), {self.most_objects}, or fewer"
            )

    @property
    def most_objects(self) -> int:
        """The largest number of objects of a scene."""
        return max(n for n, share in self.objects if share)

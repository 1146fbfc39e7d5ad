"""A world as one value: its words, its physics, time in its videos, and the camera. The defaults are CLEVRER's."""

from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, NamedTuple

from nsdr.errors import DataError
from nsdr.validation import Checked
from nsdr.world.camera import Camera
from nsdr.world.consistency import (
    check_in_view,
    check_motion,
    check_objects_arrive,
    check_objects_fit,
    check_on_table,
)
from nsdr.world.layout import Layout
from nsdr.world.look import Look
from nsdr.world.physics import Physics, Timeline
from nsdr.world.vocabulary import Vocabulary

MAX_SPEED_WORLD_PER_S = 5.0
"""`World.max_speed_world_per_s` of CLEVRER."""


class Scales(NamedTuple):
    """How many times as large a world is as CLEVRER's: thresholds that were set on CLEVRER's videos are multiplied by these.

    All are exactly 1 for CLEVRER.

    Attributes:
        size: width of the narrowest shape.
        speed: fastest start.
        step: distance at the fastest start in a step of the simulation.
        frame: distance at the fastest start from one frame to the next.
        px: width of images.
        gravity: its acceleration.
        rate: frames per second.
    """

    size: float
    speed: float
    step: float
    frame: float
    px: float
    gravity: float
    rate: float


@dataclass(frozen=True, repr=False)
class World(Checked):
    """A world of colliding objects on a table: what its videos show, and how it is told. The defaults are CLEVRER's.

    `configs/worlds/clevrer.yaml` has all fields. Printed, it is its words, frames and images.

    Attributes:
        name: for messages.
        vocabulary: the words of objects.
        physics: how they move.
        timeline: time in videos.
        camera: what takes the videos.
        look: the table and the lamps.
        layout: how many objects scenes have, and where these start.

    Raises:
        DataError: values that contradict each other; names them.
    """

    name: str = "CLEVRER"
    vocabulary: Vocabulary = field(default_factory=Vocabulary)
    physics: Physics = field(default_factory=Physics)
    timeline: Timeline = field(default_factory=Timeline)
    camera: Camera = field(default_factory=Camera)
    look: Look = field(default_factory=Look)
    layout: Layout = field(default_factory=Layout)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_objects_fit(self.vocabulary, self.layout)
        check_on_table(self.layout, self.physics)
        check_in_view(self.vocabulary, self.layout, self.camera)
        check_objects_arrive(self.vocabulary, self.physics, self.timeline, self.layout)
        check_motion(self.vocabulary, self.physics)

    def __repr__(self) -> str:
        others = []
        if self.name == CLEVRER_WORLD.name:
            of_videos = [name for name in ("look", "layout") if getattr(self, name) != getattr(CLEVRER_WORLD, name)]
            others = [*self.differences(CLEVRER_WORLD), *of_videos]
        return f"World({', '.join([repr(self.name), *(f'other {name}' for name in others)])})"

    def __str__(self) -> str:
        words = (f"{kind}s: {', '.join(known)}" for kind, known in self.vocabulary.words.items())
        images = f"{self.camera.width}x{self.camera.height}"
        return "\n  ".join(
            [self.name, *words, f"{self.timeline.frames} frames at {self.timeline.fps} per second, {images}"]
        )

    @property
    def scales(self) -> Scales:
        """How many times as large the world is as CLEVRER's."""
        sizes = zip(_measures(self), _measures(CLEVRER_WORLD), strict=True)
        return Scales(*(mine / clevrers for mine, clevrers in sizes))

    @property
    def max_speed_world_per_s(self) -> float:
        """Fastest speed that can be set: CLEVRER's objects start with up to 3, and at 5 one crosses a tenth of another one
        within two steps of the simulation."""
        return MAX_SPEED_WORLD_PER_S * self.scales.speed

    @property
    def max_position_world(self) -> float:
        """Largest coordinate of an object on the table."""
        return self.physics.table_half_width_world - max(shape.half_width_world for shape in self.vocabulary.shapes)

    def differences(self, other: "World") -> list[str]:
        """Names of the values that differ between two worlds, such as "physics.gravity" or "vocabulary.shapes.friction".

        Not compared are the name, and what only generated videos depend on: `look` and `layout`.
        """
        found = [
            _differing(name, getattr(self, name), getattr(other, name))
            for name in ("vocabulary", "physics", "timeline", "camera")
        ]
        return [name for names in found for name in names]


def _differing(name: str, mine: Any, others: Any) -> list[str]:
    """Names of the values that differ between two of a world's values, in the order of its fields."""
    if mine == others:
        return []
    if is_dataclass(mine):
        pairs = [(f.name, getattr(mine, f.name), getattr(others, f.name)) for f in fields(mine)]
        return [one for field_, a, b in pairs for one in _differing(f"{name}.{field_}", a, b)]
    if isinstance(mine, tuple) and len(mine) == len(others) and all(map(is_dataclass, mine)):
        return list(dict.fromkeys(one for a, b in zip(mine, others, strict=True) for one in _differing(name, a, b)))
    return [name]


def _measures(world: World) -> tuple[float, ...]:
    """What the fields of `Scales` compare (world units, world units/s, pixels, world units/s², 1/s)."""
    width = min(width for shape in world.vocabulary.shapes for width in shape.size_world[:2])
    physics, fastest = world.physics, world.physics.start_speed_world_per_s[1]
    step, frame = fastest * physics.step_seconds, fastest * physics.frame_seconds
    return width, fastest, step, frame, world.camera.width, physics.gravity, world.timeline.fps


CLEVRER_WORLD = World()
ANY_WORDS = (
    "vocabulary.colors.synonyms",
    "vocabulary.materials.synonyms",
    "vocabulary.shapes.synonyms",
    "vocabulary.shapes.adjectives",
    "vocabulary.shapes.plural",
)
"""Beginnings of the names of values on which texts alone depend."""
ANY_PLACE = ("camera.eye_world", "camera.target_world", "camera.lens_mm")
"""Those on which the camera's view depends."""
ANY_LOOK = (
    *ANY_WORDS,
    "vocabulary.colors",
    "vocabulary.materials.metallic",
    "vocabulary.materials.roughness",
    "physics.moving_speed_world_per_s",
    "timeline.",
    "camera.",
)
"""Those on which no motion depends."""


def check_as_clevrer(world: World, what: str, free: tuple[str, ...] = ("vocabulary.colors", "camera.")) -> None:
    """Raise `DataError` unless a world is CLEVRER's but for some of its values.

    Args:
        world: the world.
        what: that knows no other worlds as yet, for the message.
        free: beginnings of the names of values that may differ, such as "camera.".
    """
    if unknown := ", ".join(name for name in world.differences(CLEVRER_WORLD) if not name.startswith(free)):
        raise DataError(f"world {world.name}: other than CLEVRER's in {unknown}, which {what} cannot take as yet")

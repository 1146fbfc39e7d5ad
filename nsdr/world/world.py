"""A world as one value: its words, its physics, time in its videos, and the camera. The defaults are CLEVRER's."""

from dataclasses import dataclass, field, fields

from nsdr.errors import DataError
from nsdr.validation import Checked
from nsdr.world.camera import Camera
from nsdr.world.consistency import check_in_view, check_motion, check_objects_fit, check_on_table
from nsdr.world.layout import Layout
from nsdr.world.look import Look
from nsdr.world.physics import Physics, Timeline
from nsdr.world.vocabulary import Vocabulary


@dataclass(frozen=True)
class World(Checked):
    """A world of colliding objects on a table: what its videos show, and how it is told. The defaults are CLEVRER's.

    `configs/worlds/clevrer.yaml` has all fields.

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
        check_in_view(self.layout, self.camera)
        check_motion(self.vocabulary, self.physics)

    def differences(self, other: "World") -> list[str]:
        """Names of the values that differ between two worlds, such as "physics.gravity"; that of the world is not compared."""
        found = []
        for section in fields(self)[1:]:
            mine, others = getattr(self, section.name), getattr(other, section.name)
            differing = [f.name for f in fields(mine) if getattr(mine, f.name) != getattr(others, f.name)]
            found += [f"{section.name}.{name}" for name in differing]
        return found


CLEVRER_WORLD = World()


def check_as_clevrer(world: World, what: str, free: tuple[str, ...]) -> None:
    """Raise `DataError` unless a world is CLEVRER's but for some of its values.

    Args:
        world: the world.
        what: that knows no other worlds as yet, for the message.
        free: beginnings of the names of values that may differ, such as "camera.".
    """
    if unknown := ", ".join(name for name in world.differences(CLEVRER_WORLD) if not name.startswith(free)):
        raise DataError(f"world {world.name}: other than CLEVRER's in {unknown}, which {what} cannot take as yet")

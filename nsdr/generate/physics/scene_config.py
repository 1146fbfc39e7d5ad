"""What generated scenes look like: numbers of objects, attributes, start states and the planned collisions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.generate.physics.bullet import BulletConfig
from nsdr.io.limits import check_limit, limits
from nsdr.validation import Finite, NotNegative, Positive, Settings, Share, expect
from nsdr.world.physics_constants import MASS_RANGE, START_SPEED_RANGE_WORLD_PER_S
from nsdr.world.timeline import VIDEO_FRAMES, simulated_frames
from nsdr.world.vocabulary import ATTRIBUTES, COLORS, MATERIALS, SHAPES

__all__ = ["SceneConfig", "Triple", "matches_any", "of_participant"]

Triple = tuple[str, str, str]
"""(color, material, shape) of an object."""
MIN_OBJECTS = 2
"""Smallest number of objects in a scene: the first collision needs two."""
MIN_FRAMES = 10
"""Shortest video (frames)."""


@dataclass(frozen=True)
class SceneConfig(Settings):
    """What scenes look like. The defaults match the released videos.

    The first `participants` objects of a scene take part in collisions; the others rest as bystanders. In fields that hold
    one value per participant, the last value holds for all further participants.

    Attributes:
        objects: probability of each number of objects (normalised before use).
        participants: number of objects that the recursive construction places so that they collide.
        static_fraction: probability of each participant to start at rest (0 for the first one, which moves).
        partner_weights: relative probability of each participant to be hit by a later one.
        first_meeting: mean and standard deviation of the frame at which the first two objects collide.
        resting_delay: mean of the exponentially distributed delay from the first collision until a later participant that
            starts at rest is hit (frames). Moving participants collide at any later frame.
        late_fraction: probability of each moving participant to have its planned collision after the video.
        extra_fraction: probability that an object may cause more collisions than its planned one.
        shapes: allowed words.
        colors: allowed words.
        materials: allowed words.
        held_out: combinations "color material shape", or parts of one such as "red cube", that never occur.
        only: when given, at least one object of each scene matches one of these combinations or parts; the complement of
            `held_out` for compositional splits.
        speed: min and max initial speed of moving objects (world units/s).
        mass: min and max mass (relative).
        first_distance: min and max distance of the first object from the origin (world units).
        first_heading_degrees: max angle between the first object's heading and the direction to the origin (degrees).
        heading_degrees: max angle between a later moving object's heading and the direction to the origin, for starts
            beyond the min of `first_distance` (degrees).
        far_world: max distance from the origin at which an object starts (world units).
        area: min x, max x, min y, max y of planned collisions and of objects at rest (world units).
        n_frames: frames of the video; 7/5 as many are simulated.
        physics: parameters of the simulation.
    """

    objects: Mapping[int, NotNegative] = field(default_factory=lambda: {4: 0.36, 5: 0.335, 6: 0.305})
    participants: Annotated[int, Meta(ge=MIN_OBJECTS)] = 4
    static_fraction: tuple[Share, ...] = (0.0, 0.6, 0.35, 0.35)
    partner_weights: tuple[NotNegative, ...] = (1.0, 1.1, 0.5)
    first_meeting: tuple[NotNegative, NotNegative] = (30.0, 15.0)
    resting_delay: NotNegative = 36.0
    late_fraction: tuple[Share, ...] = (0.0, 0.0, 0.55, 0.9)
    extra_fraction: Share = 0.3
    shapes: tuple[str, ...] = SHAPES
    colors: tuple[str, ...] = COLORS
    materials: tuple[str, ...] = MATERIALS
    held_out: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    speed: tuple[Positive, Positive] = START_SPEED_RANGE_WORLD_PER_S
    mass: tuple[Positive, Positive] = MASS_RANGE
    first_distance: tuple[NotNegative, NotNegative] = (3.15, 3.91)
    first_heading_degrees: Annotated[float, Meta(ge=0.0, le=180.0)] = 28.0
    heading_degrees: Annotated[float, Meta(ge=0.0, le=180.0)] = 15.0
    far_world: Positive = 10.5
    area: tuple[Finite, Finite, Finite, Finite] = (-2.25, 1.15, -1.6, 1.5)
    n_frames: Annotated[int, Meta(ge=MIN_FRAMES)] = VIDEO_FRAMES
    physics: BulletConfig = field(default_factory=BulletConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, words, known in (
            ("shapes", self.shapes, SHAPES),
            ("colors", self.colors, COLORS),
            ("materials", self.materials, MATERIALS),
        ):
            if not words or set(words) - set(known):
                raise DataError(f"{name}: expected some of {', '.join(known)}, got {', '.join(words) or 'none'}")
        self._check_numbers()
        for pattern in (*self.held_out, *self.only):
            kinds = [{w: k for k, words in ATTRIBUTES.items() for w in words}.get(w, "") for w in pattern.split()]
            if not kinds or "" in kinds or len(set(kinds)) < len(kinds):
                raise DataError(f"held_out and only: expected combinations such as red metal cube, got {pattern!r}")
        if len(self.triples) < max(self.objects):
            raise DataError(
                f"shapes, colors, materials and held_out leave {len(self.triples)} combinations for scenes of "
                f"{max(self.objects)} objects; no combination occurs twice in a scene"
            )
        if self.only and not any(matches_any(t, self.only) for t in self.triples):
            raise DataError(
                f"only: shapes, colors, materials and held_out leave no combination that matches {', '.join(self.only)}"
            )

    def _check_numbers(self) -> None:
        most = limits().scene_objects
        check_limit(self.n_frames, "frames", "n_frames")
        check_limit(self.participants, "scene_objects", "participants")
        if (
            not self.objects
            or not all(MIN_OBJECTS <= n <= most for n in self.objects)
            or not any(self.objects.values())
        ):
            expected = f"probabilities of {MIN_OBJECTS} to {most} objects"
            raise DataError(f"objects: expected {expected}, got {dict(self.objects)}")
        for name in ("speed", "mass", "first_distance"):
            low, high = getattr(self, name)
            expect(low <= high, name, "a minimum and a maximum that is not below it", (low, high))
        low_x, high_x, low_y, high_y = self.area
        if low_x > high_x or low_y > high_y:
            raise DataError(f"area is {self.area}; expected min x, max x, min y, max y")
        for name in ("static_fraction", "partner_weights", "late_fraction"):
            if not getattr(self, name):
                raise DataError(f"{name} is empty; expected one value per participant, the last for all further ones")

    @property
    def triples(self) -> list[Triple]:
        """Allowed combinations of attributes."""
        every = [(c, m, s) for c in self.colors for m in self.materials for s in self.shapes]
        return [t for t in every if not matches_any(t, self.held_out)]

    @property
    def simulated_frames(self) -> int:
        """Number of frames that are simulated, see `nsdr.world.timeline.simulated_frames`."""
        return simulated_frames(self.n_frames)


def matches_any(triple: Triple, patterns: Sequence[str]) -> bool:
    """Whether a triple contains all words of at least one pattern, such as "red cube"."""
    return any(set(pattern.split()) <= set(triple) for pattern in patterns)


def of_participant(values: Sequence[float], k: int) -> float:
    """Value of the k-th participant; the last value holds for all further participants."""
    return values[min(k, len(values) - 1)]

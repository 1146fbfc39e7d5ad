"""What generated scenes look like: numbers of objects, attributes, start states and the planned collisions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.generate.physics.bullet import BulletConfig
from nsdr.io.limits import check_limit, limits
from nsdr.validation import NotNegative, Positive, Settings, expect, one_of
from nsdr.world.physics_constants import MASS_RANGE, START_SPEED_RANGE_WORLD_PER_S, VIDEO_FRAMES, horizon_frame
from nsdr.world.vocabulary import ATTRIBUTES, COLORS, MATERIALS, SHAPES

Triple = tuple[str, str, str]
"""(color, material, shape) of an object."""
MIN_SCENE_OBJECTS = 2
"""Smallest number of objects in a scene: the first collision needs two."""
MIN_VIDEO_FRAMES = 10
"""Shortest video (frames)."""


@dataclass(frozen=True)
class SceneConfig(Settings):
    """What scenes look like. The defaults match the released videos.

    The first `participants` objects of a scene take part in collisions; the others rest as bystanders.

    Attributes:
        objects: probability of each number of objects (normalised before use).
        participants: number of objects that the recursive construction places so that they collide.
        shapes: allowed words.
        colors: allowed words.
        materials: allowed words.
        held_out: combinations of words, such as "red metal cube" or "red cube", that no object matches.
        only: combinations of words; unless empty, at least one object of each scene matches one of them. It complements
            `held_out` in compositional splits.
        speed: min and max initial speed of moving objects (world units/s).
        mass: min and max mass (relative).
        n_frames: frames of the video; 7/5 as many are simulated.
        physics: parameters of the simulation.
    """

    objects: Mapping[int, NotNegative] = field(default_factory=lambda: {4: 0.36, 5: 0.335, 6: 0.305})
    participants: Annotated[int, Meta(ge=MIN_SCENE_OBJECTS)] = 4
    shapes: Annotated[tuple[Annotated[str, one_of(SHAPES)], ...], Meta(min_length=1)] = SHAPES
    colors: Annotated[tuple[Annotated[str, one_of(COLORS)], ...], Meta(min_length=1)] = COLORS
    materials: Annotated[tuple[Annotated[str, one_of(MATERIALS)], ...], Meta(min_length=1)] = MATERIALS
    held_out: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    speed: tuple[Positive, Positive] = START_SPEED_RANGE_WORLD_PER_S
    mass: tuple[Positive, Positive] = MASS_RANGE
    n_frames: Annotated[int, Meta(ge=MIN_VIDEO_FRAMES)] = VIDEO_FRAMES
    physics: BulletConfig = field(default_factory=BulletConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        most = limits().scene_objects
        check_limit(self.n_frames, "frames", "n_frames")
        check_limit(self.participants, "scene_objects", "participants")
        if not all(MIN_SCENE_OBJECTS <= n <= most for n in self.objects) or not any(self.objects.values()):
            expected = f"probabilities of {MIN_SCENE_OBJECTS} to {most} objects"
            raise DataError(f"objects: expected {expected}, got {dict(self.objects)}")
        for name in ("speed", "mass"):
            low, high = getattr(self, name)
            expect(low <= high, name, "a minimum and a maximum that is not below it", (low, high))
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

    @property
    def triples(self) -> list[Triple]:
        """Allowed combinations of attributes."""
        every = [(c, m, s) for c in self.colors for m in self.materials for s in self.shapes]
        return [t for t in every if not matches_any(t, self.held_out)]

    @property
    def simulated_frames(self) -> int:
        """Number of frames that are simulated, see `nsdr.world.physics_constants.horizon_frame`."""
        return horizon_frame(self.n_frames)


def matches_any(triple: Triple, patterns: Sequence[str]) -> bool:
    """Whether a triple contains all words of at least one pattern, such as "red cube"."""
    return any(set(pattern.split()) <= set(triple) for pattern in patterns)

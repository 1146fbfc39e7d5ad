"""What generated scenes look like: numbers of objects, attributes, start states and the planned collisions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.generate.physics.bullet import BulletConfig
from nsdr.io.limits import check_limit, limits
from nsdr.validation import NotNegative, Positive, Settings, expect
from nsdr.world.layout import MIN_OBJECTS
from nsdr.world.physics import MIN_VIDEO_FRAMES
from nsdr.world.vocabulary import Vocabulary, Word
from nsdr.world.world import World

Triple = tuple[str, str, str]
"""(color, material, shape) of an object."""


@dataclass(frozen=True)
class SceneConfig(Settings):
    """What scenes look like. What is null (None in Python) is the world's; CLEVRER's matches the released videos.

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
        n_frames: frames of the video; more are simulated, in CLEVRER 7/5 as many.
        physics: parameters of the simulation.
    """

    objects: Mapping[int, NotNegative] | None = None
    participants: Annotated[int, Meta(ge=MIN_OBJECTS)] | None = None
    shapes: Annotated[tuple[Word, ...], Meta(min_length=1)] | None = None
    colors: Annotated[tuple[Word, ...], Meta(min_length=1)] | None = None
    materials: Annotated[tuple[Word, ...], Meta(min_length=1)] | None = None
    held_out: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    speed: tuple[Positive, Positive] | None = None
    mass: tuple[Positive, Positive] | None = None
    n_frames: Annotated[int, Meta(ge=MIN_VIDEO_FRAMES)] | None = None
    physics: BulletConfig = field(default_factory=BulletConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        most = limits().scene_objects
        check_limit(self.n_frames or 0, "frames", "n_frames")
        check_limit(self.participants or 0, "scene_objects", "participants")
        objects = {MIN_OBJECTS: 1.0} if self.objects is None else self.objects
        if not all(MIN_OBJECTS <= n <= most for n in objects) or not any(objects.values()):
            expected = f"probabilities of {MIN_OBJECTS} to {most} objects"
            raise DataError(f"objects: expected {expected}, got {dict(objects)}")
        if self.objects is not None and self.participants is not None:
            largest = max(n for n, share in objects.items() if share)
            expect(
                self.participants <= largest,
                "participants",
                f"{largest} or fewer, as many as objects",
                self.participants,
            )
        for name in ("speed", "mass"):
            low, high = getattr(self, name) or (0, 0)
            expect(low <= high, name, "a minimum and a maximum that is not below it", (low, high))

    def world_of(self, world: World) -> World:
        """The world with these settings in place of its own, but for `physics` and the choice of words."""
        physics, layout, timeline = world.physics, world.layout, world.timeline
        if self.speed is not None:
            physics = replace(physics, start_speed_world_per_s=self.speed)
        if self.mass is not None:
            physics = replace(physics, mass_range=self.mass)
        if self.objects is not None:
            most = max(n for n, share in self.objects.items() if share)
            layout = replace(layout, objects=tuple(self.objects.items()), participants=min(layout.participants, most))
        if self.participants is not None:
            layout = replace(layout, participants=self.participants)
        if self.n_frames is not None:
            timeline = replace(timeline, frames=self.n_frames)
        return replace(world, physics=physics, layout=layout, timeline=timeline)

    def triples_in(self, world: World) -> list[Triple]:
        """Allowed combinations of attributes.

        Raises:
            DataError: words that the world does not have, or combinations that are too few.
        """
        known = world.vocabulary.words
        chosen = {"shape": self.shapes, "color": self.colors, "material": self.materials}
        for kind, words in chosen.items():
            unknown = ", ".join(word for word in words or () if word not in known[kind])
            expect(not unknown, f"{kind}s", f"some of {', '.join(known[kind])}", unknown)
        colors, materials, shapes = (chosen[kind] or words for kind, words in known.items())
        _check_patterns((*self.held_out, *self.only), world.vocabulary)
        every = [(c, m, s) for c in colors for m in materials for s in shapes]
        triples = [t for t in every if not matches_any(t, self.held_out)]
        most = max(self.objects) if self.objects is not None else world.layout.most_objects
        if len(triples) < most:
            raise DataError(
                f"shapes, colors, materials and held_out leave {len(triples)} combinations for scenes of {most} objects; "
                "no combination occurs twice in a scene"
            )
        if self.only and not any(matches_any(t, self.only) for t in triples):
            raise DataError(
                f"only: shapes, colors, materials and held_out leave no combination that matches {', '.join(self.only)}"
            )
        return triples


def _check_patterns(patterns: Sequence[str], vocabulary: Vocabulary) -> None:
    kind_of = {word: kind for kind, words in vocabulary.words.items() for word in words}
    for pattern in patterns:
        kinds = [kind_of.get(word, "") for word in pattern.split()]
        if not kinds or "" in kinds or len(set(kinds)) < len(kinds):
            example = " ".join(words[0] for words in vocabulary.words.values())
            raise DataError(f"held_out and only: expected combinations such as {example}, got {pattern!r}")


def matches_any(triple: Triple, patterns: Sequence[str]) -> bool:
    """Whether a triple contains all words of at least one pattern, such as "red cube"."""
    return any(set(pattern.split()) <= set(triple) for pattern in patterns)

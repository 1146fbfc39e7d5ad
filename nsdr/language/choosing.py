"""Who makes the choices of texts that are drawn, enumerated or written, and who describes their objects."""

import random
from collections.abc import Sequence
from typing import Protocol, TypeVar

__all__ = ["AtRandom", "Chooser", "Phrases", "Replay"]

T = TypeVar("T")


class Chooser(Protocol):
    """Makes the choices of texts that are drawn."""

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """One of several contents; `weights` are their relative frequencies."""
        ...

    def vary(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """One of several wordings; `weights` are their relative frequencies."""
        ...


class Phrases(Protocol):
    """Describes objects in drawn texts."""

    def words(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        """Attribute words in the order color, material, shape, possibly none.

        Args:
            choose: makes the choices.
            use: how the text uses them: "one" (a single object), "attribute" (the words alone) or, of a class of objects,
                "counted", "moves" (the one object of it that moves or rests) or "enters" (the one that enters or exits).
            without: attribute that must not be among the words; "" for none.
        """
        ...


class AtRandom:
    """Draws everything."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """One of several, at random."""
        return self.rng.choices(options, weights)[0]

    vary = pick


class Replay(AtRandom):
    """Repeats a recorded path of picks, then takes the first option of every further one; wordings are drawn at random."""

    def __init__(self, path: list[tuple[int, int]], rng: random.Random) -> None:
        super().__init__(rng)
        self.path, self.depth = path, 0

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """The recorded one, or the first one, which is recorded."""
        if self.depth == len(self.path):
            self.path.append((0, len(options)))
        index = self.path[self.depth][0]
        self.depth += 1
        return options[index]

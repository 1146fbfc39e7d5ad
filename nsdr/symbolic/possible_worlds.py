"""Worlds that the uncertain of a scene leave possible, and how probable values of programs are in them."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from nsdr.errors import ExecutionError
from nsdr.symbolic.joint import Draws
from nsdr.types import Event, Scene

__all__ = ["N_DRAWS", "PossibleWorlds", "possible_scenes"]

N_DRAWS = 512
"""Draws of possible scenes. Probabilities that depend on several collisions are off by 0.006 on average. CLEVRER's scenes have
few uncertain, so that few draws are different."""
SEED = 0
MIN_SUPPOSED = 0.05
"""A question whose suppositions are less probable is refused. Of 49 collisions of left-out `train` scenes to which the
network gives 0.01-0.05 none was true, and 12 of 32 with 0.05-0.2 (`python benchmarks/collisions.py --every 5`)."""

Program = tuple[str, ...]
Found = TypeVar("Found")


def possible_scenes(scene: Scene) -> list[tuple[int, Scene]]:
    """Different scenes drawn from the uncertain, without uncertain, each with the number of the `N_DRAWS` draws that gave it.

    Doubts are taken as independent. Each collision happens in as many of the draws as its probability says (Latin hypercube
    sampling), so that what depends on one collision is off by at most half a draw.
    """
    uncertain = scene.uncertain or ()
    order = np.random.default_rng(SEED).permuted(np.tile(np.arange(N_DRAWS), (len(uncertain), 1)), axis=1)
    happens = (order + 0.5) / N_DRAWS < np.array([d.probability for d in uncertain])[:, None]
    rows, counts = np.unique(happens.T, axis=0, return_counts=True)
    return [(int(n), _with(scene, row.tolist())) for n, row in zip(counts, rows, strict=True)]


def _with(scene: Scene, happens: list[bool]) -> Scene:
    """The scene with those of its doubtful collisions that happen, and without the others."""
    uncertain = scene.uncertain or ()
    doubtful = {(d.removed, d.event) for d in uncertain}
    drawn = [(d.removed, d.event) for d, happened in zip(uncertain, happens, strict=True) if happened]

    def events(of: tuple[Event, ...], removed: int | None, fits: Callable[[int], bool]) -> tuple[Event, ...]:
        kept = [e for e in of if (removed, e) not in doubtful]
        return (*kept, *(e for r, e in drawn if r == removed and fits(e.frame)))

    n_frames, unseen, without = scene.n_frames, scene.unseen, scene.counterfactual
    return Scene(
        scene.objects,
        n_frames,
        scene.visible,
        scene.moving,
        events(scene.events, None, lambda frame: frame < n_frames),
        None if unseen is None else events(unseen, None, lambda frame: frame >= n_frames),
        None if without is None else {k: events(of, k, lambda _: True) for k, of in without.items()},
        physics=scene.physics,
    )


class PossibleWorlds:
    """The possible worlds of one scene, drawn when a probability is first asked for.

    Args:
        scene: with uncertain.
        executor: makes the `Executor` of a scene without uncertain.
    """

    def __init__(self, scene: Scene, executor: Callable[[Scene], Any]) -> None:
        self._scene, self._executor = scene, executor

    def probability(self, program: Program, value: Any) -> float:
        """Share of the worlds in which a program has a value, of those in which it does not fail: what it supposes is given."""
        runs = [(n, found) for n, found in self._values(program) if found is not None]
        total = sum(n for n, _ in runs)
        return sum(n for n, found in runs if found == value) / total if total else 0.0

    def draws(self, programs: Sequence[Program]) -> Draws:
        """The values of programs that judge choices, None where they fail, with the number of draws, in each world."""
        columns = [self._values(program) for program in programs]
        return [(row[0][0], tuple(value for _, value in row)) for row in zip(*columns, strict=True)]

    def supposed(self, find: Callable[[Any], Found]) -> Found | None:
        """What is found by the executor of the most probable world where it raises no `ExecutionError`.

        None where all such worlds together are less probable than `MIN_SUPPOSED`.
        """
        most, total, result = 0, 0, None
        for n, executor in self._executors:
            try:
                found = find(executor)
            except ExecutionError:
                continue
            total += n
            if n > most:
                most, result = n, found
        return result if total >= MIN_SUPPOSED * N_DRAWS else None

    @cached_property
    def _executors(self) -> list[tuple[int, Any]]:
        return [(n, self._executor(scene)) for n, scene in possible_scenes(self._scene)]

    def _values(self, program: Program) -> list[tuple[int, Any]]:
        """The program's value in each world, None where it fails or is not known, and the number of draws of the world."""
        values = []
        for n, executor in self._executors:
            try:
                values.append((n, executor.value_meant(program)))
            except ExecutionError:
                values.append((n, None))
        return values

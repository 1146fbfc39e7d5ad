"""How probable answers are: programs run on every possible scene, and an answer's probability is the share that gives it.

Example: the red cube hits the blue sphere with a probability of 0.75. Of the 512 draws of possible scenes, 384 have the
collision, so "How many collisions happen?" is answered by 1, which is right with a probability of 384 / 512:

    >>> import numpy as np
    >>> from nsdr.symbolic import Executor
    >>> from nsdr.types import Event, Scene, SceneObject, UncertainEvent
    >>> objects = (SceneObject(0, "red", "metal", "cube"), SceneObject(1, "blue", "rubber", "sphere"))
    >>> seen, hit = np.ones((2, 128), bool), Event("collision", 40, (0, 1))
    >>> scene = Scene(objects, 128, seen, seen, (hit,), uncertain=(UncertainEvent(hit, 0.75),))
    >>> count = Executor(scene).answer("events objects filter_collision count")
    >>> count.answer, count.probability
    (1, 0.75)

If the probability is 0.25, the collision is not among the scene's events. But "What is the shape of the object to collide with
the red cube?" supposes that there is one. It is answered in the most probable scene in which the program runs, and the
probability is the share of such scenes that give the same answer:

    >>> scene = Scene(objects, 128, seen, seen, (), uncertain=(UncertainEvent(hit, 0.25),))
    >>> Executor(scene).answer("events objects filter_collision count").probability
    0.75
    >>> red = "objects red filter_color unique"
    >>> shape = Executor(scene).answer(f"events {red} filter_collision unique {red} get_col_partner query_shape")
    >>> shape.answer, shape.probability
    ('sphere', 1.0)
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Generic, TypeVar

from nsdr.errors import ExecutionError
from nsdr.symbolic.uncertainty import N_DRAWS, possible_scenes
from nsdr.types import Scene

SIMULATED_DOUBT = 0.005
"""An answer about what was simulated is never surer than 1 minus this. Of 1,739 options of counterfactual questions about 300
generated scenes of training that were 99 % sure, 0.46 % (0.23-0.91) were wrong (docs/results_studies.md, "Calibration")."""
MIN_SUPPOSED = 0.05
"""A question whose suppositions are less probable is refused. Of 49 collisions of left-out `train` scenes to which the
network gives 0.01-0.05 none was true, and 12 of 32 with 0.05-0.2 (`python -m benchmarks.collisions --every 5`)."""
Runner = TypeVar("Runner")
"""Runs programs on one scene."""
Found = TypeVar("Found")


class PossibleScenes(Generic[Runner]):
    """What a run gives in the scenes that are possible as far as one is known.

    Args:
        scene: the scene that is known. If its `uncertain` is None, nothing is known about other scenes.
        runner: makes what runs programs on a scene, an executor.
    """

    def __init__(self, scene: Scene, runner: Callable[[Scene], Runner]) -> None:
        self.scene, self.runner = scene, runner
        self.known = scene.uncertain is not None

    @cached_property
    def _scenes(self) -> list[tuple[int, Runner]]:
        """All that is uncertain varies. Each runner has the number of draws that give its scene."""
        return [(n, self.runner(drawn)) for n, drawn in possible_scenes(self.scene)]

    @cached_property
    def _courses(self) -> list[tuple[int, Runner]]:
        """The same, but only the collisions vary, so that what is supposed has the frames that were found."""
        return [(n, self.runner(drawn)) for n, drawn in possible_scenes(self.scene, collisions_only=True)]

    def supposed(self, run: Callable[[Runner], Found]) -> Found | None:
        """What a run gives in the most probable scene in which it does not fail.

        Returns:
            None if all such scenes together are less probable than `MIN_SUPPOSED`.
        """
        runs = _without_failures(self._courses, run) if self.known else []
        if sum(n for n, _ in runs) < MIN_SUPPOSED * N_DRAWS:
            return None
        return max(runs, key=lambda row: row[0])[1]

    def share(self, run: Callable[[Runner], Found], wanted: Found) -> float | None:
        """The probability (0-1) that a run gives what is wanted, where it does not fail; None if nothing is known."""
        if not self.known:
            return None
        runs = _without_failures(self._scenes, run)
        total = sum(n for n, _ in runs)
        return sum(n for n, found in runs if found == wanted) / total if total else 0.0


def _without_failures(runners: Sequence[tuple[int, Runner]], run: Callable[[Runner], Found]) -> list[tuple[int, Found]]:
    """What a run gives on each runner where it does not fail, with the runner's number of draws."""
    runs = []
    for n, runner in runners:
        with suppress(ExecutionError):
            runs.append((n, run(runner)))
    return runs


def simulated(share: float) -> float:
    """The probability of an answer about what was simulated, by the share of possible scenes that give it."""
    return min(max(share, SIMULATED_DOUBT), 1 - SIMULATED_DOUBT)


def first_of_two(first: float, second: float) -> float:
    """The probability of the first of two simulated events, of which exactly one happens.

    Args:
        first, second: the probabilities (0-1) of the two events by themselves.

    Returns:
        `first` (1 - `second`) as a share of itself and `second` (1 - `first`): 0.9 and 0.5 give 0.9.
    """
    one, other = first * (1 - second), second * (1 - first)
    return simulated(one / (one + other) if one + other else 0.5)

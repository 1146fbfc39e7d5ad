"""Scenes that a scene's uncertain collisions leave possible."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nsdr.types import Event, Scene

__all__ = ["MIN_SUPPOSED", "N_DRAWS", "possible_scenes"]

N_DRAWS = 512
"""Draws of possible scenes. Probabilities that depend on several collisions are off by 0.006 on average. Few of CLEVRER's
collisions are uncertain, so that few draws are different."""
SEED = 0
MIN_SUPPOSED = 0.05
"""A question whose suppositions are less probable is refused. Of 49 collisions of left-out `train` scenes to which the
network gives 0.01-0.05 none was true, and 12 of 32 with 0.05-0.2 (`python benchmarks/collisions.py --every 5`)."""


def possible_scenes(scene: Scene) -> list[tuple[int, Scene]]:
    """Different scenes without uncertain collisions, drawn from one with them; each with its number of the `N_DRAWS` draws.

    Collisions are taken as independent. Each happens in as many of the draws as its probability says (Latin hypercube
    sampling), so that what depends on one collision is off by at most half a draw.
    """
    uncertain = scene.uncertain or ()
    order = np.random.default_rng(SEED).permuted(np.tile(np.arange(N_DRAWS), (len(uncertain), 1)), axis=1)
    happens = (order + 0.5) / N_DRAWS < np.array([u.probability for u in uncertain])[:, None]
    rows, counts = np.unique(happens.T, axis=0, return_counts=True)
    return [(n, _drawn(scene, row)) for n, row in zip(counts.tolist(), rows.tolist(), strict=True)]


def _drawn(scene: Scene, happens: Sequence[bool]) -> Scene:
    """The scene with those of its uncertain collisions that happen, and without the others."""
    uncertain = {(u.removed, u.event) for u in scene.uncertain or ()}
    drawn = [(u.removed, u.event) for u, happened in zip(scene.uncertain or (), happens, strict=True) if happened]

    def events(of: Sequence[Event], removed: int | None, first: int = 0, end: float = np.inf) -> tuple[Event, ...]:
        """Those that are certain, and those that are drawn from a range of frames."""
        certain = [e for e in of if (removed, e) not in uncertain]
        return (*certain, *(e for r, e in drawn if r == removed and first <= e.frame < end))

    n_frames, unseen, without = scene.n_frames, scene.unseen, scene.counterfactual
    return replace(
        scene,
        events=events(scene.events, None, end=n_frames),
        unseen=None if unseen is None else events(unseen, None, first=n_frames),
        counterfactual=None if without is None else {k: events(of, k) for k, of in without.items()},
        unseen_scores=None,
        dynamics=None,
        uncertain=None,
    )

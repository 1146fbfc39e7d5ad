"""Scenes that the doubts of a scene leave possible."""

from collections.abc import Callable

import numpy as np

from nsdr.types import Event, Scene

__all__ = ["N_DRAWS", "possible_scenes"]

N_DRAWS = 64
"""Draws of possible scenes."""
SEED = 0


def possible_scenes(scene: Scene) -> list[tuple[int, Scene]]:
    """Different scenes drawn from the doubts, without doubts, each with the number of the `N_DRAWS` draws that gave it.

    Doubts are taken as independent. Each collision happens in as many of the draws as its probability says (Latin hypercube
    sampling), so that what depends on one collision has an error of at most half a draw.
    """
    doubts = scene.doubts or ()
    order = np.random.default_rng(SEED).permuted(np.tile(np.arange(N_DRAWS), (len(doubts), 1)), axis=1)
    happens = (order + 0.5) / N_DRAWS < np.array([d.probability for d in doubts])[:, None]
    rows, counts = np.unique(happens.T, axis=0, return_counts=True)
    return [(int(n), _with(scene, row.tolist())) for n, row in zip(counts, rows, strict=True)]


def _with(scene: Scene, happens: list[bool]) -> Scene:
    """The scene with those of its doubtful collisions that happen, and without the others."""
    doubts = scene.doubts or ()
    doubtful = {(d.removed, d.event) for d in doubts}
    drawn = [(d.removed, d.event) for d, happened in zip(doubts, happens, strict=True) if happened]

    def events(of: tuple[Event, ...], removed: int | None, where: Callable[[int], bool]) -> tuple[Event, ...]:
        kept = [e for e in of if (removed, e) not in doubtful]
        return (*kept, *(e for r, e in drawn if r == removed and where(e.frame)))

    n_frames, unseen, without = scene.n_frames, scene.unseen, scene.counterfactual
    return Scene(
        scene.objects,
        n_frames,
        scene.visible,
        scene.moving,
        events(scene.events, None, lambda frame: frame < n_frames),
        None if unseen is None else events(unseen, None, lambda frame: frame >= n_frames),
        None if without is None else {k: events(of, k, lambda _: True) for k, of in without.items()},
    )

"""Scenes that a scene's doubts leave possible: about collisions, objects, frames of events, and motion."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.types import Event, Scene
from nsdr.world.physics_constants import MOVING_SPEED_WORLD_PER_S

__all__ = ["MIN_SUPPOSED", "N_DRAWS", "possible_scenes"]

N_DRAWS = 512
"""Draws of possible scenes. Probabilities that depend on several doubts are off by 0.006 on average."""
SEED = 0
MIN_SUPPOSED = 0.05
"""A question whose suppositions are less probable is refused. Of 49 collisions of left-out `train` scenes to which the
network gives 0.01-0.05 none was true, and 12 of 32 with 0.05-0.2 (`python benchmarks/collisions.py --every 5`)."""
FRAMES_OFF = {-2: 0.007, -1: 0.083, 0: 0.82, 1: 0.083, 2: 0.007}
"""How probable it is that an event is so many frames later than it was found. Of 8,067 entrances, exits and collisions of
left-out `train` scenes, 81.9 % were exact and 16.4 % off by one frame (`python benchmarks/objects.py --every 5`, and
`benchmarks/collisions.py --every 5`)."""
SPEED_ERRORS = (-1.28, -0.52, 0.0, 0.52, 1.28)
"""Equally probable errors of an object's speed, in standard deviations: the middles of five parts of a normal distribution."""


class _Doubt(NamedTuple):
    """What one thing may be: values, and their probabilities."""

    of: Any
    values: Sequence[Any]
    probabilities: Sequence[float]


def possible_scenes(scene: Scene, collisions_only: bool = False) -> list[tuple[int, Scene]]:
    """Different scenes without doubts, drawn from one with them; each with its number of the `N_DRAWS` draws.

    All doubts are taken as independent. What one is about happens in as many of the draws as its probability says (Latin
    hypercube sampling), so that what depends on it alone is off by at most half a draw.

    Args:
        scene: with uncertain collisions. Where it says how probable its objects are, it was perceived: then these, the frames
            of its events, and which slow objects move, are uncertain, too.
        collisions_only: leave out all other doubts.
    """
    doubts = [_Doubt(u, (True, False), (u.probability, 1 - u.probability)) for u in scene.uncertain or ()]
    if scene.existence is not None and not collisions_only:
        doubts += _perceptual_doubts(scene, scene.existence)
    order = np.random.default_rng(SEED).permuted(np.tile(np.arange(N_DRAWS), (len(doubts), 1)), axis=1)
    chosen = np.zeros((len(doubts), N_DRAWS), int)
    for row, doubt, ranks in zip(chosen, doubts, order, strict=True):
        row[:] = np.searchsorted(list(accumulate(doubt.probabilities[:-1])), (ranks + 0.5) / N_DRAWS)
    rows, counts = np.unique(chosen.T, axis=0, return_counts=True)
    return [
        (n, _drawn(scene, {d.of: d.values[k] for d, k in zip(doubts, row, strict=True)}))
        for n, row in zip(counts.tolist(), rows.tolist(), strict=True)
    ]


def _perceptual_doubts(scene: Scene, existence: NDArray[Any]) -> list[_Doubt]:
    """Those about objects (by their ids), frames of events (by the events), and speeds (by ("speed", id))."""
    events = {*scene.events, *(u.event for u in scene.uncertain or () if u.removed is None)}
    observed = sorted((e for e in events if e.frame < scene.n_frames), key=lambda e: (e.frame, e.kind, e.objects))
    unsure = [i for i, p in enumerate(existence.tolist()) if p < 1]
    doubts = [_Doubt(i, (True, False), (existence[i], 1 - existence[i])) for i in unsure]
    doubts += [_Doubt(e, tuple(FRAMES_OFF), tuple(FRAMES_OFF.values())) for e in observed]
    if scene.physics is not None:
        speed, error = _speeds(scene)
        slow = (speed > 0) & (abs(speed - MOVING_SPEED_WORLD_PER_S) < SPEED_ERRORS[-1] * error)
        share = [1 / len(SPEED_ERRORS)] * len(SPEED_ERRORS)
        doubts += [_Doubt(("speed", i), SPEED_ERRORS, share) for i in np.flatnonzero(slow.any(1)).tolist()]
    return doubts


def _speeds(scene: Scene) -> tuple[NDArray[Any], float]:
    assert scene.physics is not None
    return np.linalg.norm(scene.physics.velocity_world_per_s, axis=-1), scene.physics.velocity_error_world_per_s


def _drawn(scene: Scene, values: Mapping[Any, Any]) -> Scene:
    """The scene as the values of all doubts say."""
    uncertain = {(u.removed, u.event) for u in scene.uncertain or ()}
    drawn = [(u.removed, u.event) for u in scene.uncertain or () if values[u]]

    def events(of: Sequence[Event], removed: int | None, first: int = 0, end: float = np.inf) -> tuple[Event, ...]:
        """Those that are certain, and those that are drawn from a range of frames."""
        certain = [e for e in of if (removed, e) not in uncertain]
        return (*certain, *(e for r, e in drawn if r == removed and first <= e.frame < end))

    n_frames, unseen, without = scene.n_frames, scene.unseen, scene.counterfactual
    observed, visible = _shifted(events(scene.events, None, end=n_frames), scene.visible, values)
    result = replace(
        scene,
        visible=visible,
        moving=_moving(scene, values),
        events=observed,
        unseen=None if unseen is None else events(unseen, None, first=n_frames),
        counterfactual=None if without is None else {k: events(of, k) for k, of in without.items()},
        unseen_scores=None,
        dynamics=None,
        uncertain=None,
        existence=None,
        physics=None,
    )
    for i in reversed(range(len(scene.objects))):
        if not values.get(i, True):
            result = _without(result, i)
    return result


def _shifted(
    events: Sequence[Event], visible: NDArray[np.bool_], values: Mapping[Any, Any]
) -> tuple[tuple[Event, ...], NDArray[np.bool_]]:
    """Events of the video at the frames that were drawn, and (n, F) which objects are in the image then."""
    found, visible = [], visible.copy()
    last = visible.shape[1] - 1
    for event in events:
        frame = event.frame + values.get(event, 0)
        if event.kind == "collision":
            found.append(replace(event, frame=min(max(frame, 0), last)))
            continue
        (i,), is_in = event.objects, event.kind == "in"
        visible[i, max(frame, 0) : event.frame] = is_in
        visible[i, event.frame : max(frame, 0)] = not is_in
        if 0 < frame <= last:  # else it is there, or away, in all frames on that side
            found.append(replace(event, frame=frame))
    return tuple(found), visible


def _moving(scene: Scene, values: Mapping[Any, Any]) -> NDArray[np.bool_] | None:
    """(n, F) which objects move at the speeds that were drawn."""
    drawn = {i: values["speed", i] for i in range(len(scene.objects)) if ("speed", i) in values}
    if scene.moving is None or not drawn:
        return scene.moving
    (speed, error), moving = _speeds(scene), scene.moving.copy()
    for i, off in drawn.items():
        moving[i] = np.where(speed[i] > 0, speed[i] + off * error > MOVING_SPEED_WORLD_PER_S, moving[i])
    return moving


def _without(scene: Scene, absent: int) -> Scene:
    """The scene as it is if an object was never there; the objects after it get lower ids."""
    kept = [i for i in range(len(scene.objects)) if i != absent]
    new = {old: i for i, old in enumerate(kept)}

    def events(of: Sequence[Event]) -> tuple[Event, ...]:
        return tuple(replace(e, objects=tuple(new[i] for i in e.objects)) for e in of if absent not in e.objects)

    without = scene.counterfactual
    return replace(
        scene,
        objects=tuple(replace(scene.objects[old], id=i) for i, old in enumerate(kept)),
        visible=scene.visible[kept],
        moving=None if scene.moving is None else scene.moving[kept],
        events=events(scene.events),
        unseen=None if scene.unseen is None else events(scene.unseen),
        counterfactual=None if without is None else {new[k]: events(of) for k, of in without.items() if k != absent},
    )

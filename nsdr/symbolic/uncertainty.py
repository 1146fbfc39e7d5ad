"""Scenes that are possible as far as a scene is known: events, objects, frames of events and motion may be uncertain."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.types import Event, Scene, UncertainEvent
from nsdr.types.events import collisions_in_view, enter_exit_events

N_DRAWS = 512
"""Draws of possible scenes. Probabilities that depend on several uncertain things are off by 0.006 on average."""
SEED = 0
FRAMES_OFF = {-2: 0.007, -1: 0.083, 0: 0.82, 1: 0.083, 2: 0.007}
"""How probable it is that an event is so many frames later than it was found. Of 8,067 entrances, exits and collisions of
left-out `train` scenes, 81.9 % were exact and 16.4 % off by one frame (`python -m benchmarks.objects --every 5`, and
`python -m benchmarks.collisions --every 5`)."""
SPEED_ERRORS = (-1.28, -0.52, 0.0, 0.52, 1.28)
"""Equally probable errors of an object's speed, in standard deviations: the middles of five parts of a normal distribution."""


@dataclass(frozen=True)
class _Draw:
    """One way in which everything uncertain turns out.

    Attributes:
        happens: whether each uncertain event does.
        exists: whether each object is there, by its id; those that are not listed are.
        frames_off: how many frames later each event of the video is.
        speed_error: of each object whose motion is uncertain, in standard deviations, by its id.
    """

    happens: dict[UncertainEvent, bool] = field(default_factory=dict)
    exists: dict[int, bool] = field(default_factory=dict)
    frames_off: dict[Event, int] = field(default_factory=dict)
    speed_error: dict[int, float] = field(default_factory=dict)


class _Uncertain(NamedTuple):
    """What one entry of a `_Draw` may be: its attribute and key, the values, and their probabilities."""

    attribute: str
    key: Any
    values: Sequence[Any]
    probabilities: Sequence[float]


def possible_scenes(scene: Scene, collisions_only: bool = False) -> list[tuple[int, Scene]]:
    """Different scenes in which nothing is uncertain, drawn from one; each with its number of the `N_DRAWS` draws.

    What is uncertain is taken as independent. Each thing turns out in as many of the draws as its probability says (Latin
    hypercube sampling), so that what depends on it alone is off by at most half a draw.

    Args:
        scene: with uncertain events. Where it says how probable its objects are, it was perceived: then these, the frames
            of its events, and which slow objects move, are uncertain, too.
        collisions_only: take all but the collisions as certain.
    """
    happens = [
        _Uncertain("happens", u, (True, False), (u.probability, 1 - u.probability)) for u in scene.uncertain or ()
    ]
    uncertain = [one for one in happens if one.key.event.kind == "collision"]
    if not collisions_only:
        uncertain += [] if scene.existence is None else _perceived(scene, scene.existence)
        uncertain += [one for one in happens if one.key.event.kind != "collision"]
    order = np.random.default_rng(SEED).permuted(np.tile(np.arange(N_DRAWS), (len(uncertain), 1)), axis=1)
    chosen = np.zeros((len(uncertain), N_DRAWS), int)
    for row, one, ranks in zip(chosen, uncertain, order, strict=True):
        row[:] = np.searchsorted(list(accumulate(one.probabilities[:-1])), (ranks + 0.5) / N_DRAWS)
    rows, counts = np.unique(chosen.T, axis=0, return_counts=True)
    scenes = []
    for n, row in zip(counts.tolist(), rows.tolist(), strict=True):
        draw = _Draw()
        for one, k in zip(uncertain, row, strict=True):
            getattr(draw, one.attribute)[one.key] = one.values[k]
        scenes.append((n, _drawn(scene, draw)))
    return scenes


def _perceived(scene: Scene, existence: NDArray[Any]) -> list[_Uncertain]:
    """What is uncertain in a scene because it was perceived."""
    events = {*scene.events, *(u.event for u in scene.uncertain or () if u.removed is None)}
    observed = sorted((e for e in events if e.frame < scene.n_frames), key=lambda e: (e.frame, e.kind, e.objects))
    off, share = tuple(FRAMES_OFF), tuple(FRAMES_OFF.values())
    found = [_Uncertain("exists", i, (True, False), (p, 1 - p)) for i, p in enumerate(existence.tolist()) if p < 1]
    found += [_Uncertain("frames_off", event, off, share) for event in observed]
    if scene.physics is not None:
        speed, error = _speeds(scene)
        slow = (speed > 0) & (abs(speed - scene.world.physics.moving_speed_world_per_s) < SPEED_ERRORS[-1] * error)
        equal = [1 / len(SPEED_ERRORS)] * len(SPEED_ERRORS)
        found += [_Uncertain("speed_error", i, SPEED_ERRORS, equal) for i in np.flatnonzero(slow.any(1)).tolist()]
    return found


def _speeds(scene: Scene) -> tuple[NDArray[Any], float]:
    assert scene.physics is not None
    return np.linalg.norm(scene.physics.velocity_world_per_s, axis=-1), scene.physics.velocity_error_world_per_s


def _drawn(scene: Scene, draw: _Draw) -> Scene:
    """The scene as everything turns out."""
    uncertain = {(u.removed, u.event) for u in draw.happens}
    happening = [(u.removed, u.event) for u, happens in draw.happens.items() if happens]

    def events(of: Sequence[Event], removed: int | None, first: int = 0, end: float = np.inf) -> tuple[Event, ...]:
        """Those that are certain, and those that are drawn from a range of frames."""
        certain = [e for e in of if (removed, e) not in uncertain]
        return (*certain, *(e for r, e in happening if r == removed and first <= e.frame < end))

    n_frames, predicted, without = scene.n_frames, scene.predicted, scene.counterfactual
    observed, visible = events(scene.events, None, end=n_frames), scene.visible
    if draw.frames_off:
        visible = _visible(scene, draw)
        later = [_later(e, draw.frames_off.get(e, 0), n_frames) for e in observed if e.kind == "collision"]
        observed = (*enter_exit_events(visible), *collisions_in_view(later, visible))
    result = replace(
        scene,
        visible=visible,
        moving=_moving(scene, draw),
        events=observed,
        predicted=None if predicted is None else events(predicted, None, first=n_frames),
        counterfactual=None if without is None else {k: events(of, k) for k, of in without.items()},
        predicted_scores=None,
        dynamics=None,
        uncertain=None,
        existence=None,
        physics=None,
    )
    for i in sorted((i for i, exists in draw.exists.items() if not exists), reverse=True):
        result = _without(result, i)
    return result


def _later(event: Event, frames: int, n_frames: int) -> Event:
    return replace(event, frame=min(max(event.frame + frames, 0), n_frames - 1))


def _visible(scene: Scene, draw: _Draw) -> NDArray[np.bool_]:
    """(n, F) which objects are in the image, with entrances and exits at the frames that were drawn, in their order."""
    visible = scene.visible.copy()
    border = sorted((e for e in scene.events if e.kind != "collision"), key=lambda e: e.frame)
    for i in {e.objects[0] for e in border}:
        visible[i] = visible[i, 0]
    for event in border:
        visible[event.objects[0], max(event.frame + draw.frames_off.get(event, 0), 0) :] = event.kind == "in"
    return visible


def _moving(scene: Scene, draw: _Draw) -> NDArray[np.bool_] | None:
    """(n, F) which objects move at the speeds that were drawn."""
    if scene.moving is None or not draw.speed_error:
        return scene.moving
    (speed, error), moving, least = _speeds(scene), scene.moving.copy(), scene.world.physics.moving_speed_world_per_s
    for i, off in draw.speed_error.items():
        moving[i] = np.where(speed[i] > 0, speed[i] + off * error > least, moving[i])
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
        motion_px=None if scene.motion_px is None else scene.motion_px[kept],
        events=events(scene.events),
        predicted=None if scene.predicted is None else events(scene.predicted),
        counterfactual=None if without is None else {new[k]: events(of) for k, of in without.items() if k != absent},
    )

"""Which objects of a simulation are in the image, and how probable it is that they enter and leave it."""

from collections.abc import Sequence

import numpy as np

from nsdr.dynamics.physics.simulator import SimulatedMotion
from nsdr.dynamics.track_smoothing import rollout_in_image
from nsdr.types import Event, UncertainEvent
from nsdr.validation import BoolArray
from nsdr.world.camera import Camera
from nsdr.world.vocabulary import Shape

SIGNS = {"in": 1, "out": -1}
"""How much more visible an object is after each kind of event."""


def as_observed(run: SimulatedMotion, simulated: BoolArray, from_frame: int) -> BoolArray:
    """(1 + R, n, F) bool, whether each object moves as in the video in each run.

    Args:
        run: the runs.
        simulated: (n,) bool, whether the motion of each object differs from the video from `from_frame` on.
        from_frame: first frame of the runs.
    """
    frame = np.arange(run.location_world.shape[2])
    return (frame < from_frame) | ((frame <= run.free_from[..., None]) & ~simulated[:, None])


def visible_in_runs(
    run: SimulatedMotion,
    observed: BoolArray,
    exists: BoolArray,
    simulated: BoolArray,
    from_frame: int,
    shapes: Sequence[Shape],
    camera: Camera,
) -> BoolArray:
    """(1 + R, n, F) bool, whether each object is in the image: as observed while it moves as observed, then as simulated.

    Args:
        run: the runs.
        observed: (n or fewer, F or fewer) bool, the same in the video; objects that are not listed are not in it.
        exists: (n,) bool, whether each object exists from `from_frame` on.
        simulated, from_frame: see `as_observed`.
        shapes: of the n objects.
        camera: the camera that takes the image.
    """
    n, frames = run.location_world.shape[1:3]
    follows = as_observed(run, simulated, from_frame)
    there = exists[:, None] | (np.arange(frames) < from_frame)
    visible = np.zeros(follows.shape, bool)
    visible[:, : len(observed), : observed.shape[1]] = observed
    free = ~follows & there
    for i, shape in enumerate(shapes[:n]):
        simulated_places = run.location_world[:, i][free[:, i]]
        (visible[:, i][free[:, i]],) = rollout_in_image([shape], simulated_places[None], camera)
    return visible & there


def uncertain_borders(visible: BoolArray, first_frame: int, least: float) -> list[UncertainEvent]:
    """Entrances and exits that happen in some runs and not in others, with the share of runs in which they do.

    Args:
        visible: (1 + R, n, F) bool, whether each object is in the image in each run. An event has the frame that it has in
            the first run or, if it does not happen there, the median frame of the runs in which it does.
        first_frame: earlier events are the same in all runs.
        least: an event is uncertain if its share of runs is at most 1 - this.
    """
    change = np.diff(visible.astype(np.int8), axis=2)
    change[..., : max(first_frame - 1, 0)] = 0
    found = []
    for kind, sign in SIGNS.items():
        times = (change == sign).cumsum(2)  # (1 + R, n, F - 1)
        for i, most in enumerate(times[..., -1:].max((0, 2), initial=0).tolist()):
            for k in range(1, most + 1):  # an object may enter and leave more than once
                happens = times[:, i, -1] >= k
                frames = 1 + (times[:, i] >= k).argmax(1)
                frame = frames[0] if happens[0] else np.median(frames[happens])
                if happens.mean() <= 1 - least:
                    found.append(UncertainEvent(Event(kind, int(frame), (i,)), float(happens.mean())))
    return found

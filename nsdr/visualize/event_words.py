"""Events in words: who hits whom, and what differs in a simulation."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nsdr.symbolic.traces import percent
from nsdr.symbolic.world import VERBS
from nsdr.types import DynamicsPrediction, Event, EventChange, Rollout, Scene, SceneObject, Simulation
from nsdr.types.interventions import intervention_text
from nsdr.world.physics_constants import FRAME_SECONDS

__all__ = ["change_text", "event_text", "hitter", "interventions_text"]

WINDOW_FRAMES = 6
"""Frames before a collision whose displacement gives the velocities."""
MIN_APPROACH_WORLD_PER_S = 0.4
"""Nobody hits where both come slower than this (world units/s). Set with `python benchmarks/impacts.py`."""
CLEAR_RATIO = 0.5
"""Nobody hits where the slower one comes with more than this fraction of the faster one's speed. Set with the same command:
on 11 clips 28 of 28 clear hitters are right and none of 6 unclear ones is named; with 0.65, 3 of these are."""


def hitter(rollout: Rollout, event: Event) -> int | None:
    """Id of the object that hits the other one; None where that is not clear.

    It comes clearly faster towards the other one. Before an object is in the image its velocity is not known: one that enters
    right before the collision hits an object that does not come towards it.

    Args:
        rollout: trajectories of all objects.
        event: one of its collisions.
    """
    speeds = _approach_speeds(rollout.location_world, event)
    faster, slower = max(speeds), min(speeds)
    if faster >= MIN_APPROACH_WORLD_PER_S:
        return event.objects[speeds.index(faster)] if slower <= CLEAR_RATIO * faster else None
    first = {i: int(rollout.visible[i].argmax()) for i in event.objects}
    entered = [i for i in event.objects if 0 < first[i] <= event.frame < first[i] + WINDOW_FRAMES]
    return entered[0] if len(entered) == 1 and np.isfinite(faster) else None


def _approach_speeds(location_world: NDArray[np.floating], event: Event) -> tuple[float, float]:
    """Speed of each object towards the other one before a collision (world units/s); NaN where it is not known."""
    last = max(event.frame - 1, 0)
    first = max(last - WINDOW_FRAMES, 0)
    paths = location_world[list(event.objects), first : last + 1]
    known = np.flatnonzero(np.isfinite(paths).all((0, 2)))
    if len(known) < 2:
        return np.nan, np.nan
    start, end = paths[:, known[0]], paths[:, known[-1]]
    towards = end[1] - end[0]
    towards = towards / np.linalg.norm(towards)
    velocity = (end - start) / ((known[-1] - known[0]) * FRAME_SECONDS)
    return float(velocity[0] @ towards), float(-velocity[1] @ towards)


def event_text(event: Event, scene: Scene, dynamics: DynamicsPrediction | None = None) -> str:
    """An event as a sentence without its frame; of a collision, who hits whom where trajectories make that clear."""
    first = hitter(dynamics.observed, event) if dynamics is not None and event.kind == "collision" else None
    if first is None:
        return _clause(event, scene.objects)
    other = event.objects[1 - event.objects.index(first)]
    return f"the {scene.objects[first].name} hits the {scene.objects[other].name}"


def _clause(event: Event, objects: Sequence[SceneObject]) -> str:
    return VERBS[event.kind].format(*(f"the {objects[i].name}" for i in event.objects))


def interventions_text(simulation: Simulation) -> str:
    """For example "from frame 20: without the red metal cube"."""
    what = "; ".join(intervention_text(change) for change in simulation.interventions)
    return f"from frame {simulation.from_frame}: {what}"


def change_text(simulation: Simulation, change: EventChange) -> str:
    """For example "no longer: the red metal cube and the blue rubber sphere collide (frame 48, <1 %)"."""
    probable = "" if change.probability is None else f", {percent(change.probability)}"
    before = "" if change.kind != "other frame" else f" instead of {change.before}"
    happens = _clause(change.event, simulation.objects)
    return f"{change.kind}: {happens} (frame {change.event.frame}{before}{probable})"

"""A comparison of two rollouts of an explanation: one with interventions, one without."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.base import Explanation
from nsdr.dynamics.interventions import changed_ids, resolve, with_added
from nsdr.dynamics.scene import events_of, scene_from_prediction
from nsdr.errors import DataError
from nsdr.types import Add, DynamicsPrediction, Event, Move, Remove, Rollout, Scene, SceneObject, Simulation
from nsdr.types.interventions import Intervention
from nsdr.world.world import World


def simulate(
    explanation: Explanation, interventions: Sequence[Intervention], from_frame: int = 0, frames: int | None = None
) -> Simulation:
    """Simulate a video with interventions and without them.

    Args:
        explanation: explanation of the video.
        interventions: changes of the scene, all at `from_frame`.
        from_frame: frame of the video at which the interventions happen.
        frames: number of frames of both rollouts, as in `Explanation.rollout`.

    Raises:
        DataError: no object or several objects fit the words, an intervention is impossible (the message has the numbers), or
            the backend does not support it: networks can only remove one object from frame 0.
    """
    n_frames, old = explanation.n_frames, explanation.objects
    visible = explanation.observed.visible[:, :n_frames]
    changes = resolve(interventions, old, visible, from_frame, explanation.world)
    if not changes:
        raise DataError("interventions: expected at least one, such as [nsdr.Remove('red cube')], got none")
    changed = explanation.rollout(changes, from_frame, frames)
    objects, ids = with_added(old, changes), changed_ids(changes, old)
    original = _with_absent(explanation.rollout((), from_frame, frames), len(objects) - len(old))
    removed = {i for i, change in zip(ids, changes, strict=True) if isinstance(change, Remove)}
    placed = {i for i, change in zip(ids, changes, strict=True) if isinstance(change, Remove | Move | Add)}

    def happens(event: Event, first: int) -> bool:
        """Whether an event is more than an intervention that puts its first object there or takes it away."""
        return event.kind == "collision" or event.frame != from_frame or first not in placed

    kept = [o.id for o in objects if from_frame > 0 or o.id not in removed]
    scene = _scene(objects, n_frames, changed, kept, explanation.world)
    return Simulation(
        objects,
        n_frames,
        from_frame,
        tuple(
            change if isinstance(change, Add) else replace(change, object=objects[i].name)
            for i, change in zip(ids, changes, strict=True)
        ),
        original,
        changed,
        events_of(original),
        tuple(e for e in events_of(changed) if happens(e, e.objects[0])),
        replace(scene, events=tuple(e for e in scene.events if happens(e, kept[e.objects[0]]))),
    )


def _with_absent(rollout: Rollout, extra: int) -> Rollout:
    """The rollout with `extra` further objects, which are absent in every frame."""
    speed, yaw = rollout.speed_world_per_s, rollout.yaw
    return replace(
        rollout,
        location_world=padded(rollout.location_world, extra, np.nan),
        visible=padded(rollout.visible, extra, False),
        predicted_scores=None,
        speed_world_per_s=None if speed is None else padded(speed, extra, np.nan),
        yaw=None if yaw is None else padded(yaw, extra, 0.0),
    )


def padded(values: NDArray[Any], extra: int, value: float | bool) -> NDArray[Any]:
    """Values (n, …) followed by `extra` rows filled with `value`: (n + extra, …)."""
    return np.concatenate([values, np.full((extra, *values.shape[1:]), value, values.dtype)])


def _scene(objects: Sequence[SceneObject], n_frames: int, rollout: Rollout, kept: Sequence[int], world: World) -> Scene:
    """The scene of the objects of a rollout that are in `kept`, renumbered from 0."""
    new = {old: i for i, old in enumerate(kept)}

    def renumbered(event: Event) -> Event:
        """The event with the new ids of its objects."""
        return replace(event, objects=tuple(new[i] for i in event.objects))

    uncertain, speed, yaw = rollout.uncertain, rollout.speed_world_per_s, rollout.yaw
    part = Rollout(
        rollout.location_world[kept],
        rollout.visible[kept],
        tuple(renumbered(e) for e in rollout.collisions),
        None,
        None if speed is None else speed[kept],
        None if uncertain is None else tuple(replace(one, event=renumbered(one.event)) for one in uncertain),
        None if yaw is None else yaw[kept],
    )
    prediction = DynamicsPrediction(tuple(replace(objects[i], id=new[i]) for i in kept), n_frames, part, world=world)
    return replace(scene_from_prediction(prediction), counterfactual=None, dynamics=prediction)
